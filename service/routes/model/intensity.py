"""Compute how hard the attractors of one parameter point rattle."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from fastapi import APIRouter, Depends
from pydantic import BaseModel, Field

from gear_rattle.service.operations.points import compute_intensities, finite_or_none
from gear_rattle.service.operations.processes import compute_in_process
from gear_rattle.service.routes.model.machine import PointQuery, RequestedPoint
from gear_rattle.service.routes.model.points import (
    MostImpacts,
    PointDocument,
    SampleCount,
    SampledSpeed,
    SampleSeed,
    point_document,
    require_few_samples,
)
from gear_rattle.service.state import FrontState
from gear_rattle.service.web.conditional import NOT_MODIFIED, set_query_etag
from gear_rattle.service.web.problems import declare_problems
from rattle import Attractor, Intensity
from rattle.attractors import BUDGET
from rattle.intensity import natural_energy
from rattle.models import model_of_gear

router = APIRouter(prefix="/v1", tags=["points"])


class ErrorsDocument(BaseModel):
    """Errors of an intensity: each field has the error of the field of the same name in the intensity.

    An error is half the width of the 95 % interval; 0 if the field is exact, null if the attractor is undecided.
    """

    impacts_plus: float | None
    impacts_minus: float | None
    mean_speed: float | None
    energy: float | None
    contact: float | None
    impulse: float | None


class IntensityInSI(BaseModel):
    """The intensity of one attractor of a machine, in SI units."""

    impacts: float | None = Field(description="impacts per second, on both walls together")
    mean_velocity: float | None = Field(description="m/s along the line of action")
    largest_velocity: float | None = Field(description="m/s along the line of action")
    energy: float | None = Field(description="J per revolution")
    power: float | None = Field(description="mean power of the impacts, W")
    power_error: float | None = Field(description="half-width of the 95 % interval of the power, W")
    level: float | None = Field(description="dB relative to 1 pW; null if quiet or undecided")
    contact: float | None = Field(description="share of the time in contact")


class RattlingDocument(BaseModel):
    """An attractor and its intensity per forcing period. The intensity is null if the attractor is undecided."""

    kind: str = Field(description="quiet, periodic, chaotic or undecided")
    m: int
    n_plus: int
    n_minus: int
    contacts: int = Field(description="contact phases in a period of the inelastic model")
    fraction: float
    impacts_plus: float | None = Field(description="impacts on the positive wall, or contacts")
    impacts_minus: float | None = Field(description="impacts on the negative wall, or contacts")
    mean_speed: float | None
    largest_speed: float | None
    energy: float | None = Field(description="sum of v²/2")
    level: float | None = Field(description="energy in dB relative to 2π²δ², that of A and C; null if quiet")
    contact: float | None = Field(description="share of the time in contact")
    impulse: float | None = Field(description="check of the computation: 2πδ(1 + load) for every lasting motion")
    errors: ErrorsDocument
    si: IntensityInSI | None = Field(description="null unless a machine was given")


class IntensitiesDocument(PointDocument):
    """The intensities of the attractors of one parameter point, by falling basin fraction."""

    attractors: list[RattlingDocument]


@router.get(
    "/intensity",
    summary="How hard the attractors of one parameter point rattle",
    dependencies=[Depends(set_query_etag)],
    responses={**NOT_MODIFIED, **declare_problems(422)},
)
async def intensity(
    front: FrontState,
    point: PointQuery,
    count: SampleCount = 256,
    v_max: SampledSpeed = None,
    budget: MostImpacts = BUDGET,
    seed: SampleSeed = 0,
) -> IntensitiesDocument:
    """Return the intensities of the attractors of a point, or of a machine in SI units.

    Values of periodic motions are exact; values of chaotic motions have error bars.
    """
    require_few_samples(front, count)
    found = await compute_in_process(
        front,
        compute_intensities,
        point.gear,
        count,
        v_max,
        seed,
        budget,
        model=model_of_gear(point.gear).name,
        what="The intensities",
        advice="Request fewer initial conditions (count), or submit a survey.",
    )
    return IntensitiesDocument(
        **point_document(point.gear), attractors=[_rattling_document(point, *each) for each in found]
    )


def _rattling_document(point: RequestedPoint, attractor: Attractor, found: Intensity) -> RattlingDocument:
    values: dict[str, Any] = asdict(found)
    del values["errors"]
    si = None if point.machine is None else point.machine.intensity_in_si(found)
    return RattlingDocument(
        kind=attractor.kind,
        m=attractor.m,
        n_plus=attractor.n_plus,
        n_minus=attractor.n_minus,
        contacts=attractor.contacts,
        fraction=attractor.fraction,
        **{name: finite_or_none(value) for name, value in values.items()},
        level=finite_or_none(found.level(natural_energy(point.gear.delta))),
        errors=ErrorsDocument(**{name: finite_or_none(value) for name, value in found.errors._asdict().items()}),
        si=None
        if si is None
        else IntensityInSI(**{name: finite_or_none(value) for name, value in si._asdict().items()}),
    )
