"""The job manager: one thread that runs the surveys of the database in order, on a cluster that may come and go."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

from distributed.comm import CommClosedError
from pydantic import ValidationError
from sqlalchemy.exc import SQLAlchemyError

from rattle import RattleError
from service.database import Database, DoneTile
from service.datadir import DataDirectory
from service.errors import ConflictError, ServiceError, UnavailableError
from service.tables import JobRow, State
from workers import ClusterLostError, SurveyRequest, create_store, finish_store, run_tiles, tiles_done, tiles_of

if TYPE_CHECKING:
    from distributed import Client

    from workers import TileRecord

FIRST_PAUSE, LONGEST_PAUSE = 1.0, 30.0
MAX_FAILURES = 100  # messages kept of one tile

log = logging.getLogger(__name__)


class JobManager:
    """Runs accepted surveys, one after the other, and resumes those that an earlier process left unfinished.

    Args:
        database: the truth about the surveys.
        directory: where their stores are.
        cluster: opens the dask cluster; called again whenever it was lost.
    """

    def __init__(
        self,
        database: Database,
        directory: DataDirectory,
        cluster: Callable[[], AbstractContextManager[Client]],
    ) -> None:
        self._database = database
        self._directory = directory
        self._cluster = cluster
        self._wake = threading.Event()
        self._stopping = threading.Event()
        self._dismissed = threading.Event()
        self._current: str | None = None
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._main, name="job-manager", daemon=True)
        self.cluster_state = "starting"

    def start(self) -> None:
        self._thread.start()

    def ask_to_stop(self) -> None:
        """Let the thread come to its end. The survey at work stays resumable."""
        self._stopping.set()
        self._wake.set()

    def stop(self) -> None:
        """End the thread and close the cluster."""
        self.ask_to_stop()
        self._thread.join()

    def wake(self) -> None:
        """Look into the database: there may be work."""
        self._wake.set()

    def dismiss_or_delete(self, survey_id: str) -> JobRow | None:
        """Dismiss a survey that waits or runs, delete one that has ended.

        Returns:
            The dismissed survey, or None after a deletion.

        Raises:
            UnknownSurveyError: there is no such survey.
            ConflictError: it was dismissed, but tiles of it are still being computed.
        """
        self._database.job(survey_id)
        if self._database.set_state(survey_id, State.DISMISSED, "dismissed by request"):
            with self._lock:
                if self._current == survey_id:
                    self._dismissed.set()
            return self._database.job(survey_id)
        with self._lock:
            if self._current == survey_id:
                raise ConflictError(f"Survey {survey_id} is dismissed, but its last tiles still run. Try again soon.")
            self._directory.remove_store(survey_id)
            self._database.delete(survey_id)
        return None

    def _main(self) -> None:
        pause = FIRST_PAUSE
        while not self._stopping.is_set():
            self.cluster_state = "starting"
            try:
                with self._cluster() as client:
                    self.cluster_state, pause = "ready", FIRST_PAUSE
                    self._run_all(client)
            except Exception as error:
                unexpected = None if isinstance(error, RattleError) else error
                log.warning("no cluster or no database, next try in %.0f s: %s", pause, error, exc_info=unexpected)
                self.cluster_state = f"unavailable: {error}"
                self._stopping.wait(pause)
                pause = min(2 * pause, LONGEST_PAUSE)

    def _run_all(self, client: Client) -> None:
        """Run surveys until the end of the service, or until one is dismissed while it runs."""
        while not self._interrupted():
            self._wake.clear()
            job = self._database.next_job()
            if job is None:
                self._wake.wait()
                continue
            with self._lock:
                self._current = job.id
            try:
                self._run(job, client)
            finally:
                with self._lock:
                    self._current = None
        # Tiles that have begun cannot be interrupted: a new cluster starts without those of a dismissed survey.
        self._dismissed.clear()

    def _run(self, job: JobRow, client: Client) -> None:
        try:
            self._compute(job, client)
        except (ClusterLostError, CommClosedError, SQLAlchemyError, UnavailableError):
            raise  # not the survey's fault: it goes on later
        except Exception as error:
            unexpected = None if isinstance(error, RattleError) else error
            log.warning("survey %s failed: %s", job.id, error, exc_info=unexpected)
            self._database.set_state(job.id, State.FAILED, str(error) or type(error).__name__)

    def _compute(self, job: JobRow, client: Client) -> None:
        if not self._database.set_state(job.id, State.RUNNING):
            return  # dismissed since it was read
        request = _request_of(job)
        path = self._directory.store(job.id)
        create_store(request, path)
        if job.content_hash != request.content_hash():
            self._database.set_content_hash(job.id, request.content_hash())
        # A tile counts only if both agree: the database knows its failures, the store holds its numbers.
        done = self._database.tiles_done(job.id) & tiles_done(request, path)
        self._database.keep_tiles(job.id, done)
        missing = [tile for tile in tiles_of(request) if tile.index not in done]
        run_tiles(request, path, missing, client, lambda tile: self._record(job.id, tile), self._interrupted)
        if not self._interrupted():
            finish_store(path)
            self._database.set_state(job.id, State.SUCCESSFUL)

    def _interrupted(self) -> bool:
        return self._stopping.is_set() or self._dismissed.is_set()

    def _record(self, survey_id: str, tile: TileRecord) -> None:
        first = tile.failed_cells[:MAX_FAILURES]
        failures = [{"epsilon": i, "delta": j, "message": message} for i, j, message in first]
        failed = len(tile.failed_cells)
        self._database.add_tile(survey_id, DoneTile(tile.index, tile.cells, tile.seconds, failed, failures))


def _request_of(job: JobRow) -> SurveyRequest:
    try:
        return SurveyRequest.model_validate(job.request)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ServiceError(
            f"The request is no longer valid in this version ({where}: {first['msg']}). Submit it anew."
        ) from error
