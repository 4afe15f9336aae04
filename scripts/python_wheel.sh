#!/usr/bin/env bash
# Build calib's wheel, install it into a clean environment, and run its tests there:
#
#     bash scripts/python_wheel.sh            # CALIB_TOOLS is where environments are kept; target/tools otherwise
#
# What cargo has built for the command line is used again: both have the same features.
set -euo pipefail
cd "$(dirname "$0")/.."
tools=${CALIB_TOOLS:-$PWD/target/tools}
dist=$tools/dist

if ! [ -x "$tools/maturin/bin/maturin" ]; then
    python3 -m venv "$tools/maturin"
    "$tools/maturin/bin/pip" install --quiet 'maturin==1.16.0'
fi
rm -rf "$dist"
CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$PWD/target} \
    "$tools/maturin/bin/maturin" build --quiet --release --locked --manifest-path python/Cargo.toml --out "$dist"

clean=$tools/python
rm -rf "$clean"
python3 -m venv "$clean"
"$clean/bin/pip" install --quiet "$(echo "$dist"/calib_rl-*.whl)[gym,frames]" -r python/tests/requirements.txt
# Not from the sources: what is tested is what was installed.
cd python/tests
"$clean/bin/pytest" --quiet -p no:cacheprovider -c ../pyproject.toml --rootdir .. .
"$clean/bin/mypy" --config-file ../pyproject.toml --no-incremental .
cd "$clean"
"$clean/bin/python" -m mypy.stubtest calib_rl._calib
"$clean/bin/calib" --version
