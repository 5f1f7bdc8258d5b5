#!/bin/sh
# A Slurm of two nodes on this machine, for the tests of sweeps on batch systems. It installs nothing, and writes into one
# folder: Debian's packages slurm-wlm and munge must be there, and it must run as root.
#
#   slurm_of_one_machine.sh start FOLDER    then SLURM_CONF=FOLDER/slurm.conf sinfo
#   slurm_of_one_machine.sh stop FOLDER
#
# Each node is a slurmd of this host on a port of its own (Debian builds Slurm with multiple-slurmd) and claims 2 CPUs.
# A machine that has a configuration of its own keeps it: the script refuses where /etc/slurm/slurm.conf is.
set -eu

usage="usage: $0 start|stop FOLDER"
action=${1:?$usage}
folder=$(realpath -m "${2:?$usage}")

stop() {
    for daemon in n1 n2 ctld munged; do
        [ -f "$folder/$daemon.pid" ] && kill "$(cat "$folder/$daemon.pid")" 2>/dev/null || true
        rm -f "$folder/$daemon.pid"
    done
}

configuration() {
    cat <<CONF
ClusterName=one
SlurmctldHost=$(hostname)
AuthType=auth/munge
CryptoType=crypto/munge
AuthInfo=socket=$folder/munge.socket
SlurmUser=root
SlurmdUser=root
StateSaveLocation=$folder/ctld
SlurmdSpoolDir=$folder/%n
SlurmctldPidFile=$folder/ctld.pid
SlurmdPidFile=$folder/%n.pid
SlurmctldLogFile=$folder/ctld.log
SlurmdLogFile=$folder/%n.log
SlurmctldPort=16817
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerType=sched/backfill
SchedulerParameters=batch_sched_delay=1,sched_interval=2,bf_interval=2
PreemptType=preempt/partition_prio
PreemptMode=REQUEUE
KillWait=10
ReturnToService=2
NodeName=n[1-2] NodeHostname=$(hostname) NodeAddr=127.0.0.1 Port=[17001-17002] CPUs=2 RealMemory=1000
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP PriorityTier=1 GraceTime=10
PartitionName=urgent Nodes=ALL MaxTime=INFINITE State=UP PriorityTier=2
CONF
}

start() {
    for program in munged slurmctld slurmd sbatch; do
        command -v $program >/dev/null || { echo "$program: not there; install slurm-wlm and munge" >&2; exit 2; }
    done
    if [ -e /etc/slurm/slurm.conf ]; then
        echo "/etc/slurm/slurm.conf: this machine has a Slurm of its own; nothing was changed" >&2
        exit 2
    fi
    mkdir -p "$folder/ctld" "$folder/n1" "$folder/n2"
    chmod 755 "$folder"
    (umask 077 && head -c 1024 /dev/urandom >"$folder/munge.key")
    configuration >"$folder/slurm.conf"
    export SLURM_CONF="$folder/slurm.conf"
    setsid munged --force --key-file="$folder/munge.key" --socket="$folder/munge.socket" --pid-file="$folder/munged.pid" \
        --log-file="$folder/munged.log" --seed-file="$folder/munged.seed"
    setsid slurmctld >"$folder/ctld.out" 2>&1
    for node in n1 n2; do
        setsid slurmd -N $node >"$folder/$node.out" 2>&1
    done
    for _ in $(seq 100); do
        [ "$(sinfo -h -t idle -o %D -p all)" = 2 ] && exit 0
        sleep 0.2
    done
    echo "the nodes did not come up; $folder/*.log say why" >&2
    stop
    exit 1
}

case $action in
start) start ;;
stop) stop ;;
*) echo "$usage" >&2 && exit 2 ;;
esac
