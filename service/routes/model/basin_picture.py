"""Draw the basins of attraction of one parameter point."""

from __future__ import annotations

from io import BytesIO
from typing import Annotated

from fastapi import APIRouter, Depends, Query, Response

from gear_rattle.service.errors import LimitError
from gear_rattle.service.operations.processes import compute_in_process
from gear_rattle.service.routes.model.machine import PointQuery
from gear_rattle.service.routes.picture import PNG
from gear_rattle.service.state import FrontState
from gear_rattle.service.web.conditional import NOT_MODIFIED, set_query_etag
from gear_rattle.service.web.problems import declare_problems
from rattle.attractors import highest_sampled_speed
from rattle.models import AnyGear, model_of_gear

router = APIRouter(prefix="/v1", tags=["points"])


@router.get(
    "/basins.png",
    summary="Basins of attraction of one parameter point, over phase and impact speed",
    dependencies=[Depends(set_query_etag)],
    response_class=Response,
    responses={
        200: {"content": {PNG: {"schema": {"type": "string", "format": "binary"}}}},
        **NOT_MODIFIED,
        **declare_problems(422),
    },
)
async def basins(
    front: FrontState,
    point: PointQuery,
    response: Response,
    resolution: Annotated[int, Query(ge=1, description="cells a side", examples=[50])] = 300,
    tau_min: Annotated[float, Query(ge=0, lt=1, description="least phase")] = 0.0,
    tau_max: Annotated[float, Query(gt=0, le=1, description="largest phase")] = 1.0,
    v_min: Annotated[float, Query(ge=0, allow_inf_nan=False, description="least speed")] = 0.0,
    v_max: Annotated[
        float | None, Query(gt=0, allow_inf_nan=False, description="largest speed; by default as in the paper")
    ] = None,
) -> Response:
    """Draw the basins of a point, or of a machine in SI units, over phase and speed in the model's units.

    Each point of the picture is followed as an initial condition, as in Figure 4 of the paper. The white line is the
    grazing curve Γ (impacting model).
    """
    speeds = v_min, highest_shown_speed(point.gear) if v_max is None else v_max
    for name, low, high in (("tau", tau_min, tau_max), ("v", *speeds)):
        if not low < high:
            raise LimitError(f"query.{name}_min", f"{name}_min ({low:g}) must be less than {name}_max ({high:g}).")
    limit = front.settings.max_basin_resolution
    if resolution > limit:
        raise LimitError(
            "query.resolution", f"resolution may be at most {limit:,}. For more, use the command rattle figure."
        )
    png = await compute_in_process(
        front,
        _draw_basins,
        point.gear,
        resolution,
        (tau_min, tau_max),
        speeds,
        model=model_of_gear(point.gear).name,
        what="The basins",
        advice="Request a lower resolution, or a larger δ: transients last for some 1/δ forcing periods.",
    )
    return Response(png, media_type=PNG, headers=dict(response.headers))


def highest_shown_speed(gear: AnyGear) -> float:
    """Return the largest speed that a picture of basins shows by default."""
    return highest_sampled_speed(None, gear.delta, gear.epsilon, gear.beta)


def _draw_basins(gear: AnyGear, resolution: int, tau: tuple[float, float], v: tuple[float, float]) -> bytes:
    from rattle.plot import panels  # loads matplotlib, only in the process that draws

    added = {each.name: model_of_gear(gear).numbers[each.name] for each in model_of_gear(gear).added}
    harmonics = gear.parameters.harmonics
    figure = panels(gear.delta, [gear.epsilon], gear.beta, resolution, tau, v, harmonics=harmonics, **added).figure
    figure.set_size_inches(6.4, 6.2)
    with BytesIO() as png:
        figure.savefig(png, format="png")
        return png.getvalue()
