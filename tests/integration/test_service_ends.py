"""SIGTERM ends a service within five seconds, whatever it is at, and nothing that it has noted is lost."""

import signal
import sqlite3
import threading
import time
from pathlib import Path
from typing import Any

import httpx
import psutil
import pytest
import xarray as xr
from service_processes import FIELDS, free_port, server, wait_until

from service.client import Client

SECONDS = 5.0
WHOLE = {"RATTLE_EXPLORER": "true"}
#: Some seconds a tile on an idle core: a tile that is cut off is computed again.
HEAVY: dict[str, Any] = FIELDS | {
    "epsilon": {"start": 0.2, "stop": 0.3, "num": 36},
    "delta": {"start": 0.4, "stop": 1.0, "num": 36},
    "tile": {"delta": 6, "epsilon": 6},
    "initial_conditions": {"count": 1024},
}
#: Minutes in a compiled loop that nothing interrupts.
EXTREME = "/v1/attractors?delta=1e-7&epsilon=0.3&count=1024"


def stop(process: Any) -> float:
    """Send SIGTERM; seconds until the process and all that it has started are gone."""
    children = psutil.Process(process.pid).children(recursive=True)
    began = time.monotonic()
    process.send_signal(signal.SIGTERM)
    assert process.wait(timeout=60) == 0
    wait_until(lambda: all(is_dead(child) for child in children))
    return time.monotonic() - began


def is_dead(process: psutil.Process) -> bool:
    """Whether a process is gone, or would be if somebody were there to bury it."""
    try:
        return bool(process.status() == psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return True


def test_a_busy_service_ends_in_time_with_its_tiles(tmp_path: Path) -> None:
    port = free_port()
    url = f"http://127.0.0.1:{port}"
    begun: list[str] = []
    ended: list[str] = []

    def ask(path: str) -> None:
        try:
            with httpx.stream("GET", url + path, timeout=60) as answer:
                begun.append(path)
                for _ in answer.iter_raw():
                    pass
            ended.append("closed")
        except httpx.TransportError:
            ended.append("cut")

    with server(tmp_path, port, settings=WHOLE) as process, Client(url) as client:
        job = client.submit(HEAVY)
        events = job.document["links"]["events"]
        paths = [events] * 20 + [EXTREME] * 3 + [f"{job.document['links']['map']}?variable=orbit_phase"] * 2
        wait_until(lambda: job.refresh().document["tiles_done"] >= 1)
        asking = [threading.Thread(target=ask, args=(path,)) for path in paths]
        for thread in asking:
            thread.start()
        # Two workers, the resource tracker of multiprocessing, and two processes for the points.
        wait_until(lambda: len(psutil.Process(process.pid).children(recursive=True)) >= 5)
        wait_until(lambda: begun.count(events) == 20)
        seconds = stop(process)
        for thread in asking:
            thread.join()
        assert seconds < SECONDS
        assert ended.count("closed") >= 20  # the streams, politely
    with sqlite3.connect(tmp_path / "jobs.sqlite") as database:
        state, tiles = database.execute("SELECT state, tiles_done FROM jobs").fetchone()
        rows = database.execute("SELECT count(*), sum(cells) FROM tiles").fetchone()
    assert state == "running"
    assert rows == (tiles, 36 * tiles)
    written = xr.open_zarr(tmp_path / "surveys" / f"{job.id}.zarr")["status"].values
    assert (written > 0).sum() >= 36 * tiles > 0


@pytest.mark.parametrize("after", [0.0, 1.0])
def test_a_service_ends_in_time_while_its_cluster_starts(tmp_path: Path, after: float) -> None:
    with server(tmp_path, free_port(), settings=WHOLE) as process:
        time.sleep(after)
        assert stop(process) < SECONDS
