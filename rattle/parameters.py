"""The parameters that a model has besides δ and ε (`Parameter`), and their values at points (`Parameters`)."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.errors import parameters

Array = NDArray[np.float64]
Harmonic = tuple[int, float, float]  # order, amplitude relative to the first harmonic, phase in turns
MOST_HARMONICS, HIGHEST_ORDER = 64, 1000


@dataclass(frozen=True)
class Parameter:
    """A positive parameter of a gear that is the same over a (δ, ε) plane, declared once for all its uses.

    Parameters
    ----------
    name : str
        Name in code, requests, stores and options.
    symbol : str
        Letter in texts.
    label : str
        Name in words, such as "half-backlash".
    of : str
        The part of the gear with this parameter, such as "the walls"; empty for the gear itself.
    default : float, optional
        Default value; None if a value must be given.
    example : float
        A suitable value, which forms suggest.
    least, greatest : float
        The least value that a form offers, and the greatest that a request allows.
    unit : str
        Unit, "1" for a dimensionless number.
    is_axis : bool
        Whether the parameter may be the third axis of a survey.
    path_power : float
        The power of the parameter that changes linearly along a path of parameters.
    path_label : str
        Name of that power in words, for an axis.
    may_be_zero : bool
        Whether 0 is allowed too.
    machine_number : str, optional
        The field of `rattle.Machine` from which the parameter follows.
    machine_text, machine_absent : str
        Description of that field, and of its absence, for options and forms.
    of_machine : callable, optional
        Return the parameter from that field and the `rattle.machine.conversion.Reduced` gears.
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
        """Return the parameter's name in words with its letter."""
        return f"{self.label} {self.symbol}"

    @property
    def in_words(self) -> str:
        """Return name and letter for a list of what a gear has, such as "walls" and their stiffness."""
        part = self.of.removeprefix("the ")
        return f"{part} of {self.long_name}" if part else self.long_name

    @property
    def advice(self) -> str:
        """Return a sentence about suitable values."""
        return f"such as {self.example:g}"

    @property
    def described(self) -> str:
        """Return the name in words, with the part of the gear that has the parameter."""
        return f"{self.label} of {self.of}" if self.of else self.label


def parameters_in(module: str) -> tuple[Parameter, ...]:
    """Return the parameters that the file `declaration.toml` beside a module declares.

    They are in a file because the commands and the client read them without loading the library.

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
    """Values of all parameters of a model: of one point or of many, arrays of one shape.

    `Parameters.of` checks the values. Only the callers of kernels unpack the arrays.

    Parameters
    ----------
    model : str
        The name of the model.
    delta, epsilon, beta : ndarray
        Damping, eccentricity and half-backlash.
    added : mapping of str to ndarray
        The model's other parameters by name, in the order of its declaration.
    harmonics : tuple of Harmonic
        The further harmonics of the forcing, the same at all points.
    """

    model: str
    delta: Array
    epsilon: Array
    beta: Array
    added: Mapping[str, Array] = field(default_factory=dict)
    harmonics: tuple[Harmonic, ...] = ()

    @classmethod
    def of(cls, model: str, delta: ArrayLike, epsilon: ArrayLike, beta: ArrayLike, **added: ArrayLike) -> Parameters:
        """Broadcast values to one shape. Raises ParameterError if one is outside its domain."""
        # copy, because kernels do not accept broadcast arrays, which are read-only
        d, e, b, *others = (np.array(x, order="C") for x in parameters(delta, epsilon, beta, **added))
        return cls(model, d, e, b, dict(zip(added, others, strict=True)))

    @property
    def named(self) -> dict[str, Array]:
        """Return all values by name."""
        return {"delta": self.delta, "epsilon": self.epsilon, "beta": self.beta, **self.added}

    @property
    def others(self) -> dict[str, Array]:
        """Return all values but δ and ε, by name."""
        return {"beta": self.beta, **self.added}

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the arrays."""
        return self.delta.shape

    @property
    def size(self) -> int:
        """Number of points."""
        return self.delta.size

    def flat(self) -> Parameters:
        """Return the points in C order, as contiguous arrays (size,)."""
        return self._each(lambda x: np.array(x, order="C").ravel())

    def take(self, which: Any) -> Parameters:
        """Return the points selected by an index, a slice or a mask."""
        return self._each(lambda x: np.ascontiguousarray(x[which]))

    def repeat(self, count: int) -> Parameters:
        """Return each point `count` times in succession."""
        return self._each(lambda x: np.repeat(x, count))

    def towards(self, other: Parameters, share: float) -> Parameters:
        """Return the points at `share` of the way from these to other points of the same model."""
        if share == 1.0:
            return other
        mixed = {name: x + share * (other.named[name] - x) for name, x in self.named.items()}
        delta, epsilon, beta = (mixed.pop(name) for name in ("delta", "epsilon", "beta"))
        return Parameters(self.model, delta, epsilon, beta, mixed, self.harmonics)

    def with_harmonics(self, harmonics: tuple[Harmonic, ...]) -> Parameters:
        """Return the same points with these further harmonics of the forcing."""
        return replace(self, harmonics=harmonics)

    def point(self, number: int = 0) -> dict[str, float]:
        """Return the values of one of many points by name."""
        return {name: float(x[number]) for name, x in self.named.items()}

    def _each(self, change: Any) -> Parameters:
        added = {name: change(x) for name, x in self.added.items()}
        return Parameters(
            self.model, change(self.delta), change(self.epsilon), change(self.beta), added, self.harmonics
        )
