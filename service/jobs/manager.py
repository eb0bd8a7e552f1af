"""The job manager: one thread that runs the surveys of the database by turns, on a cluster that may come and go."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import TYPE_CHECKING

from distributed.comm import CommClosedError
from pydantic import ValidationError
from sqlalchemy.exc import SQLAlchemyError

from gear_rattle.service.database import Database, DoneTile
from gear_rattle.service.database.tables import UNREADABLE, JobRow, State
from gear_rattle.service.errors import ConflictError, DirectoryAwayError, ServiceError, UnavailableError
from gear_rattle.service.jobs.directory import DataDirectory
from gear_rattle.service.jobs.turns import Turns
from gear_rattle.service.observability.logs import about
from gear_rattle.workers import (
    Begun,
    ClusterLostError,
    StoppedError,
    StorageError,
    complete_on,
    create_store,
    finish_store,
    is_incomplete,
    request_of,
    run_tiles,
    template_on,
    tiles_done,
    tiles_of,
)
from gear_rattle.workers.kinds import place_of_cell
from gear_rattle.workers.survey.axes import place_and_reason
from rattle import RattleError

if TYPE_CHECKING:
    from pathlib import Path

    from distributed import Client

    from gear_rattle.workers import AnyRequest, Bucket, TileRecord
    from gear_rattle.workers.kinds import AnyTile
    from gear_rattle.workers.survey.template import Template

FIRST_PAUSE, LONGEST_PAUSE = 1.0, 30.0
OK, READY, STARTING = "ok", "ready", "starting"
WORKERS_SECONDS = 2.0
LAST_TILES_SECONDS = 3.0  # a deletion waits for them; dismissal stops work within 2
MAX_FAILURES = 100  # messages kept of one tile

log = logging.getLogger(__name__)


class JobManager:
    """Runs accepted surveys, one at a time by turns, and resumes those that an earlier process left unfinished.

    Parameters
    ----------
    database
        The truth about the surveys.
    directory
        Where their stores are.
    cluster
        Opens the dask cluster, unless its argument says that start-up was cancelled; called again whenever the
        cluster was lost.
    on_tile
        Told of every tile that has been written.
    turns
        Whose turn comes next, and when.
    """

    def __init__(
        self,
        database: Database,
        directory: DataDirectory,
        cluster: Callable[[Callable[[], bool]], AbstractContextManager[Client]],
        on_tile: Callable[[TileRecord], None] = lambda _: None,
        turns: Turns | None = None,
    ) -> None:
        self._on_tile = on_tile
        self._turns = turns or Turns()
        self._left: dict[str, dict[int, AnyTile]] = {}  # tiles of surveys that another turn goes on with, by index
        self._begun: dict[str, Begun] = {}  # of these surveys and the one at work
        self._ends: dict[str, float] = {}  # of the survey at work: when its tiles will have ended, by `time.monotonic`
        self._client: Client | None = None
        self._database = database
        self._directory = directory
        self._cluster = cluster
        self._wake = threading.Event()
        self._stopping = threading.Event()
        self._dismissed = threading.Event()
        self._current: str | None = None
        self._lock = threading.Condition()  # told when `_current` is let go of
        self._thread = threading.Thread(target=self._main, name="job-manager", daemon=True)
        self.cluster_state = STARTING
        self.storage_state = OK

    def start(self) -> None:
        """Start the thread."""
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

        Returns
        -------
        JobRow | None
            The dismissed survey, or None after a deletion.

        Raises
        ------
        UnknownSurveyError
            There is no such survey.
        ConflictError
            It was dismissed, but tiles of it have been computed for long since; or it runs again.
        DirectoryAwayError
            It cannot be deleted where it is not.
        """
        self._database.job(survey_id)
        if self._database.set_state(survey_id, State.DISMISSED, "dismissed by request"):
            with self._lock:
                if self._current == survey_id:
                    self._dismissed.set()
            self.wake()
            return self._database.job(survey_id)
        with self._lock:
            if not self._lock.wait_for(lambda: self._current != survey_id, LAST_TILES_SECONDS):
                raise ConflictError(f"Survey {survey_id} has ended, but its last tiles still run. Try again soon.")
            if not State((job := self._database.job(survey_id)).state).final:
                raise ConflictError(f"Survey {survey_id} is {job.state} again; dismiss it first.")
            self._directory.require()
            self._database.begin_deletion(survey_id)  # or a crash would leave a survey that seems whole
            self._directory.remove_store(survey_id)
            self._database.delete(survey_id)
        return None

    def verify(self, survey_id: str, owner: str | None, max_jobs: int) -> JobRow:
        """Let a survey that has ended, or was dismissed, run again over the tiles that are damaged or missing.

        Returns
        -------
        JobRow
            Row of the survey.

        Raises
        ------
        UnknownSurveyError
            There is no such survey.
        ConflictError
            It waits or runs, is being deleted, or is a successful one of another version.
        QueueFullError
            ``max_jobs`` surveys are waiting or running, or as many as the key of ``owner`` allows.
        """
        job = self._database.job(survey_id)
        if not job.is_readable:
            raise ConflictError(UNREADABLE)
        if job.state == State.SUCCESSFUL and not _is_of_this_version(job):  # running it would only make it fail
            raise ConflictError(
                f"Survey {survey_id} was computed by another version, and only that one can verify it. Submit it anew."
            )
        with self._lock:  # not between a deletion's look at the state and its removal of the store
            job = self._database.reopen(survey_id, owner, max_jobs)
            if self._current == survey_id:  # the run that was dismissed is at its end, and is not this one
                self._dismissed.set()
        self.wake()
        return job

    def _main(self) -> None:
        pause = FIRST_PAUSE
        while not self._stopping.is_set():
            self.cluster_state = STARTING
            try:
                with self._cluster(self._stopping.is_set) as client:
                    self.cluster_state, pause = READY, FIRST_PAUSE
                    self._client = client
                    try:
                        self._run_all(client)
                    finally:
                        self._client = None
            except Exception as error:
                if self._stopping.is_set():  # which ended the cluster as it started
                    return
                unexpected = None if isinstance(error, RattleError) else error
                log.warning("no cluster or no database, next try in %.0f s: %s", pause, error, exc_info=unexpected)
                self.cluster_state = f"unavailable: {error}"
                self._stopping.wait(pause)
                pause = min(2 * pause, LONGEST_PAUSE)

    def _run_all(self, client: Client) -> None:
        """Run surveys until the end of the service, or until the cluster is lost."""
        pause = FIRST_PAUSE
        while not self._stopping.is_set():
            self._wake.clear()
            if self._stopping.is_set():  # since the loop asked: that call to wake up has just been cleared
                return
            if client.status != "running":
                raise ClusterLostError("the connection to the dask scheduler is lost")
            try:
                found = self._run_next(client)
                self.storage_state = OK
                if not found:
                    self._wake.wait()
            except (StorageError, DirectoryAwayError, SQLAlchemyError) as error:  # a full disk shows in two of them
                pause = FIRST_PAUSE if self.storage_state == OK else min(2 * pause, LONGEST_PAUSE)
                log.warning("nothing can be stored, next try in %.0f s: %s", pause, error)
                self.storage_state = f"unavailable: {error}"
                self._wake.wait(pause)

    def _run_next(self, client: Client) -> bool:
        """Run the survey whose turn it is. False if there is none."""
        active = self._database.active()
        job = self._turns.next(active)
        if job is None:
            return False
        self._turns.begin(job)
        self._left = {each.id: self._left[each.id] for each in active if each.id in self._left}
        self._begun = {each: begun for each, begun in self._begun.items() if each in self._left}
        self._database.give_turn(job.id)
        with self._lock:
            self._current = job.id
            self._dismissed.clear()
        try:
            with about(job.id):
                self._run(job.id, client)
        finally:
            self._ends = {}
            with self._lock:
                self._current = None
                self._lock.notify_all()
        return True

    def _run(self, survey_id: str, client: Client) -> None:
        try:
            with self._blaming_directory():
                self._compute(survey_id, client)
        except StoppedError:
            return
        except DirectoryAwayError as error:
            self._say_that_it_waits(survey_id, error)
            raise
        except (ClusterLostError, CommClosedError, SQLAlchemyError, UnavailableError):
            raise  # not the survey's fault: it goes on later
        except StorageError as error:
            self._say_that_it_waits(survey_id, error)
            raise
        except Exception as error:
            if client.status != "running":  # whatever a lost connection looks like
                raise
            unexpected = None if isinstance(error, RattleError) else error
            log.warning("survey %s failed: %s", survey_id, error, exc_info=unexpected)
            self._database.set_state(survey_id, State.FAILED, str(error) or type(error).__name__)

    @contextmanager
    def _blaming_directory(self) -> Iterator[None]:
        """Whatever fails while the data directory is away fails for that reason: a store that is gone, above all."""
        try:
            yield
        except Exception as error:
            try:
                self._directory.require()
            except DirectoryAwayError as away:
                raise away from error
            raise

    def _say_that_it_waits(self, survey_id: str, error: Exception) -> None:
        if self.storage_state == OK:  # told once, not at every try
            self._database.set_state(survey_id, State.RUNNING, f"waits for its store: {error}")

    def _compute(self, survey_id: str, client: Client) -> None:
        job = self._database.job(survey_id)
        if State(job.state).final or (
            job.state == State.ACCEPTED and not self._database.set_state(survey_id, State.RUNNING)
        ):
            return  # dismissed since it was found
        request = _request_of(job)
        path = self._directory.store(survey_id)
        left = self._left.pop(survey_id, None)
        has_message = bool(job.message)  # perhaps that it waits, since before a restart
        if left is None or job.state == State.ACCEPTED:  # of one that is verified, all is looked at
            left, has_lost = self._prepared(job, request, path, client)
            has_message |= has_lost

        def on_tile(tile: TileRecord) -> None:
            nonlocal has_message
            self._record(survey_id, request, tile)
            left.pop(tile.index, None)
            if has_message:
                self._database.set_state(survey_id, State.RUNNING)  # without the message
                has_message = False
            self.storage_state = OK

        is_paused = False

        def is_over() -> bool:
            nonlocal is_paused
            is_paused = is_paused or self._is_turn_over(survey_id)
            return is_paused

        def on_left(seconds: float) -> None:
            self._ends = {survey_id: time.monotonic() + seconds}

        begun = self._begun.setdefault(survey_id, Begun())
        tiles, asked = list(left.values()), (self._interrupted, self._dismissed.is_set, is_over)
        run_tiles(request, path, tiles, client, on_tile, *asked, begun, on_left)
        self._ends = {}
        if self._interrupted():
            return
        if not is_paused and is_incomplete(request, path):
            complete_on(client, request, path, self._interrupted, self._telling(survey_id), is_over)
        goes_on = is_paused and (left or is_incomplete(request, path))
        if not goes_on:
            finish_store(path)
        with self._lock:  # not between a dismissal and a verification, which begins anew
            if self._dismissed.is_set():
                return
            if goes_on:
                self._left[survey_id] = left
                self._database.set_state(survey_id, State.RUNNING)  # without what it says of certificates
            else:
                self._database.set_state(survey_id, State.SUCCESSFUL)

    def _prepared(
        self, job: JobRow, request: AnyRequest, path: Path | Bucket, client: Client
    ) -> tuple[dict[int, AnyTile], bool]:
        """Return the missing tiles of a survey, by their index, and whether some that were there are lost."""

        # Curves take minutes in some windows: nothing is computed in this process.
        def template(request: AnyRequest, created: str | None) -> Template:
            return template_on(client, request, created, self._interrupted)

        create_store(request, path, template)
        if job.content_hash != request.content_hash():
            self._database.set_content_hash(job.id, request.content_hash())
        # A tile counts only if both agree: the database knows its failures, the store holds its numbers.
        done = self._database.tiles_done(job.id) & tiles_done(request, path, self._interrupted)
        lost = self._database.keep_tiles(job.id, done)
        return {tile.index: tile for tile in tiles_of(request) if tile.index not in done}, bool(lost)

    def _is_turn_over(self, survey_id: str) -> bool:
        """Return whether the survey at work makes room for another one."""
        if not self._turns.is_used_up:
            return False
        following = self._turns.next(self._database.active())
        if following is None:
            return False
        if following.id == survey_id:
            self._turns.begin(following)
            return False
        return True

    def _telling(self, survey_id: str) -> Callable[[int, int], None]:
        """Return a function that notes the number of proved attractors, at each per cent of them."""
        shown = -1

        def tell(done: int, number: int) -> None:
            nonlocal shown
            percent = 100 * done // max(number, 1)
            if percent > shown:
                shown = percent
                message = f"proves its periodic attractors: {done} of {number} are through"
                self._database.set_state(survey_id, State.RUNNING, message)

        return tell

    def seconds_left(self, survey_id: str) -> float | None:
        """Return the seconds that the tiles of the survey at work will take; None of others, or if it is not known."""
        ends = self._ends.get(survey_id)
        return None if ends is None else max(ends - time.monotonic(), 0.0)

    def workers(self) -> int:
        """Threads of the cluster; 0 if it is not there or does not say so soon."""
        if (client := self._client) is None:
            return 0
        try:
            return sum(client.nthreads(callback_timeout=WORKERS_SECONDS).values())
        except Exception:  # whatever a lost connection looks like
            return 0

    @contextmanager
    def lent_client(self) -> Iterator[Client]:
        """Yield the client of the cluster for other threads, whose tasks run beside the tiles of surveys.

        Yields
        ------
        Client
            The client.

        Raises
        ------
        UnavailableError
            The cluster is not there.
        ClusterLostError
            If there is no cluster.
        """
        if (client := self._client) is None:
            raise UnavailableError(f"The workers cannot be used now (they are {self.cluster_state}). Try again soon.")
        try:
            yield client
        except ClusterLostError:
            self.wake()  # without a survey at work nobody else would notice
            raise

    def _interrupted(self) -> bool:
        return self._stopping.is_set() or self._dismissed.is_set()

    def _record(self, survey_id: str, request: AnyRequest, tile: TileRecord) -> None:
        self._on_tile(tile)
        first = tile.failed_cells[:MAX_FAILURES]
        failures = [{**place_of_cell(request, i, j), "message": message} for i, j, message in first]
        failed = len(tile.failed_cells)
        self._database.add_tile(survey_id, DoneTile(tile.index, tile.cells, tile.seconds, failed, failures))


def _is_of_this_version(job: JobRow) -> bool:
    try:
        return _request_of(job).content_hash() == job.content_hash
    except ServiceError:
        return False


def _request_of(job: JobRow) -> AnyRequest:
    if not job.is_readable:
        raise ServiceError(UNREADABLE)
    try:
        return request_of(job.request)
    except ValidationError as error:
        raise ServiceError(
            f"The request is no longer valid in this version ({place_and_reason(error)}). Submit it anew."
        ) from error
