"""A survey as a file: NetCDF with everything, CSV with a row per cell."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import IO

import anyio
from fastapi import APIRouter, Request, Response
from fastapi.responses import StreamingResponse
from starlette.background import BackgroundTask
from starlette.concurrency import run_in_threadpool

from service.errors import MissingError
from service.routes.documents import SurveyId
from service.state import Front, FrontState
from service.web.conditional import NOT_MODIFIED, REVALIDATE, is_known, picture_tag
from service.web.problems import declared
from workers import Bucket, open_survey

router = APIRouter(prefix="/v1/surveys", tags=["results"])

NETCDF, CSV = "application/x-netcdf", "text/csv"
BLOCK = 1 << 18


@router.get(
    "/{survey_id}/download.nc",
    summary="Everything of a survey as NetCDF 4, also of a running survey",
    response_class=Response,
    responses={
        200: {"content": {NETCDF: {"schema": {"type": "string", "format": "binary"}}}},
        **NOT_MODIFIED,
        **declared(404, 422),
    },
)
async def netcdf(request: Request, front: FrontState, survey_id: SurveyId) -> Response:
    """Complex variables are pairs of variables, `…_real` and `…_imag`."""
    place, headers = await _of(front, survey_id, "nc")
    if is_known(request, headers):
        return Response(status_code=304, headers=headers)
    with front.interruptible():
        file = await anyio.to_thread.run_sync(_written, place, limiter=front.exports, abandon_on_cancel=True)
    size = await run_in_threadpool(file.seek, 0, 2)
    file.seek(0)
    return StreamingResponse(
        _blocks(file),
        media_type=NETCDF,
        headers=headers | {"Content-Length": str(size)},
        background=BackgroundTask(file.close),  # of HEAD no block is asked for
    )


@router.get(
    "/{survey_id}/download.csv",
    summary="The variables over (delta, epsilon) alone as CSV, a row per cell, also of a running survey",
    response_class=Response,
    responses={200: {"content": {CSV: {"schema": {"type": "string"}}}}, **NOT_MODIFIED, **declared(404, 422)},
)
async def csv(request: Request, front: FrontState, survey_id: SurveyId) -> Response:
    """Codes are written as numbers; a cell whose `status` is 0 is not computed yet."""
    place, headers = await _of(front, survey_id, "csv")
    if is_known(request, headers):
        return Response(status_code=304, headers=headers)
    lines = await run_in_threadpool(_lines, place)
    return StreamingResponse(lines, media_type=CSV, headers=headers)


async def _of(front: Front, survey_id: str, ending: str) -> tuple[Path | Bucket, dict[str, str]]:
    job, place = await run_in_threadpool(front.stored, survey_id)
    if not await run_in_threadpool(place.exists):
        raise MissingError(f"Survey {job.id} is {job.state} and has no numbers yet. Try again once it runs.")
    return place, {
        "ETag": picture_tag(job.id, job.last_event, ending),
        "Cache-Control": REVALIDATE,
        "Content-Disposition": f'attachment; filename="survey-{job.id}.{ending}"',
    }


def _written(place: Path | Bucket) -> IO[bytes]:
    from workers.storage.export import require_readable, write_netcdf  # xarray

    with open_survey(place) as dataset:
        require_readable(dataset)
        return write_netcdf(dataset)


def _blocks(file: IO[bytes]) -> Iterator[bytes]:
    with file:
        while block := file.read(BLOCK):
            yield block


def _lines(place: Path | Bucket) -> Iterator[str]:
    from workers.storage.export import csv_lines, csv_names, require_readable

    dataset = open_survey(place)  # here, so that what is wrong is answered as a problem
    try:
        require_readable(dataset, csv_names(dataset))
    except BaseException:
        dataset.close()
        raise

    def lines() -> Iterator[str]:
        with dataset:
            yield from csv_lines(dataset)

    return lines()
