#!/usr/bin/env bash
# Agents of Stable-Baselines3 and d3rlpy are tuned in models, and the checkers of Stable-Baselines3 and Gymnasium look at calib's
# environments: python/tests/test_sb3.py.
#
#   bash scripts/sb3.sh      needs the wheel of scripts/python_wheel.sh in CALIB_TOOLS (target/tools otherwise). Fetches packages there.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
tools=$(realpath "${CALIB_TOOLS:-$root/target/tools}")
wheel=$(echo "$tools"/dist/calib_rl-*.whl)
test -f "$wheel" || { echo "sb3.sh: there is no wheel in $tools/dist; run scripts/python_wheel.sh" >&2; exit 2; }
python=$tools/sb3/bin/python
[ -x "$python" ] || python3 -m venv "$tools/sb3"
mapfile -t pinned < <(grep -E '^(gymnasium|numpy|polars|pytest|scikit-learn)==' "$root/python/tests/requirements.txt")
# What PyTorch needs, then what the two packages need. They themselves come without PyTorch, and d3rlpy without the Gymnasium 1.0.0 that it names.
"$python" -m pip install --quiet "${pinned[@]}" filelock fsspec jinja2 networkx sympy typing-extensions \
    click cloudpickle colorama dataclasses-json gym-notices h5py pandas structlog tqdm
"$python" -m pip install --quiet --no-deps 'stable-baselines3==2.9.2' 'd3rlpy==2.8.1' 'gym==0.26.2'
"$python" -m pip install --quiet --force-reinstall --no-deps "$wheel"
oldest=$tools/gymnasium-1.0.0
[ -d "$oldest" ] || "$python" -m pip install --quiet --no-deps --target "$oldest" 'gymnasium==1.0.0'

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
. "$root/scripts/pytorch.sh"
# Among the installed packages: calib takes code that is elsewhere for the user's own.
packages=$("$python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
for package in torch torchgen nvidia "torch-$(cat "$root/.libtorch/complete").dist-info"; do
    ln -sfn "$root/.libtorch/$package" "$packages/$package"
done
export OMP_NUM_THREADS=1

# Nothing may be skipped: everything that these tests need is here.
tests() {
    "$python" -W ignore -m pytest --quiet -p no:cacheprovider -c ../pyproject.toml --rootdir .. -rs "$@" | tee "$work/told"
    if grep -qE '[0-9]+ skipped' "$work/told"; then
        echo "sb3.sh: a test was skipped" >&2
        exit 1
    fi
}

cd "$root/python/tests"
tests test_sb3.py test_tune.py::test_tensors_and_values_of_libraries_have_an_identity
export PYTHONPATH=$oldest:$PYTHONPATH
"$python" -c 'import gymnasium; assert gymnasium.__version__ == "1.0.0", gymnasium.__version__'
tests test_gym.py test_acting.py test_sb3.py -k 'checker or gymnasium or vector or walkers or pickled or processes'
echo "sb3: agents are tuned, with Gymnasium of today and 1.0.0 (at $SECONDS s)"
