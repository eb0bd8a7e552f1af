"""The parameters of models: a `Parameter` declares one of them, and `Parameters` holds the values of all."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.errors import broadcast_parameters

Array = NDArray[np.float64]
Harmonic = tuple[int, float, float]  # (order, amplitude relative to the first harmonic, phase in turns)
#: Largest allowed number of harmonics of a forcing, and largest allowed order of a harmonic.
MOST_HARMONICS, HIGHEST_ORDER = 64, 1000


@dataclass(frozen=True)
class Parameter:
    """The declaration of a parameter other than δ and ε. It has the same value in all cells of a (δ, ε) plane.

    Parameters
    ----------
    name : str
        The name in code, requests, stores and options.
    symbol : str
        The letter in texts.
    label : str
        The name in words, such as "half-backlash".
    of : str
        The part of the gear that has the parameter, such as "the walls"; empty for the gear as a whole.
    default : float, optional
        The value if none is given; None: a value is required.
    example : float
        A value that forms and messages suggest.
    least, greatest : float
        The least value that a form offers, and the largest value that a request allows.
    unit : str
        The unit, "1" for a dimensionless number.
    is_axis : bool
        Whether the parameter may be the third axis of a survey.
    path_power : float
        The power of the parameter that changes linearly along a path of parameters.
    path_label : str
        The name of this power in words, for an axis.
    may_be_zero : bool
        Whether the value 0 is allowed; all values are at least 0.
    machine_number : str, optional
        The name of the field of `rattle.Machine` that determines the parameter; None if no field does.
    machine_text, machine_absent : str
        A description of this field, and what it means to leave the field out, for options and forms.
    of_machine : callable, optional
        Function of the value of this field and of a `rattle.machine.conversion.ReducedPair` that returns the parameter.
    """

    name: str
    symbol: str
    label: str
    of: str = ""
    default: float | None = None
    example: float = 1.0
    least: float = 0.0
    greatest: float = math.inf
    unit: str = "1"
    is_axis: bool = True
    path_power: float = 1.0
    path_label: str = ""
    may_be_zero: bool = False
    machine_number: str | None = None
    machine_text: str = ""
    machine_absent: str = ""
    of_machine: Callable[[Any, Any], Any] | None = None

    @property
    def long_name(self) -> str:
        """The name in words with the letter, such as "half-backlash β"."""
        return f"{self.label} {self.symbol}"

    @property
    def list_item_text(self) -> str:
        """The parameter as an item in a list of a gear's properties, such as "walls of stiffness κ"."""
        part = self.of.removeprefix("the ")
        return f"{part} of {self.long_name}" if part else self.long_name

    @property
    def advice(self) -> str:
        """A suggestion for the value, for example the words "such as 0.6"."""
        return f"such as {self.example:g}"

    @property
    def full_label(self) -> str:
        """The name in words with the part of the gear that has the parameter, such as "stiffness of the walls"."""
        return f"{self.label} of {self.of}" if self.of else self.label


def read_declared_parameters(module: str) -> tuple[Parameter, ...]:
    """Return the parameters that the file `declaration.toml` in the folder of a module declares.

    The declarations are in a file, because commands and the client read them without loading the library.

    Returns
    -------
    tuple[Parameter, ...]
        The parameters.
    """
    declared = tomllib.loads(Path(module).with_name("declaration.toml").read_text(encoding="utf-8"))
    return tuple(Parameter(**each) for each in declared["parameters"])


BETA = Parameter("beta", "β", "half-backlash", default=0.6, example=0.6)


@dataclass(frozen=True, eq=False)
class Parameters:
    """The values of all parameters of a model at one point or at many, as arrays of one shape.

    `Parameters.from_values` checks given values and broadcasts them.

    Parameters
    ----------
    model : str
        The name of the model.
    delta, epsilon, beta : ndarray
        Damping, eccentricity and half-backlash.
    added : mapping of str to ndarray
        The parameters that the model adds, by name, in the order of its declaration.
    harmonics : tuple of Harmonic
        The harmonics of the forcing besides the first, the same at all points.
    """

    model: str
    delta: Array
    epsilon: Array
    beta: Array
    added: Mapping[str, Array] = field(default_factory=dict)
    harmonics: tuple[Harmonic, ...] = ()

    @classmethod
    def from_values(
        cls, model: str, delta: ArrayLike, epsilon: ArrayLike, beta: ArrayLike, **added: ArrayLike
    ) -> Parameters:
        """Check values and broadcast them to one shape. Raises ParameterError if one is outside its domain."""
        # copies, because kernels need arrays that are contiguous and writable
        d, e, b, *others = (np.array(x, order="C") for x in broadcast_parameters(delta, epsilon, beta, **added))
        return cls(model, d, e, b, dict(zip(added, others, strict=True)))

    @property
    def values_by_name(self) -> dict[str, Array]:
        """{name: values} of δ, ε, β and the parameters that the model adds."""
        return {"delta": self.delta, "epsilon": self.epsilon, "beta": self.beta, **self.added}

    @property
    def others(self) -> dict[str, Array]:
        """{name: values} of β and of the parameters that the model adds to δ, ε and β."""
        return {"beta": self.beta, **self.added}

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the arrays."""
        return self.delta.shape

    @property
    def size(self) -> int:
        """The number of points."""
        return self.delta.size

    def flat(self) -> Parameters:
        """Return the points in C order as new arrays (size,)."""
        return self._apply_to_arrays(lambda x: np.array(x, order="C").ravel())

    def take(self, which: Any) -> Parameters:
        """Return the points that an index, a slice or a mask selects."""
        return self._apply_to_arrays(lambda x: np.ascontiguousarray(x[which]))

    def repeat(self, count: int) -> Parameters:
        """Return each point `count` times in a row."""
        return self._apply_to_arrays(lambda x: np.repeat(x, count))

    def interpolate(self, other: Parameters, share: float) -> Parameters:
        """Return the points at a share of the way from these points (share 0) to the points of `other` (share 1)."""
        if share == 1.0:
            return other
        mixed = {name: x + share * (other.values_by_name[name] - x) for name, x in self.values_by_name.items()}
        delta, epsilon, beta = (mixed.pop(name) for name in ("delta", "epsilon", "beta"))
        return Parameters(self.model, delta, epsilon, beta, mixed, self.harmonics)

    def with_harmonics(self, harmonics: tuple[Harmonic, ...]) -> Parameters:
        """Return the same points with these harmonics of the forcing besides the first."""
        return replace(self, harmonics=harmonics)

    def point(self, number: int = 0) -> dict[str, float]:
        """Return the values at point number `number`, by name."""
        return {name: float(x[number]) for name, x in self.values_by_name.items()}

    def _apply_to_arrays(self, function: Any) -> Parameters:
        """Return the points with a function applied to each array."""
        added = {name: function(x) for name, x in self.added.items()}
        return Parameters(
            self.model, function(self.delta), function(self.epsilon), function(self.beta), added, self.harmonics
        )
