"""The tolerances of a gear: its numbers and their distributions, and the gears that follow from random numbers."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.errors import ParameterError, did_you_mean, require, require_number
from rattle.machine import Machine, Units, conversion
from rattle.machine.forcing import AMPLITUDES, PairForcing
from rattle.machine.given import DRIVEN, RPM
from rattle.machine.given import MAY_BE_ZERO as MACHINE_MAY_BE_ZERO
from rattle.machine.point import machine_point
from rattle.models import ADDED, OTHERS, Inelastic, Model, model_with_parameters
from rattle.parameters import BETA, Harmonic, Parameters
from rattle.populations.copula import Copula, check_correlation_matrix, normal_probabilities
from rattle.populations.distributions import Distribution, Normal, parse_distribution

#: The numbers of a dimensionless gear by name.
DIMENSIONLESS = ("delta", "epsilon", *OTHERS)
#: {name of a parameter that a model adds: name of the machine's number that determines this parameter}.
MACHINE_NUMBERS = {each.name: each.machine_number for each in ADDED.values() if each.machine_number is not None}
#: Numbers that every machine must have.
NEEDED = ("inertia", "drag", "backlash", "eccentricity", "radius", "rpm")
#: Numbers of a machine besides those of its first gear: the second gear's own numbers, the numbers of teeth of both
#: gears, and the amplitudes of the second gear's and the mesh's errors.
OF_GEAR_PAIR = (*(f"driven_{name}" for name in DRIVEN), "teeth", "driven_teeth", *AMPLITUDES)
#: All numbers of a machine by name, besides amplitudes such as error_20.
OF_MACHINE = (*NEEDED, *MACHINE_NUMBERS.values(), *OF_GEAR_PAIR)
#: Numbers without a dimension, which both a dimensionless gear and a machine may have.
OF_EITHER = ("restitution",)
#: {name: default} of the numbers that may be left out; None means that the number has no value if it is left out.
DEFAULTS = {BETA.name: BETA.default, **dict.fromkeys((*ADDED, *OF_MACHINE[len(NEEDED) :]))}
#: Numbers of a machine that cannot vary.
CANNOT_VARY = ("drive", "teeth", "driven_teeth")
#: Numbers that may be 0, besides amplitudes; all others must be above 0.
MAY_BE_ZERO = ("epsilon", "load", *MACHINE_MAY_BE_ZERO)
#: Names of the amplitudes of further harmonics of a dimensionless gear, relative to the first harmonic: harmonic_20 is
#: the amplitude of order 20.
HARMONIC = re.compile(r"harmonic_([1-9]\d{0,2})")
#: Names of amplitudes of a machine in m, by their order in the revolution of the first gear: error_20.
ERROR = re.compile(r"error_([1-9]\d{0,2})")

Array = NDArray[np.float64]


class GearPoints(NamedTuple):
    """n gears as parameter points of a model.

    parameters: the parameters (n,). units: the SI sizes of the model's units for each machine; None if the gears are
    dimensionless. further_harmonics (n,): the tuple of each gear's harmonics besides the first; None if no gear has
    any.
    """

    parameters: Parameters
    units: Units | None
    further_harmonics: NDArray[np.object_] | None = None

    def take(self, which: Any) -> GearPoints:
        """Return the gears that an index, a slice or a mask selects."""
        shape = self.parameters.shape
        units = None if self.units is None else Units(*(np.broadcast_to(x, shape)[which] for x in self.units))
        return GearPoints(
            self.parameters.take(which),
            units,
            None if self.further_harmonics is None else self.further_harmonics[which],
        )

    def group_by_harmonics(self) -> Iterator[tuple[NDArray[np.int64], GearPoints]]:
        """Yield the gears in groups with equal harmonics: the indices and the points of the gears of each group."""
        if self.further_harmonics is None:
            yield np.arange(self.parameters.size), self
            return
        rows: dict[tuple[Harmonic, ...], list[int]] = {}
        for row, harmonics in enumerate(self.further_harmonics):
            rows.setdefault(harmonics, []).append(row)
        for harmonics, which in rows.items():
            index = np.array(which)
            few = self.take(index)
            yield index, few._replace(parameters=few.parameters.with_harmonics(harmonics), further_harmonics=None)


@dataclass(frozen=True, eq=False)
class Tolerances:
    """The numbers that describe a gear, by name; each is a number, a distribution, or text for `parse_distribution`.

    A dimensionless gear has delta, epsilon, beta (by default 0.6), the parameters that a model adds, and amplitudes
    such as harmonic_20. A `Machine` has inertia, drag, backlash, eccentricity, radius, rpm, stiffness, load_torque, the
    numbers of its second gear, mesh_error, amplitudes such as error_20, and the text drive ("torque" or "speed"). Both
    may have restitution. The phases of all harmonics and errors are 0.

    correlation: the correlation matrix of the normal scores of the varying numbers, in the order in which the numbers
    are listed above. Raises ParameterError if a name is unknown, no number varies, or a value is outside its domain.
    """

    given: Mapping[str, Any]
    correlation: ArrayLike | None = None

    def __post_init__(self) -> None:
        """Check and convert the fields."""
        given = {name: value for name, value in self.given.items() if value is not None}
        require_known_names(given)
        order = (*DIMENSIONLESS, *OF_MACHINE, "drive")
        names = [*(name for name in order if name in given), *sorted(set(given).difference(order))]
        read = {name: _read_distribution_or_number(name, given[name]) for name in names}
        object.__setattr__(self, "given", read)
        require(bool(self.names), "nothing varies: give a distribution for at least one number")
        matrix = check_correlation_matrix(self.correlation, self.names)
        object.__setattr__(self, "correlation", matrix)
        self._require_plausible()

    def _require_plausible(self) -> None:
        """Raise ParameterError if a value that can be drawn is impossible, or so large that its unit must be wrong."""
        low, high = ({name: ends[i] for name, ends in self._ranges_of_numbers.items()} for i in (0, 1))
        for name, least in low.items():
            inside = least >= 0.0 if is_zero_allowed(name) else least > 0.0
            require(inside, self._below_zero_message(name, least))
        if not is_machine(self.given):
            return
        for ends in (high | {"radius": low["radius"]}, low | {"radius": high["radius"], "rpm": high["rpm"]}):
            machine_from_numbers({**ends, "drive": self.given.get("drive", "torque")})

    def _below_zero_message(self, name: str, least: float) -> str:
        """Return the message for a number whose distribution reaches down to `least`, below the allowed values."""
        limit, allowed = (
            ("0", "must not be below 0") if is_zero_allowed(name) else ("a number above 0", "must be above 0")
        )
        advice = (
            f"cut it off (low={limit}), make its deviation smaller, or give a log-normal one"
            if isinstance(self.given[name], Normal)
            else f"let it begin at {limit}"
        )
        return f"{name} {allowed}, but its distribution reaches down to {least:.3g}: {advice}"

    @cached_property
    def _ranges_of_numbers(self) -> dict[str, tuple[float, float]]:
        """For each number, by name, the least and the largest possible value; for a fixed number both are its value."""
        return {
            name: value.range if isinstance(value, Distribution) else (value, value)
            for name, value in self.given.items()
            if name != "drive"
        }

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The names of the numbers that vary, in the order of the correlation matrix."""
        return tuple(name for name, value in self.given.items() if isinstance(value, Distribution))

    @property
    def model(self) -> type[Model]:
        """The model of the gears."""
        return model_of_numbers(self.given)

    @cached_property
    def copula(self) -> Copula:
        """The copula from which correlated values of the varying numbers are drawn."""
        return Copula(np.asarray(self.correlation, np.float64))

    def values(self, z: Array) -> Array:
        """Convert standard normal numbers z (n, d) to values (n, d) of the d varying numbers of n gears."""
        u = normal_probabilities(z)
        return np.stack([self.given[name].quantile(u[:, j]) for j, name in enumerate(self.names)], axis=1)

    def points(self, values: Array) -> GearPoints:
        """Return the gears with these values (n, d) of the varying numbers. Raises ParameterError."""
        return gear_points_of_numbers({**self.given, **dict(zip(self.names, values.T, strict=True))})


