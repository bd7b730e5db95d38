#!/bin/bash
# Tries the workflow on a real Slurm: one node on the loopback address, without accounting.
#
#   apt-get install slurmctld slurmd slurm-client munge
#   pip install 'qboot[cluster]'
#   experiments/cluster/try_slurm.sh [FOLDER]        # as root, on a machine that runs no Slurm of its own
#
# 1. `qboot reproduce` makes the smoke study of a task in FOLDER/reference.
# 2. Snakemake makes the same with Slurm in FOLDER/cluster. On the way the process of one job is killed, and another
#    job is cancelled as when its node is lost.
# 3. The files of both must be the same. The daemons are stopped in any case.
set -euo pipefail
FOLDER=$(realpath "${1:-$(mktemp -d)}")
TASK=${TASK:-$(realpath "$(dirname "$0")/../../examples/point_robot.py"):TASK}
PYTHON=${PYTHON:-python3}
HERE=$(dirname "$(realpath "$0")")
mkdir -p "$FOLDER"/{state,spool,jobs}
chmod 755 "$FOLDER"  # munge has a user of its own
cd "$FOLDER"
export JAX_COMPILATION_CACHE_DIR=${JAX_COMPILATION_CACHE_DIR:-$FOLDER/compiled}
SINCE=$SECONDS
say() { printf '%4d s  %s\n' $((SECONDS - SINCE)) "$*"; }

stop() {
    for name in slurmd slurmctld munged; do
        if [ -f "$FOLDER/$name.pid" ]; then kill "$(cat "$FOLDER/$name.pid")" 2>/dev/null || true; fi
    done
}
trap stop EXIT

start_slurm() {
    install -d -o munge -g munge -m 755 /run/munge
    install -o munge -g munge -d "$FOLDER/munge"
    runuser -u munge -- munged --force --pid-file="$FOLDER/munge/munged.pid" --log-file="$FOLDER/munge/munged.log" \
        --seed-file="$FOLDER/munge/seed"
    ln -sf munge/munged.pid "$FOLDER/munged.pid"
    export SLURM_CONF=$FOLDER/slurm.conf
    sed -e "s|@HOST@|$(hostname -s)|; s|@FOLDER@|$FOLDER|; s|@CORES@|$(nproc)|" -e "s|@HOST@|$(hostname -s)|" \
        -e "s|@MEMORY@|$(($(awk '/MemTotal/ {print $2}' /proc/meminfo) / 1024))|" "$HERE/slurm.conf.in" > "$SLURM_CONF"
    slurmctld
    slurmd
    for _ in $(seq 30); do
        if sinfo --noheader --format=%T 2>/dev/null | grep -q idle; then return; fi
        sleep 1
    done
    tail "$FOLDER"/slurm*.log
    exit 1
}

# The number of the process that does a step in the folder of the cluster's study, once there is one.
process_of() {
    until pgrep -f "^[^ ]*python[^ ]* -m qboot.cli $1 .*$FOLDER/cluster" | head -n 1 | grep .; do sleep 0.2; done
}

# The Slurm job that a process belongs to.
job_of() { tr '\0' '\n' < "/proc/$1/environ" | sed -n 's/^SLURM_JOB_ID=//p'; }

say "reference: qboot reproduce --profile smoke --task $TASK"
"$PYTHON" -m qboot.cli reproduce --profile smoke --task "$TASK" --out "$FOLDER/reference" > reference.log 2>&1
say "reference done; starting Slurm"
start_slurm
say "Slurm $(sinfo --version | cut -d' ' -f2): $(sinfo --noheader --format='%D node, %c cores, %T')"
"$PYTHON" -m snakemake --snakefile "$("$PYTHON" -m qboot.cli workflow)" \
    --executor cluster-generic --jobs "$(nproc)" \
    --cluster-generic-submit-cmd "sbatch --parsable --job-name={rule} --cpus-per-task={threads} --mem={resources.mem_mb} --output=$FOLDER/jobs/%j.log" \
    --cluster-generic-status-cmd "$PYTHON -m qboot.study.workflow.slurm_status" \
    --cluster-generic-cancel-cmd scancel \
    --config profile=smoke "task=$TASK" "out=$FOLDER/cluster" > snakemake.log 2>&1 &
ENGINE=$!
victim=$(process_of evolve)
sleep "${BEFORE_KILL:-6}"
say "kill -9 of the process of Slurm job $(job_of "$victim") (evolve)"
kill -9 "$victim"
victim=$(process_of learn)
sleep "${BEFORE_KILL:-6}"
job=$(job_of "$victim")
say "scancel of Slurm job $job (learn)"
scancel "$job"
wait "$ENGINE" && say "Snakemake is done" || { tail -n 40 snakemake.log; exit 1; }
scontrol --oneliner show job | tr ' ' '\n' | awk -F= '
    $1 == "JobId" {id = $2} $1 == "JobName" {name = $2} $1 == "JobState" {state = $2} $1 == "RunTime" {
        printf "        job %-3s %-28s %-10s %s\n", id, name, state, $2}' | sort -k2n
sums() { (cd "$1" && find . -type f ! -name timing.csv ! -name report.html ! -path './logs/*' ! -path './.*/*' -print0 \
    | sort -z | xargs -0 sha256sum); }
sums reference > reference.sha256
sums cluster > cluster.sha256
diff reference.sha256 cluster.sha256
say "all $(wc -l < cluster.sha256) files have the same sha256; of the list: $(sha256sum < cluster.sha256 | cut -c1-16)"
