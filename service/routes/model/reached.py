"""Find the attractors to which given states of one parameter point go."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Query
from pydantic import Field

from gear_rattle.service.errors import LimitError
from gear_rattle.service.operations.processes import compute_in_process
from gear_rattle.service.routes.model.machine import PointQuery
from gear_rattle.service.routes.model.points import AttractorDocument, PointDocument, attractor_document, point_document
from gear_rattle.service.state import FrontState
from gear_rattle.service.web.conditional import NOT_MODIFIED, set_query_etag
from gear_rattle.service.web.problems import declare_problems
from rattle.models import model_of_gear

router = APIRouter(prefix="/v1", tags=["points"])

MOST_STATES = 100  # at most this many states in one URL
Phase = Annotated[float, Field(allow_inf_nan=False)]
Speed = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class ReachedDocument(PointDocument):
    """The attractors to which states of one parameter point go."""

    attractors: list[AttractorDocument] = Field(description="by falling share of these states")
    which: list[int] = Field(description="for each state, the number of its attractor in this list, from 0")
    impacts: list[int] = Field(
        description="for each state, its impacts on the positive wall until its attractor was certain; -1: chaotic or "
        "undecided"
    )


@router.get(
    "/reached",
    summary="Which attractors given states go to",
    dependencies=[Depends(set_query_etag)],
    responses={**NOT_MODIFIED, **declare_problems(422)},
)
async def reached(
    front: FrontState,
    point: PointQuery,
    tau: Annotated[
        list[Phase],
        Query(min_length=1, max_length=MOST_STATES, description="phases of departures", examples=[[0.2, 0.79]]),
    ],
    v: Annotated[
        list[Speed],
        Query(
            min_length=1,
            max_length=MOST_STATES,
            description="speeds of departures: one for each phase, or one for all",
            examples=[[0.1, 3.77]],
        ),
    ],
) -> ReachedDocument:
    """Return the attractors to which states go, for a point or a machine.

    Repeat tau for each state, and v too unless all states have the same speed.
    """
    limit = front.settings.max_point_count
    if max(len(tau), len(v)) > limit:
        raise LimitError("query.tau", f"there may be at most {limit:,} states. For more, use Gear.reached in Python.")
    gear = point.gear
    found = await compute_in_process(
        front,
        gear.reached,
        tau,
        v,
        model=model_of_gear(gear).name,
        what="The attractors of the states",
        advice="Request fewer states.",
    )
    return ReachedDocument(
        **point_document(gear),
        attractors=[attractor_document(item) for item in found.attractors],
        which=found.which.tolist(),
        impacts=found.impacts.tolist(),
    )
