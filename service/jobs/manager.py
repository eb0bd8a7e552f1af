"""The job manager: a thread that computes surveys and populations in turns, on a cluster that may be lost."""

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
from gear_rattle.service.errors import ConflictError, DirectoryMissingError, ServiceError, UnavailableError
from gear_rattle.service.jobs.directory import DataDirectory
from gear_rattle.service.jobs.turns import TurnScheduler
from gear_rattle.service.observability.logs import add_survey_id_to_logs
from gear_rattle.workers import (
    ClusterLostError,
    RunState,
    StoppedError,
    StorageError,
    complete_on_cluster,
    compute_template_on_cluster,
    create_store,
    finish_store,
    is_incomplete,
    parse_request_document,
    run_tiles,
    tiles_done,
    tiles_of,
)
from gear_rattle.workers.kinds import position_of_failed_cell
from gear_rattle.workers.survey.axes import message_with_field
from rattle import RattleError

if TYPE_CHECKING:
    from pathlib import Path

    from distributed import Client

    from gear_rattle.workers import AnyRequest, StoreInBucket, TileRecord
    from gear_rattle.workers.kinds import AnyTile
    from gear_rattle.workers.survey.template import Template

#: Least and largest pause in seconds before the thread tries again to open the cluster or to compute a survey. After
#: each failure the pause is twice as long as before.
FIRST_PAUSE, LONGEST_PAUSE = 1.0, 30.0
OK, READY, STARTING = "ok", "ready", "starting"
WORKERS_SECONDS = 2.0  # longest wait for the cluster to report its number of threads
LAST_TILES_SECONDS = 3.0  # longest wait of a deletion for a dismissed job's last tiles, which end within about 2 s
MAX_FAILURES = 100  # at most this many messages of failed cells are stored for a tile

log = logging.getLogger(__name__)


