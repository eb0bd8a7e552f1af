"""The zarr store of a survey, read-only, for ``xr.open_zarr("http://…/v1/surveys/{id}/store")``."""

from __future__ import annotations

import re

from fastapi import APIRouter, Request, Response
from starlette.concurrency import run_in_threadpool
from starlette.staticfiles import StaticFiles

from service.errors import MissingError
from service.problems import declared
from service.state import FrontState
from service.tables import State

router = APIRouter(prefix="/v1/surveys", tags=["results"])

# What zarr calls its groups, arrays and chunks: no dot files, no parents, no empty segments.
NAME = r"[A-Za-z0-9_][A-Za-z0-9_.\-]*"
KEY = re.compile(rf"{NAME}(/{NAME})*")


@router.head("/{survey_id}/store/{key:path}", include_in_schema=False)
@router.get(
    "/{survey_id}/store/{key:path}",
    summary="Read the zarr store, also of a running survey",
    response_class=Response,
    responses={
        200: {"content": {"application/octet-stream": {}, "application/json": {}}},
        206: {"description": "the requested range"},
        304: {"description": "not modified"},
        **declared(404, 416, 422, 503),
    },
)
async def read(front: FrontState, survey_id: str, key: str, request: Request) -> Response:
    """A chunk that is not computed yet has no file: 404, which zarr reads as fill values."""
    job = await run_in_threadpool(front.database.job, survey_id)
    if not KEY.fullmatch(key) or key.endswith(".partial"):
        raise MissingError(f"The store of survey {survey_id} has no key {key!r}.")
    files = StaticFiles(directory=front.directory.store(survey_id), check_dir=False)
    response = await files.get_response(key, request.scope)
    if response.status_code == 200 and key.endswith("zarr.json"):
        response.headers["content-type"] = "application/json"
    response.headers["cache-control"] = "no-cache" if not State(job.state).final else "max-age=3600"
    return response
