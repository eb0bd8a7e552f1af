"""Gather quantities from the impacts of samples: one interface for this library's and for anybody's own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.reached import states_of
from rattle.errors import require_integer, require_number
from rattle.models import MODELS, AnyGear
from rattle.parameters import Parameters

Array = NDArray[np.float64]
MOST_IMPACTS = 100_000_000


class Accumulator(Protocol):
    """A quantity of each of n samples, from their impacts on Σ⁺ one by one."""

    def begin(self, tau: Array, v: Array) -> None:
        """Begin with the samples (n,)."""

    def add(self, sample: NDArray[np.int64], tau: Array, v: Array, time: Array) -> NDArray[np.bool_] | None:
        """Return the next departures from Σ⁺ of these samples (k,), with the forcing periods since they set out.

        Returns which of them need not be followed on; None: all shall be.
        """

    def values(self) -> Array:
        """Return the quantity (n,)."""


Make = Callable[[], Accumulator]


def accumulated(
    gear: AnyGear, tau: Array, v: Array, accumulator: Accumulator, periods: float, impacts: int = 100_000
) -> Array:
    """Return the quantity of samples (τ, v) of a gear.

    Each is followed for `periods` forcing periods, or `impacts` impacts on Σ⁺ at most. A sample that comes to rest has
    no impacts from there on.

    Returns
    -------
    Array
        What the accumulator has summed up for each sample.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    phases, speeds, _shape = states_of(tau, v)
    return accumulated_at(gear.parameters.repeat(phases.size), phases, speeds, accumulator, periods, impacts)


def accumulated_at(
    parameters: Parameters, tau: Array, v: Array, accumulator: Accumulator, periods: float, impacts: int = 100_000
) -> Array:
    """Return the same of samples (n,) that each have their own parameters."""
    periods = require_number("periods", periods, positive=True)
    impacts = require_integer("impacts", impacts, 1, MOST_IMPACTS)
    model = MODELS[parameters.model]
    accumulator.begin(tau, v)
    which, time = np.arange(tau.size), np.zeros(tau.size)
    for _ in range(impacts):
        if not which.size:
            break
        moved = model.returned(parameters, tau, v)
        time = time + moved.time
        going = moved.goes & (time <= periods)
        ended = accumulator.add(which[going], moved.tau[going], moved.v[going], time[going])
        if ended is not None:
            going[np.flatnonzero(going)[ended]] = False
        which, tau, v, time = which[going], moved.tau[going], moved.v[going], time[going]
        parameters = parameters.take(going)
    return accumulator.values()
