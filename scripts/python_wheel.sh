#!/usr/bin/env bash
# Build calib's wheel, install it into a clean environment, and run its tests there:
#
#     bash scripts/python_wheel.sh            # CALIB_TOOLS is where environments are kept; target/tools otherwise
#     CALIB_SDIST=1 bash scripts/python_wheel.sh   # the sources as a package too, compiled where nothing else is: a full build
#
# What cargo has built for the command line is used again: both have the same features.
set -euo pipefail
cd "$(dirname "$0")/.."
root=$PWD
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
"$clean/bin/pip" install --quiet "$(echo "$dist"/calib_rl-*.whl)[gym,frames,onnx]" -r python/tests/requirements.txt
# Not from the sources: what is tested is what was installed. Tests that need PyTorch are those of scripts/sb3.sh.
cd python/tests
"$clean/bin/pytest" --quiet -p no:cacheprovider -c ../pyproject.toml --rootdir .. --ignore test_sb3.py .
"$clean/bin/mypy" --config-file ../pyproject.toml --no-incremental .
"$clean/bin/mypy" --config-file ../pyproject.toml --no-incremental -p calib_rl
"$clean/bin/pyright" --project ../pyproject.toml --pythonpath "$clean/bin/python"
cd "$clean"
"$clean/bin/python" -m mypy.stubtest calib_rl._calib
# Every name that is there for users has a type. Gymnasium says too little of its own classes for those that are built on them.
PATH=$clean/bin:$PATH pyright --verifytypes calib_rl --ignoreexternal >types || true
grep -q '^Type completeness score' types
if grep -E ' error: ' types | grep -vE '/(gym|_acting_env)\.py:|Type of (metaclass|base class) unknown'; then exit 1; fi
"$clean/bin/calib" --version

if [ -n "${CALIB_SDIST:-}" ]; then
    cd "$root"
    "$tools/maturin/bin/maturin" sdist --manifest-path python/Cargo.toml --out "$dist"
    alone=$tools/sdist
    rm -rf "$alone"
    python3 -m venv "$alone"
    # Beside its own sources nothing may be used that was compiled here.
    (cd "$alone" && env -u CARGO_TARGET_DIR "$alone/bin/pip" install --quiet "$(echo "$dist"/calib_rl-*.tar.gz)")
    (cd "$alone" && "$alone/bin/calib" --version && "$alone/bin/python" -c "import calib_rl; print(calib_rl.knn_join([[0.0], [1.0], [3.0]], 2)[0])")
fi
