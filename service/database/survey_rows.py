"""The transactions on surveys and populations, their tiles and their events."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from typing import Any, NamedTuple

from sqlalchemy import bindparam, delete, func, select, text, update
from sqlalchemy.orm import Session

from gear_rattle.service.database.identity import NewJob, find_identical_job, find_job_by_idempotency_key
from gear_rattle.service.database.tables import (
    ACTIVE,
    EventRow,
    JobKind,
    JobRow,
    KeyRow,
    ServiceRow,
    State,
    TileRow,
    timestamp,
)
from gear_rattle.service.database.transactions import Transactions
from gear_rattle.service.errors import ConflictError, QueueFullError, QuotaError, UnauthorizedError, UnknownSurveyError

MOST_IN_LIST = 500  # most values in the list of one SQL condition IN (…)
BEING_DELETED = "being deleted"
WAITS_FOR_TURN = "waits for its turn: "
WAITS_IN_QUEUE = JobRow.message.startswith(WAITS_FOR_TURN)
#: The states are literals in the SQL, so that query planners use the index ix_jobs_active.
IS_ACTIVE = JobRow.state.in_(bindparam("active", ACTIVE, expanding=True, literal_execute=True))


class ActiveSurvey(NamedTuple):
    """An active survey or population.

    owner: id of the API key that submitted it, or None. remaining_cells: number of its cells (or gears) that are
    not computed yet.
    """

    id: str
    owner: str | None
    remaining_cells: int


@dataclass(frozen=True)
class DoneTile:
    """A written tile. failed: number of its failed cells. failures: indices and messages of the first failed cells."""

    index: int
    cells: int
    seconds: float
    failed: int
    failures: list[dict[str, Any]]


class Surveys(Transactions):
    """The surveys and populations in a job database. Every method is one transaction.

    The argument `survey_id` is the id of a survey or of a population.
    """

    def add_or_find_job(self, new: NewJob, max_jobs: int, has_results: Callable[[str], bool] | None = None) -> JobRow:
        """Add a survey or population, or return the existing job with the same idempotency key or the same content.

        Parameters
        ----------
        has_results : Callable[[str], bool] | None
            Returns whether the store of a successful survey still exists. If it is None, no survey counts as identical,
            and the survey is computed again.

        Returns
        -------
        JobRow
            The new or the existing survey.

        Raises
        ------
        ConflictError
            The idempotency key was used for another request.
        UnauthorizedError
            The owner's key was revoked.
        QueueFullError
            ``max_jobs`` surveys are waiting or running, or the owner has as many of them as its key allows.
        QuotaError
            With this survey the owner would have more cells than its key allows.
        """
        with self._begin_write_transaction() as (session, service):
            known = find_job_by_idempotency_key(session, new) or (
                has_results and find_identical_job(session, new, has_results)
            )
            if known:
                return known
            _require_within_quota(session, new.owner, new.n_cells, max_jobs)
            values = vars(new) | {"idempotency_key": new.stored_idempotency_key}
            at_work = session.scalars(
                select(JobRow).where(IS_ACTIVE, JobRow.state == State.RUNNING, ~WAITS_IN_QUEUE).limit(1)
            )
            message = _wait_message(before) if (before := at_work.first()) else ""
            job = JobRow(id=secrets.token_hex(8), state=State.ACCEPTED, message=message, **values)
            session.add(job)
            _adjust_job_count(service, job, 1)
            session.flush()
            _add_state_event(session, job)
        self._on_change(job.id)
        return job

    def job(self, survey_id: str, kind: JobKind | None = None) -> JobRow:
        """Return the survey or population with this id. kind: the required kind; None for either.

        Returns
        -------
        JobRow
            A copy, detached from the database.

        Raises
        ------
        UnknownSurveyError
            There is no job with this id, or it is not a job of this kind.
        """
        with self._begin_read_transaction() as session:
            job = _find_job(session, survey_id, kind)
        if kind not in (None, job.kind):
            raise UnknownSurveyError(survey_id, str(kind))
        return job

    def jobs(
        self, limit: int, before: int | None = None, kind: JobKind = JobKind.SURVEY
    ) -> tuple[Sequence[JobRow], int]:
        """Return at most `limit` jobs of a kind, newest first, and the number of all jobs of this kind.

        Parameters
        ----------
        limit : int
            The most jobs to return.
        before : int | None
            Number of a job: only older jobs are returned. None returns the newest jobs.
        kind : JobKind
            The kind of the jobs.

        Returns
        -------
        tuple[Sequence[JobRow], int]
            The jobs, detached from the database, and the number of all jobs of this kind.
        """
        newest_first = select(JobRow).where(JobRow.kind == kind).order_by(JobRow.number.desc()).limit(limit)
        if before is not None:
            newest_first = newest_first.where(JobRow.number < before)
        with self._begin_read_transaction() as session:
            counted = ServiceRow.surveys if kind == JobKind.SURVEY else ServiceRow.populations
            total = session.scalars(select(counted)).one()
            return session.scalars(newest_first).all(), total

    def existing_ids(self, survey_ids: Collection[str]) -> set[str]:
        """Return the ids among `survey_ids` for which a survey or population exists."""
        ids, found = sorted(survey_ids), set[str]()
        with self._begin_read_transaction() as session:
            for start in range(0, len(ids), MOST_IN_LIST):
                found.update(session.scalars(select(JobRow.id).where(JobRow.id.in_(ids[start : start + MOST_IN_LIST]))))
        return found

    def active_surveys(self) -> list[ActiveSurvey]:
        """Return all surveys that wait or run, including interrupted surveys, oldest first."""
        remaining_cells = JobRow.n_cells - JobRow.cells_done
        with self._begin_read_transaction() as session:
            found = session.execute(
                select(JobRow.id, JobRow.owner, remaining_cells).where(IS_ACTIVE).order_by(JobRow.number)
            )
            return [ActiveSurvey(*row) for row in found]

    def write_messages_of_waiting_jobs(self, survey_id: str) -> None:
        """Write to all other waiting jobs that `survey_id` is computed now; clear that survey's own message."""
        with self._begin_write_transaction() as (session, _):
            if (job := _find_active_job(session, survey_id)) is None:
                return
            others = update(JobRow).where(
                IS_ACTIVE, JobRow.number != job.number, WAITS_IN_QUEUE | (JobRow.message == "")
            )
            session.execute(others.values(message=_wait_message(job)), execution_options={"synchronize_session": False})
            if job.message.startswith(WAITS_FOR_TURN):
                job.message = ""
        self._on_change(survey_id)

    def running_surveys(self) -> list[tuple[str, str]]:
        """Return the id and content hash of each survey that runs, or that ran when an earlier service ended."""
        with self._begin_read_transaction() as session:
            found = session.execute(select(JobRow.id, JobRow.content_hash).where(JobRow.state == State.RUNNING))
            return [(survey_id, content_hash) for survey_id, content_hash in found]

    def set_content_hash(self, survey_id: str, content_hash: str) -> None:
        """Store the content hash of a survey that an earlier version of the service accepted but did not begin."""
        with self._begin_write_transaction() as (session, _):
            if job := _find_active_job(session, survey_id):
                job.content_hash = content_hash

    def count_jobs_and_tiles(self) -> dict[State, tuple[int, int, int]]:
        """Return {state: (number of jobs in this state, number of tiles of these jobs, number of finished tiles)}."""
        numbers = func.count(), func.sum(JobRow.n_tiles), func.sum(JobRow.tiles_done)
        with self._begin_read_transaction() as session:
            found = session.execute(select(JobRow.state, *numbers).group_by(JobRow.state))
            return {State(state): (count, int(tiles), int(done)) for state, count, tiles, done in found}

    def count_jobs(self, state: State) -> int:
        """Return the number of jobs in a state."""
        with self._begin_read_transaction() as session:
            return session.scalar(select(func.count()).select_from(JobRow).where(JobRow.state == state)) or 0

    def set_state(self, survey_id: str, state: State, message: str = "") -> bool:
        """Change the state of an active survey. If the survey has ended or is gone, do nothing and return False."""
        with self._begin_write_transaction() as (session, _):
            job = _find_active_job(session, survey_id)
            if job is None:
                return False
            job.state, job.message = state, _replace_unstorable_characters(message)
            if state == State.RUNNING and job.started is None:
                job.started = timestamp()
            if state.is_final:
                job.finished = timestamp()
            _add_state_event(session, job)
        self._on_change(survey_id)
        return True

    def describe(self, survey_id: str, name: str | None, notes: str | None) -> JobRow:
        """Give a survey another name or other notes. None leaves the present text unchanged."""
        with self._begin_write_transaction() as (session, _):
            job = _find_job(session, survey_id)
            job.name = job.name if name is None else _replace_unstorable_characters(name)
            job.notes = job.notes if notes is None else _replace_unstorable_characters(notes)
        self._on_change(survey_id)
        return job

    def queue_again(self, survey_id: str, owner: str | None, max_jobs: int) -> JobRow:
        """Queue an ended survey or population again; its recorded tiles are kept.

        Parameters
        ----------
        owner : str | None
            Id of the API key that requests the computation and whose quotas apply; None without a key.

        Returns
        -------
        JobRow
            The queued survey.

        Raises
        ------
        UnknownSurveyError
            There is no such survey or population.
        UnauthorizedError
            The key of ``owner`` was revoked.
        QueueFullError
            ``max_jobs`` surveys are waiting or running, or the owner has as many of them as its key allows.
        ConflictError
            The survey is active, or is being deleted.
        """
        with self._begin_write_transaction() as (session, _):
            job = _find_job(session, survey_id)
            which = f"{job.kind.capitalize()} {survey_id}"
            if job.message == BEING_DELETED:
                raise ConflictError(
                    f"{which} is {BEING_DELETED} and cannot be continued. Submit its request as a new one."
                )
            if not State(job.state).is_final:
                raise ConflictError(f"{which} is {job.state}: wait until it has ended, and try again.")
            _require_within_quota(session, owner, 0, max_jobs)
            job.state, job.message, job.finished = State.ACCEPTED, "", None
            _add_state_event(session, job)
        self._on_change(survey_id)
        return job

    def add_tile(self, survey_id: str, tile: DoneTile) -> None:
        """Record a written tile. Do nothing if the survey has been dismissed or deleted."""
        with self._begin_write_transaction() as (session, _):
            job = _find_active_job(session, survey_id)
            if job is None:
                return
            session.add(TileRow(job=job.number, **vars(tile)))
            job.tiles_done += 1
            job.cells_done += tile.cells
            job.cells_failed += tile.failed
            data = {"tile": tile.index, "seconds": round(tile.seconds, 4), "failed": tile.failed}
            _add_event(session, job, "tile", data | _progress_fields(job))
        self._on_change(survey_id)

    def recorded_tile_indices(self, survey_id: str) -> set[int]:
        """Return the indices of the tiles that are recorded as written."""
        with self._begin_read_transaction() as session:
            return set(session.scalars(select(TileRow.index).where(TileRow.job == _job_number(session, survey_id))))

    def has_tile(self, survey_id: str, index: int) -> bool:
        """Return whether a tile is recorded as written."""
        with self._begin_read_transaction() as session:
            return session.get(TileRow, (_job_number(session, survey_id), index)) is not None

    def total_tile_seconds(self, survey_id: str) -> float:
        """Return the total computing time of a survey's tiles in seconds."""
        with self._begin_read_transaction() as session:
            total = select(func.sum(TileRow.seconds)).where(TileRow.job == _job_number(session, survey_id))
            return session.scalar(total) or 0.0

    def keep_only_tiles(self, survey_id: str, kept: set[int]) -> int:
        """Delete the records of all tiles whose indices are not in ``kept``, because their chunks are lost.

        If records are deleted and the survey is active, an event with the new, lower counts is added for subscribers.

        Returns
        -------
        int
            Number of deleted records.
        """
        with self._begin_write_transaction() as (session, _):
            number = _job_number(session, survey_id)
            lost = sorted(set(session.scalars(select(TileRow.index).where(TileRow.job == number))) - kept)
            for start in range(0, len(lost), MOST_IN_LIST):
                some = lost[start : start + MOST_IN_LIST]
                session.execute(delete(TileRow).where(TileRow.job == number, TileRow.index.in_(some)))
            job = _find_job(session, survey_id)
            totals = select(func.count(), func.sum(TileRow.cells), func.sum(TileRow.failed))
            counts = session.execute(totals.where(TileRow.job == number)).one()
            job.tiles_done, job.cells_done, job.cells_failed = (int(count or 0) for count in counts)
            if lost and State(job.state) in ACTIVE:
                tiles = "1 tile is" if len(lost) == 1 else f"{len(lost)} tiles are"
                job.message = f"{tiles} lost or damaged, and computed again"
                _add_state_event(session, job)
        if lost:
            self._on_change(survey_id)
        return len(lost)

    def failures(self, survey_id: str, limit: int) -> list[dict[str, Any]]:
        """Return the indices and messages of the first failed cells of a survey, at most `limit` of them."""
        with self._begin_read_transaction() as session:
            # Literal SQL, because with a bound parameter the database would not use the partial index ix_tiles_failed.
            has_failed = text("tiles.failed > 0")
            failed = select(TileRow.failures).where(TileRow.job == _job_number(session, survey_id), has_failed)
            some = {"yield_per": 10}
            with session.scalars(failed.order_by(TileRow.index).limit(limit), execution_options=some) as tiles:
                return list(islice(chain.from_iterable(tiles), limit))

    def events(self, survey_id: str, after: int, limit: int = 500) -> Sequence[EventRow]:
        """Return the first ``limit`` events after number ``after``. Raises UnknownSurveyError for a deleted survey."""
        with self._begin_read_transaction() as session:
            number = _job_number(session, survey_id)
            later = select(EventRow).where(EventRow.job == number, EventRow.id > after)
            return session.scalars(later.order_by(EventRow.id).limit(limit)).all()

    def begin_deletion(self, survey_id: str) -> None:
        """Mark an ended survey as being deleted, before its store is deleted.

        Raises
        ------
        ConflictError
            The survey has not ended.
        """
        with self._begin_write_transaction() as (session, _):
            job = _find_ended_job(session, survey_id)
            job.state, job.message = State.DISMISSED, BEING_DELETED
            _add_state_event(session, job)
        self._on_change(survey_id)

    def surveys_being_deleted(self) -> list[str]:
        """Return the ids of surveys whose deletion has begun."""
        with self._begin_read_transaction() as session:
            begun = JobRow.state == State.DISMISSED, JobRow.message == BEING_DELETED
            return list(session.scalars(select(JobRow.id).where(*begun)))

    def delete(self, survey_id: str) -> None:
        """Delete the record of an ended survey, with the records of its tiles and events.

        Raises
        ------
        ConflictError
            The survey has not ended.
        """
        with self._begin_write_transaction() as (session, service):
            job = _find_ended_job(session, survey_id)
            session.execute(delete(JobRow).where(JobRow.number == job.number))
            _adjust_job_count(service, job, -1)
        self._on_change(survey_id)


