"""The state that all routes of an application share. FastAPI injects it into the routes.

Dependencies that read only the request are coroutines, because FastAPI runs all other dependencies in threads, and each
change of thread waits for the GIL.
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

from gear_rattle.service.access.revocation import RevocationWatcher
from gear_rattle.service.database import Database
from gear_rattle.service.database.tables import JobKind, JobRow, State
from gear_rattle.service.errors import MissingPartError, UnavailableError
from gear_rattle.service.jobs.broadcast import SurveyEventBroadcaster
from gear_rattle.service.jobs.directory import DataDirectory
from gear_rattle.service.jobs.manager import JobManager
from gear_rattle.service.kernels import KernelCompiler
from gear_rattle.service.limiter import PriorityLimiter
from gear_rattle.service.observability.metrics import Metrics
from gear_rattle.service.settings import Settings
from gear_rattle.workers import StoreInBucket


@dataclass(frozen=True)
class ApplicationState:
    """The state of an application that its routes need. It exists during the application's lifespan.

    picture_limiter: limits how many pictures are drawn at the same time. export_limiter: limits how many files are
    written at the same time. point_limiter: limits how many parameter points are computed at the same time.
    """

    settings: Settings
    directory: DataDirectory
    database: Database
    manager: JobManager
    broadcast: SurveyEventBroadcaster
    metrics: Metrics
    picture_limiter: CapacityLimiter
    export_limiter: CapacityLimiter
    point_limiter: CapacityLimiter
    kernels: KernelCompiler
    revocations: RevocationWatcher
    _interruptible: set[CancelScope] = field(default_factory=set)

    def find_job_and_store(self, survey_id: str, kind: JobKind = JobKind.SURVEY) -> tuple[JobRow, Path | StoreInBucket]:
        """Return the row of a survey or a population, and the location of its store. This call blocks: use a thread.

        Returns
        -------
        tuple[JobRow, Path | StoreInBucket]
            The row, and the location.

        Raises
        ------
        UnknownSurveyError
            There is no job of this kind with this id.
        DirectoryMissingError
            The data directory is missing.
        """
        return self.database.job(survey_id, kind), self.directory.store(survey_id)

    def find_job_and_existing_store(self, survey_id: str) -> tuple[JobRow, Path | StoreInBucket]:
        """Return the row of a survey and the location of its store, if the store exists. The call blocks: use a thread.

        Returns
        -------
        tuple[JobRow, Path | StoreInBucket]
            The row, and the location.

        Raises
        ------
        UnknownSurveyError, DirectoryMissingError
            See `find_job_and_store`.
        MissingPartError
            The survey has no stored values, or its store is gone.
        """
        job, place = self.find_job_and_store(survey_id)
        if place.exists():
            return job, place
        if job.cells_done or job.state == State.SUCCESSFUL:
            raise MissingPartError(
                f"The store of survey {survey_id} is gone: it was moved or deleted. Restore it, or compute it "
                f"again with POST /v1/surveys/{survey_id}/verify."
            )
        if State(job.state).is_final:
            raise MissingPartError(f"Survey {survey_id} is {job.state} and has no stored values. Submit it again.")
        raise MissingPartError(
            f"Survey {survey_id} is {job.state} and has no stored values yet. Try again when its first tile is done."
        )

    @cached_property
    def window_limiter(self) -> CapacityLimiter:
        """The limiter of computations of finer windows: at most `Settings.max_windows` run at the same time."""
        return CapacityLimiter(self.settings.max_windows)

    @cached_property
    def slow_point_limiter(self) -> PriorityLimiter:
        """Limiter of slow computations at points. If `max_points` exceeds 1, one process is left for quick ones."""
        return PriorityLimiter(max(1, self.settings.max_points - 1))

    @contextmanager
    def interruptible_work(self) -> Iterator[None]:
        """Run the work of this context so that `end` can cancel it. Raises UnavailableError if it was cancelled."""
        with CancelScope() as scope:
            self._interruptible.add(scope)
            try:
                yield
            finally:
                self._interruptible.discard(scope)
        if scope.cancelled_caught:
            raise UnavailableError("The service is ending. Try again when the service runs again.")

    def end(self) -> None:
        """Cancel all interruptible work, and ask the job manager to end. This must be called in the event loop."""
        self.manager.ask_to_stop()
        for scope in tuple(self._interruptible):
            scope.cancel()


async def front_of(request: Request) -> ApplicationState:
    """Return the shared state of the application of a request."""
    front: ApplicationState = request.app.state.front
    return front


FrontState = Annotated[ApplicationState, Depends(front_of)]