class JobManager:
    """A thread that computes accepted surveys and populations: one at a time, each in turns of a few seconds.

    It also resumes the surveys and populations that an earlier process did not complete.

    Parameters
    ----------
    database
        The record of all surveys and populations.
    directory
        The data directory, which locates the stores.
    cluster
        Function that opens the dask cluster. It is called again after the cluster was lost. Its argument is a function
        that returns whether to stop opening the cluster.
    on_tile
        Called with the record of every written tile.
    turns
        The scheduler that decides which survey has the next turn.
    """

    def __init__(
        self,
        database: Database,
        directory: DataDirectory,
        cluster: Callable[[Callable[[], bool]], AbstractContextManager[Client]],
        on_tile: Callable[[TileRecord], None] = lambda _: None,
        turns: TurnScheduler | None = None,
    ) -> None:
        self._on_tile = on_tile
        self._turns = turns or TurnScheduler()
        # {id of a survey that waits for its next turn: {index: missing tile}}.
        self._missing_tiles: dict[str, dict[int, AnyTile]] = {}
        # {id of a survey that runs or waits for its next turn: state of its run}.
        self._run_states: dict[str, RunState] = {}
        # {id of the running survey: predicted value of `time.monotonic` at the end of its tiles}.
        self._predicted_ends: dict[str, float] = {}
        self._client: Client | None = None
        self._database = database
        self._directory = directory
        self._cluster = cluster
        self._wake = threading.Event()
        self._stopping = threading.Event()
        self._dismissed = threading.Event()
        self._current: str | None = None
        self._lock = threading.Condition()  # notified when `_current` is reset
        self._thread = threading.Thread(target=self._compute_until_stopped, name="job-manager", daemon=True)
        self.cluster_state = STARTING
        self.storage_state = OK

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def ask_to_stop(self) -> None:
        """Ask the thread to end soon, without waiting for it. The running survey can be resumed later."""
        self._stopping.set()
        self._wake.set()

    def stop(self) -> None:
        """Ask the thread to end, and wait until it has ended and closed the cluster."""
        self.ask_to_stop()
        self._thread.join()

    def wake(self) -> None:
        """Let the thread look for work in the database."""
        self._wake.set()

    def dismiss_or_delete(self, survey_id: str) -> JobRow | None:
        """Dismiss a survey that waits or runs, or delete a survey that has ended.

        Returns
        -------
        JobRow | None
            The dismissed survey, or None after a deletion.

        Raises
        ------
        UnknownSurveyError
            There is no such survey.
        ConflictError
            The survey cannot be deleted, because its last tiles still run after some seconds, or it was queued again.
        DirectoryMissingError
            The data directory is missing, so nothing can be deleted.
        """
        which = f"{self._database.job(survey_id).kind.capitalize()} {survey_id}"
        if self._database.set_state(survey_id, State.DISMISSED, "dismissed by request"):
            with self._lock:
                if self._current == survey_id:
                    self._dismissed.set()
            self.wake()
            return self._database.job(survey_id)
        with self._lock:
            if not self._lock.wait_for(lambda: self._current != survey_id, LAST_TILES_SECONDS):
                raise ConflictError(f"{which} has ended, but its last tiles still run. Try again soon.")
            if not State((job := self._database.job(survey_id)).state).is_final:
                raise ConflictError(f"{which} is {job.state} again; dismiss it first.")
            self._directory.require_present()
            self._database.begin_deletion(survey_id)  # after a crash, the next service completes the deletion
            self._directory.remove_store(survey_id)
            self._database.delete(survey_id)
        return None

    def verify(self, survey_id: str, owner: str | None, max_jobs: int) -> JobRow:
        """Queue a survey that has ended, to check all its tiles and compute damaged or missing tiles again.

        Returns
        -------
        JobRow
            The queued survey.

        Raises
        ------
        UnknownSurveyError
            There is no such survey.
        QueueFullError
            ``max_jobs`` surveys are waiting or running, or as many as the key of ``owner`` allows.
        ConflictError
            The survey is active or being deleted, its stored request is unreadable, or another version completed it.
        UnauthorizedError
            The key of ``owner`` was revoked.
        """
        job = self._database.job(survey_id)
        if not job.is_readable:
            raise ConflictError(UNREADABLE)
        # Only the code version that completed a store can repair it.
        if job.state == State.SUCCESSFUL and not _would_compute_stored_numbers(job):
            raise ConflictError(
                f"{job.kind.capitalize()} {survey_id} was computed by another version, and only that version can "
                "verify it. Submit it again."
            )
        with self._lock:  # so that no deletion comes between the check of the state and the new run
            job = self._database.queue_again(survey_id, owner, max_jobs)
            if self._current == survey_id:  # the dismissed run has not ended yet, and must end before the new run
                self._dismissed.set()
        self.wake()
        return job

    def _compute_until_stopped(self) -> None:
        pause = FIRST_PAUSE
        while not self._stopping.is_set():
            self.cluster_state = STARTING
            try:
                with self._cluster(self._stopping.is_set) as client:
                    self.cluster_state, pause = READY, FIRST_PAUSE
                    self._client = client
                    try:
                        self._run_surveys(client)
                    finally:
                        self._client = None
            except Exception as error:
                if self._stopping.is_set():  # the cluster was not opened because the service stops
                    return
                unexpected = None if isinstance(error, RattleError) else error
                log.warning("no cluster or no database, next try in %.0f s: %s", pause, error, exc_info=unexpected)
                self.cluster_state = f"unavailable: {error}"
                self._stopping.wait(pause)
                pause = min(2 * pause, LONGEST_PAUSE)

    def _run_surveys(self, client: Client) -> None:
        """Compute surveys until the service stops or the cluster is lost."""
        pause = FIRST_PAUSE
        while not self._stopping.is_set():
            self._wake.clear()
            if self._stopping.is_set():  # `ask_to_stop` may have set `_wake` just before `clear`
                return
            if client.status != "running":
                raise ClusterLostError("the connection to the dask scheduler is lost: the service opens it again")
            try:
                found = self._run_next_survey(client)
                self.storage_state = OK
                if not found:
                    self._wake.wait()
            except (StorageError, DirectoryMissingError, SQLAlchemyError) as error:  # for example, the disk is full
                pause = FIRST_PAUSE if self.storage_state == OK else min(2 * pause, LONGEST_PAUSE)
                log.warning("nothing can be stored, next try in %.0f s: %s", pause, error)
                self.storage_state = f"unavailable: {error}"
                self._wake.wait(pause)

    def _run_next_survey(self, client: Client) -> bool:
        """Compute the survey that has the next turn, until it pauses or ends. Return False if no survey is active."""
        active = self._database.active_surveys()
        job = self._turns.next_survey(active)
        if job is None:
            return False
        self._turns.begin_turn(job)
        self._missing_tiles = {
            each.id: self._missing_tiles[each.id] for each in active if each.id in self._missing_tiles
        }
        self._run_states = {
            each: run_state for each, run_state in self._run_states.items() if each in self._missing_tiles
        }
        self._database.write_messages_of_waiting_jobs(job.id)
        with self._lock:
            self._current = job.id
            self._dismissed.clear()
        try:
            with add_survey_id_to_logs(job.id):
                self._run_and_record_failure(job.id, client)
        finally:
            self._predicted_ends = {}
            with self._lock:
                self._current = None
                self._lock.notify_all()
        return True

    def _run_and_record_failure(self, survey_id: str, client: Client) -> None:
        try:
            with self._prefer_missing_directory_error():
                self._compute_until_pause(survey_id, client)
        except StoppedError:
            return
        except DirectoryMissingError as error:
            self._write_wait_message(survey_id, error)
            raise
        except (ClusterLostError, CommClosedError, SQLAlchemyError, UnavailableError):
            raise  # the survey did not cause the error, and continues later
        except StorageError as error:
            self._write_wait_message(survey_id, error)
            raise
        except Exception as error:
            if client.status != "running":  # a lost connection raises errors of several types
                raise
            unexpected = None if isinstance(error, RattleError) else error
            log.warning("survey %s failed: %s", survey_id, error, exc_info=unexpected)
            self._database.set_state(survey_id, State.FAILED, str(error) or type(error).__name__)

    @contextmanager
    def _prefer_missing_directory_error(self) -> Iterator[None]:
        """If the data directory is missing, raise DirectoryMissingError in place of any error of this context."""
        try:
            yield
        except Exception as error:
            try:
                self._directory.require_present()
            except DirectoryMissingError as away:
                raise away from error
            raise

    def _write_wait_message(self, survey_id: str, error: Exception) -> None:
        if self.storage_state == OK:  # the message is written once, not at every attempt
            self._database.set_state(survey_id, State.RUNNING, f"waits for its store: {error}")

    def _compute_until_pause(self, survey_id: str, client: Client) -> None:
        """Compute a survey until another survey has the next turn, or until the survey is complete or interrupted."""
        job = self._database.job(survey_id)
        if State(job.state).is_final or (
            job.state == State.ACCEPTED and not self._database.set_state(survey_id, State.RUNNING)
        ):
            return  # the survey has ended or been dismissed
        request = _request_of(job)
        path = self._directory.store(survey_id)
        left = self._missing_tiles.pop(survey_id, None)
        has_message = bool(job.message)  # an earlier attempt may have written "waits for its store", for example
        if left is None or job.state == State.ACCEPTED:  # a survey in this state is new, or must be verified
            left, has_lost = self._prepare_tiles(job, request, path, client)
            has_message |= has_lost

        def on_tile(tile: TileRecord) -> None:
            nonlocal has_message
            self._record_tile(survey_id, request, tile)
            left.pop(tile.index, None)
            if has_message:
                self._database.set_state(survey_id, State.RUNNING)  # removes the survey's old message
                has_message = False
            self.storage_state = OK

        is_paused = False

        def must_pause() -> bool:
            nonlocal is_paused
            is_paused = is_paused or self._must_pause(survey_id)
            return is_paused

        def on_forecast(seconds: float) -> None:
            self._predicted_ends = {survey_id: time.monotonic() + seconds}

        run_state = self._run_states.setdefault(survey_id, RunState())
        tiles, asked = list(left.values()), (self._is_interrupted, self._dismissed.is_set, must_pause)
        run_tiles(request, path, tiles, client, on_tile, *asked, run_state, on_forecast)
        self._predicted_ends = {}
        if self._is_interrupted():
            return
        if not is_paused and is_incomplete(request, path):
            complete_on_cluster(
                client, request, path, self._is_interrupted, self._progress_writer(survey_id), must_pause
            )
        goes_on = is_paused and (left or is_incomplete(request, path))
        if not goes_on:
            finish_store(path)
        with self._lock:  # so that no dismissal or verification comes between the check and the new state
            if self._dismissed.is_set():
                return
            if goes_on:
                self._missing_tiles[survey_id] = left
                self._database.set_state(survey_id, State.RUNNING)  # removes a message about the progress of proofs
            else:
                self._database.set_state(survey_id, State.SUCCESSFUL)

    def _prepare_tiles(
        self, job: JobRow, request: AnyRequest, path: Path | StoreInBucket, client: Client
    ) -> tuple[dict[int, AnyTile], bool]:
        """Create or repair the store of a survey, and find the tiles that must be computed.

        Returns
        -------
        tuple[dict[int, AnyTile], bool]
            {index: missing tile}, and True if the database has recorded a tile whose values the store does not have.
        """

        # The cluster computes the template of the store, because the bifurcation curves in it may take minutes.
        def compute_template(request: AnyRequest, created: str | None) -> Template:
            return compute_template_on_cluster(client, request, created, self._is_interrupted)

        create_store(request, path, compute_template)
        if job.content_hash != request.content_hash():
            self._database.set_content_hash(job.id, request.content_hash())
        # A tile counts as done only if the database has its failures and the store has its values.
        done = self._database.recorded_tile_indices(job.id) & tiles_done(request, path, self._is_interrupted)
        lost = self._database.keep_only_tiles(job.id, done)
        return {tile.index: tile for tile in tiles_of(request) if tile.index not in done}, bool(lost)

    def _must_pause(self, survey_id: str) -> bool:
        """Return whether the survey must pause, because its turn is over and another survey has the next turn.

        If its turn is over and the survey itself has the next turn, begin that turn.

        Returns
        -------
        bool
            False also if the survey goes on with another turn of its own.
        """
        if not self._turns.is_turn_over:
            return False
        following = self._turns.next_survey(self._database.active_surveys())
        if following is None:
            return False
        if following.id == survey_id:
            self._turns.begin_turn(following)
            return False
        return True

    def _progress_writer(self, survey_id: str) -> Callable[[int, int], None]:
        """Return a function that writes the progress of proofs, in whole per cent, into a survey's message."""
        shown = -1

        def write_progress(done: int, number: int) -> None:
            nonlocal shown
            percent = 100 * done // max(number, 1)
            if percent > shown:
                shown = percent
                message = f"proves its periodic attractors: {done} of {number} have been tried"
                self._database.set_state(survey_id, State.RUNNING, message)

        return write_progress

    def seconds_left(self, survey_id: str) -> float | None:
        """Return the predicted seconds until all tiles of a survey are computed; None if there is no prediction now."""
        ends = self._predicted_ends.get(survey_id)
        return None if ends is None else max(ends - time.monotonic(), 0.0)

    def count_cluster_threads(self) -> int:
        """Return the number of threads of the cluster; 0 without a cluster, or if it does not answer within 2 s."""
        if (client := self._client) is None:
            return 0
        try:
            return sum(client.nthreads(callback_timeout=WORKERS_SECONDS).values())
        except Exception:  # a lost connection raises errors of several types
            return 0

    @contextmanager
    def borrow_client(self) -> Iterator[Client]:
        """Yield the client of the cluster to a thread other than the job thread.

        Tasks that this thread submits run at the same time as the tiles of surveys.

        Yields
        ------
        Client
            The dask client.

        Raises
        ------
        UnavailableError
            There is no cluster.
        ClusterLostError
            The cluster was lost during this context.
        """
        if (client := self._client) is None:
            raise UnavailableError(f"The workers cannot be used now ({self.cluster_state}). Try again soon.")
        try:
            yield client
        except ClusterLostError:
            self.wake()  # without a survey to run, the job thread sleeps, and would not notice the lost cluster
            raise

    def _is_interrupted(self) -> bool:
        return self._stopping.is_set() or self._dismissed.is_set()

    def _record_tile(self, survey_id: str, request: AnyRequest, tile: TileRecord) -> None:
        self._on_tile(tile)
        first = tile.failed_cells[:MAX_FAILURES]
        failures = [{**position_of_failed_cell(request, i, j), "message": message} for i, j, message in first]
        failed = len(tile.failed_cells)
        self._database.add_tile(survey_id, DoneTile(tile.index, tile.cells, tile.seconds, failed, failures))


def _would_compute_stored_numbers(job: JobRow) -> bool:
    """Return whether this version would compute the same numbers for the job's request as are stored."""
    try:
        return _request_of(job).content_hash() == job.content_hash
    except ServiceError:
        return False


def _request_of(job: JobRow) -> AnyRequest:
    if not job.is_readable:
        raise ServiceError(UNREADABLE)
    try:
        return parse_request_document(job.request)
    except ValidationError as error:
        raise ServiceError(
            f"The request of this {job.kind} is no longer valid in this version ({message_with_field(error)}). Submit "
            "a corrected request."
        ) from error
