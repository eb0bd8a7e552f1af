"""Convert a machine, two gears in SI units, to a parameter point of the model, with the sizes of the model's units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from fastapi import APIRouter, Depends, Query
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, Field

from gear_rattle.service.harmonics import HARMONIC_HELP, read_harmonics
from gear_rattle.service.operations.points import finite_or_none
from gear_rattle.service.routes.model.added import (
    add_parameter_fields,
    added_fields,
    annotate_added_parameter_query,
    machine_number_descriptions,
    with_query_parameters,
)
from gear_rattle.service.web.conditional import NOT_MODIFIED, set_query_etag
from gear_rattle.service.web.problems import declare_problems
from rattle import Machine, ParameterError
from rattle.models import ADDED, AnyGear, model_of, with_harmonics

router = APIRouter(prefix="/v1", tags=["points"])


def declare_positive_query(description: str, example: float | None = None, *, zero: bool = False) -> Any:
    """Return the declaration of a query parameter that must be positive; with `zero`, it may also be 0."""
    above, least = (None, 0.0) if zero else (0.0, None)
    examples = None if example is None else [example]
    return Query(gt=above, ge=least, allow_inf_nan=False, description=description, examples=examples)


MOST_HARMONICS = 64
ALONG_LINE_OF_ACTION = "m along the line of action"
INERTIA = "kg m², of each of two equal gears with its shaft, or of the first of two unlike gears"
DRAG = "N m s/rad: the drag torque of each gear over its speed"
ECCENTRICITY = f"{ALONG_LINE_OF_ACTION}: the amplitude of the transmission error once a revolution"
DRIVE = "torque: a constant torque on one gear; speed: an imposed speed of one gear"
Drive = Annotated[Literal["torque", "speed"], Query(description=DRIVE)]
#: Descriptions of the numbers of a second gear and of parts of the transmission error, by name.
SECOND_GEAR = {
    "driven_inertia": "kg m², of the second gear; by default equal to the first gear's",
    "driven_drag": "N m s/rad, of the second gear; by default equal to the first gear's",
    "driven_radius": "m, of the second gear's base circle; by default from the tooth numbers",
    "teeth": "tooth number of the first gear",
    "driven_teeth": "tooth number of the second gear",
    "driven_eccentricity": f"{ALONG_LINE_OF_ACTION}: the transmission error once a revolution of the second gear",
    "mesh_error": f"{ALONG_LINE_OF_ACTION}: the transmission error once a tooth",
    "mesh_error_2": f"{ALONG_LINE_OF_ACTION}: the transmission error twice a tooth",
    "mesh_error_3": f"{ALONG_LINE_OF_ACTION}: the transmission error three times a tooth",
}
#: Optional numbers of a machine that must be positive.
POSITIVE_NUMBERS = ("stiffness", "driven_inertia", "driven_drag", "driven_radius", "teeth", "driven_teeth")
Harmonics = Annotated[Sequence[str], Query(description=HARMONIC_HELP, max_length=MOST_HARMONICS)]
#: Query parameters of the further numbers of a machine, by name.
FURTHER_NUMBER_QUERIES = {
    name: Annotated[float | None, declare_positive_query(text, zero=name not in POSITIVE_NUMBERS)]
    for name, text in (machine_number_descriptions() | SECOND_GEAR).items()
}
FURTHER_MACHINE_QUERIES = {
    "restitution": annotate_added_parameter_query("restitution", example=0.7),
    **FURTHER_NUMBER_QUERIES,
}
#: Query parameters of the numbers that a machine needs, for routes that take dimensionless numbers instead.
NEEDED_NUMBER_QUERIES = {
    "inertia": Annotated[float | None, declare_positive_query(f"a machine instead: {INERTIA}")],
    "drag": Annotated[float | None, declare_positive_query(DRAG)],
    "backlash": Annotated[float | None, declare_positive_query(ALONG_LINE_OF_ACTION)],
    "eccentricity": Annotated[float | None, declare_positive_query(ECCENTRICITY, zero=True)],
    "radius": Annotated[float | None, declare_positive_query("m, of the base circle")],
    "rpm": Annotated[float | None, declare_positive_query("revolutions per minute")],
}
#: Query parameters after β for such routes: the parameters that models add, then all numbers of a machine.
ADDED_AND_MACHINE_QUERIES: dict[str, Any] = {
    **{name: annotate_added_parameter_query(name) for name in ADDED},
    **NEEDED_NUMBER_QUERIES,
    "drive": Annotated[Literal["torque", "speed"] | None, Query(description=DRIVE)],
    **FURTHER_NUMBER_QUERIES,
}


@with_query_parameters({"drive": FURTHER_MACHINE_QUERIES})
async def machine_of_query(
    inertia: Annotated[float, declare_positive_query(INERTIA, 0.003)],
    drag: Annotated[float, declare_positive_query(DRAG, 0.0005)],
    backlash: Annotated[float, declare_positive_query(ALONG_LINE_OF_ACTION, 0.0001)],
    eccentricity: Annotated[float, declare_positive_query(ECCENTRICITY, 0.000015, zero=True)],
    radius: Annotated[float, declare_positive_query("m, of the base circle", 0.05)],
    rpm: Annotated[float, declare_positive_query("revolutions per minute", 3000.0)],
    drive: Drive = "torque",
    **further_numbers: Any,
) -> Machine:
    """Return the machine that the query describes. Raises ParameterError for numbers that seem to be in other units."""
    return Machine(inertia, drag, backlash, eccentricity, radius, drive=drive, rpm=rpm, **further_numbers)


@with_query_parameters({"drive": FURTHER_MACHINE_QUERIES})
async def measured_machine_of_query(
    inertia: Annotated[float, declare_positive_query(INERTIA, 0.003)],
    drag: Annotated[float, declare_positive_query(DRAG, 0.0005)],
    backlash: Annotated[float, declare_positive_query(ALONG_LINE_OF_ACTION, 0.0001)],
    radius: Annotated[float, declare_positive_query("m, of the base circle", 0.05)],
    rpm: Annotated[float, declare_positive_query("revolutions per minute", 3000.0)],
    drive: Drive = "torque",
    **further_numbers: Any,
) -> Machine:
    """Return the machine of a query, with eccentricity 0 because its transmission error is measured."""
    return Machine(inertia, drag, backlash, 0.0, radius, drive=drive, rpm=rpm, **further_numbers)


@dataclass(frozen=True)
class RequestedPoint:
    """A requested parameter point. machine: the machine that the request describes; None for dimensionless numbers."""

    gear: AnyGear
    machine: Machine | None


@with_query_parameters({"beta": ADDED_AND_MACHINE_QUERIES})
async def point_of_query(
    delta: Annotated[float | None, declare_positive_query("damping; needed without a machine", 0.6)] = None,
    epsilon: Annotated[
        float | None, declare_positive_query("eccentricity; needed without a machine", 0.1, zero=True)
    ] = None,
    beta: Annotated[float | None, declare_positive_query("half-backlash, by default 0.6", 0.6)] = None,
    harmonic: Harmonics = (),
    **more: Any,
) -> RequestedPoint:
    """Return the point that the query describes, by dimensionless numbers or by the numbers of a machine.

    Returns
    -------
    RequestedPoint
        The point, with its machine if the query describes one.

    Raises
    ------
    ParameterError
        A number is wrong, or both kinds of numbers are given.
    RequestValidationError
        A number is missing.
    """
    plain: dict[str, Any] = {"delta": delta, "epsilon": epsilon}
    added = {name: more.pop(name) for name in ADDED}
    needed = {name: more.pop(name) for name in NEEDED_NUMBER_QUERIES}
    given = [name for name, value in {**needed, **more}.items() if value is not None]
    if not given:
        model = with_harmonics(model_of(0.6 if beta is None else beta, **added), read_harmonics(harmonic))
        return RequestedPoint(model.gear(**_require_all_numbers(plain)), None)
    restitution, drive = added.pop("restitution"), more.pop("drive") or "torque"
    plain |= {"beta": beta, **added, "harmonic": harmonic or None}
    both = [name for name, value in plain.items() if value is not None]
    if both:
        raise ParameterError(
            f"{' and '.join(both)} and a machine's {' and '.join(given)} exclude each other: give only dimensionless "
            "numbers, or only a machine's numbers"
        )
    numbers: dict[str, Any] = {**_require_all_numbers(needed), **more}
    machine = Machine(**numbers, restitution=restitution, drive=drive)
    return RequestedPoint(machine.gear, machine)


def _require_all_numbers(numbers: dict[str, float | None]) -> dict[str, float]:
    """Return the numbers. If one is None, raise RequestValidationError, as FastAPI does for a missing parameter."""
    lacking = [name for name, value in numbers.items() if value is None]
    if lacking:
        raise RequestValidationError(
            [
                {"type": "missing", "loc": ("query", name), "msg": "is not given: give it", "input": None}
                for name in lacking
            ]
        )
    return {name: value for name, value in numbers.items() if value is not None}


PointQuery = Annotated[RequestedPoint, Depends(point_of_query)]
MachineQuery = Annotated[Machine, Depends(machine_of_query)]
MeasuredMachineQuery = Annotated[Machine, Depends(measured_machine_of_query)]


class UnitsDocument(BaseModel):
    """Factors that convert the model's numbers to SI units. A factor that overflows double precision is null."""

    length: float | None = Field(description="unit of Φ along the line of action, in m")
    time: float | None = Field(description="forcing period, which is a revolution, in s")
    velocity: float | None = Field(description="unit of speeds along the line of action, in m/s")
    energy: float | None = Field(description="unit of v²/2, in J")
    power: float | None = Field(description="unit of v²/2 per forcing period, in W")
    force: float | None = Field(description="unit of forces between the teeth, in N")
    frequency: float | None = Field(description="frequency of order 1, in Hz")