def gear_points_of_numbers(given: Mapping[str, Any]) -> GearPoints:
    """Return the parameter points of gears with these numbers.

    given: dimensionless numbers, or numbers of a machine, by name, as arrays that broadcast.

    Returns
    -------
    GearPoints
        The parameter points of the gears.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    numbers = {name: value for name, value in given.items() if value is not None}
    if not is_machine(given):
        own = {**{name: DEFAULTS[name] for name in (BETA.name, *ADDED)}, **numbers}
        orders = amplitudes_by_order(numbers, HARMONIC)
        return _points_of_arrays(
            {name: own[name] for name in DIMENSIONLESS}, None, {k: (own[name], 0.0) for k, name in orders}
        )
    errors = [(order, numbers[name], 0.0) for order, name in amplitudes_by_order(numbers, ERROR)]
    at = machine_point(numbers, numbers["rpm"] * RPM, errors)
    rows = zip(at.forcing.orders, at.forcing.relative_amplitudes, at.forcing.phase, strict=True)
    harmonics = {order: (size, phase) for order, size, phase in rows} if len(at.forcing.orders) > 1 else {}
    dimensionless = {"delta": at.delta, "epsilon": at.epsilon, "beta": at.beta, **at.added}
    return _points_of_arrays(dimensionless, at.units, harmonics)


def machine_from_numbers(numbers: Mapping[str, Any]) -> Machine:
    """Return the machine with these numbers, whose names are those of `Tolerances`. Raises ParameterError."""
    given = {name: value for name, value in numbers.items() if not ERROR.fullmatch(name)}
    errors = [(order, numbers[name], 0.0) for order, name in amplitudes_by_order(numbers, ERROR)]
    return Machine(**given, errors=errors)


def amplitudes_by_order(given: Mapping[str, Any], pattern: re.Pattern[str]) -> list[tuple[int, str]]:
    """Return (order, name), sorted by order, of each amplitude in `given` whose name matches HARMONIC or ERROR."""
    return sorted((int(found[1]), name) for name in given if (found := pattern.fullmatch(name)))


def is_zero_allowed(name: str) -> bool:
    """Return whether the number of a gear with this name may be 0."""
    return name in MAY_BE_ZERO or bool(HARMONIC.fullmatch(name) or ERROR.fullmatch(name))


def model_of_numbers(given: Mapping[str, Any]) -> type[Model]:
    """Return the model of a gear with these numbers by name, dimensionless numbers or numbers of a machine."""
    shaped = any(name in AMPLITUDES or HARMONIC.fullmatch(name) or ERROR.fullmatch(name) for name in given)
    named = {
        name for name in ADDED if given.get(name) is not None or given.get(MACHINE_NUMBERS.get(name, "")) is not None
    }
    if shaped or named & {each.name for each in Inelastic.added}:
        named |= {each.name for each in Inelastic.added}
    return model_with_parameters(named)


def is_machine(given: Mapping[str, Any]) -> bool:
    """Return whether a gear is a machine: at least one of its numbers (`given`, by name) belongs to machines only."""
    return any(name in OF_MACHINE or ERROR.fullmatch(name) for name in given)


def require_known_names(given: Mapping[str, Any]) -> None:
    """Raise ParameterError unless the names describe one gear, and the numbers that cannot vary have valid values."""
    require("speed" not in given, "speed is not taken here: give the mean speed as rpm, in revolutions per minute")
    own = [name for name in given if name in DIMENSIONLESS or HARMONIC.fullmatch(name)]
    of_machine = [name for name in given if name in (*OF_MACHINE, "drive") or ERROR.fullmatch(name)]
    for name in given:
        known = *DIMENSIONLESS, *OF_MACHINE, "drive"
        require(
            name in own or name in of_machine,
            f"a gear has no {name}: it has {', '.join(DIMENSIONLESS)}, or {', '.join(known[len(DIMENSIONLESS) :])}"
            f"{did_you_mean(name, known)}",
        )
        if name in CANNOT_VARY[1:]:
            require_number(name, given[name], positive=True)
    plain = [name for name in own if name not in OF_EITHER]
    if plain and of_machine:
        raise ParameterError(
            f"{' and '.join(plain)} (dimensionless) and {' and '.join(of_machine)} (of a machine) both define the "
            "gear: give only one of these two groups"
        )
    lacking = [name for name in (NEEDED if of_machine else ("delta", "epsilon")) if name not in given]
    require(not lacking, f"{' and '.join(lacking)} must be given too")
    drive = given.get("drive", "torque")
    require(drive in conversion.DRIVES, f"drive must be torque or speed, got {drive!r}")


def _points_of_arrays(
    numbers: Mapping[str, Any], units: Units | None, harmonics: Mapping[int, tuple[Any, Any]]
) -> GearPoints:
    """Return the gears with these dimensionless numbers, as arrays; harmonics: {order: (amplitude/ε, phase)}."""
    given = {name: value for name, value in numbers.items() if value is not None}
    if harmonics or any(each.name in given for each in Inelastic.added):
        given = {"restitution": 1.0, "load": 0.0, **given}
    model = model_with_parameters(name for name in given if name in ADDED)
    numbers_of = {name: given[name] for name in ("delta", "epsilon", "beta")}
    numbers_of |= {each.name: given[each.name] for each in model.added}
    at = Parameters.from_values(model.name, **numbers_of).take(...)
    if not harmonics:
        return GearPoints(at, units)
    sizes, phases = ([np.broadcast_to(each[i], at.shape) for each in harmonics.values()] for i in (0, 1))
    forcing = PairForcing(1.0, 1.0, 1.0, tuple(harmonics), np.stack(sizes), np.stack(phases))
    shapes = np.empty(at.shape, object)
    for row in np.ndindex(at.shape):
        shapes[row] = forcing.harmonics(row)
    return GearPoints(at, units, shapes)


def _read_distribution_or_number(name: str, value: Any) -> Distribution | float | str:
    """Return a distribution or a checked number from a given value, which may be text.

    The value of `drive` ("torque" or "speed") is returned unchecked.

    Returns
    -------
    Distribution | float | str
        A distribution or a number; for `drive` its value.

    Raises
    ------
    ParameterError
        The value is neither a distribution nor a number in its domain.
    """
    if isinstance(value, Distribution) or name == "drive":
        return value
    if isinstance(value, str):
        try:
            return require_number(name, float(value), positive=not is_zero_allowed(name))
        except ParameterError:
            raise
        except ValueError:
            return parse_distribution(value)
    return require_number(name, value, positive=not is_zero_allowed(name))
