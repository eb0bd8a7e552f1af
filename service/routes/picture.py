"""A survey as a picture, finished or not."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import anyio
from fastapi import APIRouter, Query, Request, Response
from starlette.concurrency import run_in_threadpool

from service.errors import MissingError
from service.routes.documents import SurveyId
from service.state import FrontState
from service.web.conditional import NOT_MODIFIED, REVALIDATE, is_known, picture_tag
from service.web.problems import declared
from workers import QUANTITIES, Bucket, open_survey
from workers.storage.store import has_added
from workers.survey.levels.grid import GROUP as LEVELS
from workers.survey.request import MAX_SLICES
from workers.survey.slices import slice_of

router = APIRouter(prefix="/v1/surveys", tags=["results"])

PNG = "image/png"
MAPS = [quantity.name for quantity in QUANTITIES if quantity.per_cell]


@router.get(
    "/{survey_id}/map.png",
    summary="A map over the (delta, epsilon) plane, also of a running survey",
    response_class=Response,
    responses={
        200: {"content": {PNG: {"schema": {"type": "string", "format": "binary"}}}},
        **NOT_MODIFIED,
        **declared(404, 422),
    },
)
async def picture(
    request: Request,
    front: FrontState,
    survey_id: SurveyId,
    variable: Annotated[str, Query(max_length=64, json_schema_extra={"enum": MAPS})] = "region",
    index: Annotated[int, Query(ge=0, le=64, description="which orbit, or slot of attractors")] = 0,
    slice_: Annotated[
        int | None, Query(alias="slice", ge=0, lt=MAX_SLICES, description="of a survey with a third axis, from 0")
    ] = None,
) -> Response:
    """Cells that failed or are still to be computed are told apart from the others."""
    job, place = await run_in_threadpool(front.stored, survey_id)
    if not await run_in_threadpool(place.exists):
        raise MissingError(f"Survey {survey_id} is {job.state} and has no numbers yet. Try again once it runs.")
    headers = {
        "ETag": picture_tag(survey_id, job.last_event, variable, index, slice_),
        "Cache-Control": REVALIDATE,  # another version may draw otherwise, and what was lost may have been repaired
    }
    if is_known(request, headers):
        return Response(status_code=304, headers=headers)
    with front.interruptible():
        png = await anyio.to_thread.run_sync(
            _draw, place, variable, index, slice_, limiter=front.pictures, abandon_on_cancel=True
        )
    return Response(png, media_type=PNG, headers=headers)


def _draw(place: Path | Bucket, variable: str, index: int, slice_number: int | None) -> bytes:
    from workers.pictures.levels import groups_of
    from workers.pictures.maps import map_png  # matplotlib: a second for who asks first, not for every start

    with open_survey(place) as dataset:
        levels = groups_of(partial(open_survey, place), slice_number, has_added(place, LEVELS))
        return map_png(slice_of(dataset, slice_number), variable, index, levels)