class _MachineBase(BaseModel):
    delta: float = Field(description="damping")
    epsilon: float = Field(description="eccentricity")
    beta: float = Field(description="half-backlash")


if TYPE_CHECKING:
    _Numbers = _MachineBase
else:
    _Numbers = add_parameter_fields(_MachineBase)


class MachineDocument(_Numbers):
    """A machine, two gears, as a parameter point, with the units for converting results back."""

    units: UnitsDocument
    harmonics: list[tuple[int, float, float]] = Field(description="order, amplitude over the first, phase in turns")
    revolutions: float = Field(description="revolutions of the first gear in a forcing period")
    rate_error: float | None = Field(description="relative error of describing both gears by one damping; 0: exact")
    quiet_limit: float | None = Field(description="eccentricity in m above which quiet running is impossible")


@router.get(
    "/machine",
    summary="A machine, two gears in SI units, as a parameter point, and back",
    dependencies=[Depends(set_query_etag)],
    responses={**NOT_MODIFIED, **declare_problems(422)},
)
async def machine(found: MachineQuery) -> MachineDocument:
    """Convert the numbers of a machine to the model. By default the second gear equals the first.

    Numbers that can only be in other units, such as millimetres, are refused; the message names the unit to use.
    """
    return machine_document(found)


def machine_document(found: Machine) -> MachineDocument:
    """Return the document of a machine: its parameter point, and the sizes of the model's units."""
    gear = found.gear
    with np.errstate(all="ignore"):  # extreme parameters may overflow
        quiet_limit = finite_or_none(gear.quiet_limit * found.units.length)
    return MachineDocument(
        delta=gear.delta,
        epsilon=gear.epsilon,
        beta=gear.beta,
        **added_fields(found.added),
        units=UnitsDocument(**{name: finite_or_none(value) for name, value in found.units._asdict().items()}),
        harmonics=list(found.harmonics),
        revolutions=found.revolutions,
        rate_error=finite_or_none(found.rate_error),
        quiet_limit=quiet_limit,
    )
