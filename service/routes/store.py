"""Serve the files of a survey's zarr store, for ``xr.open_zarr("http://…/v1/surveys/{id}/store")``."""

from __future__ import annotations

import pathlib
import re
from typing import Annotated, Any

from fastapi import APIRouter, Path, Request, Response
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.staticfiles import StaticFiles
from starlette.types import Scope

from gear_rattle.service.database.tables import JobKind, State
from gear_rattle.service.errors import MissingPartError
from gear_rattle.service.operations.chunks import is_expected_file
from gear_rattle.service.routes.documents import SurveyId, path_of_job
from gear_rattle.service.state import ApplicationState, FrontState
from gear_rattle.service.web.conditional import HOUR, NOT_MODIFIED, REVALIDATE
from gear_rattle.service.web.objects import object_response
from gear_rattle.service.web.problems import declare_problems
from gear_rattle.workers import StoreInBucket
from gear_rattle.workers.errors import DamageError

router = APIRouter(prefix="/v1/surveys", tags=["results"])

#: Pattern of a segment of a key: a name of a group, array or chunk, but no name that begins with a dot.
NAME = r"[A-Za-z0-9_][A-Za-z0-9_.\-]*"
#: Statuses of StaticFiles for a file that does not exist, or that the service has no permission to read.
MISSING_STATUSES = (401, 404)
KEY = re.compile(rf"{NAME}(/{NAME})*")


#: OpenAPI declaration of the responses with files of a store.
FILES: dict[int | str, dict[str, Any]] = {
    200: {
        "content": {
            "application/octet-stream": {"schema": {"type": "string", "format": "binary"}},
            "application/json": {"schema": {"type": "object"}},
        }
    },
    206: {
        "description": "the requested range",
        "content": {"application/octet-stream": {}, "application/json": {}, "multipart/byteranges": {}},
    },
    **NOT_MODIFIED,
    **declare_problems(404, 416, 422),
}


@router.get(
    "/{survey_id}/store/{key:path}",
    summary="Read the zarr store, also of a running survey",
    response_class=Response,
    responses=FILES,
)
async def read(
    front: FrontState,
    survey_id: SurveyId,
    key: Annotated[str, Path(description="of the zarr store", examples=["zarr.json", "region/c/0/0"])],
    request: Request,
) -> Response:
    """Read a file of a store.

    For a chunk that is not computed yet the answer is 404, which zarr reads as fill values. If a chunk was computed but
    cannot be read, the answer is 503; POST …/verify computes it again.
    """
    return await answer_with_stored_file(front, survey_id, JobKind.SURVEY, key, request)


async def answer_with_stored_file(
    front: ApplicationState, survey_id: str, kind: JobKind, key: str, request: Request
) -> Response:
    """Return a file of a survey's or a population's store.

    Raises MissingPartError or HTTPException (404) if there is no such file, DamageError if a written file cannot be
    read.
    """
    job, store = await run_in_threadpool(front.find_job_and_store, survey_id, kind)
    if not KEY.fullmatch(key) or key.endswith(".partial"):
        raise MissingPartError(f"The store of {kind} {survey_id} has no key {key!r}.")
    is_unchanging = job.state == State.SUCCESSFUL
    try:
        response = await file_response(store, key, request, is_unchanging)
    except (HTTPException, OSError) as error:  # OSError: for example, the file is a link to itself
        if getattr(error, "status_code", 404) not in MISSING_STATUSES:
            raise
        if not await run_in_threadpool(is_expected_file, front, survey_id, key):
            raise HTTPException(404) from error
        try:
            # The file is tried again, because a tile may have been written since the first try.
            response = await file_response(store, key, request, is_unchanging)
        except (HTTPException, OSError):
            raise DamageError(
                f"{key} of {kind} {survey_id} was computed but cannot be read now. "
                f"POST {path_of_job(survey_id, kind)}/verify computes damaged or lost files again."
            ) from error
    if response.status_code == 200 and key.endswith("zarr.json"):
        response.headers["content-type"] = "application/json"
    response.headers["cache-control"] = HOUR if is_unchanging else REVALIDATE
    return response


async def file_response(
    store: pathlib.Path | StoreInBucket, key: str, request: Request, is_unchanging: bool
) -> Response:
    """Return the file with this key in a store. Raises HTTPException or OSError if there is no such file.

    is_unchanging: whether files never change again. If False, the request's header If-Modified-Since is ignored.
    """
    if isinstance(store, StoreInBucket):
        return await object_response(store, key, request)
    files = StaticFiles(directory=store, check_dir=False)
    return await files.get_response(key, request.scope if is_unchanging else _drop_modified_since(request.scope))


def _drop_modified_since(scope: Scope) -> Scope:
    """Return a request's scope without If-Modified-Since, because a file may change twice within one second."""
    return {**scope, "headers": [each for each in scope["headers"] if each[0] != b"if-modified-since"]}
