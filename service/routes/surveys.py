"""Submit, list, show and remove surveys."""

from __future__ import annotations

from collections.abc import Sequence
from email.message import Message
from typing import Annotated

from fastapi import APIRouter, Body, Depends, Header, Query, Request, Response
from starlette.exceptions import HTTPException

from gear_rattle.service.access.middleware import CallerState
from gear_rattle.service.database.tables import JobKind, JobRow, State
from gear_rattle.service.operations.surveys import (
    SurveyDescription,
    find_job,
    first_failures,
    list_jobs,
    remove_survey,
    set_survey_name_and_notes,
    submit_survey,
    verify_survey,
)
from gear_rattle.service.routes.documents import (
    Survey,
    SurveyDetail,
    SurveyId,
    SurveyList,
    path_of_job,
    readable_request,
)
from gear_rattle.service.state import ApplicationState, FrontState
from gear_rattle.service.web import examples
from gear_rattle.service.web.conditional import NOT_MODIFIED, json_answer
from gear_rattle.service.web.problems import ADVICE, declare_problems
from gear_rattle.workers import SurveyRequest

router = APIRouter(prefix="/v1/surveys", tags=["surveys"])

LARGEST_NUMBER = 2**53
RETRY_SECONDS = "1"

IdempotencyKey = Annotated[str | None, Header(min_length=1, max_length=255, pattern=r"^[\x21-\x7e]+$")]
Cursor = Annotated[
    int | None, Query(ge=1, le=LARGEST_NUMBER, description="`next` of the previous page; left out for the first page")
]


def set_job_headers(response: Response, job: JobRow, kind: JobKind) -> None:
    """Set the header Location to the path of a job. If the job has ended, set status 200, else set Retry-After."""
    response.headers["Location"] = path_of_job(job.id, kind)
    if State(job.state).is_final:
        response.status_code = 200
    else:
        response.headers["Retry-After"] = RETRY_SECONDS


def page_of_jobs(
    front: ApplicationState, kind: JobKind, limit: int, cursor: int | None
) -> tuple[Sequence[JobRow], int, str | None]:
    """Return a page of the list of jobs, newest first, the number of all jobs, and the cursor of the next page."""
    jobs, count = list_jobs(front, limit + 1, cursor, kind)
    page = jobs[:limit]
    return page, count, str(page[-1].number) if len(jobs) > limit else None


async def require_json(request: Request) -> None:
    """Raise HTTPException if the media type of the body is not JSON."""
    declared_type = Message()
    declared_type["content-type"] = request.headers.get("content-type", "")
    subtype = declared_type.get_content_subtype()
    is_json = declared_type.get_content_maintype() == "application" and (subtype == "json" or subtype.endswith("+json"))
    if not is_json:
        raise HTTPException(415, ADVICE[415])


@router.post(
    "",
    status_code=202,
    summary="Submit a survey",
    dependencies=[Depends(require_json)],
    responses={
        200: {"description": "an identical survey has ended", "model": SurveyDetail, "links": examples.SURVEY_LINKS},
        202: {"description": "accepted, or an identical survey that waits or runs", "links": examples.SURVEY_LINKS},
        **declare_problems(409, 415, 422, 429),
    },
)
def submit(
    front: FrontState,
    caller: CallerState,
    response: Response,
    body: Annotated[SurveyRequest, Body(examples=[examples.REQUEST, examples.THIRD_AXIS, examples.INELASTIC])],
    idempotency_key: IdempotencyKey = None,
    force: Annotated[bool, Query(description="compute it although an identical survey exists")] = False,
) -> SurveyDetail:
    """Accept a survey and compute it in the background, or answer with an existing identical survey.

    Surveys are identical if everything that determines their numbers is the same, including the code; names may differ.
    If anybody's identical survey is successful, the answer is that survey with status 200. If your identical survey
    waits or runs, the answer is that survey with status 202. If an identical survey has failed or was dismissed, a new
    survey is computed from the beginning.

    If the same body is sent again with the same `Idempotency-Key`, the answer is the survey of the first answer, with
    or without `force`, as long as that survey exists. A survey remembers the idempotency key that created it, and the
    latest 100 idempotency keys of later requests.
    """
    job = submit_survey(front, caller, body, idempotency_key, force)
    set_job_headers(response, job, JobKind.SURVEY)
    return _survey_detail(front, job)