def _adjust_job_count(service: ServiceRow, job: JobRow, change: int) -> None:
    if job.kind == JobKind.SURVEY:
        service.surveys += change
    else:
        service.populations += change


def _find_job(session: Session, survey_id: str, kind: JobKind | None = None) -> JobRow:
    job = session.scalars(select(JobRow).where(JobRow.id == _replace_unstorable_characters(survey_id))).one_or_none()
    if job is None:
        raise UnknownSurveyError(survey_id, kind or JobKind.SURVEY)
    return job


def _find_ended_job(session: Session, survey_id: str) -> JobRow:
    job = _find_job(session, survey_id)
    if not State(job.state).is_final:
        raise ConflictError(f"{job.kind.capitalize()} {survey_id} is {job.state}; dismiss it first.")
    return job


def _job_number(session: Session, survey_id: str) -> int:
    number = session.scalars(
        select(JobRow.number).where(JobRow.id == _replace_unstorable_characters(survey_id))
    ).one_or_none()
    if number is None:
        raise UnknownSurveyError(survey_id)
    return number


def _find_active_job(session: Session, survey_id: str) -> JobRow | None:
    active = select(JobRow).where(JobRow.id == survey_id, IS_ACTIVE)
    return session.scalars(active).one_or_none()


def _require_within_quota(session: Session, owner: str | None, n_cells: int, max_jobs: int) -> None:
    active = select(func.count()).select_from(JobRow).where(IS_ACTIVE)
    if (session.scalar(active) or 0) >= max_jobs:
        raise QueueFullError(
            f"{max_jobs} surveys and populations are waiting or running. Wait for one to end, or DELETE one of them."
        )
    key = session.get(KeyRow, owner) if owner is not None else None
    if key is None:
        return
    if key.revoked is not None:
        raise UnauthorizedError("This API key was revoked. `rattle key add` makes a new key.")
    running = session.scalar(active.where(JobRow.owner == key.id)) or 0
    if key.max_running is not None and running >= key.max_running:
        raise QueueFullError(
            f"{running} surveys and populations of your key are waiting or running, and the quota is "
            f"{key.max_running}. Wait for one to end, or DELETE one of them."
        )
    kept = session.scalar(select(func.sum(JobRow.n_cells)).where(JobRow.owner == key.id)) or 0
    if key.max_cells is not None and kept + n_cells > key.max_cells:
        raise QuotaError(
            f"With this request your surveys and populations would have {kept + n_cells:,} cells, more than the quota "
            f"of your key, {key.max_cells:,} cells. Request fewer cells, or DELETE results that you no longer need."
        )


def _wait_message(job: JobRow) -> str:
    return f"{WAITS_FOR_TURN}{job.display_name} is computed now"


def _replace_unstorable_characters(value: str) -> str:
    """Replace the characters that PostgreSQL cannot store: NUL, and unpaired surrogates."""
    return value.replace("\0", "\ufffd").encode("utf-8", "replace").decode()


def _progress_fields(job: JobRow) -> dict[str, int]:
    return {
        "progress": job.progress,
        "tiles_done": job.tiles_done,
        "tiles": job.n_tiles,
        "cells_done": job.cells_done,
        "cells": job.n_cells,
    }


def _add_state_event(session: Session, job: JobRow) -> None:
    _add_event(session, job, "state", {"state": str(job.state), "message": job.message} | _progress_fields(job))


def _add_event(session: Session, job: JobRow, kind: str, data: dict[str, Any]) -> None:
    job.last_event = (job.last_event or 0) + 1
    session.add(EventRow(job=job.number, id=job.last_event, kind=kind, data=data))
