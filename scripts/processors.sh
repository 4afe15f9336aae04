#!/usr/bin/env bash
# Whether results depend on the processor: every step of three small studies, once as it is and once on emulated
# processors without AVX-512, compared byte by byte. Wants Debian's qemu-user, which it installs where it is root.
#
#   bash scripts/processors.sh [CALIB] [PROCESSOR...]      default: target/release/calib, Haswell
set -euo pipefail
calib=$(realpath "${1:-$(dirname "$0")/../target/release/calib}")
shift || true
processors=("${@:-Haswell}")
command -v qemu-x86_64 >/dev/null || {
    apt-get -qq update
    DEBIAN_FRONTEND=noninteractive apt-get -qq install --yes --no-install-recommends qemu-user >/dev/null
}
work=$(mktemp -d -p "${CALIB_WORK:-/dev/shm}")
running=()
finish() {
    # Groups of their own, whoever of them still runs.
    for process in "${running[@]}"; do kill -- "-$process" 2>/dev/null || true; done
    wait
    rm -rf "$work"
}
trap finish EXIT

cat >"$work/study.toml" <<'STUDY'
seed = 3
[simulate]
days = 0.5
channels = 8
period_secs = 60
[data]
path = "data"
train_fraction = 0.7
[model]
members = 2
neighbors = 3
[rollout]
steps = 60
rollouts = 1
[agent]
value_function = "mlp"
hidden_units = 24
gamma = 0.9
batch_size = 16
[sweep]
sensors = ["PIT300", "TIT101"]
steps = 90
online_runs = 1
member_runs = 1
log_replay_runs = 1
[sweep.grid]
learning_rate = [1e-4, 1e-2]
STUDY

# Networks of every kind that is trained natively, both precisions, representations, pre-training, weights with an exponential.
declare -A sets=(
    [neighbours]=""
    [learnt]="model.kind=nn dynamics.hidden_units=20 dynamics.epochs=2 agent.optimiser=sgd agent.precision=bf16 agent.hidden_layers=1"
    [represented]="representation.kind=laplacian representation.steps=40 representation.hidden_units=16 model.weights=softmax pretrain.epochs=2 agent.traces=[0.5]"
)
run() { # STUDY, NAME, and what calib is run by
    local study=$1 name=$2 options=() set ended=0
    shift 2
    for set in ${sets[$study]}; do options+=(--set "$set"); done
    mkdir -p "$work/$study/$name"
    cp "$work/study.toml" "$work/$study/$name"
    (cd "$work/$study/$name" && "$@" "$calib" -q --threads 1 run study.toml "${options[@]}" --output results) \
        >"$work/$study/$name.out" 2>"$work/$study/$name.err" || ended=$?
    # 1 is an answer: all values tie.
    [ "$ended" -le 1 ] || { cat "$work/$study/$name.err" >&2; echo "processors: $study on $name ends with $ended" >&2; exit 1; }
}
# Each on one thread, so side by side.
set -m
for study in "${!sets[@]}"; do
    run "$study" native env &
    running+=($!)
    for processor in "${processors[@]}"; do
        run "$study" "$processor" qemu-x86_64 -cpu "$processor" &
        running+=($!)
    done
done
wrong=0
for process in "${running[@]}"; do wait "$process" || wrong=1; done
[ "$wrong" = 0 ] || exit 1
running=()
for study in "${!sets[@]}"; do
    for processor in "${processors[@]}"; do
        if diff -rq -x timings.json -x sources.json -x .lock "$work/$study/native" "$work/$study/$processor" &&
            diff -q "$work/$study/native.out" "$work/$study/$processor.out"; then
            files=$(find "$work/$study/$processor" -type f | wc -l)
            echo "$study: $files files are the same here and on $processor"
        else
            wrong=1
        fi
    done
done
exit "$wrong"
