"""Download a Jupyter notebook that computes what the explorer shows of a parameter point."""

from __future__ import annotations

import json
from typing import Annotated, Literal

from fastapi import APIRouter, Depends, Query, Response

from gear_rattle.service.operations.diagrams import LEAST_SPAN, MOST_SPAN, diagram_ends
from gear_rattle.service.operations.notebook import create_notebook
from gear_rattle.service.routes.model.machine import PointQuery, declare_positive_query
from gear_rattle.service.web.conditional import NOT_MODIFIED, set_query_etag
from gear_rattle.service.web.problems import declare_problems
from rattle import ParameterError

router = APIRouter(prefix="/v1", tags=["points"])

IPYNB = "application/x-ipynb+json"


@router.get(
    "/notebook",
    summary="A Jupyter notebook of one parameter point",
    dependencies=[Depends(set_query_etag)],
    response_class=Response,
    responses={200: {"content": {IPYNB: {"schema": {"type": "object"}}}}, **NOT_MODIFIED, **declare_problems(422)},
)
async def notebook(
    point: PointQuery,
    response: Response,
    direction: Annotated[Literal["epsilon", "delta"], Query(description="axis of the diagram")] = "epsilon",
    span: Annotated[
        float | None,
        Query(ge=LEAST_SPAN, le=MOST_SPAN, description="extent of the diagram on either side of the point"),
    ] = None,
    to_delta: Annotated[
        float | None,
        declare_positive_query("damping at the end of a diagram that begins at the point; needs to_epsilon"),
    ] = None,
    to_epsilon: Annotated[
        float | None, declare_positive_query("eccentricity at its end; needs to_delta", zero=True)
    ] = None,
) -> Response:
    """Return a Jupyter notebook that computes the attractors, the basins and a bifurcation diagram of a point.

    The point may be given as a machine in SI units. The service computes nothing: the notebook does when it is run.
    """
    if (to_delta is None) != (to_epsilon is None):
        raise ParameterError("to_delta and to_epsilon are the end of the diagram: give both or neither")
    to = None if to_delta is None or to_epsilon is None else (to_delta, to_epsilon)
    gear = point.gear
    found = create_notebook(gear, point.machine, diagram_ends(gear, direction, span, to))
    name = f"gear-delta-{gear.delta:g}-epsilon-{gear.epsilon:g}.ipynb"
    headers = dict(response.headers) | {"Content-Disposition": f'attachment; filename="{name}"'}
    return Response(json.dumps(found, ensure_ascii=False, indent=1), media_type=IPYNB, headers=headers)
