#!/usr/bin/env bash
# A SLURM of one node on this machine, for an integration test: no systemd, as root, everything in one folder.
#   one_node.sh start FOLDER [CORES]     one_node.sh stop FOLDER
# Needs the Debian packages slurm-wlm, munge, slurmdbd and mariadb-server. With the accounting database a killed
# job is known to be dead at once; without it submitit waits for ever. Every process is ended by its own id.
set -euo pipefail
action=$1 folder=$2 cores=${3:-$(nproc)}
export SLURM_CONF="$folder/slurm.conf"

alive() { [ -s "$1" ] && kill -0 "$(cat "$1" 2>/dev/null)" 2>/dev/null; }

wait_for() { # seconds, command...
  local end=$((SECONDS + $1)); shift
  until "$@" >/dev/null 2>&1; do
    [ $SECONDS -lt $end ] || { echo "one_node.sh: gave up waiting for: $*" >&2; "$@" >&2 || true; exit 1; }
    sleep 0.2
  done
}

stop() {
  for name in slurmd slurmctld slurmdbd munged mariadb; do
    local pid="$folder/$name.pid"
    if alive "$pid"; then
      kill "$(cat "$pid")" 2>/dev/null || true
      for _ in $(seq 100); do alive "$pid" || break; sleep 0.1; done
      alive "$pid" && kill -9 "$(cat "$pid")" || true
    fi
  done
}

write_configuration() {
  local host memory
  host=$(hostname -s)
  memory=$(slurmd -C | grep -o 'RealMemory=[0-9]*' | cut -d= -f2)
  cat >"$SLURM_CONF" <<EOF
ClusterName=test
SlurmctldHost=$host
SlurmUser=root
SlurmdUser=root
SlurmctldPort=16817
SlurmdPort=16818
AuthType=auth/munge
AuthInfo=socket=$folder/munge.socket
CryptoType=crypto/munge
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerParameters=sched_interval=2,batch_sched_delay=0
ReturnToService=2
MpiDefault=none
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/slurmd.log
AccountingStorageType=accounting_storage/slurmdbd
AccountingStorageHost=localhost
AccountingStoragePort=16819
AccountingStoragePass=$folder/munge.socket
MinJobAge=60
KillWait=2
NodeName=$host NodeAddr=127.0.0.1 CPUs=$cores Boards=1 SocketsPerBoard=1 CoresPerSocket=$cores ThreadsPerCore=1 RealMemory=$memory
PartitionName=test Nodes=$host Default=YES MaxTime=60 State=UP
EOF
  cat >"$folder/slurmdbd.conf" <<EOF
AuthType=auth/munge
AuthInfo=socket=$folder/munge.socket
DbdHost=localhost
DbdPort=16819
SlurmUser=root
StorageType=accounting_storage/mysql
StorageHost=127.0.0.1
StoragePort=13306
StorageUser=slurm
StoragePass=slurm
StorageLoc=slurm_acct_db
PidFile=$folder/slurmdbd.pid
LogFile=$folder/slurmdbd.log
EOF
  chmod 600 "$folder/slurmdbd.conf"
}

start_database() {
  local owner=mysql
  install -d -o $owner -g $owner "$folder/db" "$folder/dbrun"
  mariadb-install-db --no-defaults --user=$owner --datadir="$folder/db" --auth-root-authentication-method=socket \
    --skip-test-db >"$folder/mariadb-install.log" 2>&1
  mariadbd --no-defaults --user=$owner --datadir="$folder/db" --socket="$folder/dbrun/socket" --port=13306 \
    --bind-address=127.0.0.1 --pid-file="$folder/dbrun/pid" --innodb-buffer-pool-size=64M \
    --innodb-lock-wait-timeout=900 >"$folder/mariadb.log" 2>&1 &
  echo $! >"$folder/mariadb.pid"
  wait_for 60 mariadb-admin --no-defaults --socket="$folder/dbrun/socket" ping
  mariadb --no-defaults --socket="$folder/dbrun/socket" -e "
    create database slurm_acct_db;
    create user slurm@localhost identified by 'slurm'; create user slurm@'127.0.0.1' identified by 'slurm';
    grant all on slurm_acct_db.* to slurm@localhost; grant all on slurm_acct_db.* to slurm@'127.0.0.1';"
}

start_munge() {
  install -d -m 0700 "$folder/munge"
  dd if=/dev/urandom of="$folder/munge/key" bs=64 count=1 status=none
  chmod 400 "$folder/munge/key"
  munged --force --key-file="$folder/munge/key" --socket="$folder/munge.socket" --pid-file="$folder/munged.pid" \
    --log-file="$folder/munge/log" --seed-file="$folder/munge/seed" --num-threads=10
}

start() {
  mkdir -p "$folder/state" "$folder/spool"
  write_configuration
  start_munge
  start_database
  slurmdbd -D >"$folder/slurmdbd.out" 2>&1 &
  wait_for 60 sacctmgr -n show cluster
  sacctmgr -i add cluster test >/dev/null
  slurmctld -c >/dev/null
  slurmd
  wait_for 60 sh -c 'sinfo -h -o %T | grep -q idle'
}

case $action in
  start) trap stop ERR EXIT; start; trap - ERR EXIT ;;
  stop) stop ;;
esac
