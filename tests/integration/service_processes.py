"""Processes of the service on the loopback interface, their clients, and the values that a survey must have."""

import os
import random
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import psutil
import xarray as xr
from waiting import HANG, wait_until

from gear_rattle.service.client import Client
from gear_rattle.workers import SurveyRequest, compute_tile, tiles_of
from gear_rattle.workers.cluster.nannies import TRACKER

ROOT = Path(__file__).parents[2]
RATTLE = [sys.executable, "-m", "gear_rattle.cli"]
ENVIRONMENT = {
    **os.environ,
    "PYTHONPATH": str(ROOT),
    "PYTHONUNBUFFERED": "1",
    "RATTLE_EXPLORER": "false",  # tests in a browser switch it on; without it the service starts faster
    "RATTLE_PRELOAD": "false",
    "RATTLE_WORKERS": "1",  # a test that needs several says so
}
NO_SETTINGS: Mapping[str, str] = {}

#: 36 cells in 9 tiles. To act in the middle of the survey, a test holds its tiles with `faults.Faults`.
FIELDS: dict[str, Any] = {
    "delta": {"start": 0.45, "stop": 0.9, "num": 6},
    "epsilon": {"start": 0.02, "stop": 0.25, "num": 6},
    "initial_conditions": {"count": 16},
    "tile": {"delta": 2, "epsilon": 2},
    "seed": 7,
}
REQUEST = SurveyRequest(**FIELDS)
OPTIONS = ["--delta", "0.45:0.9:6", "--epsilon", "0.02:0.25:6", "--count", "16", "--tile", "2x2", "--seed", "7"]


def free_port() -> int:
    """Return a free port below the ephemeral ports, which the system could give to a connection meanwhile."""
    while True:
        port = random.SystemRandom().randrange(10_000, 30_000)
        with socket.socket() as probe, suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return port


def start(*arguments: str, settings: Mapping[str, str] = NO_SETTINGS, **options: Any) -> subprocess.Popen[str]:
    """Start a command of rattle in a process group of its own."""
    environment = ENVIRONMENT | settings
    return subprocess.Popen(
        [*RATTLE, *arguments], cwd=ROOT, env=environment, text=True, start_new_session=True, **options
    )


def finish(*arguments: str, settings: Mapping[str, str] = NO_SETTINGS) -> subprocess.CompletedProcess[str]:
    """Run a command of rattle to its end; return its exit status and output."""
    environment = ENVIRONMENT | settings
    return subprocess.run(
        [*RATTLE, *arguments], cwd=ROOT, env=environment, text=True, capture_output=True, timeout=HANG
    )


@contextmanager
def server(
    data: Path, port: int, *arguments: str, settings: Mapping[str, str] = NO_SETTINGS, **options: Any
) -> Iterator[subprocess.Popen[str]]:
    """Run a server. At the end, SIGTERM stops it, and it must stop without an error."""
    process = start("serve", "--port", str(port), "--data", str(data), *arguments, settings=settings, **options)
    try:
        wait_until(lambda: answers(process, port))
        yield process
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
            assert process.wait(timeout=HANG) == 0
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()


def answers(process: subprocess.Popen[str], port: int) -> bool:
    assert process.poll() is None, "the server ended"
    try:
        return get(f"http://127.0.0.1:{port}/v1/health").is_success
    except httpx.TransportError:
        return False


def get(url: str, **options: Any) -> httpx.Response:
    """Return the answer to a GET request without a timeout. No certificates are loaded: that takes 20 ms."""
    return httpx.get(url, timeout=HANG, verify=False, **options)


@contextmanager
def client_of(port: int, key: str | None = None) -> Iterator[Client]:
    """Open a client without a timeout of the service at this port."""
    url = f"http://127.0.0.1:{port}"
    with Client(url, http=httpx.Client(base_url=url, timeout=HANG), key=key) as client:
        yield client


def nannies_of(pid: int) -> list[psutil.Process]:
    """Return the processes that start the workers of a process (their nannies)."""
    found = []
    for each in psutil.Process(pid).children():
        with suppress(psutil.ZombieProcess, psutil.NoSuchProcess):  # it has ended
            if "gear_rattle.workers.cluster.nannies" in " ".join(each.cmdline()):
                found.append(each)
    return found


def workers_of(pid: int) -> list[psutil.Process]:
    """Return the worker processes of a process, including frozen ones."""
    with suppress(psutil.NoSuchProcess):
        children = [worker for each in nannies_of(pid) for worker in each.children()]
        return [each for each in children if TRACKER not in " ".join(each.cmdline())]
    return []


def written_in(store: Path) -> dict[str, bytes]:
    """Return the content of the files that tiles have written below a directory, by path."""
    return {str(path.relative_to(store)): path.read_bytes() for path in store.rglob("c/**/*") if path.is_file()}


@cache
def serial_run(request: SurveyRequest) -> dict[str, np.ndarray]:
    """Return every per-cell variable, computed in this process tile by tile in reverse order."""
    whole: dict[str, np.ndarray] = {}
    for tile in reversed(tiles_of(request)):
        arrays, _ = compute_tile(request, tile)
        for name, values in arrays.items():
            target = whole.setdefault(name, np.empty((*values.shape[:-2], *request.shape), values.dtype))
            target[..., tile.epsilon, tile.delta] = values
    return whole


def assert_bit_identical(dataset: xr.Dataset, expected: dict[str, np.ndarray]) -> None:
    """Assert that a data set has every expected variable with the same dtype and the same bytes, NaN included."""
    assert len(expected) > 10
    for name, values in expected.items():
        whole, _, part = name.rpartition("_")  # open_survey combines real and imaginary parts
        found = dataset[name].values if name in dataset else getattr(dataset[whole].values, part)
        assert found.dtype == values.dtype, name
        assert found.shape == values.shape, name
        assert found.tobytes() == values.tobytes(), name
