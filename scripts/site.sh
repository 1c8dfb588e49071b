#!/usr/bin/env bash
# Builds the documentation as a site in site/; fails on any warning, such as a link that leads nowhere.
# Arguments go to mkdocs, e.g. `bash scripts/site.sh --site-dir /tmp/site`.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/environment.sh
source scripts/environment.sh
set_up_environment dev
# What mkdocs-material says of the next mkdocs is no matter of these pages.
NO_MKDOCS_2_WARNING=1 mkdocs build --strict --quiet "$@"
say "The site: site/index.html, unless you named another folder."
