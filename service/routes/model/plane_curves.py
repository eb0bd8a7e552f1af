"""Compute the bifurcation curves in the (δ, ε) plane of one half-backlash."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from fastapi import APIRouter, Depends, Query
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, Field

from gear_rattle.service.harmonics import read_harmonics
from gear_rattle.service.operations.points import curves_document
from gear_rattle.service.operations.processes import compute_in_process
from gear_rattle.service.routes.model.added import (
    add_parameter_fields,
    added_fields,
    annotate_added_parameter_query,
    with_query_parameters,
)
from gear_rattle.service.routes.model.machine import Harmonics
from gear_rattle.service.routes.model.points import Backlash, Multiplier
from gear_rattle.service.state import FrontState
from gear_rattle.service.web import examples
from gear_rattle.service.web.conditional import NOT_MODIFIED, set_query_etag
from gear_rattle.service.web.problems import declare_problems
from rattle.continuation import FARTHEST
from rattle.models import ADDED, DEFAULT_MODEL, model_of, with_harmonics

router = APIRouter(prefix="/v1", tags=["points"])

Damping = Annotated[float, Query(gt=0, le=FARTHEST, allow_inf_nan=False)]
Eccentricity = Annotated[float, Query(ge=0, le=FARTHEST, allow_inf_nan=False)]


class RectangleDocument(BaseModel):
    """A window of the (δ, ε) plane."""

    delta: tuple[float, float]
    epsilon: tuple[float, float]


class EndDocument(BaseModel):
    """An end of a connected piece of a curve."""

    index: int = Field(description="index of the last point")
    reason: str = Field(description="why the curve ends there; `window: …` if it only leaves the window")


class CurveDocument(BaseModel):
    """A bifurcation curve. Each list from `delta` to `piece` has one entry for each computed point of the curve."""

    name: str
    meaning: str
    delta: list[float] = Field(description="damping")
    epsilon: list[float] = Field(description="eccentricity")
    tau: list[float] = Field(description="phase of the departure from the positive wall, in forcing periods")
    v: list[float] = Field(description="speed of the departure")
    multipliers: list[tuple[Multiplier, Multiplier]] = Field(
        description="Floquet multipliers; on grazing curves without the square-root singularity"
    )
    arclength: list[float] = Field(description="length along the curve in the plane, from the start of the piece")
    piece: list[int] = Field(description="number of the connected piece")
    folds: list[int] = Field(description="indices of the points where delta turns back")
    ends: list[EndDocument]
    missing: str | None = Field(description="why the curve could not be traced, if it could not")


class CurveMeeting(BaseModel):
    """The way in which two bifurcation curves meet at a codimension-two point: they cross, or they touch."""

    curves: tuple[str, str]
    order: float | None = Field(
        description="measured p of |epsilon1 - epsilon2| ~ |delta|^p: 1 where they cross, 2 where they touch"
    )


class CurvePointDocument(BaseModel):
    """A codimension-two point, with the names of the curves that meet there and the tangency of each pair of them."""

    name: str
    meaning: str
    delta: float
    epsilon: float
    curves: list[str] = Field(description="names of the curves that meet there")
    tangency: list[CurveMeeting]


class _CurveBase(BaseModel):
    beta: float


if TYPE_CHECKING:
    _Numbers = _CurveBase
else:
    _Numbers = add_parameter_fields(_CurveBase)


class Curves(_Numbers):
    """The bifurcation curves inside a window, and all codimension-two points of the model."""

    window: RectangleDocument
    curves: list[CurveDocument]
    points: list[CurvePointDocument]


@router.get(
    "/curves",
    summary="Bifurcation curves of one model",
    dependencies=[Depends(set_query_etag)],
    responses={200: {"links": examples.CURVES_LINKS}, **NOT_MODIFIED, **declare_problems(422)},
)
@with_query_parameters(
    {"beta": {name: annotate_added_parameter_query(name, f"the {DEFAULT_MODEL} one") for name in ADDED}}
)
async def curves(
    front: FrontState,
    beta: Backlash = 0.6,
    delta_min: Annotated[Damping, Query(examples=[0.7])] = 0.3,
    delta_max: Annotated[Damping, Query(examples=[0.8])] = 1.2,
    epsilon_min: Eccentricity = 0.0,
    epsilon_max: Eccentricity = 1.0,
    harmonic: Harmonics = (),
    **added: float | None,
) -> Curves:
    """Return the bifurcation curves in a window. A curve that does not cross the window has no points."""
    window = {"delta": (delta_min, delta_max), "epsilon": (epsilon_min, epsilon_max)}
    for name, (low, high) in window.items():
        if not low < high:
            message = f"{name}_max ({high:g}) must be above {name}_min ({low:g})"
            raise RequestValidationError([{"loc": ("query", f"{name}_max"), "msg": message}])
    model = with_harmonics(model_of(beta, **added), read_harmonics(harmonic))
    found = await compute_in_process(
        front,
        curves_document,
        model,
        window["delta"],
        window["epsilon"],
        model=model.name,
        what="The curves",
        advice="Request a smaller window.",
    )
    numbers: dict[str, Any] = added_fields(model.numbers)
    return Curves(beta=beta, **numbers, window=RectangleDocument(**window), **found)
