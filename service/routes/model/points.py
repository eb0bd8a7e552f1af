"""Compute the orbits and the attractors of one parameter point."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from fastapi import APIRouter, Depends, Query
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool

import rattle
from gear_rattle.service.errors import LimitError
from gear_rattle.service.operations.points import finite_or_none, orbits_document
from gear_rattle.service.operations.processes import compute_in_process
from gear_rattle.service.routes.model.added import add_parameter_fields, added_fields
from gear_rattle.service.routes.model.machine import PointQuery, RequestedPoint
from gear_rattle.service.state import ApplicationState, FrontState
from gear_rattle.service.web import examples
from gear_rattle.service.web.conditional import NOT_MODIFIED, set_query_etag
from gear_rattle.service.web.problems import declare_problems
from gear_rattle.workers.survey.request import SpeedLimitOnce
from rattle.attractors import BUDGET, LARGEST_BUDGET, highest_sampled_speed
from rattle.models import AnyGear, model_of_gear

router = APIRouter(prefix="/v1", tags=["points"])

Backlash = Annotated[float, Query(gt=0, allow_inf_nan=False, description="half-backlash", examples=[0.6])]
SampledSpeed = Annotated[
    Annotated[float, Field(gt=0, allow_inf_nan=False)] | Literal["natural"] | None,
    SpeedLimitOnce,
    Query(description="largest initial speed, or natural; by default 7 in the paper's plane, natural elsewhere"),
]


SampleCount = Annotated[int, Query(ge=1, description="initial conditions", examples=[16])]
MostImpacts = Annotated[
    int, Query(ge=1, le=LARGEST_BUDGET, description="impacts on Σ⁺ after which an initial condition is undecided")
]
SampleSeed = Annotated[int, Query(ge=0, lt=2**32)]


def require_few_samples(front: ApplicationState, count: int) -> None:
    """Raise LimitError if `count`, the initial conditions of a point, exceeds the limit of this service."""
    if count > front.settings.max_point_count:
        raise LimitError(
            "query.count", f"count may be at most {front.settings.max_point_count:,}. For more, submit a survey."
        )


class _PointBase(BaseModel):
    delta: float = Field(description="damping")
    epsilon: float = Field(description="eccentricity")
    beta: float = Field(description="half-backlash")
    harmonics: list[tuple[int, float, float]] = Field(
        default=[],
        description="further harmonics of the forcing: order, amplitude divided by that of the first, phase in turns",
    )


if TYPE_CHECKING:
    _Numbers = _PointBase
else:
    _Numbers = add_parameter_fields(_PointBase)


class PointDocument(_Numbers):
    """A point of the parameter space of the gear model."""


class Multiplier(BaseModel):
    """A Floquet multiplier."""

    re: float | None
    im: float | None


class OrbitDocument(BaseModel):
    """An admissible period-one orbit."""

    name: str = Field(description="A, B, C or D; P: an orbit of another model that corresponds to none of these")
    m: int = Field(description="forcing periods")
    n_plus: int = Field(description="impacts on the positive wall, or contacts")
    n_minus: int = Field(description="impacts on the negative wall, or contacts")
    tau: float | None = Field(description="phase of the departure, in forcing periods")
    v: float | None = Field(description="speed of the departure")
    multipliers: tuple[Multiplier, Multiplier]
    stable: bool


class MissingLimitDocument(BaseModel):
    """An analytic limit, SN1 or the flip, that does not exist at this damping, and what happens instead."""

    limit: Literal["sn1", "flip"]
    reason: str = Field(description="what happens instead, such as: none at this damping: C ends in grazing G1")
    epsilon: float | None = Field(description="eccentricity at which that happens; null if at no eccentricity")


class OrbitsInSI(BaseModel):
    """The analytic limits of a machine in metres of eccentricity, and the speeds of its period-one orbits in m/s."""

    sn1: float | None = Field(description="eccentricity in m, like the other limits")
    flip: float | None
    quiet_limit: float | None
    missing: list[float | None] = Field(description="eccentricities in m of the missing limits, in their order")
    velocities: list[float | None] = Field(description="speeds at the orbits' departures, m/s along the line of action")


class OrbitsDocument(PointDocument):
    """Period-one orbits and analytic limits of one parameter point."""

    region: int | None = Field(
        ge=1, lt=len(rattle.REGIONS), description="1 to 5: I to V; more: other sets of orbits; null with harmonics"
    )
    region_name: str | None = Field(
        description="I…V, or the letters of the orbits that exist, such as ABD; null with harmonics"
    )
    sn1: float | None = Field(description="epsilon at which A and C are born; null where `missing` says why")
    flip: float | None = Field(description="epsilon at which C loses stability; null where `missing` says why")
    quiet_limit: float | None = Field(description="epsilon above which quiet running is impossible")
    missing: list[MissingLimitDocument] = Field(description="limits that are null, and what happens instead")
    orbits: list[OrbitDocument]
    si: OrbitsInSI | None = Field(description="limits and speeds of a machine in SI units; null without a machine")


class AttractorDocument(BaseModel):
    """An attractor with its basin fraction; or, of kind undecided, the fraction of undecided samples."""

    kind: str = Field(description="quiet, periodic, chaotic or undecided")
    m: int
    n_plus: int
    n_minus: int
    contacts: int = Field(description="contact phases in a period (inelastic model); if any, both multipliers are 0")
    fraction: float = Field(description="basin fraction; 0 for a stable orbit that no initial condition reached")
    fraction_interval: tuple[float, float] = Field(description="95 % Wilson interval")
    lyapunov: tuple[float | None, float | None] = Field(
        description="exponents per forcing period; null if not defined, or if -∞ because of contact phases"
    )
    lyapunov_error: float | None
    tau: float | None = Field(description="phase of a representative point")
    v: float | None = Field(description="speed of a representative point")


class Attractors(PointDocument):
    """The attractors of one parameter point, by falling basin fraction."""

    count: int
    v_max: float
    seed: int
    budget: int
    attractors: list[AttractorDocument]


@router.get(
    "/orbits",
    summary="Period-one orbits of one parameter point",
    dependencies=[Depends(set_query_etag)],
    responses={200: {"links": examples.ORBITS_LINKS}, **NOT_MODIFIED, **declare_problems(422)},
)
async def orbits(front: FrontState, point: PointQuery) -> OrbitsDocument:
    """Return the period-one orbits of a point, or of a machine in SI units."""
    gear = point.gear
    model = model_of_gear(gear)
    if model.has_closed_forms:
        await front.kernels.wait_until_compiled(model.name)
        found = await run_in_threadpool(orbits_document, gear)
    else:
        found = await compute_in_process(
            front,
            orbits_document,
            gear,
            model=model.name,
            what="The orbits",
            advice="Choose another point.",
        )
    return OrbitsDocument(**point_document(gear), **found, si=_orbits_in_si(point, found))


def _orbits_in_si(point: RequestedPoint, found: dict[str, Any]) -> OrbitsInSI | None:
    if point.machine is None:
        return None
    units = point.machine.units

    def to_si_units(value: float | None, unit: float) -> float | None:
        return None if value is None else finite_or_none(value * unit)

    limits = {name: to_si_units(found[name], units.length) for name in ("sn1", "flip", "quiet_limit")}
    return OrbitsInSI(
        **limits,
        missing=[to_si_units(each["epsilon"], units.length) for each in found["missing"]],
        velocities=[to_si_units(orbit["v"], units.velocity) for orbit in found["orbits"]],
    )


@router.get(
    "/attractors",
    summary="Attractors of one parameter point",
    dependencies=[Depends(set_query_etag)],
    responses={200: {"links": examples.ATTRACTORS_LINKS}, **NOT_MODIFIED, **declare_problems(422)},
)
async def attractors(
    front: FrontState,
    point: PointQuery,
    count: SampleCount = 256,
    v_max: SampledSpeed = None,
    budget: MostImpacts = BUDGET,
    seed: SampleSeed = 0,
) -> Attractors:
    """Return the attractors of a point, or of a machine in SI units."""
    gear = point.gear
    require_few_samples(front, count)
    found = await compute_in_process(
        front,
        gear.attractors,
        count,
        v_max,
        seed,
        budget,
        model=model_of_gear(gear).name,
        what="The attractors",
        advice="Request fewer initial conditions (count), or submit a survey.",
    )
    return Attractors(
        **point_document(gear),
        count=count,
        v_max=highest_sampled_speed(v_max, gear.delta, gear.epsilon, gear.beta),
        seed=seed,
        budget=budget,
        attractors=[attractor_document(item) for item in found],
    )


def point_document(gear: AnyGear) -> dict[str, Any]:
    """Return the fields of `PointDocument` for a gear."""
    point = gear.parameters.point()
    plain: dict[str, Any] = {name: point[name] for name in ("delta", "epsilon", "beta")}
    return plain | added_fields(point) | {"harmonics": list(gear.parameters.harmonics)}


def attractor_document(item: rattle.Attractor) -> AttractorDocument:
    """Return the document of an attractor."""
    return AttractorDocument(
        kind=item.kind,
        m=item.m,
        n_plus=item.n_plus,
        n_minus=item.n_minus,
        contacts=item.contacts,
        fraction=item.fraction,
        fraction_interval=item.fraction_interval,
        lyapunov=(finite_or_none(item.lyapunov[0]), finite_or_none(item.lyapunov[1])),
        lyapunov_error=finite_or_none(item.lyapunov_error),
        tau=finite_or_none(item.tau),
        v=finite_or_none(item.v),
    )
