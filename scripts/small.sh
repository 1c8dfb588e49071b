#!/usr/bin/env bash
# The run behind docs/results.md: world, templates, training, evaluation and the turn-leak check
# of the `small` preset. Run again, it goes on where it was.
#   bash scripts/small.sh [FOLDER]        (default: runs/small-results)
set -euo pipefail
cd "$(dirname "$0")/.."
# shellcheck source=scripts/environment.sh
source scripts/environment.sh
set_up_environment
out=${1:-runs/small-results}
world=$out/world

shoot-make-world "$world" --train-scenes 700 --val-scenes 100 --seed 0 \
  --image-scale 0.11 --scenes-per-town 2 --tail-s 5 --workers 2
[ -f "$out/templates.npz" ] ||
  shoot-fit-templates --data.root "$world" --k 1000 --seed 0 --out "$out/templates.npz"
shoot-train small --data.root "$world" --templates "$out/templates.npz" --out "$out/run" --resume
shoot-evaluate "$out/run" --split val --out "$out/report.json"
python scripts/turn_leak.py "$out/run" --out "$out/turn_leak.json" --figure "$out/turn_leak.png"
