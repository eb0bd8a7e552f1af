"""Download a survey as a file: NetCDF with everything, or CSV and Parquet with a row per cell, attractor or orbit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import IO, Annotated, Any

import anyio
from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import StreamingResponse
from starlette.background import BackgroundTask
from starlette.concurrency import run_in_threadpool

from gear_rattle.service.errors import MissingPartError
from gear_rattle.service.routes.documents import SurveyId
from gear_rattle.service.state import ApplicationState, FrontState
from gear_rattle.service.web.conditional import NOT_MODIFIED, REVALIDATE, is_not_modified, weak_etag
from gear_rattle.service.web.problems import declare_problems
from gear_rattle.workers import StoreInBucket, open_survey
from gear_rattle.workers.survey.values.schema import RowForm
from rattle import MissingExtraError

router = APIRouter(prefix="/v1/surveys", tags=["results"])

NETCDF, CSV, PARQUET = "application/x-netcdf", "text/csv", "application/vnd.apache.parquet"
BLOCK_BYTES = 1 << 18


RowFormQuery = Annotated[RowForm, Query(description="meaning of a row: a cell, or an attractor or an orbit of a cell")]


def _binary_responses(media_type: str) -> dict[int | str, dict[str, Any]]:
    return {200: {"content": {media_type: {"schema": {"type": "string", "format": "binary"}}}}, **NOT_MODIFIED}


@router.get(
    "/{survey_id}/download.nc",
    summary="Everything of a survey as NetCDF 4, also of a running survey",
    response_class=Response,
    responses={**_binary_responses(NETCDF), **declare_problems(404, 422)},
)
async def netcdf(request: Request, front: FrontState, survey_id: SurveyId) -> Response:
    """Return a survey with all its variables as one file: all groups of its store except the pyramid levels.

    Each complex variable becomes two variables, `…_real` and `…_imag`.
    """
    return await _file_response(request, front, survey_id, "nc", NETCDF, _write_netcdf)


@router.get(
    "/{survey_id}/download.parquet",
    summary="The table of download.csv as Parquet, if this service can write it",
    response_class=Response,
    responses={**_binary_responses(PARQUET), **declare_problems(404, 422)},
)
async def parquet(
    request: Request, front: FrontState, survey_id: SurveyId, form: RowFormQuery = RowForm.CELLS
) -> Response:
    """Return the table of `download.csv` as Parquet, with the survey's attributes as metadata of the file.

    If the service was installed without the extra `parquet`, the answer is 404.
    """
    return await _file_response(
        request, front, survey_id, f"{form}.parquet", PARQUET, partial(_write_parquet, form=form)
    )


@router.get(
    "/{survey_id}/download.csv",
    summary="A table of a survey as CSV, also of a running survey: by default a row per cell",
    response_class=Response,
    responses={200: {"content": {CSV: {"schema": {"type": "string"}}}}, **NOT_MODIFIED, **declare_problems(404, 422)},
)
async def csv(request: Request, front: FrontState, survey_id: SurveyId, form: RowFormQuery = RowForm.CELLS) -> Response:
    """Return a table with a row for each cell, or for each attractor or orbit of each cell.

    Codes, such as those of regions, are numbers. A cell with `status` 0 is not computed yet.
    """
    store, headers = await _find_store_and_headers(front, survey_id, "csv" if form is RowForm.CELLS else f"{form}.csv")
    if is_not_modified(request, headers):
        return Response(status_code=304, headers=headers)
    lines = await run_in_threadpool(_open_csv_lines, store, form)
    return StreamingResponse(lines, media_type=CSV, headers=headers)


async def _file_response(
    request: Request,
    front: ApplicationState,
    survey_id: str,
    ending: str,
    media_type: str,
    write: Callable[[Path | StoreInBucket], IO[bytes]],
) -> Response:
    store, headers = await _find_store_and_headers(front, survey_id, ending)
    if is_not_modified(request, headers):
        return Response(status_code=304, headers=headers)
    with front.interruptible_work():
        file = await anyio.to_thread.run_sync(write, store, limiter=front.export_limiter, abandon_on_cancel=True)
    size = await run_in_threadpool(file.seek, 0, 2)
    file.seek(0)
    return StreamingResponse(
        _read_blocks(file),
        media_type=media_type,
        headers=headers | {"Content-Length": str(size)},
        background=BackgroundTask(file.close),  # for HEAD no block is read, so `_read_blocks` does not close the file
    )


async def _find_store_and_headers(
    front: ApplicationState, survey_id: str, ending: str
) -> tuple[Path | StoreInBucket, dict[str, str]]:
    job, store = await run_in_threadpool(front.find_job_and_existing_store, survey_id)
    return store, {
        "ETag": weak_etag(job.id, job.last_event, ending),
        "Cache-Control": REVALIDATE,
        "Content-Disposition": f'attachment; filename="survey-{job.id}.{ending}"',
    }


def _write_netcdf(store: Path | StoreInBucket) -> IO[bytes]:
    from gear_rattle.workers.storage.export import require_readable_variables, write_netcdf  # loads xarray
    from gear_rattle.workers.storage.store import open_groups

    with open_survey(store, as_stored=True) as dataset:
        require_readable_variables(dataset)
        return write_netcdf(dataset, open_groups(store))


def _write_parquet(store: Path | StoreInBucket, form: RowForm) -> IO[bytes]:
    from gear_rattle.workers.storage.export import names_of_column_variables, require_readable_variables, write_parquet

    with open_survey(store, as_stored=True) as dataset:
        require_readable_variables(dataset, names_of_column_variables(dataset, form))
        try:
            return write_parquet(dataset, form)
        except MissingExtraError as error:
            raise MissingPartError(f"This service cannot write Parquet. {error}") from error


def _read_blocks(file: IO[bytes]) -> Iterator[bytes]:
    with file:
        while block := file.read(BLOCK_BYTES):
            yield block


def _open_csv_lines(store: Path | StoreInBucket, form: RowForm) -> Iterator[str]:
    from gear_rattle.workers.storage.export import csv_lines, names_of_column_variables, require_readable_variables

    # The survey is opened before the answer begins, so that errors become problem documents.
    dataset = open_survey(store, as_stored=True)
    try:
        require_readable_variables(dataset, names_of_column_variables(dataset, form))
    except BaseException:
        dataset.close()
        raise

    def lines() -> Iterator[str]:
        with dataset:
            yield from csv_lines(dataset, form)

    return lines()
