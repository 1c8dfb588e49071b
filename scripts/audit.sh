#!/usr/bin/env bash
# Asks PyPI for known weaknesses of everything that is installed in .venv. Fails on any, and where
# the question could not be answered.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/environment.sh
source scripts/environment.sh
set_up_environment dev
tools=$(mktemp -d)
trap 'rm -rf "$tools"' EXIT
python -m venv "$tools"
"$tools/bin/pip" install --quiet pip-audit
# --strict: a package that could not be looked up is no clean one. Our own is on no index.
packages=$(python -c 'import site; print(site.getsitepackages()[0])')
"$tools/bin/pip-audit" --strict --skip-editable --path "$packages" "$@"
