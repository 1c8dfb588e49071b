#!/usr/bin/env bash
# All checks and tests: lint, format, types, who imports whom, tests with line coverage.
# Sets up .venv first if needed. Arguments go to pytest, e.g. `bash scripts/test.sh -m 'not slow'`;
# coverage is then not asked for, since a part of the tests cannot reach it.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/environment.sh
source scripts/environment.sh
set_up_environment dev

ruff check .
ruff format --check .
mypy
lint-imports

# Each pytest worker is one process; were torch to start a thread per core in each, they would slow
# each other down. The required coverage stands in pyproject.toml.
export OMP_NUM_THREADS=1
coverage=()
[ $# -gt 0 ] || coverage=(--cov --cov-report=term:skip-covered)
exec pytest -n "${SHOOT_TEST_WORKERS:-2}" ${coverage[@]+"${coverage[@]}"} "$@"
