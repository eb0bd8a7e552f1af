# What both batch scripts beside this file do: a dask cluster in the nodes of a SLURM job, with certificates of its own.
#
#   RATTLE_SHARED     directory that all nodes share, for kernels and the cluster's files; by default that of submission
#   RATTLE_CLUSTER    directory of the scheduler file and the certificates; by default one of the job's own
#   RATTLE_INTERFACE  network between the nodes, such as ib0; by default that of the host's name
#
# The environment with gear-rattle[workers] is the one that is active when the job is submitted.

shared=${RATTLE_SHARED:-$SLURM_SUBMIT_DIR}
cluster=${RATTLE_CLUSTER:-$shared/rattle-cluster-$SLURM_JOB_ID}
# Kernels suit one kind of processor: below this directory each kind has its own.
export RATTLE_CACHE_DIR=${RATTLE_CACHE_DIR:-$shared/rattle-kernels}
export NUMBA_NUM_THREADS=1 OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
# A frozen worker is replaced, and a tile that kills workers computed apart, as soon as in the embedded cluster.
export DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL=60s DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES=1
# Else the last thousand messages of every connection are kept, with what is in them.
export DASK_DISTRIBUTED__ADMIN__LOW_LEVEL_LOG_LENGTH=10
interface=(${RATTLE_INTERFACE:+--interface "$RATTLE_INTERFACE"})
program= limit_met=

# The job's time limit comes near (#SBATCH --signal): what runs ends whole, and the job begins again where it was.
trap 'limit_met=1; [ -z "$program" ] || kill -TERM "$program" 2> /dev/null || true' USR1

# A dask port executes what it is sent, and other users reach it: each part shows the certificate of this cluster.
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

# Start the scheduler on this node, the first of the job, and a worker for each task of the job; return when one is there.
begin_cluster() {
    (umask 077 && mkdir -p "$cluster" "$RATTLE_CACHE_DIR")
    rm -f "$cluster/scheduler.json"
    make_certificate
    # One process of each node compiles what is missing for its processor; a lock lets one of each kind do it.
    srun --ntasks-per-node=1 --ntasks="$SLURM_JOB_NUM_NODES" python -c 'import rattle; rattle.precompile()'
    dask scheduler --protocol tls --port 0 --no-dashboard "${interface[@]}" --scheduler-file "$cluster/scheduler.json" &
    scheduler=$!
    # Each worker has a nanny, which starts it again; a node that is lost takes its own workers with it, and no others.
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

# Run a command to its end, or to the job's time limit, after which the job is queued again.
run_until_the_limit() {
    local status=0
    if [ -z "$limit_met" ]; then
        "$@" &
        program=$!
        wait "$program" || status=$?
        if [ -n "$limit_met" ]; then wait "$program" || status=$?; fi # a signal ends only the waiting
    fi
    end_cluster
    if [ -n "$limit_met" ] && [ "$status" -ne 0 -o -z "$program" ]; then
        scontrol requeue "$SLURM_JOB_ID"
        sleep infinity # until the job is ended, or it would count as failed
    fi
    exit "$status"
}
