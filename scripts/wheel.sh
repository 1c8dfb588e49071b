#!/usr/bin/env bash
# Builds the wheel, installs it into an empty environment, and plans the example from there; then, with
# its extra `demo`, runs shoot-demo.
# Arguments go to shoot-demo; without any it is a very small one.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/environment.sh
source scripts/environment.sh
python=$(find_python)
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

"$python" -m venv "$folder/venv"
# From a copy: setuptools would leave its own folders in the tree.
git archive HEAD | tar -x -C "$folder" --one-top-level=source
"$folder/venv/bin/pip" wheel --quiet --no-deps --wheel-dir "$folder" "$folder/source"
wheel=("$folder"/shoot_planner-*.whl)
"$folder/venv/bin/pip" install --quiet "${wheel[0]}"
(
    cd "$folder"
    PATH="$folder/venv/bin:$PATH"
    shoot-plan --example try >said
    eval "$(tail -n 1 said)"
)
"$folder/venv/bin/pip" install --quiet "${wheel[0]}[demo]"
[ $# -gt 0 ] || set -- --first-scenes 2 --train-scenes 4 --val-scenes 2 --k 50 --steps 20 --image-scale 0.11
cd "$folder"
PATH="$folder/venv/bin:$PATH" shoot-demo --out demo "$@"
