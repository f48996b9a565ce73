#!/bin/sh
# A sequence on a real Slurm: one machine that plays a cluster of two nodes. As root, on Debian or Ubuntu:
#
#   sh benches/slurm/slurm.sh target/release/nelu3d RIG SEQUENCE
#
# RIG has its color field already (`nelu3d calibrate RIG`). Installs slurm-wlm if it is not there, starts a controller and two
# node daemons on configuration of its own in a temporary folder, submits what `nelu3d sequence --slurm` writes, and compares every frame
# with a run without Slurm, byte by byte. Everything it started is stopped again.
set -eu

[ $# -eq 3 ] || { echo "usage: $0 NELU3D RIG SEQUENCE" >&2; exit 2; }
program=$(realpath "$1") rig=$(realpath "$2") sequence=$3
[ "$(id -u)" = 0 ] || { echo "$0: run it as root: Slurm's daemons need that" >&2; exit 1; }
for tool in slurmctld slurmd sbatch munged; do
    command -v $tool > /dev/null || { apt-get install -y --no-install-recommends slurm-wlm munge; break; }
done

dir=$(mktemp -d /tmp/nelu3d-slurm.XXXXXX)
chmod 755 "$dir"
stop() {
    for daemon in slurmd-n1 slurmd-n2 slurmctld munged; do
        [ ! -f "$dir/$daemon.pid" ] || kill "$(cat "$dir/$daemon.pid")" 2> /dev/null || true
    done
    sleep 1
    rm -rf "$dir"
}
trap stop EXIT INT TERM

# Messages between the daemons are signed with a key of their own.
mkdir -p "$dir/munge" "$dir/state" "$dir/n1" "$dir/n2"
head -c 1024 /dev/urandom > "$dir/munge/key"
chmod 700 "$dir/munge"; chmod 400 "$dir/munge/key"
munged --force --key-file="$dir/munge/key" --socket="$dir/munge.socket" --pid-file="$dir/munged.pid" \
    --log-file="$dir/munged.log" --seed-file="$dir/munge.seed"

host=$(hostname -s)
cat > "$dir/slurm.conf" << END
ClusterName=nelu3d
SlurmctldHost=$host(127.0.0.1)
SlurmUser=root
SlurmdUser=root
SlurmctldPort=26817
AuthType=auth/munge
AuthInfo=socket=$dir/munge.socket
CredType=cred/munge
MpiDefault=none
ProctrackType=proctrack/pgid
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerType=sched/backfill
StateSaveLocation=$dir/state
SlurmdSpoolDir=$dir/%n
SlurmctldPidFile=$dir/slurmctld.pid
SlurmdPidFile=$dir/slurmd-%n.pid
SlurmctldLogFile=$dir/slurmctld.log
SlurmdLogFile=$dir/slurmd-%n.log
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
ReturnToService=2
NodeName=n1 NodeHostname=$host NodeAddr=127.0.0.1 Port=26818 CPUs=1 State=UNKNOWN
NodeName=n2 NodeHostname=$host NodeAddr=127.0.0.1 Port=26819 CPUs=1 State=UNKNOWN
PartitionName=all Nodes=n1,n2 Default=YES MaxTime=INFINITE State=UP
END
export SLURM_CONF="$dir/slurm.conf"
slurmctld
sleep 2
slurmd -N n1
slurmd -N n2
i=0
until [ "$(sinfo -h -N -t idle -o %N | wc -l)" = 2 ]; do
    i=$((i + 1))
    [ $i -lt 30 ] || { echo "$0: the nodes do not come up; the logs:" >&2; tail -n 20 "$dir"/*.log >&2; exit 1; }
    sleep 1
done
sinfo

cd "$dir"
"$program" sequence "$rig" "$sequence" -o "$dir/cluster" --keyframe 2 --slurm "$dir/job.sh" --tasks 3
job=$(sbatch --parsable "$dir/job.sh")
seen=""
while squeue -h -j "$job" 2> /dev/null | grep -q .; do
    seen="$seen $(squeue -h -t running -j "$job" -o %N | tr '\n' ' ')"
    sleep 0.2
done
cat "$dir"/nelu3d-*.log
echo "nodes that worked: $(echo "$seen" | tr ' ' '\n' | sort -u | tr '\n' ' ')"

"$program" sequence "$rig" "$sequence" -o "$dir/alone" --keyframe 2 --quiet > /dev/null
[ -f "$dir/cluster/sequence.json" ] || { echo "$0: the sequence is not complete" >&2; exit 1; }
n=0
for frame in "$dir"/alone/*/depth.npy; do
    name=$(basename "$(dirname "$frame")")
    for file in depth.npy sigma.npy mesh.ply; do
        cmp "$dir/alone/$name/$file" "$dir/cluster/$name/$file"
    done
    n=$((n + 1))
done
echo "$n frames are the same, byte by byte, as without Slurm"
