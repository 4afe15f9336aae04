#!/usr/bin/env bash
# A Slurm cluster of two nodes on this machine's loopback, from Debian's packages, for tests. Wants root.
#   two_nodes.sh up DIR          prints what to export
#   two_nodes.sh lose DIR n2     the node, its tasks and their children are gone at once (kill -9)
#   two_nodes.sh back DIR n2     it comes back
#   two_nodes.sh down DIR        ends what `up` started, and nothing else
# No systemd, cgroups, namespaces or data base. Partitions: main, and urgent, whose jobs requeue those of main.
set -euo pipefail

need() {
    command -v slurmctld slurmd munged sbatch >/dev/null && return
    apt-get -qq update
    DEBIAN_FRONTEND=noninteractive apt-get -qq install --yes --no-install-recommends \
        slurmctld slurmd slurm-client munge >/dev/null
}

up() {
    need
    mkdir -p "$1"
    D=$(cd "$1" && pwd)
    chmod 755 "$D"
    install -d -o munge -g munge -m 755 "$D/munge"
    install -d -m 755 "$D/state" "$D/log"
    head -c 128 /dev/urandom >"$D/munge/key"
    chown munge:munge "$D/munge/key"
    chmod 600 "$D/munge/key"
    setpriv --reuid munge --regid munge --clear-groups munged --force --key-file="$D/munge/key" \
        --log-file="$D/munge/log" --pid-file="$D/munge/pid" --seed-file="$D/munge/seed" --socket="$D/munge/sock" >&2
    for _ in $(seq 100); do [ -s "$D/munge/pid" ] && break; sleep 0.1; done
    cp "$D/munge/pid" "$D/munged.pid"
    cat >"$D/slurm.conf" <<CONF
ClusterName=test
SlurmctldHost=localhost(127.0.0.1)
AuthType=auth/munge
AuthInfo=socket=$D/munge/sock,cred_expire=5
SlurmUser=root
SlurmctldPort=26817
SlurmctldPidFile=$D/slurmctld.pid
SlurmctldLogFile=$D/log/slurmctld.log
StateSaveLocation=$D/state
SlurmdPidFile=$D/slurmd.%n.pid
SlurmdLogFile=$D/log/slurmd.%n.log
SlurmdSpoolDir=$D/spool.%n
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
JobCompType=jobcomp/filetxt
JobCompLoc=$D/log/jobcomp.txt
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerParameters=bf_interval=2,sched_min_interval=0
PreemptType=preempt/partition_prio
PreemptMode=REQUEUE
ReturnToService=2
SlurmdTimeout=5
KillWait=2
SlurmdParameters=config_overrides
NodeName=n[1-2] NodeHostname=localhost NodeAddr=127.0.0.1 Port=[27001-27002] CPUs=2 CoresPerSocket=2 RealMemory=4000
PartitionName=main Nodes=n[1-2] Default=YES MaxTime=INFINITE State=UP PriorityTier=1 PreemptMode=REQUEUE GraceTime=10
PartitionName=urgent Nodes=n[1-2] MaxTime=INFINITE State=UP PriorityTier=9 PreemptMode=OFF
CONF
    export SLURM_CONF=$D/slurm.conf
    slurmctld -c >&2
    slurmd -N n1 >&2
    slurmd -N n2 >&2
    for _ in $(seq 200); do [ "$(sinfo -h -p main -t idle -o %D 2>/dev/null)" = 2 ] && break; sleep 0.1; done
    [ "$(sinfo -h -p main -t idle -o %D)" = 2 ] || { echo "no cluster; see $D/log" >&2; exit 1; }
    echo "export SLURM_CONF=$SLURM_CONF"
}

descendants() { for child in $(ps -o pid= --ppid "$1"); do echo "$child"; descendants "$child"; done; }

lose() {
    D=$(cd "$1" && pwd)
    export SLURM_CONF=$D/slurm.conf
    gone=$(cat "$D/slurmd.$2.pid")
    for job in $(squeue -h -w "$2" -t R -o %A); do
        step=$(ps -eo pid,args --no-headers | awk -v step="slurmstepd: [$job.batch]" 'index($0, step) {print $1; exit}')
        [ -z "$step" ] || gone="$gone $step $(descendants "$step")"
    done
    # shellcheck disable=SC2086
    kill -9 $gone
}

back() {
    D=$(cd "$1" && pwd)
    SLURM_CONF=$D/slurm.conf slurmd -N "$2" >&2
}

down() {
    D=$(cd "$1" && pwd)
    for daemon in slurmd.n1 slurmd.n2 slurmctld munged; do
        [ -s "$D/$daemon.pid" ] && kill "$(cat "$D/$daemon.pid")" 2>/dev/null || true
    done
    sleep 1
}

"$@"
