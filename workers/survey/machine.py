"""A survey of a machine: two gears with fixed dimensions; the axes of the survey are their speed and eccentricity.

β depends on neither speed nor eccentricity; δ = 2πc/(IΩ) depends on the speed alone (drag c, inertia I, angular speed
Ω), and ε on the eccentricity alone. So a plane of one β is a plane of speeds and eccentricities, also if the two gears
have different dimensions. Amplitudes of harmonics in the request are relative to the eccentricity. Even steps of δ are
even steps of the duration of a revolution, not of the speed.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import Field, SerializerFunctionWrapHandler, ValidationError, model_serializer

from gear_rattle.workers.survey.axes import Axis, Real, StrictRecord, message_of_first_error
from rattle import Machine
from rattle.machine import RPM, ReducedPair, machine_point

Part = TypeVar("Part", bound=StrictRecord)
Positive = Annotated[Real, Field(gt=0)]
Teeth = Annotated[int, Field(strict=True, ge=1, le=1000)]

#: {axis of a survey of a machine: the axis of the model to which it is converted}.
AXES = {"rpm": "delta", "eccentricity": "epsilon"}


class SurveyedMachine(StrictRecord):
    """Two gears in SI units, as `rattle.Machine` takes them, without speed, eccentricity and stiffness.

    inertia: kg m². drag: N m s. backlash, radius: m. drive: "torque" or "speed". driven_inertia, driven_drag,
    driven_radius: numbers of the second gear, by default equal to the first gear's. teeth, driven_teeth: tooth numbers.
    """

    inertia: Positive
    drag: Positive
    backlash: Positive
    radius: Positive
    drive: Literal["torque", "speed"] = "torque"
    driven_inertia: Positive | None = None
    driven_drag: Positive | None = None
    driven_radius: Positive | None = None
    teeth: Teeth | None = None
    driven_teeth: Teeth | None = None

    @model_serializer(mode="wrap")
    def _omit_none(self, handler: SerializerFunctionWrapHandler):  # type: ignore[no-untyped-def]
        """Leave out fields that are None, for example the fields of a second gear that equals the first gear."""
        return {name: value for name, value in handler(self).items() if value is not None}

    def machine_at_speed(self, rpm: float, eccentricity: float) -> Machine:
        """Return the machine at a speed, with an eccentricity in metres. Raises ParameterError."""
        given = self.model_dump()
        return Machine(**given, eccentricity=eccentricity, rpm=rpm)

    @property
    def _reduced_pair(self) -> ReducedPair:
        """The two gears reduced to one coordinate. The speed is 1 rad/s; the fields used here do not depend on it."""
        return machine_point({**self.model_dump(), "eccentricity": 0.0}, 1.0).pair

    @property
    def beta(self) -> float:
        """The model's half-backlash β of these gears."""
        return float(self._reduced_pair.phi_per_angle * self.backlash / (2.0 * self.radius))

    def speed_at_damping(self, delta: Any) -> Any:
        """Return the speeds in revolutions per minute at which the gears have the dampings `delta`."""
        pair = self._reduced_pair
        return 2.0 * np.pi * pair.drag / pair.inertia / delta / RPM

    def eccentricity_in_metres(self, epsilon: Any) -> Any:
        """Return the eccentricities, in metres along the line of action, that correspond to `epsilon`."""
        return epsilon * self.radius / self._reduced_pair.phi_per_angle


def plane_range_of_axis(machine: SurveyedMachine, name: str, axis: Axis) -> tuple[float, float]:
    """Return the range of δ for an axis of speeds ("rpm"), or of ε for eccentricities. Raises ParameterError."""
    if name == "rpm":
        return machine.machine_at_speed(axis.stop, 0.0).delta, machine.machine_at_speed(axis.start, 0.0).delta
    any_speed = 1.0  # in revolutions per minute; another number would do, because ε does not depend on the speed
    low, high = (machine.machine_at_speed(any_speed, end).epsilon for end in (axis.start, axis.stop))
    return low, high


def convert_fields_to_dimensionless(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a survey request, with the machine's speeds, eccentricities and backlash as δ, ε and β.

    Returns
    -------
    dict[str, Any]
        Fields by name; `machine` and both axes are validated.

    Raises
    ------
    ValueError
        A field of the machine is wrong, or the request has an axis both in the machine and beside it.
    """
    machine = dict(given["machine"])
    spans = {name: machine.pop(name) for name in AXES if name in machine}
    numbers = _validate_part(SurveyedMachine, "machine", machine)
    made: dict[str, Any] = {"machine": numbers}
    for name, span in spans.items():
        if given.get(AXES[name]) is not None:
            raise ValueError(f"machine.{name} and {AXES[name]} describe the same axis: give one of them")
        read = _validate_part(Axis, f"machine.{name}", span)
        start, stop = plane_range_of_axis(numbers, name, read)
        made[AXES[name]] = Axis(start=start, stop=stop, num=read.num)
    return {"beta": numbers.beta, **given, **made}


def _validate_part(kind: type[Part], where: str, value: Any) -> Part:
    """Validate a part of a request as `kind`. A ValueError names the wrong field; `where` is the name of the part."""
    try:
        return kind.model_validate(value)
    except ValidationError as error:
        place = ".".join([where, *map(str, error.errors()[0]["loc"])])
        raise ValueError(f"{place}: {message_of_first_error(error)}") from error
