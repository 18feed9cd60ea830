#!/bin/bash
# A data set rendered by a real Slurm on this machine is, byte for byte, the one rendered without.
# Usage: tests/slurm/run.sh [PYTHON]. Needs Slurm and munge (as root on Debian, they are installed) and rauca in PYTHON.
set -euo pipefail
python=$(realpath --no-symlinks "${1:-.venv/bin/python}")
cd "$(dirname "$0")/../.."

if ! command -v sbatch slurmctld slurmd munged >/dev/null; then
  [ "$(id -u)" = 0 ] || { echo "Slurm is missing: apt-get install slurmctld slurmd slurm-client munge" >&2; exit 77; }
  apt-get update -qq
  DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends slurmctld slurmd slurm-client munge
fi

place=$(mktemp -d)
pids=()
stop() {
  kill "${pids[@]}" 2>/dev/null || true
  wait "${pids[@]}" 2>/dev/null || true
  rm -rf "$place"
}
trap stop EXIT
mkdir "$place/state" "$place/spool"
chmod 755 "$place"

# Authentication: a munge of its own, with a key of its own.
head -c 1024 /dev/urandom > "$place/munge.key"
chmod 400 "$place/munge.key"
munged --foreground --force --key-file "$place/munge.key" --socket "$place/munge.socket" --seed-file "$place/seed" \
  --pid-file "$place/munged.pid" --log-file "$place/munged.log" & pids+=($!)

host=$(hostname -s)
export SLURM_CONF=$place/slurm.conf
cat > "$SLURM_CONF" <<CONF
ClusterName=rauca
SlurmctldHost=$host(127.0.0.1)
SlurmUser=$(id -un)
SlurmdUser=$(id -un)
SlurmctldPort=26817
SlurmdPort=26818
AuthType=auth/munge
AuthInfo=socket=$place/munge.socket
StateSaveLocation=$place/state
SlurmdSpoolDir=$place/spool
SlurmctldPidFile=$place/slurmctld.pid
SlurmdPidFile=$place/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
ReturnToService=2
NodeName=$host NodeAddr=127.0.0.1 CPUs=$(nproc) RealMemory=$(($(awk '/MemTotal/ {print $2}' /proc/meminfo) / 1024 * 9 / 10)) State=UNKNOWN
PartitionName=test Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF
while [ ! -S "$place/munge.socket" ]; do sleep 0.1; done
slurmctld -D > "$place/slurmctld.log" 2>&1 & pids+=($!)
slurmd -D -N "$host" > "$place/slurmd.log" 2>&1 & pids+=($!)
for _ in $(seq 100); do
  [ "$(sinfo --noheader --format %T 2>/dev/null)" = idle ] && break
  sleep 0.3
done
sinfo || { cat "$place"/*.log; exit 1; }

set_of=(--azimuths 2 --elevations 15 --distances 6 --size 48 --samples 1 --no-denoise)
rauca() { "$python" -c "from pipelines.cli import run; run()" "$@"; }

rauca dataset make --out "$place/array/set" "${set_of[@]}" --slurm --shards 2 --partition test --time 10 --memory 1 --cpus 1 ||
  { cat "$place"/*.log "$place"/array/set.slurm/*_log.* 2>/dev/null | tail -80; exit 1; }
ls "$place/array/set"
rauca dataset make --out "$place/local/set" "${set_of[@]}"
diff --recursive --exclude 'ledger*' "$place/array/set" "$place/local/set"
[ "$(ls "$place/local/set/frames" | wc -l)" = 6 ]
echo "Slurm $(slurmd -V): 2 shards made the same 6 frames as a local run"
