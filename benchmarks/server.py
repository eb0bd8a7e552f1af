"""Start a service to measure, as a process on a free port of loopback."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import psutil

START_SECONDS = 300.0  # longest wait for the start, which may include compiling


@contextmanager
def server(data: Path, *options: str, first: str = "") -> Iterator[tuple[str, psutil.Process]]:
    """Start a service, wait for its cluster, and yield its URL and process; at the end print how it ended.

    Parameters
    ----------
    first : str
        Python code that the process runs first.

    Yields
    ------
    tuple[str, psutil.Process]
        URL and process of the service.
    """
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-c", f"{first}from gear_rattle.cli import main; main()", "serve", "--port", str(port)]
    here = Path(__file__).parent
    environment = os.environ | {"RATTLE_MAX_JOBS": "1000000", "PYTHONPATH": f"{here.parent}{os.pathsep}{here}"}
    process = subprocess.Popen(
        [*command, "--data", str(data), *options],
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    url = f"http://127.0.0.1:{port}"
    try:
        deadline = time.monotonic() + START_SECONDS
        while not has_cluster(url):
            if process.poll() is not None:
                raise RuntimeError(f"the service ended with status {process.returncode}; start it by hand to see why")
            if time.monotonic() > deadline:
                raise RuntimeError(f"the service did not start within {START_SECONDS:.0f} s")
            time.sleep(0.2)
        yield url, psutil.Process(process.pid)
    finally:
        began = time.perf_counter()
        process.terminate()
        process.wait(60)
        print(f"\nended {time.perf_counter() - began:.1f} s after SIGTERM, status {process.returncode}")


def has_cluster(url: str) -> bool:
    """Return whether a service answers and has workers."""
    try:
        return bool(httpx.get(f"{url}/v1/health", timeout=30).json()["cluster"] == "ready")
    except httpx.TransportError:
        return False
