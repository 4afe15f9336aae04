#!/usr/bin/env bash
# Agents of Stable-Baselines3 and d3rlpy are tuned in models, and the checkers of Stable-Baselines3 and Gymnasium look at calib's
# environments: python/tests/test_sb3.py.
#
#   bash scripts/sb3.sh      needs the wheel of scripts/python_wheel.sh in CALIB_TOOLS (target/tools otherwise). Fetches packages there.
set -euo pipefail
. "$(dirname "$0")/python_env.sh" sb3
mapfile -t pinned < <(grep -E '^(gymnasium|numpy|pandas|polars|pytest|scikit-learn)==' "$root/python/tests/requirements.txt")
# Without what packages name themselves: PyTorch, and in d3rlpy Gymnasium 1.0.0.
"$python" -m pip install --quiet --no-deps "${pinned[@]}" -r "$root/python/tests/requirements-sb3.txt"
"$python" -m pip install --quiet --force-reinstall --no-deps "$wheel"
oldest=$tools/gymnasium-1.0.0
if ! [ -d "$oldest" ]; then
    # Under another name until it is whole: this may be stopped.
    rm -rf "$oldest.part"
    "$python" -m pip install --quiet --no-deps --target "$oldest.part" 'gymnasium==1.0.0'
    mv "$oldest.part" "$oldest"
fi

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
# What depends on Gymnasium. A name that is not there is an error.
tests test_gym.py \
    test_acting.py::{test_checkers_find_nothing_wrong,test_action_spaces_agree,test_many_walkers_are_single_ones} \
    test_acting.py::{test_walks_that_leave_recorded_rows,test_gymnasium_makes_it_by_name,test_processes_and_a_stop_change_nothing} \
    test_sb3.py::test_the_checker_finds_nothing_wrong_{with_actions,without_actions} \
    test_sb3.py::test_environments_in_processes_are_those_of_this_one
echo "sb3: agents are tuned, with Gymnasium of today and 1.0.0 (at $SECONDS s)"
