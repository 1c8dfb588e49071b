#!/usr/bin/env bash
# Runs the tests with the oldest releases that pyproject.toml allows, in .venv-oldest, on the oldest
# Python found (or SHOOT_PYTHON). Arguments go to pytest.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/environment.sh
source scripts/environment.sh
python=$(SHOOT_PYTHON=${SHOOT_PYTHON:-python3.10 python3.11} find_python)

"$python" -m venv --clear .venv-oldest
PATH="$PWD/.venv-oldest/bin:$PATH"
export VIRTUAL_ENV="$PWD/.venv-oldest" # or uv takes one that happens to be active
pip install --quiet uv
# What shoot itself needs is old; the tools that test it are new. Those that only look at the source
# (the extra `dev`) would ask for newer libraries than that; so would the extra `export`.
uv pip compile --quiet --resolution lowest-direct pyproject.toml \
    --extra argoverse --extra cluster --extra demo --extra video \
    --output-file .venv-oldest/oldest.txt
uv pip install --quiet --requirement .venv-oldest/oldest.txt
uv pip install --quiet --constraint .venv-oldest/oldest.txt --editable '.[test]'

export OMP_NUM_THREADS=1
# Without jaxtyping's checks: newer beartypes do not understand the annotations of older numpys.
exec pytest -n "${SHOOT_TEST_WORKERS:-2}" -o addopts="--strict-markers --strict-config -ra" "$@"
