"""Numbers of a gear and how they vary: from random numbers to gears."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.errors import ParameterError, did_you_mean, require, require_number
from rattle.machine import Machine, Units, conversion
from rattle.machine.given import RPM
from rattle.models import ADDED, OTHERS, Model, model_adding
from rattle.parameters import BETA, Parameters
from rattle.populations.copula import Copula, correlation_of, shares
from rattle.populations.distributions import Distribution, Normal, distribution_of

DIMENSIONLESS = ("delta", "epsilon", *OTHERS)
#: Of a machine: what makes a parameter that a model adds, by the name of that.
MAKING = {each.name: each.machine_number for each in ADDED.values() if each.machine_number is not None}
OF_MACHINE = ("inertia", "drag", "backlash", "eccentricity", "radius", "rpm", *MAKING.values())
OPTIONAL = {BETA.name: BETA.default, **dict.fromkeys((*ADDED, *MAKING.values()))}
MAY_BE_ZERO = ("epsilon", "eccentricity")

Array = NDArray[np.float64]


class Points(NamedTuple):
    """Gears as points of the model (n,), units None without a machine."""

    parameters: Parameters
    units: Units | None

    def some(self, which: Any) -> Points:
        """Return those of an index or a mask."""
        shape = self.parameters.shape
        units = None if self.units is None else Units(*(np.broadcast_to(x, shape)[which] for x in self.units))
        return Points(self.parameters.take(which), units)


@dataclass(frozen=True, eq=False)
class Tolerances:
    """The numbers of a gear, each one number or a distribution (or its text, see `distribution_of`), by name.

    Dimensionless: delta, epsilon, beta (0.6), and what a model adds. Or of a `Machine`: inertia, drag, backlash,
    eccentricity, radius, rpm, stiffness, and drive. correlation: a matrix of the normal numbers that the ranks of
    those that vary stand for, in the order in which they are listed here. Raises ParameterError.
    """

    given: Mapping[str, Any]
    correlation: ArrayLike | None = None

    def __post_init__(self) -> None:
        """Check and convert the fields."""
        given = {name: value for name, value in self.given.items() if value is not None}
        require_known(given)
        read = {name: _read(name, given[name]) for name in (*DIMENSIONLESS, *OF_MACHINE, "drive") if name in given}
        object.__setattr__(self, "given", read)
        require(bool(self.names), "nothing varies: give a distribution for one of the numbers at least")
        matrix = correlation_of(self.correlation, self.names)
        object.__setattr__(self, "correlation", matrix)
        self._require_meant()

    def _require_meant(self) -> None:
        """Raise ParameterError where what may be drawn is no gear, or can only be in other units."""
        low, high = ({name: ends[i] for name, ends in self._ranges.items()} for i in (0, 1))
        for name, least in low.items():
            inside = least >= 0.0 if name in MAY_BE_ZERO else least > 0.0
            require(inside, self._below_zero(name, least))
        if not is_machine(self.given):
            return
        for ends in (high | {"radius": low["radius"]}, low | {"radius": high["radius"], "rpm": high["rpm"]}):
            Machine(**ends, drive=self.given.get("drive", "torque"))

    def _below_zero(self, name: str, least: float) -> str:
        limit = "0" if name in MAY_BE_ZERO else "a number above 0"
        advice = (
            f"cut it off (low={limit}), make its deviation smaller, or give a log-normal one"
            if isinstance(self.given[name], Normal)
            else "begin it above"
        )
        return f"{name} must not be below 0, and its distribution goes down to {least:.3g}: {advice}"

    @cached_property
    def _ranges(self) -> dict[str, tuple[float, float]]:
        return {
            name: value.range if isinstance(value, Distribution) else (value, value)
            for name, value in self.given.items()
            if name != "drive"
        }

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Those that vary, in the order of the correlation matrix."""
        return tuple(name for name, value in self.given.items() if isinstance(value, Distribution))

    @property
    def model(self) -> type[Model]:
        """The model that its gears are of."""
        return model_of_numbers(self.given)

    @cached_property
    def copula(self) -> Copula:
        """How they vary together."""
        return Copula(np.asarray(self.correlation, np.float64))

    def values(self, z: Array) -> Array:
        """Return the numbers (n, d) of gears with these normal numbers (n, d)."""
        u = shares(z)
        return np.stack([self.given[name].quantile(u[:, j]) for j, name in enumerate(self.names)], axis=1)

    def points(self, values: Array) -> Points:
        """Return the gears whose varying numbers (n, d) these are. Raises ParameterError."""
        return points_of({**self.given, **dict(zip(self.names, values.T, strict=True))})


