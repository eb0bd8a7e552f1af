"""The job database: the truth about every survey. The cluster is disposable, this is not."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, Engine, create_engine, delete, event, func, inspect, select
from sqlalchemy.exc import IntegrityError, SQLAlchemyError
from sqlalchemy.orm import Session

from service.errors import ConflictError, DataDirectoryError, QueueFullError, UnknownSurveyError
from service.tables import ACTIVE, EventRow, JobRow, State, Table, TileRow, now

BUSY_SECONDS = 10


@dataclass(frozen=True)
class NewJob:
    """What a survey is when it is accepted; ``body_hash`` tells one body from another under the same key."""

    name: str
    request: dict[str, Any]
    content_hash: str
    body_hash: str
    n_cells: int
    n_tiles: int
    idempotency_key: str | None = None


@dataclass(frozen=True)
class DoneTile:
    """A tile that has been written to the store; ``failures`` explains the first of its ``failed`` cells."""

    index: int
    cells: int
    seconds: float
    failed: int
    failures: list[dict[str, Any]]


class Database:
    """Surveys, their tiles and their events. Every method is one transaction and may be called from any thread.

    Args:
        url: SQLAlchemy URL. SQLite runs in WAL mode, with foreign keys and a busy timeout.
        on_change: called with the id of a survey after each commit that added an event to it.

    Raises:
        DataDirectoryError: the database cannot be opened.
    """

    def __init__(self, url: str, on_change: Callable[[str], None]) -> None:
        self._on_change = on_change
        try:
            engine = create_engine(url)
            if engine.dialect.name == "sqlite":
                _prepare_sqlite(engine)
            _refuse_foreign(engine)
            Table.metadata.create_all(engine)
        except (SQLAlchemyError, ImportError) as error:
            raise DataDirectoryError(f"The job database {url} cannot be opened: {error}") from error
        self._reader = engine
        self._writer = engine.execution_options(writes=True)

    def close(self) -> None:
        self._reader.dispose()

    @contextmanager
    def _read(self) -> Iterator[Session]:
        with Session(self._reader, expire_on_commit=False) as session:
            yield session

    @contextmanager
    def _write(self) -> Iterator[Session]:
        with Session(self._writer, expire_on_commit=False) as session, session.begin():
            yield session

    def accept(self, new: NewJob, max_jobs: int) -> JobRow:
        """Add a survey, or find the one accepted before under the same idempotency key.

        Raises:
            ConflictError: the key was used for another body.
            QueueFullError: ``max_jobs`` surveys are waiting or running.
        """
        try:
            with self._write() as session:
                if known := _find_by_key(session, new):
                    return known
                _require_room(session, max_jobs)
                job = JobRow(id=secrets.token_hex(8), state=State.ACCEPTED, **vars(new))
                session.add(job)
                session.flush()
                _add_state_event(session, job)
        except IntegrityError:  # another database server than SQLite: the same key at the same moment
            with self._read() as session:
                if known := _find_by_key(session, new):
                    return known
            raise
        self._on_change(job.id)
        return job

    def job(self, survey_id: str) -> JobRow:
        """The survey with this id; UnknownSurveyError if there is none."""
        with self._read() as session:
            return _find(session, survey_id)

    def jobs(self, limit: int, before: int | None = None) -> tuple[Sequence[JobRow], int]:
        """Surveys, newest first, from those with a number below ``before``; and how many there are in all."""
        newest_first = select(JobRow).order_by(JobRow.number.desc()).limit(limit)
        if before is not None:
            newest_first = newest_first.where(JobRow.number < before)
        with self._read() as session:
            total = session.scalar(select(func.count()).select_from(JobRow)) or 0
            return session.scalars(newest_first).all(), total

    def next_job(self) -> JobRow | None:
        """The oldest survey that is waiting or was interrupted."""
        with self._read() as session:
            oldest = select(JobRow).where(JobRow.state.in_(ACTIVE)).order_by(JobRow.number).limit(1)
            return session.scalars(oldest).first()

    def count(self, state: State) -> int:
        with self._read() as session:
            return session.scalar(select(func.count()).select_from(JobRow).where(JobRow.state == state)) or 0

    def set_state(self, survey_id: str, state: State, message: str = "") -> bool:
        """Move a survey on. False, and no change, if it already is in a final state or gone."""
        with self._write() as session:
            job = _find_active(session, survey_id)
            if job is None:
                return False
            job.state, job.message = state, message
            if state == State.RUNNING and job.started is None:
                job.started = now()
            if state.final:
                job.finished = now()
            _add_state_event(session, job)
        self._on_change(survey_id)
        return True

    def reopen(self, survey_id: str, max_jobs: int) -> JobRow:
        """Let a survey that was successful or failed wait again; its tiles stay noted.

        Raises:
            ConflictError: it waits or runs, or was dismissed.
            QueueFullError: ``max_jobs`` surveys are waiting or running.
        """
        with self._write() as session:
            job = _find(session, survey_id)
            if job.state not in (State.SUCCESSFUL, State.FAILED):
                raise ConflictError(f"Survey {survey_id} is {job.state}; only one that was computed can be verified.")
            _require_room(session, max_jobs)
            job.state, job.message, job.finished = State.ACCEPTED, "", None
            _add_state_event(session, job)
        self._on_change(survey_id)
        return job

    def add_tile(self, survey_id: str, tile: DoneTile) -> None:
        """Note that a tile has been written; nothing if the survey was dismissed or deleted meanwhile."""
        with self._write() as session:
            job = _find_active(session, survey_id)
            if job is None:
                return
            session.add(
                TileRow(
                    job=job.number,
                    index=tile.index,
                    cells=tile.cells,
                    seconds=tile.seconds,
                    failed=tile.failed,
                    failures=tile.failures,
                )
            )
            job.tiles_done += 1
            job.cells_done += tile.cells
            job.cells_failed += tile.failed
            data = {"tile": tile.index, "seconds": round(tile.seconds, 4), "failed": tile.failed}
            _add_event(session, job, "tile", data | _counts(job))
        self._on_change(survey_id)

    def tiles_done(self, survey_id: str) -> set[int]:
        """Indices of the tiles that have been noted as written."""
        with self._read() as session:
            return set(session.scalars(select(TileRow.index).where(TileRow.job == _find(session, survey_id).number)))

    def keep_tiles(self, survey_id: str, kept: set[int]) -> None:
        """Forget every tile that is not in ``kept``: its chunks have been lost."""
        with self._write() as session:
            job = _find(session, survey_id)
            for tile in session.scalars(select(TileRow).where(TileRow.job == job.number)):
                if tile.index not in kept:
                    session.delete(tile)
            session.flush()
            totals = select(func.count(), func.sum(TileRow.cells), func.sum(TileRow.failed))
            counts = session.execute(totals.where(TileRow.job == job.number)).one()
            job.tiles_done, job.cells_done, job.cells_failed = (int(count or 0) for count in counts)

    def failures(self, survey_id: str, limit: int) -> list[dict[str, Any]]:
        """The first failed cells of a survey: indices and message."""
        with self._read() as session:
            failed = select(TileRow.failures).where(TileRow.job == _find(session, survey_id).number, TileRow.failed > 0)
            tiles = session.scalars(failed.order_by(TileRow.index).limit(limit))
            return [cell for tile in tiles for cell in tile][:limit]

    def events(self, survey_id: str, after: int, limit: int = 500) -> Sequence[EventRow]:
        """The events that follow number ``after``; UnknownSurveyError once the survey is deleted."""
        with self._read() as session:
            number = _find(session, survey_id).number
            later = select(EventRow).where(EventRow.job == number, EventRow.id > after)
            return session.scalars(later.order_by(EventRow.id).limit(limit)).all()

    def delete(self, survey_id: str) -> None:
        """Remove a survey that has ended, with its tiles and events.

        Raises:
            ConflictError: it has not ended.
        """
        with self._write() as session:
            job = _find(session, survey_id)
            if not State(job.state).final:
                raise ConflictError(f"Survey {survey_id} is {job.state}; dismiss it first.")
            session.execute(delete(JobRow).where(JobRow.number == job.number))
        self._on_change(survey_id)


def _prepare_sqlite(engine: Engine) -> None:
    @event.listens_for(engine, "connect")
    def set_pragmas(connection: Any, record: object) -> None:  # noqa: ARG001 - SQLAlchemy's signature
        connection.isolation_level = None  # sqlite3 shall not start transactions behind SQLAlchemy's back
        for pragma in ("journal_mode=WAL", "synchronous=NORMAL", "foreign_keys=ON", f"busy_timeout={BUSY_SECONDS}000"):
            connection.execute(f"PRAGMA {pragma}")

    @event.listens_for(engine, "begin")
    def begin(connection: Connection) -> None:
        # A transaction that reads before it writes must hold the write lock from its start.
        writes = connection.get_execution_options().get("writes", False)
        connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


def _refuse_foreign(engine: Engine) -> None:
    present = inspect(engine)
    for table in Table.metadata.tables.values():
        if present.has_table(table.name):
            found = {column["name"] for column in present.get_columns(table.name)}
            if found != set(table.columns.keys()):
                raise DataDirectoryError(
                    f"Table {table.name} of the job database {engine.url} belongs to another program or version. "
                    "Use another data directory."
                )


def _find(session: Session, survey_id: str) -> JobRow:
    job = session.scalars(select(JobRow).where(JobRow.id == survey_id)).one_or_none()
    if job is None:
        raise UnknownSurveyError(survey_id)
    return job


def _find_active(session: Session, survey_id: str) -> JobRow | None:
    active = select(JobRow).where(JobRow.id == survey_id, JobRow.state.in_(ACTIVE))
    return session.scalars(active).one_or_none()


def _find_by_key(session: Session, new: NewJob) -> JobRow | None:
    if new.idempotency_key is None:
        return None
    job = session.scalars(select(JobRow).where(JobRow.idempotency_key == new.idempotency_key)).one_or_none()
    if job is not None and job.body_hash != new.body_hash:
        raise ConflictError(
            f"Idempotency-Key {new.idempotency_key!r} was used for survey {job.id}, which has another body. "
            "Repeat that body, or send a new key."
        )
    return job


def _count_active(session: Session) -> int:
    return session.scalar(select(func.count()).select_from(JobRow).where(JobRow.state.in_(ACTIVE))) or 0


def _require_room(session: Session, max_jobs: int) -> None:
    if _count_active(session) >= max_jobs:
        raise QueueFullError(f"{max_jobs} surveys are waiting or running. Wait for one to end, or DELETE one of them.")


def _counts(job: JobRow) -> dict[str, int]:
    return {
        "progress": job.progress,
        "tiles_done": job.tiles_done,
        "tiles": job.n_tiles,
        "cells_done": job.cells_done,
        "cells": job.n_cells,
    }


def _add_state_event(session: Session, job: JobRow) -> None:
    _add_event(session, job, "state", {"state": str(job.state), "message": job.message} | _counts(job))


def _add_event(session: Session, job: JobRow, kind: str, data: dict[str, Any]) -> None:
    job.last_event = (job.last_event or 0) + 1
    session.add(EventRow(job=job.number, id=job.last_event, kind=kind, data=data))
