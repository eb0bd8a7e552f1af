"""State that the routes of one application share, injected into them.

Dependencies that only look at the request are coroutines: FastAPI sends every other one to a thread, and each way there
and back waits for Python's lock.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated

from anyio import CancelScope, CapacityLimiter
from fastapi import Depends, Request

from gear_rattle.service.access.revocation import Revocations
from gear_rattle.service.database import Database
from gear_rattle.service.database.tables import JobKind, JobRow, State
from gear_rattle.service.errors import MissingError, UnavailableError
from gear_rattle.service.jobs.broadcast import Broadcast
from gear_rattle.service.jobs.directory import DataDirectory
from gear_rattle.service.jobs.manager import JobManager
from gear_rattle.service.kernels import Kernels
from gear_rattle.service.observability.metrics import Metrics
from gear_rattle.service.places import Places
from gear_rattle.service.settings import Settings
from gear_rattle.workers import Bucket


@dataclass(frozen=True)
class Front:
    """Everything a route may need; it lives as long as the application's lifespan."""

    settings: Settings
    directory: DataDirectory
    database: Database
    manager: JobManager
    broadcast: Broadcast
    metrics: Metrics
    pictures: CapacityLimiter
    exports: CapacityLimiter
    points: CapacityLimiter
    kernels: Kernels
    revocations: Revocations
    _interruptible: set[CancelScope] = field(default_factory=set)

    def stored(self, survey_id: str, kind: JobKind = JobKind.SURVEY) -> tuple[JobRow, Path | Bucket]:
        """Return a survey, or a population, and the place of its store. Blocks: for a thread.

        Returns
        -------
        tuple[JobRow, Path | Bucket]
            Row, and place.

        Raises
        ------
        UnknownSurveyError
            There is none of this kind.
        DirectoryAwayError
            The data directory is not there.
        """
        return self.database.job(survey_id, kind), self.directory.store(survey_id)

    def with_numbers(self, survey_id: str) -> tuple[JobRow, Path | Bucket]:
        """Return a survey, and the place of its store, which is there. Blocks: for a thread.

        Returns
        -------
        tuple[JobRow, Path | Bucket]
            Row, and place.

        Raises
        ------
        MissingError
            It has no numbers yet, or its store is gone.
        UnknownSurveyError, DirectoryAwayError
            As `stored`.
        """
        job, place = self.stored(survey_id)
        if place.exists():
            return job, place
        if job.cells_done or job.state == State.SUCCESSFUL:
            raise MissingError(
                f"The store of survey {survey_id} is gone: it was moved or deleted. Bring it back, or POST "
                f"/v1/surveys/{survey_id}/verify computes it anew."
            )
        raise MissingError(f"Survey {survey_id} is {job.state} and has no numbers yet. Try again once it runs.")

    @cached_property
    def windows(self) -> CapacityLimiter:
        """Windows of the plane that are refined at once."""
        return CapacityLimiter(self.settings.max_windows)

    @cached_property
    def slow_points(self) -> Places:
        """Slow parts of the views of points, of all pages: a process is left for what is quick."""
        return Places(max(1, self.settings.max_points - 1))

    @contextmanager
    def interruptible(self) -> Iterator[None]:
        """Work of a request that the end of the service cuts short, with UnavailableError."""
        with CancelScope() as scope:
            self._interruptible.add(scope)
            try:
                yield
            finally:
                self._interruptible.discard(scope)
        if scope.cancelled_caught:
            raise UnavailableError("The service is ending. Ask again when it is back.")

    def end(self) -> None:
        """Let everything come to its end that would take long; called in the event loop."""
        self.manager.ask_to_stop()
        for scope in tuple(self._interruptible):
            scope.cancel()


async def front_of(request: Request) -> Front:
    """Return the shared state of the application that got this request."""
    front: Front = request.app.state.front
    return front


FrontState = Annotated[Front, Depends(front_of)]
