"""Publish the status of surveys to all open pages after each change. One reading of the database serves all pages."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy.exc import SQLAlchemyError
from starlette.concurrency import run_in_threadpool

from gear_rattle.service.database.tables import JobRow, State
from gear_rattle.service.errors import UnavailableError
from gear_rattle.service.operations.surveys import list_jobs
from gear_rattle.service.state import ApplicationState

LISTED = 100  # the list of a page shows at most this many surveys, the newest ones
PAUSE_SECONDS = 0.5  # least seconds between two readings of the database; a new listener ends this pause early
RATE_SECONDS = 20.0  # seconds over which the rate of a running survey is measured


@dataclass(frozen=True)
class JobStatus:
    """Status of a survey.

    rate: computed cells per second, None if not known. seconds_left: predicted seconds until the survey's last tile is
    computed, None if not known or if the survey is not running.
    """

    job: JobRow
    rate: float | None
    seconds_left: float | None


Listener = Callable[[Sequence[JobStatus]], None]
log = logging.getLogger(__name__)


class StatusPublisher:
    """Publisher of job status to listeners in the event loop: soon after a listener joins, and after every change.

    A new listener gets no status that was read before it joined, because a page chooses its default survey from the
    first status that it gets.
    """

    def __init__(self, front: ApplicationState) -> None:
        self._front = front
        self._listeners: set[Listener] = set()
        self._stale, self._arrived = asyncio.Event(), asyncio.Event()
        self._past: dict[str, list[tuple[float, int]]] = {}  # (time, cells done) of each running survey, by its id

    @asynccontextmanager
    async def publish_status(self) -> AsyncIterator[None]:
        """Publish status inside this context, which lasts as long as the application runs."""
        loop = asyncio.get_running_loop()

        def on_change(_survey_id: str) -> None:
            if not loop.is_closed():
                loop.call_soon_threadsafe(self._stale.set)

        keeper = asyncio.create_task(self._publish_changes())
        try:
            with self._front.broadcast.watch(on_change):
                yield
        finally:
            keeper.cancel()

    def add_listener(self, listener: Listener) -> None:
        """Add a listener, and publish the status soon."""
        self._listeners.add(listener)
        self._stale.set()
        self._arrived.set()

    def remove_listener(self, listener: Listener) -> None:
        """Remove a listener."""
        self._listeners.discard(listener)

    async def _publish_changes(self) -> None:
        while True:
            await self._stale.wait()
            self._stale.clear()
            self._arrived.clear()
            if not (listeners := tuple(self._listeners)):
                continue
            try:
                jobs, _ = await run_in_threadpool(list_jobs, self._front, LISTED)
            except (SQLAlchemyError, UnavailableError) as error:
                log.warning("the surveys cannot be listed for the explorer: %s", error)
                self._stale.set()
            else:
                statuses = [self._measure_job_status(job, time.monotonic()) for job in jobs]
                for listener in self._listeners.intersection(listeners):
                    listener(statuses)
            with suppress(TimeoutError):  # a new listener ends the pause early
                await asyncio.wait_for(self._arrived.wait(), PAUSE_SECONDS)

    def _measure_job_status(self, job: JobRow, now: float) -> JobStatus:
        if job.state != State.RUNNING:
            self._past.pop(job.id, None)
            return JobStatus(job, mean_cells_per_second(job), None)
        past = self._past.setdefault(job.id, [])
        past.append((now, job.cells_done))
        while len(past) > 2 and past[1][0] < now - RATE_SECONDS:
            past.pop(0)
        (began, before), (ended, after) = past[0], past[-1]
        rate = (after - before) / (ended - began) if ended > began and after > before else None
        return JobStatus(job, rate, self._front.manager.seconds_left(job.id))


def mean_cells_per_second(job: JobRow) -> float | None:
    """Return a survey's mean cells per second from start to end; None if it has not ended or computed no cells."""
    if not (job.started and job.finished and job.cells_done):
        return None
    seconds = (datetime.fromisoformat(job.finished) - datetime.fromisoformat(job.started)).total_seconds()
    return job.cells_done / seconds if seconds > 0 else None
