"""Submit, list, show and remove populations of gears, and return the answers about them."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Annotated

import anyio
from fastapi import APIRouter, Body, Depends, Header, Path, Query, Request, Response
from sse_starlette import EventSourceResponse
from starlette.concurrency import run_in_threadpool

from gear_rattle.service.access.middleware import CallerState
from gear_rattle.service.database.tables import JobKind, JobRow, State
from gear_rattle.service.errors import MissingPartError
from gear_rattle.service.operations.estimate import estimate_cost
from gear_rattle.service.operations.surveys import find_job, first_failures, remove_survey, submit_survey, verify_survey
from gear_rattle.service.routes.documents import path_of_job
from gear_rattle.service.routes.events import LARGEST_ID, event_stream
from gear_rattle.service.routes.population_documents import (
    Answers,
    EstimateDocument,
    PopulationDetail,
    PopulationDocument,
    PopulationList,
    answers_document,
)
from gear_rattle.service.routes.store import FILES, answer_with_stored_file
from gear_rattle.service.routes.surveys import (
    RETRY_SECONDS,
    Cursor,
    IdempotencyKey,
    page_of_jobs,
    require_json,
    set_job_headers,
)
from gear_rattle.service.state import ApplicationState, FrontState
from gear_rattle.service.web import examples
from gear_rattle.service.web.conditional import NOT_MODIFIED, REVALIDATE, is_not_modified, json_answer, weak_etag
from gear_rattle.service.web.problems import declare_problems
from gear_rattle.workers import PopulationRequest, StoreInBucket

router = APIRouter(prefix="/v1/populations", tags=["populations"])
estimates = APIRouter(prefix="/v1", tags=["populations"])

KIND = JobKind.POPULATION
PopulationId = Annotated[
    str, Path(description="id of a population, from the answer to its submission", examples=[examples.POPULATION_ID])
]
PopulationBody = Annotated[PopulationRequest, Body(examples=[examples.POPULATION_REQUEST])]


@router.post(
    "",
    status_code=202,
    summary="Submit a population of gears",
    dependencies=[Depends(require_json)],
    responses={
        200: {"description": "an identical population has ended", "model": PopulationDetail},
        202: {"description": "accepted, or an identical population that waits or runs"},
        **declare_problems(409, 415, 422, 429),
    },
)
def submit_population(
    front: FrontState,
    caller: CallerState,
    response: Response,
    body: PopulationBody,
    idempotency_key: IdempotencyKey = None,
    force: Annotated[bool, Query(description="compute it although an identical population exists")] = False,
) -> PopulationDetail:
    """Accept a population. It is computed in the background, like a survey.

    `POST /v1/surveys` describes the answers to identical requests and to idempotency keys.
    """
    job = submit_survey(front, caller, body, idempotency_key, force)
    set_job_headers(response, job, KIND)
    return _population_detail(front, job)


@estimates.post(
    "/estimate",
    summary="Estimate the cost of a population",
    dependencies=[Depends(require_json)],
    responses=declare_problems(415, 422),
)
async def estimate_population(front: FrontState, body: PopulationBody) -> EstimateDocument:
    """Return the estimated computing time of a population in seconds, measured on a few of its gears."""
    found = await estimate_cost(front, body)
    return EstimateDocument(seconds=found.seconds, workers=found.workers, basis=found.basis)


@router.get(
    "",
    summary="List the populations, newest first",
    response_model=PopulationList,
    responses={**NOT_MODIFIED, **declare_problems(422)},
)
def list_populations(
    request: Request,
    front: FrontState,
    limit: Annotated[int, Query(ge=1, le=500, description="populations per page")] = 50,
    cursor: Cursor = None,
) -> Response:
    """List populations, newest first."""
    page, count, following = page_of_jobs(front, KIND, limit, cursor)
    shown = [PopulationDocument.from_job(job) for job in page]
    return json_answer(request, PopulationList(populations=shown, count=count, next=following))


@router.get(
    "/{population_id}",
    summary="Show a population",
    response_model=PopulationDetail,
    responses={**NOT_MODIFIED, **declare_problems(404, 422)},
)
def show_population(request: Request, front: FrontState, population_id: PopulationId) -> Response:
    """Return the status and the request of a population."""
    job = find_job(front, population_id, KIND)
    return json_answer(request, _population_detail(front, job), job.finished)


@router.post(
    "/{population_id}/verify",
    status_code=202,
    summary="Check every tile of a population, and compute damaged or missing ones again",
    responses=declare_problems(404, 409, 422, 429),
)
def verify_population(
    front: FrontState, caller: CallerState, response: Response, population_id: PopulationId
) -> PopulationDetail:
    """Verify a population, as `POST /v1/surveys/{survey_id}/verify` does for a survey."""
    job = verify_survey(front, caller, population_id, KIND)
    response.headers["Location"] = path_of_job(job.id, KIND)
    response.headers["Retry-After"] = RETRY_SECONDS
    return _population_detail(front, job)


@router.delete(
    "/{population_id}",
    summary="Dismiss a population that waits or runs, delete one that has ended",
    response_model=PopulationDetail,
    responses={204: {"description": "deleted, with its store"}, **declare_problems(404, 409, 422)},
)
def remove_population(
    front: FrontState, caller: CallerState, population_id: PopulationId
) -> Response | PopulationDetail:
    """Remove a population, as `DELETE /v1/surveys/{survey_id}` does for a survey."""
    dismissed = remove_survey(front, caller, population_id, KIND)
    return Response(status_code=204) if dismissed is None else _population_detail(front, dismissed)


@router.get(
    "/{population_id}/events",
    summary="Follow a population",
    response_class=EventSourceResponse,
    responses={204: {"description": "the population has ended and every event was seen"}, **declare_problems(404, 422)},
)
async def follow_population(
    front: FrontState,
    caller: CallerState,
    population_id: PopulationId,
    last_event_id: Annotated[
        int, Header(ge=0, le=LARGEST_ID, description="id of the last event seen", examples=[0])
    ] = 0,
) -> Response:
    """Stream the events of a population, as `GET /v1/surveys/{survey_id}/events` does for a survey."""
    return await event_stream(front, caller, population_id, KIND, last_event_id)


@router.get(
    "/{population_id}/store/{key:path}",
    summary="Read the zarr store of a population, also of a running one",
    response_class=Response,
    responses=FILES,
)
async def read_population(
    front: FrontState,
    population_id: PopulationId,
    key: Annotated[str, Path(description="of the zarr store", examples=["zarr.json", "energy/c/0/0"])],
    request: Request,
) -> Response:
    """Read a file of a population's store, as `GET /v1/surveys/{survey_id}/store/{key}` does for a survey.

    The variables of the store have the dimension `gear`.
    """
    return await answer_with_stored_file(front, population_id, KIND, key, request)


@router.get(
    "/{population_id}/answers",
    summary="Answers of a population that has ended",
    response_model=Answers,
    responses={**NOT_MODIFIED, **declare_problems(404, 422)},
)
async def answers(request: Request, front: FrontState, population_id: PopulationId) -> Response:
    """Return the probability of quiet running, yield, quantiles of the intensity, Sobol indices and the worst gears."""
    job, store = await run_in_threadpool(front.find_job_and_store, population_id, KIND)
    if job.state != State.SUCCESSFUL:
        raise MissingPartError(f"Population {population_id} is {job.state}: only a successful population has answers.")
    headers = {"ETag": weak_etag(job.id, job.last_event, "answers"), "Cache-Control": REVALIDATE}
    if is_not_modified(request, headers):
        return Response(status_code=304, headers=headers)
    with front.interruptible_work():
        body = await anyio.to_thread.run_sync(
            _read_answers, store, limiter=front.export_limiter, abandon_on_cancel=True
        )
    return Response(body, media_type="application/json", headers=headers)


def _read_answers(store: FilePath | StoreInBucket) -> str:
    from gear_rattle.workers.answers import read_finished_population  # loads zarr

    return answers_document(read_finished_population(store)).model_dump_json()


def _population_detail(front: ApplicationState, job: JobRow) -> PopulationDetail:
    return PopulationDetail.from_job_and_failures(job, first_failures(front, job))
