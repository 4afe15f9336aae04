#!/usr/bin/env bash
# Checks Cargo.lock against the RustSec advisories. CALIB_ADVISORY_DB names a copy of the database
# (a clone of https://github.com/RustSec/advisory-db); without one it is fetched, and where there is no network
# the check is skipped, and says so.
#
#   bash scripts/advisories.sh [FOLDER_OF_CARGO_DENY]
set -euo pipefail
cd "$(dirname "$0")/.."
PATH="${1:-}:$PATH"
url=https://github.com/RustSec/advisory-db

if [ -n "${CALIB_ADVISORY_DB:-}" ]; then
    # cargo-deny looks for a database in a folder that is named after its address.
    place=$(mktemp -d)
    trap 'rm -rf "$place"' EXIT
    config=$place/deny.toml
    { printf '[advisories]\ndb-path = "%s"\n' "$place/db"; sed '1,/^\[advisories\]$/d' deny.toml; } >"$config"
    mkdir -p "$place/db"
    git clone --quiet "$CALIB_ADVISORY_DB" "$place/db/advisory-db-3157b0e258782691"
    git -C "$place/db/advisory-db-3157b0e258782691" fetch --quiet "$CALIB_ADVISORY_DB"
    cargo deny --log-level error --offline check --config "$config" --disable-fetch advisories
elif GIT_TERMINAL_PROMPT=0 timeout 20 git ls-remote --quiet --exit-code "$url" HEAD >/dev/null 2>&1; then
    cargo deny --log-level error check advisories
else
    echo "skipped: $url cannot be reached; give a copy of it with CALIB_ADVISORY_DB"
fi