@router.get(
    "",
    summary="List the surveys, newest first",
    response_model=SurveyList,
    responses={**NOT_MODIFIED, **declare_problems(422)},
)
def list_surveys(
    request: Request,
    front: FrontState,
    limit: Annotated[int, Query(ge=1, le=500, description="surveys per page")] = 50,
    cursor: Cursor = None,
) -> Response:
    """List surveys, newest first."""
    page, count, following = page_of_jobs(front, JobKind.SURVEY, limit, cursor)
    document = SurveyList(surveys=[Survey.from_job(job) for job in page], count=count, next=following)
    return json_answer(request, document)


@router.get(
    "/{survey_id}",
    summary="Show a survey",
    response_model=SurveyDetail,
    responses={200: {"links": examples.SURVEY_LINKS}, **NOT_MODIFIED, **declare_problems(404, 422)},
)
def show(request: Request, front: FrontState, survey_id: SurveyId) -> Response:
    """Return the status and the request of a survey."""
    job = find_job(front, survey_id, JobKind.SURVEY)
    # The time of the last change is known only if nobody has changed the name or the notes.
    is_as_submitted = not job.notes and job.name == readable_request(job).get("name")
    return json_answer(request, _survey_detail(front, job), job.finished if is_as_submitted else None)


@router.post(
    "/{survey_id}/verify",
    status_code=202,
    summary="Check every tile of a survey, and compute damaged or missing ones again",
    responses=declare_problems(404, 409, 422, 429),
)
def verify(front: FrontState, caller: CallerState, response: Response, survey_id: SurveyId) -> SurveyDetail:
    """Queue a survey that has ended, to check all its tiles and compute damaged or missing tiles again.

    The survey may be successful, dismissed or failed. All chunks are compared with their checksums. Undamaged chunks
    are kept, and can be read all the time.
    """
    job = verify_survey(front, caller, survey_id)
    response.headers["Location"] = path_of_job(job.id)
    response.headers["Retry-After"] = RETRY_SECONDS
    return _survey_detail(front, job)


@router.patch(
    "/{survey_id}",
    summary="Give a survey another name, or notes",
    dependencies=[Depends(require_json)],
    responses=declare_problems(404, 415, 422),
)
def describe(
    front: FrontState,
    caller: CallerState,
    survey_id: SurveyId,
    body: Annotated[SurveyDescription, Body(examples=[examples.DESCRIPTION])],
) -> SurveyDetail:
    """Give a survey another name or other notes. This needs the key that submitted the survey.

    Fields that are left out do not change. The store keeps the name of the submission. Surveys with different names can
    be identical.
    """
    return _survey_detail(front, set_survey_name_and_notes(front, caller, survey_id, body))


@router.delete(
    "/{survey_id}",
    summary="Dismiss a survey that waits or runs, delete one that has ended",
    response_model=SurveyDetail,
    responses={204: {"description": "deleted, with its store"}, **declare_problems(404, 409, 422)},
)
def remove(front: FrontState, caller: CallerState, survey_id: SurveyId) -> Response | SurveyDetail:
    """Dismiss a survey that waits or runs, or delete a survey that has ended.

    A dismissed survey keeps its computed tiles until a second DELETE deletes it. Every key may read every survey, but
    only the key that submitted a survey may remove it.
    """
    dismissed = remove_survey(front, caller, survey_id)
    return Response(status_code=204) if dismissed is None else _survey_detail(front, dismissed)


def _survey_detail(front: ApplicationState, job: JobRow) -> SurveyDetail:
    return SurveyDetail.from_job_and_failures(job, first_failures(front, job))
