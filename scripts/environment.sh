# Sourced by demo.sh and test.sh. Makes .venv on a fresh machine, brings it up to date when
# pyproject.toml has changed, and otherwise reuses it. Other checkouts' environments are left alone.
#
#   set_up_environment [EXTRAS]     EXTRAS: what stands in the brackets of `pip install .[...]`
#
# SHOOT_PYTHON names a Python to use instead of the first suitable one.

say() { printf '%s\n' "$*" >&2; }

# A name on the PATH proves nothing (pyenv puts stubs there), so each candidate is run.
find_python() {
    local candidate
    for candidate in ${SHOOT_PYTHON:-python3.12 python3.11 python3.10 python3 python}; do
        if "$candidate" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info < (3, 13))' \
            >/dev/null 2>&1; then
            command -v "$candidate"
            return
        fi
    done
    if [ -n "${SHOOT_PYTHON:-}" ]; then
        say "error: SHOOT_PYTHON is '$SHOOT_PYTHON', which is not a working Python 3.10, 3.11 or 3.12."
    else
        say "error: Python 3.10, 3.11 or 3.12 is needed (nuscenes-devkit needs numpy 1, which has no" \
            "wheels for later ones); none is on the PATH. Install one, or name it: SHOOT_PYTHON=/path/to/python3.11."
    fi
    return 1
}

make_venv() {
    local python
    python=$(find_python) || return 1
    say "Making .venv with $("$python" --version 2>&1) ($python)."
    # --clear: a half-made environment of an interrupted run is not worth mending.
    if ! "$python" -m venv --clear .venv; then
        say "error: '$python -m venv' failed; on Debian and Ubuntu install the package python3-venv" \
            "(or python3.12-venv, as your Python is called)."
        return 1
    fi
}

# What an installation depends on: the requirements, and where it lies (programs in .venv/bin and the
# editable install hold absolute paths).
fingerprint() {
    .venv/bin/python -c \
        'import hashlib; print(hashlib.sha256(open("pyproject.toml", "rb").read()).hexdigest())' || return 1
    printf '%s\n' "$PWD"
}

is_usable() {
    .venv/bin/python -c 'import sys; sys.exit(not (3, 10) <= sys.version_info < (3, 13))' \
        >/dev/null 2>&1 || return 1
    # One that was copied or moved here from another folder would run that folder's code.
    [ ! -f .venv/shoot-installed ] || [ "$(tail -n 1 .venv/shoot-installed)" = "$PWD" ]
}

set_up_environment() {
    local extras=${1:-} stamp sum
    stamp=.venv/shoot-installed${extras:+-$extras}
    is_usable || make_venv || return 1
    sum=$(fingerprint) || return 1
    if [ "$(cat "$stamp" 2>/dev/null)" != "$sum" ]; then
        say "Installing shoot-planner${extras:+ with its extra '$extras'} and what it needs into .venv" \
            "(several GB with the CUDA build of torch; docs/install.md tells how to get the CPU build)."
        # What is imported is compiled then; compiling all that is installed takes 40 s.
        if ! .venv/bin/python -m pip install --quiet --no-compile -e ".${extras:+[$extras]}"; then
            say "error: pip could not install shoot; see its message above, then run this again."
            return 1
        fi
        printf '%s\n' "$sum" >"$stamp"
        # What is installed with an extra is installed without it, too.
        printf '%s\n' "$sum" >.venv/shoot-installed
    fi
    # Given once for the project: the scripts below need not know where the programs are.
    PATH="$PWD/.venv/bin:$PATH"
    export PATH
}
