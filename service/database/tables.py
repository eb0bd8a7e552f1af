"""The tables of the job database. A change here also needs a new revision in `service/migrations`."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from enum import StrEnum
from typing import Any

from sqlalchemy import JSON, Double, ForeignKey, Index, text
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column


class State(StrEnum):
    """The state of a survey or population. The last three are the states of ended jobs."""

    ACCEPTED = "accepted"
    RUNNING = "running"
    SUCCESSFUL = "successful"
    FAILED = "failed"
    DISMISSED = "dismissed"

    @property
    def is_final(self) -> bool:
        """True if a job in this state has ended. An ended job gets another state only if it is verified or deleted."""
        return self not in ACTIVE


class JobKind(StrEnum):
    """The kind of a job: a survey or a population."""

    SURVEY = "survey"
    POPULATION = "population"


ACTIVE = (State.ACCEPTED, State.RUNNING)
UNREADABLE = (
    "The request of this survey or population cannot be read: its row in the job database is damaged. DELETE it, and "
    "submit it again."
)
ACTIVE_SQL = "state IN ('accepted', 'running')"


def timestamp(later: float = 0.0) -> str:
    """Return the present time plus `later` seconds, as ISO 8601 in UTC; such texts sort by time."""
    return (datetime.now(UTC) + timedelta(seconds=later)).isoformat(timespec="milliseconds")


class TableBase(DeclarativeBase):
    """Base class of all tables."""


class JobRow(TableBase):
    """A survey or a population: its request and its state."""

    __tablename__ = "jobs"

    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=True)
    id: Mapped[str] = mapped_column(unique=True)
    name: Mapped[str]
    notes: Mapped[str] = mapped_column(default="")
    state: Mapped[str] = mapped_column(index=True)
    message: Mapped[str] = mapped_column(default="")
    request: Mapped[dict[str, Any]] = mapped_column(JSON)
    content_hash: Mapped[str]
    idempotency_key: Mapped[str | None] = mapped_column(unique=True)
    body_hash: Mapped[str]
    n_cells: Mapped[int]
    n_tiles: Mapped[int]
    cells_done: Mapped[int] = mapped_column(default=0)
    tiles_done: Mapped[int] = mapped_column(default=0)
    cells_failed: Mapped[int] = mapped_column(default=0)
    last_event: Mapped[int] = mapped_column(default=0)
    created: Mapped[str] = mapped_column(default=timestamp)
    started: Mapped[str | None]
    finished: Mapped[str | None]
    owner: Mapped[str | None] = mapped_column(ForeignKey("keys.id"))
    kind: Mapped[str] = mapped_column(default=JobKind.SURVEY)

    # sqlite_autoincrement, because SQLite would otherwise give the number of a deleted last row to the next row.
    __table_args__ = (
        Index("ix_jobs_owner", "owner", "number"),
        Index("ix_jobs_kind", "kind", "number"),
        Index("ix_jobs_content", "content_hash", "number"),
        Index("ix_jobs_active", "number", sqlite_where=text(ACTIVE_SQL), postgresql_where=text(ACTIVE_SQL)),
        {"sqlite_autoincrement": True},
    )

    @property
    def is_readable(self) -> bool:
        """True if the stored request is readable; the database engine reads damaged JSON as None."""
        return isinstance(self.request, dict)

    @property
    def display_name(self) -> str:
        """The name of the survey or population; without a name, its kind and the beginning of its id."""
        return self.name or f"{self.kind} {self.id[:6]}"

    @property
    def shown_state_and_message(self) -> tuple[State, str]:
        """The state and message to show to people. A job with a damaged row counts as failed."""
        return (State(self.state), self.message) if self.is_readable else (State.FAILED, UNREADABLE)

    @property
    def progress(self) -> int:
        """The finished share of the tiles in per cent; 100 only when the job is successful."""
        if self.state == State.SUCCESSFUL:
            return 100
        return min(99, 100 * self.tiles_done // self.n_tiles)


class TileRow(TableBase):
    """A finished tile. Tiles without a row are not computed yet.

    failed: number of failed cells. failures: indices and messages of the first failed cells.
    """

    __tablename__ = "tiles"

    job: Mapped[int] = mapped_column(ForeignKey("jobs.number", ondelete="CASCADE"), primary_key=True)
    index: Mapped[int] = mapped_column(primary_key=True)
    cells: Mapped[int]
    seconds: Mapped[float] = mapped_column(Double)
    failed: Mapped[int]
    failures: Mapped[list[dict[str, Any]]] = mapped_column(JSON)

    # Few tiles have failed cells; with the index the database finds these tiles without reading the others.
    __table_args__ = (
        Index("ix_tiles_failed", "job", "index", sqlite_where=text("failed > 0"), postgresql_where=text("failed > 0")),
    )


class EventRow(TableBase):
    """An event of a job. The events of a job are numbered from 1 by `id`."""

    __tablename__ = "events"

    job: Mapped[int] = mapped_column(ForeignKey("jobs.number", ondelete="CASCADE"), primary_key=True)
    id: Mapped[int] = mapped_column(primary_key=True)
    kind: Mapped[str]
    data: Mapped[dict[str, Any]] = mapped_column(JSON)
    at: Mapped[str] = mapped_column(default=timestamp)


class RepeatedKeyRow(TableBase):
    """An idempotency key with which an existing survey was submitted again.

    The key of the first submission is in the survey's own row. Of the later keys, the latest
    `identity.MOST_REPEATED_KEYS` of each survey are kept.
    """

    __tablename__ = "answered"

    idempotency_key: Mapped[str] = mapped_column(primary_key=True)
    body_hash: Mapped[str]
    job: Mapped[int] = mapped_column(ForeignKey("jobs.number", ondelete="CASCADE"), index=True)
    at: Mapped[str] = mapped_column(default=timestamp)


class Scope(StrEnum):
    """A permission of a key."""

    READ = "read"
    SUBMIT = "submit"


class KeyRow(TableBase):
    """An API key; only its hash is stored. Revoked keys are kept, because surveys name them as owners."""

    __tablename__ = "keys"

    id: Mapped[str] = mapped_column(primary_key=True)
    name: Mapped[str]
    hash: Mapped[str] = mapped_column(unique=True)
    scopes: Mapped[list[str]] = mapped_column(JSON)
    max_cells: Mapped[int | None]
    max_running: Mapped[int | None]
    created: Mapped[str] = mapped_column(default=timestamp)
    revoked: Mapped[str | None]


class SessionRow(TableBase):
    """The session of a browser that is signed in with a key. hash: the hash of the token in the browser's cookie."""

    __tablename__ = "sessions"

    hash: Mapped[str] = mapped_column(primary_key=True)
    key: Mapped[str] = mapped_column(ForeignKey("keys.id", ondelete="CASCADE"), index=True)
    created: Mapped[str] = mapped_column(default=timestamp)
    expires: Mapped[str]


class ServiceRow(TableBase):
    """The single row that every writer locks first, so that a database has one writer at a time.

    epoch: a number that grows when a service opens the database. surveys, populations: how many surveys and how many
    populations the database has. directory: identity of the data directory that has the stores; None if the database is
    inside this directory, or the stores are in a bucket.
    """

    __tablename__ = "service"

    id: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    epoch: Mapped[int]
    surveys: Mapped[int]
    populations: Mapped[int] = mapped_column(default=0)
    directory: Mapped[str | None]
