"""A scheduler that is killed and started again, under a service that goes on by itself."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from depth import deep
from faults import REQUEST, Faults
from service_processes import ROOT, assert_bit_identical, client_of, free_port, serial_run, server
from waiting import wait_until

MIDDLE = 5  # tiles that are done while the others are held


@contextmanager
def dask(faults: Faults, *arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(
        [sys.executable, "-m", "dask", *arguments, "--no-dashboard"],
        cwd=ROOT,
        env=faults.environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@deep
def test_killed_and_started_again(tmp_path: Path) -> None:
    faults, port, scheduler_port = Faults(tmp_path), free_port(), free_port()
    faults.hold(MIDDLE)
    url = f"tcp://127.0.0.1:{scheduler_port}"

    def start_cluster(stack: ExitStack) -> subprocess.Popen[bytes]:
        scheduler = ("scheduler", "--host", "127.0.0.1", "--port", str(scheduler_port))
        worker = ("worker", url, "--nthreads", "1", "--no-nanny")
        process = stack.enter_context(dask(faults, *scheduler))
        stack.enter_context(dask(faults, *worker))
        return process

    with ExitStack() as stack, server(tmp_path / "data", port, "--scheduler", url), client_of(port) as client:
        scheduler = start_cluster(stack)
        job = client.submit(REQUEST)
        wait_until(lambda: job.refresh().document["tiles_done"] == MIDDLE and faults.executions()[MIDDLE])
        scheduler.kill()
        scheduler.wait()
        wait_until(lambda: client.call("GET", "/v1/health").json()["status"] == "degraded")
        assert job.refresh().state == "running"
        assert job.document["tiles_done"] == MIDDLE
        faults.release()
        start_cluster(stack)
        job.wait()
        assert_bit_identical(job.open(), serial_run(REQUEST))
    assert set(faults.executions()) == set(range(REQUEST.n_tiles))
    assert faults.executions().total() <= REQUEST.n_tiles + 1  # only the tile that was at work
