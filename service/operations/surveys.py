"""Submit, find, remove and verify surveys and populations, and rename surveys, for the routes and the explorer."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import AfterValidator, Field

from gear_rattle.service.access.keys import Caller
from gear_rattle.service.database import NewJob
from gear_rattle.service.database.tables import UNREADABLE, JobKind, JobRow, State
from gear_rattle.service.errors import ForbiddenError
from gear_rattle.service.operations.limits import require_within_service_limits
from gear_rattle.service.state import ApplicationState
from gear_rattle.workers import AnyRequest, PopulationRequest
from gear_rattle.workers.survey.axes import Name, StrictRecord, require_visible_text

MAX_FAILURES = 100  # an answer lists at most this many failed cells
LONGEST_NOTES = 10_000  # notes have at most this many characters
WHITE_SPACE = "\t\n\r"
JOINERS = "\u200c\u200d"  # invisible characters that some scripts and emoji need; other invisible ones are refused


def _require_visible_notes(text: str) -> str:
    return require_visible_text("text of the notes", text, besides=WHITE_SPACE + JOINERS)


Notes = Annotated[str, Field(max_length=LONGEST_NOTES), AfterValidator(_require_visible_notes)]


class SurveyDescription(StrictRecord):
    """The name and the notes of a survey. Fields that are left out do not change."""

    name: Name | None = None
    notes: Notes | None = None


def submit_survey(
    front: ApplicationState,
    caller: Caller,
    request: AnyRequest,
    idempotency_key: str | None = None,
    force: bool = False,
) -> JobRow:
    """Accept a survey or a population, unless an identical one exists or its idempotency key was used before.

    force: accept a new survey although an identical one exists. But if the idempotency key was used before, the survey
    of that earlier request is returned.

    Returns
    -------
    JobRow
        The accepted or the existing survey.

    Raises
    ------
    ConflictError, QueueFullError, QuotaError, UnauthorizedError
        See `gear_rattle.service.database.Surveys.add_or_find_job`.
    LimitError
        The request exceeds a limit of this service.
    DirectoryMissingError
        The data directory is missing.
    """
    require_within_service_limits(request, front.settings)
    front.directory.require_present()
    job = front.database.add_or_find_job(
        NewJob(
            name=request.name,
            request=request.model_dump(mode="json"),
            content_hash=request.content_hash(),
            body_hash=hashlib.sha256(request.model_dump_json().encode()).hexdigest(),
            n_cells=request.n_cells,
            n_tiles=request.n_tiles,
            idempotency_key=idempotency_key,
            owner=caller.owner,
            kind=JobKind.POPULATION if isinstance(request, PopulationRequest) else JobKind.SURVEY,
        ),
        front.settings.max_jobs,
        None if force else lambda survey_id: front.directory.store(survey_id).exists(),
    )
    front.manager.wake()
    return job


def list_jobs(
    front: ApplicationState, limit: int, before: int | None = None, kind: JobKind = JobKind.SURVEY
) -> tuple[Sequence[JobRow], int]:
    """Return at most `limit` jobs of a kind, newest first, and the number of all jobs of this kind.

    Parameters
    ----------
    front : ApplicationState
        The service.
    limit : int
        Largest number of jobs to return.
    before : int | None
        Only jobs that are older than the job with this number are returned; None for the newest jobs.
    kind : JobKind
        Surveys or populations.

    Returns
    -------
    tuple[Sequence[JobRow], int]
        The jobs, and the number of all jobs.
    """
    return front.database.jobs(limit, before, kind)


def find_job(front: ApplicationState, survey_id: str, kind: JobKind | None = None) -> JobRow:
    """Return the job with this id. Raises UnknownSurveyError if no job of this kind (None: of any kind) has this id."""
    return front.database.job(survey_id, kind)


def first_failures(front: ApplicationState, job: JobRow) -> list[dict[str, Any]]:
    """Return the first failed cells of a survey or a population, with their messages."""
    return front.database.failures(job.id, MAX_FAILURES) if job.cells_failed else []


def written_tiles(front: ApplicationState, survey_id: str) -> set[int]:
    """Return the indices of the tiles that are written. Raises UnknownSurveyError if there is no such survey."""
    return front.database.recorded_tile_indices(survey_id)


def remove_survey(
    front: ApplicationState, caller: Caller, survey_id: str, kind: JobKind = JobKind.SURVEY
) -> JobRow | None:
    """Dismiss a survey or population that waits or runs, or delete one that has ended.

    Returns
    -------
    JobRow | None
        The dismissed survey, or None after a deletion.

    Raises
    ------
    UnknownSurveyError
        There is no such survey.
    ForbiddenError
        The survey was submitted with another key.
    ConflictError, DirectoryMissingError
        See `gear_rattle.service.jobs.manager.JobManager.dismiss_or_delete`.
    """
    require_owner(front, caller, survey_id, kind)
    if not front.database.job(survey_id).is_readable:  # a survey with a damaged row counts as ended
        front.database.set_state(survey_id, State.FAILED, UNREADABLE)
    return front.manager.dismiss_or_delete(survey_id)


def set_survey_name_and_notes(
    front: ApplicationState, caller: Caller, survey_id: str, given: SurveyDescription
) -> JobRow:
    """Give a survey another name or other notes. Its content and its store do not change.

    Returns
    -------
    JobRow
        The survey with its new texts.

    Raises
    ------
    UnknownSurveyError
        There is no such survey.
    ForbiddenError
        The survey was submitted with another key.
    """
    require_owner(front, caller, survey_id)
    return front.database.describe(survey_id, given.name, given.notes)


def verify_survey(front: ApplicationState, caller: Caller, survey_id: str, kind: JobKind = JobKind.SURVEY) -> JobRow:
    """Queue an ended survey or population again, to check all its tiles and compute damaged or missing ones.

    Returns
    -------
    JobRow
        The queued survey.

    Raises
    ------
    UnknownSurveyError
        There is no such survey.
    ForbiddenError
        The survey was submitted with another key.
    ConflictError, QueueFullError, UnauthorizedError
        See `gear_rattle.service.jobs.manager.JobManager.verify`.
    """
    require_owner(front, caller, survey_id, kind)
    return front.manager.verify(survey_id, caller.owner, front.settings.max_jobs)


def require_owner(front: ApplicationState, caller: Caller, survey_id: str, kind: JobKind = JobKind.SURVEY) -> None:
    """Raise ForbiddenError if a survey or population was submitted with another key than the caller's."""
    if not caller.is_owner_of(front.database.job(survey_id, kind)):
        which = f"{kind.capitalize()} {survey_id}"
        raise ForbiddenError(f"{which} was not submitted with this API key. Use the key that submitted it.")


def current_caller(front: ApplicationState, caller: Caller) -> Caller | None:
    """Return the caller with the present scopes of its key; None after sign-out, or if the key was revoked.

    The function reads the database: call it in a thread.

    Returns
    -------
    Caller | None
        A caller without a key is returned unchanged.
    """
    if caller.key is None:
        return caller
    read = front.database
    key = (
        read.key_by_hash(caller.key.hash) if caller.session is None else read.find_key_of_login_session(caller.session)
    )
    return None if key is None else Caller(key, caller.session)
