"""Measure service, scheduler and job database with a survey of 10⁹ cells whose tiles compute nothing.

    PYTHONPATH=. python benchmarks/scale.py --seconds 300 --to-the-end

The service and the dask scheduler are real. The workers are simulated: each process has many, now and then one of them
leaves and a new one comes, and all tiles are copies of files that were encoded once. The program prints a table of
tiles, time per tile, memory and rows; then the time to resume after SIGKILL, and the time of `rattle verify` by one
process and by several. Processor times are printed too, because other programs on the machine do not change them.
"""

from __future__ import annotations

import argparse
import asyncio
import math
import os
import random
import signal
import socket
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import httpx
import psutil

HERE = Path(__file__).parent
SIDE, TILE = 31_623, 64
LIMITS = {
    "RATTLE_MAX_CELLS": str(2 * SIDE**2),
    "RATTLE_MAX_TILES": "1000000",
    "RATTLE_MAX_SAMPLES": str(10**12),
    "RATTLE_EXPLORER": "false",
    "RATTLE_PRELOAD": "false",
}
QUIET = {"DASK_DISTRIBUTED__ADMIN__LOW_LEVEL_LOG_LENGTH": "10"}  # the same setting as in deploy/
PROCESSES = 2  # number of processes with simulated workers
STAY_SECONDS = 10.0  # at this interval a worker leaves and a new worker comes


