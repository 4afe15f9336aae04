#!/usr/bin/env bash
# A sweep on two Ray nodes on this machine, one of which is lost half-way: the bytes of one process.
#
#   bash scripts/cluster/ray.sh [CALIB]         default: target/release/calib. Fetches ray with pip into CALIB_TOOLS.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
calib=$(realpath "${1:-$here/../../target/release/calib}")
tools=${CALIB_TOOLS:-$here/../../target/tools}
mkdir -p "$tools"
[ -x "$tools/ray/bin/python" ] || python3 -m venv "$tools/ray"
"$tools/ray/bin/python" -m pip install --quiet 'ray[rllib]==2.40.0'
work=$(mktemp -d -p "${CALIB_WORK:-/dev/shm}")
trap 'rm -rf "$work"' EXIT
cd "$work"
cat >study.toml <<'STUDY'
seed = 3
[simulate]
days = 3
channels = 12
period_secs = 60
[data]
path = "data"
train_fraction = 0.7
[model]
members = 3
[agent]
value_function = "linear"
gamma = 0.9
[sweep]
sensors = ["PIT300", "TIT101"]
steps = 1500
online_runs = 4
member_runs = 4
log_replay_runs = 4
[sweep.grid]
learning_rate = [1e-4, 1e-3, 1e-2]
STUDY
"$calib" -q simulate study.toml >/dev/null
"$calib" -q build-model study.toml >/dev/null
"$calib" -q sweep study.toml >/dev/null
mv study-results/sweep alone
"$calib" -q cluster plan study.toml --shards 12 -o plan >/dev/null
"$calib" cluster submit plan --engine ray --dry-run | grep -q calib_ray.py
# The driver as the binary carries it.
PYTHONPATH=$here/../../python/calib_ray "$tools/ray/bin/python" "$here/ray_two_nodes.py" plan "$calib"
"$calib" cluster status plan
"$calib" -q cluster merge plan >/dev/null
diff -rq -x timings.json -x .lock alone study-results/sweep
echo "ray: the same bytes (at $SECONDS s)"
