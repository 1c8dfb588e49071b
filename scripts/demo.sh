#!/usr/bin/env bash
# The main job on the synthetic world: makes it, fits templates, trains, evaluates and renders.
# Sets up .venv first if needed. Arguments go to shoot-demo (`--help` lists them).
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/environment.sh
source scripts/environment.sh
set_up_environment demo
exec shoot-demo "$@"  # its --out is demo/ unless told otherwise
