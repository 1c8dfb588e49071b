#!/usr/bin/env bash
# All checks and tests: lint, format, types, who imports whom, tests, and what trains once more as on
# a CPU with AVX2 only. From Python 3.12 on with line coverage, as in the workflow.
# Sets up .venv first if needed. Arguments go to pytest, e.g. `bash scripts/test.sh -m 'not slow'`;
# there is then one pass, and coverage is not asked for, since a part of the tests cannot reach it.
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
test_all() {
    # One more than the two cores that there are at least: tests wait for processes that they start.
    # A worker with nothing left takes half of what another one still has.
    pytest -n "${SHOOT_TEST_WORKERS:-3}" --dist worksteal "$@"
}

if [ $# -gt 0 ]; then
    test_all "$@"
    exit
fi
# Python 3.12 counts lines for next to nothing; before, being asked at every line, tests take half
# as long again.
coverage=()
if python -c 'import sys; sys.exit(sys.version_info < (3, 12))'; then
    export COVERAGE_CORE=sysmon
    coverage=(--cov --cov-report=term:skip-covered)
else
    say "Lines covered are counted from Python 3.12 on."
fi
test_all ${coverage[@]+"${coverage[@]}"}
# Convolutions take other code there, with errors of its own. A machine without AVX-512 has run it.
if python -c 'import sys, torch; sys.exit(torch.backends.cpu.get_cpu_capability() != "AVX512")'; then
    # Without the options of pyproject.toml: shapes have been checked above.
    ONEDNN_MAX_CPU_ISA=AVX2 ATEN_CPU_CAPABILITY=avx2 test_all -o addopts= -m trains
fi