def free_port() -> int:
    """Return a free port of this computer."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def started(*command: str, **settings: str) -> Iterator[psutil.Process]:
    """Run a process for as long as the context lasts."""
    environment = os.environ | {"PYTHONPATH": str(HERE.parent)} | settings
    log = open(os.environ.get("SCALE_LOG", os.devnull), "a")  # noqa: SIM115 - closed at the end of the context
    with log, subprocess.Popen(command, env=environment, stdout=log, stderr=log) as process:
        try:
            yield psutil.Process(process.pid)
        finally:
            process.terminate()


def body(side: int) -> dict[str, Any]:
    """Return the request: regions over the plane of Figure 7, with `side` cells along each axis."""
    return {
        "delta": {"start": 0.4, "stop": 1.0, "num": side},
        "epsilon": {"start": 0.005, "stop": 0.3, "num": side},
        "quantities": ["region"],
        "tile": {"delta": TILE, "epsilon": TILE},
    }


async def simulate(url: str, number: int) -> None:
    """Simulate `number` workers; at regular intervals one of them leaves and a new worker comes."""
    from distributed import Worker

    from gear_rattle.workers.cluster import cluster, runner
    from gear_rattle.workers.storage import store
    from gear_rattle.workers.survey.manifest import file_digests
    from gear_rattle.workers.survey.tiles import TileRecord

    encoding = threading.Lock()

    @lru_cache(maxsize=8)
    def contents(request: Any, shape: tuple[int, ...]) -> list[bytes]:
        import numpy as np

        tile = next(each for each in runner_tiles(request) if _shape(each) == shape)
        _, arrays, _ = store._blank(request)
        return list(
            store._encode_tile(
                request,
                tile,
                {
                    name: np.ones(np.broadcast_to(0, each.shape)[tile.selection].shape, each.dtype)
                    for name, each in arrays.items()
                },
            ).values()
        )

    def nothing(request: Any, path: str, tile: Any, *_: Any) -> TileRecord:
        keys = store._chunk_keys(request, tile).values()
        with encoding:  # the workers of this process share one encoder
            written = dict(zip(keys, contents(request, _shape(tile)), strict=True))
        place = store._checked_store_location(path, request)
        for key, content in written.items():
            place.put(key, content)
        return TileRecord(tile.index, tile.n_cells, (), 0, 0.001, files=file_digests(written))

    def runner_tiles(request: Any) -> list[Any]:
        from gear_rattle.workers.survey.tiles import tiles_of

        return tiles_of(request)

    runner.advance_tile = nothing

    cluster.rattle.precompile = lambda *_, **__: None

    def begin() -> Any:
        return Worker(url, nthreads=1, memory_limit=0, dashboard=False, host="127.0.0.1", silence_logs=50)

    workers = [await begin() for _ in range(number)]
    while True:
        await asyncio.sleep(STAY_SECONDS)
        leaving = workers.pop(random.randrange(len(workers)))
        with suppress(Exception):
            await leaving.close()
        workers.append(await begin())


def _shape(tile: Any) -> tuple[int, ...]:
    return tuple(span.stop - span.start for span in tile.spans)


def mebibytes(process: psutil.Process) -> int:
    """Return the resident memory of a process in MiB."""
    return int(process.memory_info().rss / 2**20)


def processor_seconds(process: psutil.Process) -> float:
    """Return the processor time of a process so far."""
    times = process.cpu_times()
    return float(times.user + times.system)


def rows_in(database: Path) -> dict[str, int]:
    """Return the number of rows of each table of the job database."""
    with sqlite3.connect(f"file:{database}?mode=ro", uri=True) as connection:
        names = [name for (name,) in connection.execute("select name from sqlite_master where type = 'table'")]
        return {name: connection.execute(f"select count(*) from {name}").fetchone()[0] for name in names}


@contextmanager
def service(data: Path, scheduler: str) -> Iterator[tuple[str, psutil.Process]]:
    """Run the service with a scheduler; yield the address and the process of the service."""
    port = free_port()
    command = [sys.executable, "-m", "gear_rattle.cli", "serve", "--port", str(port), "--data", str(data)]
    with started(*command, "--scheduler", scheduler, **LIMITS) as process:
        url = f"http://127.0.0.1:{port}"
        while True:
            with suppress(httpx.TransportError):
                if httpx.get(f"{url}/v1/health", timeout=60).json()["cluster"] == "ready":
                    break
            time.sleep(0.5)
        yield url, process


def tiles_done(url: str, survey: str) -> int:
    """Return the number of finished tiles of a survey."""
    return int(httpx.get(f"{url}{survey}", timeout=600).json()["tiles_done"])


def watch(url: str, survey: str, seconds: float, watched: dict[str, psutil.Process], until: int | None = None) -> int:
    """Print ten lines within `seconds`: finished tiles, time per tile, memory. Return the tiles at the end.

    until: if given, lines are printed at the same intervals until this many tiles are finished.
    """
    began, before = time.monotonic(), tiles_done(url, survey)
    last, spent = began, [processor_seconds(each) for each in watched.values()]
    while (before < until) if until else (last - began < seconds):
        time.sleep(seconds / 10)
        now, done = time.monotonic(), tiles_done(url, survey)
        memory = " | ".join(str(mebibytes(each)) for each in watched.values())
        pace = 1e3 * (now - last) / max(done - before, 1)
        spends = [processor_seconds(each) for each in watched.values()]
        each = " | ".join(f"{1e3 * (b - a) / max(done - before, 1):.1f}" for a, b in zip(spent, spends, strict=True))
        print(f"| {now - began:.0f} | {done:,} | {pace:.1f} | {each} | {memory} |", flush=True)
        last, before, spent = now, done, spends
    return before


def main() -> None:
    """Run the measurements and print them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--workers", type=int, default=64)
    parser.add_argument("--side", type=int, default=SIDE)
    parser.add_argument("--to-the-end", action="store_true", help="after the restart, wait until the survey is done")
    parser.add_argument("--simulate", metavar="URL")
    given = parser.parse_args()
    if given.simulate:
        asyncio.run(simulate(given.simulate, given.workers))
        return
    port = free_port()
    address = f"tcp://127.0.0.1:{port}"
    dask = (sys.executable, "-m", "dask", "scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
    ours = (sys.executable, __file__, "--simulate", address, "--workers", str(given.workers // PROCESSES))
    with tempfile.TemporaryDirectory(prefix="rattle-scale-") as directory, started(*dask, **QUIET) as scheduler:
        data = Path(directory) / "data"
        with started(*ours), started(*ours):
            with service(data, address) as (url, front):
                began = time.monotonic()
                survey = httpx.post(f"{url}/v1/surveys", json=body(given.side), timeout=600).json()["links"]["self"]
                while not tiles_done(url, survey):
                    time.sleep(0.1)
                print(
                    f"first tile after {time.monotonic() - began:.1f} s, {processor_seconds(front):.1f} s of the front"
                )
                print("| s | tiles | ms a tile | of the front | of the scheduler | front, MiB | scheduler, MiB |")
                print("|---|---|---|---|---|---|---|", flush=True)
                done = watch(url, survey, given.seconds, {"front": front, "scheduler": scheduler})
                print("rows:", rows_in(data / "jobs.sqlite"), flush=True)
                front.send_signal(signal.SIGKILL)
            began = time.monotonic()
            with service(data, address) as (url, front):
                for more in (0, 100):
                    while tiles_done(url, survey) <= done + more:
                        time.sleep(0.1)
                    print(
                        f"{more + 1} more tiles {time.monotonic() - began:.1f} s after the restart, "
                        f"{processor_seconds(front):.1f} s of the front, {mebibytes(front)} MiB",
                        flush=True,
                    )
                if given.to_the_end:
                    number = math.ceil(given.side / TILE) ** 2
                    watch(url, survey, given.seconds, {"front": front, "scheduler": scheduler}, number)
                    last_tile = time.monotonic()
                    while (state := httpx.get(f"{url}{survey}", timeout=600).json()["state"]) == "running":
                        time.sleep(1)
                    print(
                        f"{state} {time.monotonic() - last_tile:.0f} s after the last tile; front "
                        f"{mebibytes(front)} MiB, scheduler {mebibytes(scheduler)} MiB",
                        flush=True,
                    )
                    print("rows:", rows_in(data / "jobs.sqlite"), flush=True)
        (store,) = (data / "surveys").glob("*.zarr")
        command = [sys.executable, "-m", "gear_rattle.cli", "verify", str(store), "--processes"]
        for processes in (1, PROCESSES):
            began, before = time.monotonic(), sum(os.times()[2:4])
            verified = subprocess.run([*command, str(processes)], capture_output=True, text=True, check=False)
            print(
                f"verified by {processes} in {time.monotonic() - began:.1f} s, "
                f"{sum(os.times()[2:4]) - before:.1f} s of processors: {verified.stdout.strip()}",
                flush=True,
            )


if __name__ == "__main__":
    main()
