"""A scheduler that is killed and started again, under a service that goes on by itself."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from itertools import islice
from pathlib import Path

from faults import REQUEST, Faults
from service_processes import ROOT, assert_bit_identical, free_port, serial_run, server, wait_until

from service.client import Client


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


def test_killed_and_started_again(tmp_path: Path) -> None:
    faults, port, scheduler_port = Faults(tmp_path), free_port(), free_port()
    faults.inject("""
        @patch("workers.tiles")
        def slow(tiles):
            before(tiles, "compute_tile", lambda *_: time.sleep(0.05))
    """)
    url = f"tcp://127.0.0.1:{scheduler_port}"

    def start_cluster(stack: ExitStack) -> subprocess.Popen[bytes]:
        scheduler = ("scheduler", "--host", "127.0.0.1", "--port", str(scheduler_port))
        worker = ("worker", url, "--nthreads", "1", "--no-nanny")
        process = stack.enter_context(dask(faults, *scheduler))
        stack.enter_context(dask(faults, *worker))
        return process

    with (
        ExitStack() as stack,
        server(tmp_path / "data", port, "--scheduler", url),
        Client(f"http://127.0.0.1:{port}") as client,
    ):
        scheduler = start_cluster(stack)
        job = client.submit(REQUEST)
        tiles = (event for _, event in client.events(job.document["links"]["events"], 0) if "tile" in event)
        done = list(islice(tiles, 10))[-1]["tiles_done"]
        scheduler.kill()
        scheduler.wait()
        wait_until(lambda: client.call("GET", "/v1/health").json()["status"] == "degraded")
        assert job.refresh().state == "running"
        assert done <= job.document["tiles_done"] < 64
        start_cluster(stack)
        job.wait()
        assert_bit_identical(job.open(), serial_run(REQUEST))
    executed = faults.executions()
    assert set(executed) == set(range(64))
    assert executed.total() <= 65  # only the tile that was at work
