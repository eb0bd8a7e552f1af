# Functions of both batch scripts here: a dask cluster on the nodes of a SLURM job, with certificates of its own.
#
#   RATTLE_SHARED     directory on a file system that all nodes share, for kernels and the files of the cluster;
#                     default: the directory from which the job was submitted
#   RATTLE_CLUSTER    directory of the scheduler file and the certificates; default: a directory for each job
#   RATTLE_INTERFACE  network interface between the nodes, such as ib0; default: that of the host's name
#
# Submit the job while the Python environment with gear-rattle[workers] is active: the job uses it.

shared=${RATTLE_SHARED:-$SLURM_SUBMIT_DIR}
cluster=${RATTLE_CLUSTER:-$shared/rattle-cluster-$SLURM_JOB_ID}
# Compiled kernels run on one kind of processor; each kind has its own directory below this one.
export RATTLE_CACHE_DIR=${RATTLE_CACHE_DIR:-$shared/rattle-kernels}
export NUMBA_NUM_THREADS=1 OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
# As in the embedded cluster: how soon a frozen worker is replaced, and after how many deaths of workers a tile is
# computed in a process of its own.
export DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL=60s DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES=1
# By default, dask keeps the last thousand messages of every connection with their content.
export DASK_DISTRIBUTED__ADMIN__LOW_LEVEL_LOG_LENGTH=10
interface=(${RATTLE_INTERFACE:+--interface "$RATTLE_INTERFACE"})
program= limit_met=

# SLURM sends the signal shortly before the time limit (#SBATCH --signal). The survey then stops with complete tiles, and
# the job is queued again and continues there.
trap 'limit_met=1; [ -z "$program" ] || kill -TERM "$program" 2> /dev/null || true' USR1

# A dask port executes whatever it receives, and other users can reach it. So every part of the cluster requires the
# certificate of this cluster.
make_certificate() {
    if [ ! -e "$cluster/environment" ]; then
        openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -noenc -days 365 -subj /CN=gear-rattle \
            -keyout "$cluster/key.pem" -out "$cluster/certificate.pem" 2> /dev/null
        {
            echo "export DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION=true"
            echo "export DASK_DISTRIBUTED__COMM__TLS__CA_FILE='$cluster/certificate.pem'"
            for part in SCHEDULER WORKER CLIENT; do
                echo "export DASK_DISTRIBUTED__COMM__TLS__${part}__CERT='$cluster/certificate.pem'"
                echo "export DASK_DISTRIBUTED__COMM__TLS__${part}__KEY='$cluster/key.pem'"
            done
        } > "$cluster/environment.new"
        mv "$cluster/environment.new" "$cluster/environment"
    fi
    source "$cluster/environment"
}

# Start the scheduler on this node, which is the first of the job, and a worker for each task of the job. Return when the
# first worker has connected.
begin_cluster() {
    (umask 077 && mkdir -p "$cluster" "$RATTLE_CACHE_DIR")
    rm -f "$cluster/scheduler.json"
    make_certificate
    # One process on each node compiles the missing kernels; a lock lets one node of each kind of processor do it.
    srun --ntasks-per-node=1 --ntasks="$SLURM_JOB_NUM_NODES" python -c 'import rattle; rattle.precompile()'
    dask scheduler --protocol tls --port 0 --no-dashboard "${interface[@]}" --scheduler-file "$cluster/scheduler.json" &
    scheduler=$!
    # Each worker has a nanny, which starts it again. If a node is lost, only its own workers are lost.
    srun --no-kill --kill-on-bad-exit=0 dask worker --scheduler-file "$cluster/scheduler.json" --protocol tls --nworkers 1 --nthreads 1 \
        --memory-limit 2GiB --no-dashboard "${interface[@]}" --local-directory "${TMPDIR:-/tmp}" --preload gear_rattle.cluster &
    workers=$!
    python -c 'import sys; from distributed import Client; Client(scheduler_file=sys.argv[1], timeout=300).wait_for_workers(1, 300)' \
        "$cluster/scheduler.json"
}

end_cluster() {
    kill -TERM "$workers" "$scheduler" 2> /dev/null || true
    wait
}

# Run a command until it ends, or until the time limit of the job; then queue the job again.
run_until_the_limit() {
    local status=0
    if [ -z "$limit_met" ]; then
        "$@" &
        program=$!
        wait "$program" || status=$?
        if [ -n "$limit_met" ]; then wait "$program" || status=$?; fi # the signal has interrupted only `wait`
    fi
    end_cluster
    if [ -n "$limit_met" ] && [ "$status" -ne 0 -o -z "$program" ]; then
        scontrol requeue "$SLURM_JOB_ID"
        sleep infinity # until SLURM ends the job: if the script ended by itself, the job would count as failed
    fi
    exit "$status"
}
