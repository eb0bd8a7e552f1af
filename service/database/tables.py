"""Tables of the job database. A change here also needs a new revision in `service/migrations`."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from enum import StrEnum
from typing import Any

from sqlalchemy import JSON, Double, ForeignKey, Index, text
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column


class State(StrEnum):
    """State of a survey; the last three are final."""

    ACCEPTED = "accepted"
    RUNNING = "running"
    SUCCESSFUL = "successful"
    FAILED = "failed"
    DISMISSED = "dismissed"

    @property
    def final(self) -> bool:
        """True if the state cannot change any more."""
        return self not in ACTIVE


class JobKind(StrEnum):
    """Kinds of jobs."""

    SURVEY = "survey"
    POPULATION = "population"


ACTIVE = (State.ACCEPTED, State.RUNNING)
UNREADABLE = (
    "What this survey computes cannot be read: its row in the job database is damaged. DELETE it, and submit it anew."
)
IN_ACTIVE = "state IN ('accepted', 'running')"


def timestamp(later: float = 0.0) -> str:
    """Return the present instant, or one so many seconds later: ISO 8601 in UTC, which sorts as text by time."""
    return (datetime.now(UTC) + timedelta(seconds=later)).isoformat(timespec="milliseconds")


class Table(DeclarativeBase):
    """Base of every table."""


class JobRow(Table):
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

    # Without autoincrement SQLite reuses the number of a deleted last row.
    __table_args__ = (
        Index("ix_jobs_owner", "owner", "number"),
        Index("ix_jobs_kind", "kind", "number"),
        Index("ix_jobs_content", "content_hash", "number"),
        Index("ix_jobs_active", "number", sqlite_where=text(IN_ACTIVE), postgresql_where=text(IN_ACTIVE)),
        {"sqlite_autoincrement": True},
    )

    @property
    def is_readable(self) -> bool:
        """True if the request is valid; damaged JSON is read as None (`gear_rattle.service.database.engine`)."""
        return isinstance(self.request, dict)

    @property
    def called(self) -> str:
        """The name; without one, the beginning of the id."""
        return self.name or f"survey {self.id[:6]}"

    @property
    def shown(self) -> tuple[State, str]:
        """State and message for readers; a survey with a damaged row counts as failed."""
        return (State(self.state), self.message) if self.is_readable else (State.FAILED, UNREADABLE)

    @property
    def progress(self) -> int:
        """Percent of the tiles done; 100 only once the survey is successful."""
        if self.state == State.SUCCESSFUL:
            return 100
        return min(99, 100 * self.tiles_done // self.n_tiles)


class TileRow(Table):
    """A finished tile. Tiles without a row are still to be computed.

    ``failures`` has the indices and messages of the first ``failed`` cells.
    """

    __tablename__ = "tiles"

    job: Mapped[int] = mapped_column(ForeignKey("jobs.number", ondelete="CASCADE"), primary_key=True)
    index: Mapped[int] = mapped_column(primary_key=True)
    cells: Mapped[int]
    seconds: Mapped[float] = mapped_column(Double)
    failed: Mapped[int]
    failures: Mapped[list[dict[str, Any]]] = mapped_column(JSON)

    # Few tiles have failures; the index finds them without reading the others.
    __table_args__ = (
        Index("ix_tiles_failed", "job", "index", sqlite_where=text("failed > 0"), postgresql_where=text("failed > 0")),
    )


class EventRow(Table):
    """An event of a survey; ids increase by one within a survey."""

    __tablename__ = "events"

    job: Mapped[int] = mapped_column(ForeignKey("jobs.number", ondelete="CASCADE"), primary_key=True)
    id: Mapped[int] = mapped_column(primary_key=True)
    kind: Mapped[str]
    data: Mapped[dict[str, Any]] = mapped_column(JSON)
    at: Mapped[str] = mapped_column(default=timestamp)


class AnsweredRow(Table):
    """An idempotency key whose submission was answered with an existing survey, which has its own key in its row.

    Only the latest keys of each survey are kept.
    """

    __tablename__ = "answered"

    idempotency_key: Mapped[str] = mapped_column(primary_key=True)
    body_hash: Mapped[str]
    job: Mapped[int] = mapped_column(ForeignKey("jobs.number", ondelete="CASCADE"), index=True)
    at: Mapped[str] = mapped_column(default=timestamp)


class Scope(StrEnum):
    """Permissions of a key."""

    READ = "read"
    SUBMIT = "submit"


class KeyRow(Table):
    """An API key, with its hash only. Revoked keys are kept, because surveys name them as owners."""

    __tablename__ = "keys"

    id: Mapped[str] = mapped_column(primary_key=True)
    name: Mapped[str]
    hash: Mapped[str] = mapped_column(unique=True)
    scopes: Mapped[list[str]] = mapped_column(JSON)
    max_cells: Mapped[int | None]
    max_running: Mapped[int | None]
    created: Mapped[str] = mapped_column(default=timestamp)
    revoked: Mapped[str | None]


class SessionRow(Table):
    """A session of a browser that has signed in with a key, with the hash of its cookie's token."""

    __tablename__ = "sessions"

    hash: Mapped[str] = mapped_column(primary_key=True)
    key: Mapped[str] = mapped_column(ForeignKey("keys.id", ondelete="CASCADE"), index=True)
    created: Mapped[str] = mapped_column(default=timestamp)
    expires: Mapped[str]


class ServiceRow(Table):
    """The single row that every writer locks first, so that any database has one writer at a time.

    ``epoch`` grows with each service that opens the database; ``surveys`` and ``populations`` are their numbers;
    ``directory`` is the identity of the data directory with the stores, if the database is elsewhere.
    """

    __tablename__ = "service"

    id: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    epoch: Mapped[int]
    surveys: Mapped[int]
    populations: Mapped[int] = mapped_column(default=0)
    directory: Mapped[str | None]
