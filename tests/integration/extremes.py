"""Surveys with extreme but valid requests: `PYTHONPATH=tests python tests/integration/extremes.py [WORD …]`.

This takes minutes, so it is not part of the test suite. Each survey is submitted twice: the first runs until it ends or
until `--seconds` are over, the second is dismissed while it runs. For each survey, the program prints how it ended, the
most memory that all processes of the service had together (shared pages counted once), and the seconds from DELETE
until the store can be removed. Only surveys whose name contains one of the words run.
"""

import argparse
import subprocess
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil
from service_processes import client_of, free_port, server

from gear_rattle.service.client import FINAL, Client, Job
from gear_rattle.service.errors import ResponseError

PLACE = {"delta": (0.6, 0.61, 2), "epsilon": (0.1, 0.11, 2)}
STIFF = PLACE | {"model": "stiff"}
WIDE = {"tile": {"delta": 32_768, "epsilon": 2}, "initial_conditions": {"count": 4}}
TALL = {"tile": {"delta": 2, "epsilon": 32_768}, "initial_conditions": {"count": 4}}
SURVEYS: dict[str, dict[str, Any]] = {
    "2 × 2": PLACE,
    "2 × 2, two neighbouring doubles": PLACE | {"delta": (0.5, 0.5000000000000001, 2)},
    "δ = 1e-6": PLACE | {"delta": (1e-6, 2e-6, 2), "epsilon": (1e-7, 2e-7, 2)},
    "δ = 1e-6, ε = 0.1": PLACE | {"delta": (1e-6, 2e-6, 2)},
    "δ = 1e-3": PLACE | {"delta": (1e-3, 2e-3, 2)},
    "δ = 1e6": PLACE | {"delta": (1e6, 2e6, 2)},
    "δ = 1e300": PLACE | {"delta": (1e300, 2e300, 2)},
    "β = 1e-9": PLACE | {"beta": 1e-9},
    "β = 1e300": PLACE | {"beta": 1e300},
    "ε = 1e15": PLACE | {"epsilon": (1e15, 2e15, 2)},
    "ε = 1e300": PLACE | {"epsilon": (1e300, 2e300, 2)},
    "κ = 5e-324": STIFF | {"kappa": 5e-324},
    "κ = 1": STIFF | {"kappa": 1.0},
    "κ = 1e8": STIFF | {"kappa": 1e8},
    "κ = 1e300": STIFF | {"kappa": 1e300},
    "4096 samples, basins": PLACE | {"quantities": ["attractors", "basins"], "initial_conditions": {"count": 4096}},
    "10⁶ × 1": PLACE | {"delta": (0.4, 1.0, 1_000_000), "epsilon": (0.1, 0.1, 1)},
    "10⁶ × 2": PLACE | WIDE | {"delta": (0.4, 1.0, 1_000_000)},
    "2 × 10⁶": PLACE | TALL | {"epsilon": (0.0, 0.3, 1_000_000)},
}
LIMITS = {"RATTLE_MAX_CELLS": "2000000"}
POLL = 0.1
BEGUN = 2.0  # seconds that a survey runs before it is dismissed
MEBIBYTE = 2**20


def main() -> None:
    """Submit, measure and dismiss each survey, and print a row of a table for it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("words", nargs="*")
    parser.add_argument("--seconds", type=float, default=60.0, help="after which a survey is dismissed")
    known = parser.parse_args()
    port = free_port()
    with (
        tempfile.TemporaryDirectory() as directory,
        server(Path(directory), port, "--workers", "2", settings=LIMITS, stderr=subprocess.DEVNULL) as service,
        client_of(port) as client,
    ):
        used = Memory(service.pid)
        client.submit(PLACE).wait()
        client.submit(STIFF | {"kappa": 1e4}).wait()
        print("| survey | end | memory, MiB | DELETE, s |\n|---|---|---|---|", flush=True)
        print(f"| none | | {used.now():.0f} | |", flush=True)
        for name, fields in SURVEYS.items():
            if not known.words or any(word in name for word in known.words):
                print(f"| {name} | {' | '.join(row(client, fields, used, known.seconds))} |", flush=True)


class Memory:
    """Resident memory of a process and all its descendants, in MiB; `most` is the largest value measured."""

    def __init__(self, pid: int) -> None:
        self._process = psutil.Process(pid)
        self.most = 0.0

    def now(self) -> float:
        """Measure the memory, and return it."""
        total = 0
        for each in [self._process, *self._process.children(recursive=True)]:
            with suppress(psutil.NoSuchProcess):
                total += each.memory_full_info().pss
        self.most = max(self.most, total / MEBIBYTE)
        return total / MEBIBYTE


def row(client: Client, fields: dict[str, Any], used: Memory, seconds: float) -> tuple[str, str, str]:
    """Return how a survey ends, the most memory meanwhile, and how long its dismissal takes."""
    used.most = 0.0
    began = time.monotonic()
    try:
        job = client.submit(fields, force=True)
    except ResponseError as error:
        return f"refused: {error}", "", ""
    passed(lambda: ended(job), used, seconds)
    end = f"{job.state} after {time.monotonic() - began:.1f} s"
    if job.state == "failed":
        end += f": {job.document['message']}"
    if job.state in FINAL:
        job.delete()
        job = client.submit(fields, force=True)
        passed(lambda: running(job), used, seconds)
        passed(lambda: ended(job), used, BEGUN)
    return end, f"{used.most:.0f}", dismissed(job, used)


def ended(job: Job) -> bool:
    return job.refresh().state in FINAL


def running(job: Job) -> bool:
    return job.refresh().state != "accepted"


def passed(condition: Callable[[], bool], used: Memory, seconds: float) -> None:
    """Measure the memory until the condition holds, or `seconds` are over."""
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        used.now()
        time.sleep(POLL)


def dismissed(job: Job, used: Memory) -> str:
    """Return the seconds from the first DELETE until the DELETE that removes the store."""
    if ended(job):
        job.delete()
        return "ends before"
    began = time.monotonic()
    job.delete()
    while True:
        try:
            job.delete()
            return f"{time.monotonic() - began:.1f}"
        except ResponseError as error:
            if error.status != 409:  # 409: its last tiles are still being stopped
                raise
        used.now()
        time.sleep(POLL)


if __name__ == "__main__":
    main()
