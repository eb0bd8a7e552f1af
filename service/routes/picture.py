"""Draw maps of a survey, finished or not."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Coroutine
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypeVar

import anyio
from fastapi import APIRouter, Depends, Query, Request, Response
from starlette.concurrency import run_in_threadpool

import rattle
from gear_rattle.service.database.tables import JobRow
from gear_rattle.service.errors import LimitError, UnavailableError
from gear_rattle.service.operations.notebook import PACKAGE
from gear_rattle.service.operations.overlaid import Overlays, PictureOptions
from gear_rattle.service.routes.documents import SurveyId
from gear_rattle.service.state import ApplicationState, FrontState
from gear_rattle.service.web.conditional import NOT_MODIFIED, REVALIDATE, is_not_modified, weak_etag
from gear_rattle.service.web.problems import declare_problems
from gear_rattle.workers import QUANTITIES, StoreInBucket, SurveyRequest, open_survey
from gear_rattle.workers.cluster.window import MOST_PIXELS
from gear_rattle.workers.pictures.look import (
    LARGEST,
    LINES,
    SHARE,
    USUAL_SHARE,
    Form,
    MapPictureOptions,
    OverlayData,
    Pair,
    Span,
)
from gear_rattle.workers.storage.store import has_added_node
from gear_rattle.workers.survey.levels.grid import GROUP as LEVELS
from gear_rattle.workers.survey.request import MAX_SLICES
from gear_rattle.workers.survey.slices import require_slice
from rattle.populations import MOST_SHARE

router = APIRouter(prefix="/v1/surveys", tags=["results"])

PNG, SVG, PDF = "image/png", "image/svg+xml", "application/pdf"
MAPS = [*(quantity.name for quantity in QUANTITIES if quantity.is_per_cell), LARGEST, SHARE]
#: Least width of a window, as a share of the magnitude of its larger end, so that the labels of its ticks differ.
LEAST_WIDTH_SHARE = 1e-10
LARGEST_END = 1e100  # ends of windows and of the colours' range are at most this large
LONGEST_LINES = 200  # most characters of the query parameter `lines`
MOST_WINDOW_PIXELS = 4_000_000  # most pixels of a window that is computed anew: pixels_delta × pixels_epsilon
DISCONNECT_CHECK_SECONDS = 1.0  # seconds between two checks whether the client has disconnected

T = TypeVar("T")

WindowEnd = Annotated[
    float | None,
    Query(ge=-LARGEST_END, le=LARGEST_END, description="an end of the window; by default the whole survey is drawn"),
]
ColourEnd = Annotated[float | None, Query(ge=-LARGEST_END, le=LARGEST_END, description="an end of the colours' range")]


async def picture_look_of_query(
    delta_min: WindowEnd = None,
    delta_max: WindowEnd = None,
    epsilon_min: WindowEnd = None,
    epsilon_max: WindowEnd = None,
    span: Annotated[
        Span,
        Query(description="range of the colours: auto: the usual; robust: the middle 96 % of the values; full: all"),
    ] = "auto",
    low: ColourEnd = None,
    high: ColourEnd = None,
    log: Annotated[bool, Query(description="logarithmic colours")] = False,
    lines: Annotated[
        str | None,
        Query(
            max_length=LONGEST_LINES,
            description=f"lines to draw, separated by commas: {', '.join(LINES)}; by default those of the variable",
        ),
    ] = None,
    family: Annotated[
        int | None, Query(ge=0, le=10**9, description="number of a family; cells without it are dimmed")
    ] = None,
) -> MapPictureOptions:
    """Return the window, colours and lines of a picture that a query describes. Raises LimitError for wrong values."""
    chosen = None if lines is None else tuple(name for name in lines.split(",") if name)
    if unknown := set(chosen or ()) - set(LINES):
        raise LimitError("query.lines", f"there is no line {min(unknown)!r}: choose from {', '.join(LINES)}.")
    if log and low is not None and 0 < low < 1 / LARGEST_END:
        least = 1 / LARGEST_END
        raise LimitError("query.low", f"for logarithmic colours, low must be at most 0, or at least {least:g}.")
    return MapPictureOptions(
        _range_of_query("delta", delta_min, delta_max),
        _range_of_query("epsilon", epsilon_min, epsilon_max),
        _range_of_query("colours", low, high, ("low", "high")) or span,
        log,
        chosen,
        family,
    )


def _range_of_query(
    name: str, low: float | None, high: float | None, ends: tuple[str, str] | None = None
) -> Pair | None:
    """Return two query parameters as a range; None if both are missing. Raises LimitError if the range is not valid.

    ends: names of the two parameters for messages; None for the names `name`_min and `name`_max.
    """
    first, last = ends or (f"{name}_min", f"{name}_max")
    both = _require_both_or_none(first, low, last, high)
    if both is None:
        return None
    low, high = both
    if not high - low > max(LEAST_WIDTH_SHARE * max(abs(low), abs(high)), 1 / LARGEST_END):
        raise LimitError(
            f"query.{first}",
            f"{first} ({low:g}) must be less than {last} ({high:g}), by more than 1e-10 of the larger magnitude.",
        )
    return both


def _require_both_or_none(first_name: str, first: T | None, second_name: str, second: T | None) -> tuple[T, T] | None:
    """Return two parameters that belong together, or None if neither is given. Raises LimitError if only one is."""
    if first is None and second is None:
        return None
    if first is None or second is None:
        missing = first_name if first is None else second_name
        raise LimitError(f"query.{missing}", f"give both {first_name} and {second_name}, or neither.")
    return first, second


Index = Annotated[int, Query(ge=0, le=64, description="number of the orbit, slot of attractors, or family")]
Pixels = Annotated[
    int | None,
    Query(
        ge=2, le=MOST_PIXELS,
        description="resolution along this axis. If a cell of the survey is larger than three pixels, the window is "
        "computed anew with about one cell per pixel, which takes as long as a survey of this size",
    ),
]  # fmt: skip


async def options_of_query(
    look: Annotated[MapPictureOptions, Depends(picture_look_of_query)],
    variable: Annotated[str, Query(max_length=64, json_schema_extra={"enum": MAPS})] = "region",
    index: Index = 0,
    slice_: Annotated[
        int | None,
        Query(alias="slice", ge=0, lt=MAX_SLICES, description="number of the slice along a third axis, from 0"),
    ] = None,
    share: Annotated[
        float,
        Query(ge=0.01, le=MOST_SHARE, description="required probability of quiet running for the line design_limit"),
    ] = USUAL_SHARE,
    pixels_delta: Pixels = None,
    pixels_epsilon: Pixels = None,
    caption: Annotated[bool, Query(description="name the survey, its address and the version below the map")] = False,
) -> PictureOptions:
    """Return the options of a picture that the query describes. Raises LimitError for wrong numbers of pixels."""
    pixels = _require_both_or_none("pixels_delta", pixels_delta, "pixels_epsilon", pixels_epsilon)
    if pixels and math.prod(pixels) > MOST_WINDOW_PIXELS:
        raise LimitError(
            "query.pixels_delta",
            f"a window may have at most {MOST_WINDOW_PIXELS:,} pixels: lower pixels_delta or pixels_epsilon.",
        )
    return PictureOptions(variable, index, slice_, look, share, pixels, caption)


PictureQuery = Annotated[PictureOptions, Depends(options_of_query)]


def _picture_responses(media: str, schema: dict[str, str]) -> dict[int | str, dict[str, Any]]:
    return {200: {"content": {media: {"schema": schema}}}, **NOT_MODIFIED, **declare_problems(404, 422, 503)}


@router.get(
    "/{survey_id}/map.png",
    summary="A map over the (delta, epsilon) plane, also of a running survey",
    response_class=Response,
    responses=_picture_responses(PNG, {"type": "string", "format": "binary"}),
)
async def picture(request: Request, front: FrontState, survey_id: SurveyId, options: PictureQuery) -> Response:
    """Draw a map as PNG. Failed cells, and cells that are not computed yet, have colours of their own."""
    return await _picture_response(request, front, survey_id, options, "png", PNG)


@router.get(
    "/{survey_id}/map.svg",
    summary="The same map as SVG",
    response_class=Response,
    responses=_picture_responses(SVG, {"type": "string"}),
)
async def drawing(request: Request, front: FrontState, survey_id: SurveyId, options: PictureQuery) -> Response:
    """Draw a map as SVG, with lines and letters as vectors, and cells as pixels."""
    return await _picture_response(request, front, survey_id, options, "svg", SVG)


@router.get(
    "/{survey_id}/map.pdf",
    summary="The same map as PDF",
    response_class=Response,
    responses=_picture_responses(PDF, {"type": "string", "format": "binary"}),
)
async def sheet(request: Request, front: FrontState, survey_id: SurveyId, options: PictureQuery) -> Response:
    """Draw a map as PDF, with lines and letters as vectors, and cells as pixels."""
    return await _picture_response(request, front, survey_id, options, "pdf", PDF)


async def _picture_response(
    request: Request, front: ApplicationState, survey_id: str, options: PictureOptions, form: Form, media: str
) -> Response:
    job, store = await run_in_threadpool(front.find_job_and_existing_store, survey_id)
    if options.has_caption:
        options = replace(options, look=options.look.with_caption(_caption_text(job, str(request.url))))
    headers = {
        "ETag": weak_etag(survey_id, job.last_event, options, form),
        "Cache-Control": REVALIDATE,  # a later version may draw the picture differently, and a repair may add tiles
    }
    if is_not_modified(request, headers):
        return Response(status_code=304, headers=headers)
    with front.interruptible_work():
        overlays = await _await_while_connected(
            request, _compute_overlays(front, request.app.state.overlaid, job, options)
        )
        drawn = await anyio.to_thread.run_sync(
            _draw_map, store, options, form, overlays, limiter=front.picture_limiter, abandon_on_cancel=True
        )
    return Response(drawn, media_type=media, headers=headers)


async def _compute_overlays(
    front: ApplicationState, overlaid: Overlays, job: JobRow, options: PictureOptions
) -> OverlayData:
    """Compute the overlays of a map before it is drawn. Raises RattleError for a wrong slice or if an overlay fails."""
    whole = SurveyRequest.model_validate(job.request)
    require_slice({name: axis.num for name, axis in whole.third_axis.items()}, options.slice)
    survey = whole.slice_request(whole.slice_index(options.slice or 0))
    await front.kernels.wait_until_compiled(survey.gear_model.name, patience=math.inf)
    return await overlaid.compute_overlays(survey, options)


async def _await_while_connected(request: Request, work: Coroutine[Any, Any, OverlayData]) -> OverlayData:
    """Return the overlays of a picture. If the client disconnects, cancel `work` and raise UnavailableError."""
    task = asyncio.ensure_future(work)
    try:
        while not (await asyncio.wait([task], timeout=DISCONNECT_CHECK_SECONDS))[0]:
            if await request.is_disconnected():
                raise UnavailableError("The client of this picture has disconnected.")
        return task.result()
    finally:
        task.cancel()


def _caption_text(job: JobRow, address: str) -> str:
    return f"{job.name or job.id}, {address}, {PACKAGE} {rattle.__version__}"


def _draw_map(store: Path | StoreInBucket, options: PictureOptions, form: Form, overlays: OverlayData) -> bytes:
    from gear_rattle.workers.pictures.largest import open_survey_for_map
    from gear_rattle.workers.pictures.levels import level_opener
    from gear_rattle.workers.pictures.maps import render_map_picture  # loads matplotlib, which takes a second

    opened = partial(open_survey, store)
    with_families = SHARE if options.look.family is not None else options.variable
    with open_survey_for_map(opened, with_families, options.slice) as dataset:
        levels = level_opener(opened, options.slice, has_added_node(store, LEVELS))
        return render_map_picture(dataset, options.variable, options.index, levels, options.look, form, overlays)
