"""Find the existing survey or population that a submission repeats, by its idempotency key or by its content."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from gear_rattle.service.database.tables import ACTIVE, JobKind, JobRow, RepeatedKeyRow, State
from gear_rattle.service.errors import ConflictError

#: The most idempotency keys that are stored for one survey, besides the key of its first submission.
MOST_REPEATED_KEYS = 100


@dataclass(frozen=True)
class NewJob:
    """A survey or population that a client submits.

    body_hash: hash of the request body, which shows whether an idempotency key is used again for the same body. owner:
    id of an API key; each owner has its own idempotency keys.
    """

    name: str
    request: dict[str, Any]
    content_hash: str
    body_hash: str
    n_cells: int
    n_tiles: int
    idempotency_key: str | None = None
    owner: str | None = None
    kind: JobKind = JobKind.SURVEY

    @property
    def stored_idempotency_key(self) -> str | None:
        """The idempotency key as the database stores it, with the owner; None without a key."""
        if self.owner is None or self.idempotency_key is None:
            return self.idempotency_key
        return f"{self.owner} {self.idempotency_key}"  # unique, because neither part has a space


def find_job_by_idempotency_key(session: Session, new: NewJob) -> JobRow | None:
    """Return the job that was submitted with the idempotency key of `new`; None if there is none.

    Returns
    -------
    JobRow | None
        The job.

    Raises
    ------
    ConflictError
        The earlier submission with this key had another request body.
    """
    if new.stored_idempotency_key is None:
        return None
    job = session.scalars(select(JobRow).where(JobRow.idempotency_key == new.stored_idempotency_key)).one_or_none()
    body_hash = job.body_hash if job else ""
    if job is None and (answered := session.get(RepeatedKeyRow, new.stored_idempotency_key)):
        job, body_hash = session.get_one(JobRow, answered.job), answered.body_hash
    if job is not None and body_hash != new.body_hash:
        raise ConflictError(
            f"Idempotency-Key {new.idempotency_key!r} was sent before, for {job.kind} {job.id}, with another request "
            "body. Send that body again, or use a new key."
        )
    return job


def find_identical_job(session: Session, new: NewJob, has_results: Callable[[str], bool]) -> JobRow | None:
    """Return a job with the same content: a successful job of any owner, or an active one of the same owner.

    Active jobs of other owners do not count, because their owners could dismiss them. If a job is found, the
    idempotency key of the submission is stored for it.

    Returns
    -------
    JobRow | None
        The job; None if there is none. Successful jobs whose results are gone do not count.
    """
    own = JobRow.owner.is_(None) if new.owner is None else JobRow.owner == new.owner
    same = select(JobRow).where(JobRow.content_hash == new.content_hash).order_by(JobRow.number.desc())
    some = {"yield_per": 10}
    with session.scalars(same.where(JobRow.state == State.SUCCESSFUL), execution_options=some) as successful:
        job = next((job for job in successful if job.is_readable and has_results(job.id)), None)
    if job is None:
        active = session.scalars(same.where(JobRow.state.in_(ACTIVE), own))
        job = next((job for job in active if job.is_readable), None)
    if job is not None and new.stored_idempotency_key is not None:
        session.add(RepeatedKeyRow(idempotency_key=new.stored_idempotency_key, body_hash=new.body_hash, job=job.number))
        session.flush()
        of_it = select(RepeatedKeyRow.idempotency_key).where(RepeatedKeyRow.job == job.number)
        latest = of_it.order_by(RepeatedKeyRow.at.desc()).limit(MOST_REPEATED_KEYS)
        forgotten = RepeatedKeyRow.job == job.number, RepeatedKeyRow.idempotency_key.not_in(latest)
        session.execute(delete(RepeatedKeyRow).where(*forgotten), execution_options={"synchronize_session": False})
    return job
