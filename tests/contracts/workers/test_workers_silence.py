"""Which silent workers are taken for frozen, without a cluster: their processes are here, the clock is the test's."""

import asyncio
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import distributed.scheduler
import psutil
import pytest
from waiting import wait_until

from workers.cluster import parts

PATIENCE = 5  # seconds of silence; dask makes it no less
LONG = 1000.0


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(distributed.scheduler, "time", clock)
    monkeypatch.setattr(parts, "time", SimpleNamespace(time=clock))
    return clock


@pytest.fixture
def busy() -> Iterator[int]:
    """A process that always has something to do."""
    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as process:
        yield process.pid
        process.kill()


def ended(pid: int, clock: Clock, steps: list[Callable[[Any], None]]) -> list[int]:
    """The numbers of the steps after which the worker of a process is ended, each LONG after the one before."""

    async def run() -> list[int]:
        scheduler = parts.SilentScheduler(host="127.0.0.1", dashboard=False, worker_ttl=PATIENCE)
        worker = SimpleNamespace(pid=pid, last_seen=clock.now, address="tls://127.0.0.1:1", nanny="tls://127.0.0.1:2")
        scheduler.workers[worker.address] = worker
        restarted = list[list[str]]()

        async def restart(addresses: list[str], **_: Any) -> None:
            restarted.append(addresses)

        scheduler.restart_workers = restart
        found = list[int]()
        for number, step in enumerate(steps):
            clock.now += LONG
            step(worker)
            restarted.clear()
            await scheduler.check_worker_ttl()
            found += [number for addresses in restarted if addresses == [worker.address]]
        return found

    return asyncio.run(run())


def gets_on(worker: Any) -> None:
    """Wait until the process has used some processor time."""
    before = parts.processor_seconds(worker.pid)
    wait_until(lambda: parts.processor_seconds(worker.pid) > before)


def frozen(worker: Any) -> None:
    os.kill(worker.pid, signal.SIGSTOP)
    wait_until(lambda: psutil.Process(worker.pid).status() == psutil.STATUS_STOPPED)


def nothing(worker: Any) -> None:
    pass


def test_a_worker_that_is_only_slow_goes_on(busy: int, clock: Clock) -> None:
    assert ended(busy, clock, [nothing, gets_on, gets_on, gets_on]) == []


def test_a_frozen_worker_is_ended(busy: int, clock: Clock) -> None:
    # At the second step it may have got on since the first, at the third not.
    assert ended(busy, clock, [gets_on, frozen, nothing])[-1:] == [2]


def test_a_worker_whose_process_is_gone_is_ended(busy: int, clock: Clock) -> None:
    def killed(worker: Any) -> None:
        process = psutil.Process(worker.pid)
        process.kill()
        process.wait()

    assert ended(busy, clock, [gets_on, killed]) == [1]


def test_a_worker_that_computes_without_a_word_is_ended(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    used = iter([1.0, 1.0 + 0.5 * PATIENCE, 1.0 + PATIENCE, 2.0 + PATIENCE])
    monkeypatch.setattr(parts, "processor_seconds", lambda _: next(used))

    def speaks(worker: Any) -> None:
        worker.last_seen = clock.now - LONG / 2

    assert ended(1, clock, [nothing, nothing, nothing, speaks]) == [2]
