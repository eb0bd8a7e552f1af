"""Submit, list, show and remove surveys."""

from __future__ import annotations

import hashlib
from email.message import Message
from typing import Annotated

from fastapi import APIRouter, Body, Depends, Header, Query, Request, Response
from starlette.exceptions import HTTPException

from service.access import CallerState
from service.database import NewJob
from service.documents import Survey, SurveyDetail, SurveyList, path_of
from service.errors import ForbiddenError
from service.limits import check_limits
from service.problems import ADVICE, declared
from service.state import FrontState
from workers import SurveyRequest

router = APIRouter(prefix="/v1/surveys", tags=["surveys"])

LARGEST_NUMBER = 2**53
MAX_FAILURES = 100
RETRY_SECONDS = "1"

EXAMPLE = {
    "name": "figure 7",
    "beta": 0.6,
    "delta": {"start": 0.4, "stop": 1.0, "num": 61},
    "epsilon": {"start": 0.005, "stop": 0.3, "num": 60},
    "initial_conditions": {"count": 64, "v_max": 7.0},
    "tile": {"delta": 16, "epsilon": 16},
    "seed": 0,
}


def require_json(request: Request) -> None:
    """Refuse a body that does not say it is JSON, instead of guessing."""
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
    responses=declared(400, 409, 413, 415, 422, 429, 503),
)
def submit(
    front: FrontState,
    caller: CallerState,
    response: Response,
    body: Annotated[SurveyRequest, Body(examples=[EXAMPLE])],
    idempotency_key: Annotated[str | None, Header(min_length=1, max_length=255, pattern=r"^[\x21-\x7e]+$")] = None,
) -> SurveyDetail:
    """Accept a survey and compute it in the background.

    The same body with the same `Idempotency-Key` again answers with the survey that was accepted the first time.
    """
    check_limits(body, front.settings)
    document = body.model_dump_json()
    job = front.database.accept(
        NewJob(
            name=body.name,
            request=body.model_dump(mode="json"),
            content_hash=body.content_hash(),
            body_hash=hashlib.sha256(document.encode()).hexdigest(),
            n_cells=body.n_cells,
            n_tiles=body.n_tiles,
            idempotency_key=idempotency_key,
            owner=caller.owner,
        ),
        front.settings.max_jobs,
    )
    front.manager.wake()
    response.headers["Location"] = path_of(job.id)
    response.headers["Retry-After"] = RETRY_SECONDS
    return SurveyDetail.with_failures(job, [])


@router.get("", summary="List the surveys, newest first", responses=declared(422, 503))
def list_surveys(
    front: FrontState,
    limit: Annotated[int, Query(ge=1, le=500, description="surveys per page")] = 50,
    cursor: Annotated[
        int | None, Query(ge=1, le=LARGEST_NUMBER, description="`next` of the page before; nothing for the first")
    ] = None,
) -> SurveyList:
    jobs, count = front.database.jobs(limit + 1, before=cursor)
    page = jobs[:limit]
    following = str(page[-1].number) if len(jobs) > limit else None
    return SurveyList(surveys=[Survey.of(job) for job in page], count=count, next=following)


@router.get("/{survey_id}", summary="Show a survey", responses=declared(404, 422, 503))
def show(front: FrontState, survey_id: str) -> SurveyDetail:
    job = front.database.job(survey_id)
    failures = front.database.failures(survey_id, MAX_FAILURES) if job.cells_failed else []
    return SurveyDetail.with_failures(job, failures)


@router.delete(
    "/{survey_id}",
    summary="Dismiss a survey that waits or runs, delete one that has ended",
    response_model=SurveyDetail,
    responses={204: {"description": "deleted, with its store"}, **declared(404, 409, 422, 503)},
)
def remove(front: FrontState, caller: CallerState, survey_id: str) -> Response | SurveyDetail:
    """A dismissed survey keeps what was computed of it until it is deleted by a second DELETE.

    Every key may read every survey; only the key that submitted one may remove it.
    """
    if not caller.owns(front.database.job(survey_id)):
        raise ForbiddenError(f"Survey {survey_id} was not submitted with this API key. Use the key that submitted it.")
    dismissed = front.manager.dismiss_or_delete(survey_id)
    return Response(status_code=204) if dismissed is None else SurveyDetail.with_failures(dismissed, [])
