#!/usr/bin/env bash
# A sweep on a Slurm cluster of two nodes on this machine, with everything that goes wrong on clusters; see docs/guides/cluster.md.
# The merged folder must have the bytes of one process, or merge must say what is wrong and write nothing.
#
#   bash scripts/cluster/slurm.sh [CALIB]       default: target/release/calib. Wants root, and installs Slurm and qemu-user.
#
# CALIB_STEPS is how long runs are: long enough that tasks are in the middle when something happens to them.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
calib=$(realpath "${1:-$here/../../target/release/calib}")
# Not a folder of this user alone: the cluster's daemons have users of their own.
work=$(mktemp -d -p "${CALIB_WORK:-/dev/shm}")
chmod 755 "$work"
cluster=$work/cluster
finish() {
    code=$?
    [ -z "${processors:-}" ] || kill "$processors" 2>/dev/null || true
    bash "$here/two_nodes.sh" down "$cluster" 2>/dev/null || true
    if [ "$code" != 0 ]; then
        for file in "$work"/*/slurm/*.out; do
            echo "== $file" >&2
            tail -20 "$file" >&2 || true
        done
    fi
    rm -rf "$work"
    exit "$code"
}
trap finish EXIT
say() { echo "slurm: $* (at $SECONDS s)"; }
fail() { echo "slurm: $*" >&2; exit 1; }
command -v qemu-x86_64 >/dev/null || {
    apt-get -qq update
    DEBIAN_FRONTEND=noninteractive apt-get -qq install --yes --no-install-recommends qemu-user >/dev/null
}

cd "$work"
steps=${CALIB_STEPS:-6000}
cat >study.toml <<STUDY
seed = 3
[simulate]
days = 3
channels = 12
period_secs = 20
[data]
path = "data"
train_fraction = 0.7
[model]
members = 3
[agent]
value_function = "mlp"
hidden_units = 64
gamma = 0.9
batch_size = 64
[sweep]
sensors = ["PIT300", "TIT101"]
steps = $steps
online_runs = 6
member_runs = 8
log_replay_runs = 6
[sweep.grid]
learning_rate = [1e-4, 1e-3, 1e-2]
STUDY
"$calib" -q simulate study.toml >/dev/null
"$calib" -q build-model study.toml >/dev/null
"$calib" -q sweep study.toml >/dev/null
mv study-results/sweep alone
say "one process is done"

same() { diff -rq -x timings.json -x .lock alone study-results/sweep || fail "$1: other bytes than one process"; rm -rf study-results/sweep; }
plan() { "$calib" -q cluster plan study.toml --shards "$1" -o "$2" >/dev/null; }

# --- A lost node, a preempted task, time limits, and a shard that somebody else runs as well.
eval "$(bash "$here/two_nodes.sh" up "$cluster")"
say "two nodes are up"
plan 8 plan
cat >cluster.toml <<CONFIG
calib = "$calib"
minutes = 1
# The system looks at limits once in a while: with a minute, this is ten seconds after the start.
grace_secs = 50
requeues = 40
memory_mb = 300
evaluate = false
CONFIG
"$calib" cluster submit plan --engine slurm --config cluster.toml --dry-run >shown
grep -q -- '--array=0-7' shown || fail "the dry run shows no array"
[ ! -e plan/slurm ] || fail "the dry run wrote something"
"$calib" -q cluster submit plan --engine slurm --config cluster.toml
# Both cores of both nodes have begun a shard.
count() { ls -d plan/shards/*.attempts/*.json 2>/dev/null | wc -l; }
for _ in $(seq 600); do [ "$(count)" -ge 4 ] && break; sleep 0.05; done
"$calib" -q cluster run plan --shard 7 >/dev/null &
duplicate=$!
bash "$here/two_nodes.sh" lose "$cluster" n2
say "node n2 is lost"
sbatch --quiet --partition=urgent --nodelist=n1 --ntasks=2 --output=/dev/null --wrap "sleep 2"
say "an urgent job takes n1"
sleep 6
bash "$here/two_nodes.sh" back "$cluster" n2
wait "$duplicate" || fail "the duplicate ended with $?"
settle() {
    for _ in $(seq 3000); do [ -z "$(squeue -h -o %A)" ] && return; sleep 0.1; done
    fail "$(squeue)"
}
settle
"$calib" cluster status plan || fail "status says that something is missing"
same "after all that"
missed() { say "this machine is too fast to see that $1: give CALIB_STEPS"; }
# Seen and not supposed: tasks were asked to stop and went on, and one was lost without a word.
ended() { cat "$1"/shards/*.attempts/*.json | grep -c "\"ended\": \"$2\"" || true; }
stopped=$(ended plan stopped)
killed=$(ended plan not_yet)
say "8 shards in $(count) attempts: $stopped asked to stop, $killed killed; the same bytes"
[ "$stopped" -ge 1 ] || missed "a task is asked to stop"
[ "$killed" -ge 1 ] || missed "a task is killed"

# --- Two processors: this one, and an emulated one without AVX-512. Meanwhile, because what follows waits most of the time.
two_processors() {
    mkdir processors
    cd processors
    ln -s ../data data
    sed "s/^steps = $steps/steps = 120/; s/_runs = [68]/_runs = 1/" ../study.toml >study.toml
    "$calib" -q build-model study.toml >/dev/null
    "$calib" -q sweep study.toml >/dev/null
    mv study-results/sweep alone
    plan 2 pair
    "$calib" -q cluster run pair --shard 0 >/dev/null
    qemu-x86_64 -cpu Haswell "$calib" -q cluster run pair --shard 1 >/dev/null 2>qemu.err || fail "Haswell: $(cat qemu.err)"
    "$calib" -q cluster merge pair >/dev/null
    same "native and Haswell"
}
(two_processors) &
processors=$!

# --- A task that needs more time than it may have.
plan 1 long
"$calib" -q cluster submit long --engine slurm --config cluster.toml
settle
same "one task in several pieces"
stopped=$(ended long stopped)
say "one shard was asked to stop $stopped times before its limit; the same bytes"
[ "$stopped" -ge 1 ] || missed "a task reaches its limit"

# --- A byte that flips, and a worker of another version.
shard=plan/shards/0003.units
cp "$shard" whole
printf '\x01' | dd of="$shard" bs=1 seek=5000 conv=notrunc status=none
refused() {
    ended=0
    "$calib" -q cluster merge plan >merged.out 2>&1 || ended=$?
    [ "$ended" = "$1" ] || fail "merge ended with $ended: $(cat merged.out)"
    grep -q "$2" merged.out || fail "merge does not say '$2': $(cat merged.out)"
    [ ! -e study-results/sweep ] || fail "merge wrote something"
}
refused 4 "shard 3: "
"$calib" -q cluster submit plan --engine slurm --config cluster.toml --missing-only
grep -q -- '--array=3$' plan/slurm/stage-0.sh || fail "not only what is missing"
settle
cmp "$shard" whole || fail "a shard that is made again has other bytes"
same "after a flipped byte"
say "a flipped byte is found and made again"
version=$("$calib" --version | awk '{print $2; exit}')
sed "s/calib $version/calib 9.9.9/g" "$calib" >other
chmod +x other
# A build may keep so short a text in its code, where it cannot be edited.
if ./other -q cluster plan study.toml --shards 1 -o others >/dev/null && grep -q 'calib 9.9.9' others/plan.json; then
rm "$shard"
ended=0
./other -q cluster run plan --shard 3 >other.out 2>&1 || ended=$?
[ "$ended" = 2 ] || fail "another version ended with $ended: $(cat other.out)"
[ ! -e "$shard" ] || fail "another version wrote results"
refused 4 "shard 3: it has no results"
say "another version is refused"
else
    say "another version cannot be made of this build: tests/cli/cluster.rs has one"
fi
rm -rf others

wait "$processors" || fail "native and Haswell"
say "native and Haswell give the same bytes; done"