def points_of(given: Mapping[str, Any]) -> Points:
    """Return gears of these numbers, which broadcast: dimensionless ones, or a machine's with its drive.

    Returns
    -------
    Points
        Parameter points of the gears.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    numbers = {**OPTIONAL, **given}
    if not is_machine(given):
        return _points({name: numbers[name] for name in DIMENSIONLESS}, None)
    inertia, radius, drive = numbers["inertia"], numbers["radius"], given.get("drive", "torque")
    speed = numbers["rpm"] * RPM
    found = {
        "delta": conversion.damping(inertia, numbers["drag"], speed),
        "epsilon": conversion.over_radius(numbers["eccentricity"], radius, drive),
        "beta": conversion.half_backlash(numbers["backlash"], radius, drive),
    }
    for name, number in MAKING.items():
        make = ADDED[name].of_machine
        if make is not None and numbers[number] is not None:
            found[name] = make(numbers[number], inertia, radius, speed, conversion.DRIVES[drive])
    return _points(found, conversion.units(inertia, radius, speed, drive))


def model_of_numbers(given: Mapping[str, Any]) -> type[Model]:
    """Return the model of a gear with these numbers, dimensionless or a machine's."""
    return model_adding(
        name for name in ADDED if given.get(name) is not None or given.get(MAKING.get(name, "")) is not None
    )


def is_machine(given: Mapping[str, Any]) -> bool:
    """Return whether numbers are a machine's."""
    return any(name in OF_MACHINE for name in given)


def require_known(given: Mapping[str, Any]) -> None:
    """Raise ParameterError unless these are all numbers of a gear, of one kind."""
    require("speed" not in given, "give the mean speed as rpm, in revolutions per minute")
    for name in given:
        known = *DIMENSIONLESS, *OF_MACHINE, "drive"
        require(
            name in known,
            f"a gear has no {name}: it has {', '.join(DIMENSIONLESS)}, or {', '.join(known[len(DIMENSIONLESS) :])}"
            f"{did_you_mean(name, known)}",
        )
    both = [[name for name in given if name in names] for names in (DIMENSIONLESS, (*OF_MACHINE, "drive"))]
    if all(both):
        raise ParameterError(
            f"{' and '.join(both[0])} and a machine's {' and '.join(both[1])} say it twice: give one of both"
        )
    lacking = [
        name for name in (OF_MACHINE if both[1] else DIMENSIONLESS) if name not in given and name not in OPTIONAL
    ]
    require(not lacking, f"{' and '.join(lacking)} must be given too")
    drive = given.get("drive", "torque")
    require(drive in conversion.DRIVES, f"drive must be torque or speed, got {drive!r}")


def _points(numbers: Mapping[str, Any], units: Units | None) -> Points:
    given = {name: value for name, value in numbers.items() if value is not None}
    model = model_adding(name for name in given if name in ADDED)
    return Points(Parameters.of(model.name, **given).take(...), units)


def _read(name: str, value: Any) -> Distribution | float | str:
    if isinstance(value, Distribution) or name == "drive":
        return value
    if isinstance(value, str):
        try:
            return require_number(name, float(value), positive=name not in MAY_BE_ZERO)
        except ParameterError:
            raise
        except ValueError:
            return distribution_of(value)
    return require_number(name, value, positive=name not in MAY_BE_ZERO)
