#!/usr/bin/env bash
# All campaigns of tests/torture, with the counts of docs/reliability.md: hours on two cores.
# More or less of it: CALIB_DAMAGES, CALIB_CASES (of odd logs, and of odd values), CALIB_FAULTS=all, CALIB_SEED.
set -euo pipefail
cd "$(dirname "$0")/.."
export CALIB_DAMAGES=${CALIB_DAMAGES:-2000} CALIB_CASES=${CALIB_CASES:-5000} CALIB_FAULTS=${CALIB_FAULTS:-all}
# Places are made where files are in memory, if there is such a place.
if [ -z "${TMPDIR:-}" ] && [ -w /dev/shm ]; then export TMPDIR=/dev/shm; fi
PROPTEST_CASES=${PROPTEST_CASES:-200000} cargo test --release --locked --workspace --test fuzz
cargo test --release --locked --workspace --test torture -- --nocapture --test-threads 1 "$@"
