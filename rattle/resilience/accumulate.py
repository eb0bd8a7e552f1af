"""Accumulate quantities over the impacts of samples: quantities of this library, or quantities that a user defines."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.reached import check_and_flatten_states
from rattle.errors import require_integer, require_number
from rattle.models import MODELS, AnyGear
from rattle.parameters import Parameters

Array = NDArray[np.float64]
#: Largest allowed value of `impacts`.
MOST_IMPACTS = 100_000_000


class Accumulator(Protocol):
    """A quantity of each of n samples, accumulated from their impacts on Σ⁺ one by one.

    `accumulated` calls `begin` once, `add` after each impact on Σ⁺ of the samples still followed, and at last `values`.
    """

    def begin(self, tau: Array, v: Array) -> None:
        """Prepare for n samples that start at the states tau, v (n,)."""

    def add(self, sample: NDArray[np.int64], tau: Array, v: Array, time: Array) -> NDArray[np.bool_] | None:
        """Add the next departure (τ, v) from Σ⁺ of k samples.

        sample: the indices (k,) of these samples. time: forcing periods since each sample started. The method returns
        flags (k,), True for samples that need not be followed further; or None if all must be followed further.
        """

    def values(self) -> Array:
        """Return the quantity of each sample (n,)."""


Make = Callable[[], Accumulator]


def accumulated(
    gear: AnyGear, tau: Array, v: Array, accumulator: Accumulator, periods: float, impacts: int = 100_000
) -> Array:
    """Return a quantity that is accumulated over the impacts of samples (τ, v) of a gear.

    Each sample is followed for `periods` forcing periods, but at most for `impacts` impacts on Σ⁺. A sample that comes
    to rest on a wall has no further impacts.

    Returns
    -------
    Array
        The values of the accumulator, one for each sample.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    phases, speeds, _shape = check_and_flatten_states(tau, v)
    return accumulate_at_parameters(gear.parameters.repeat(phases.size), phases, speeds, accumulator, periods, impacts)


def accumulate_at_parameters(
    parameters: Parameters, tau: Array, v: Array, accumulator: Accumulator, periods: float, impacts: int = 100_000
) -> Array:
    """Return an accumulated quantity of n samples, each at its own parameters.

    tau, v (n,): the initial states. parameters (n,): the parameters of each sample. Each sample is followed for
    `periods` forcing periods, but at most for `impacts` impacts on Σ⁺.

    Returns
    -------
    Array
        The values of the accumulator, one for each sample.
    """
    periods = require_number("periods", periods, positive=True)
    impacts = require_integer("impacts", impacts, 1, MOST_IMPACTS)
    model = MODELS[parameters.model]
    accumulator.begin(tau, v)
    which, time = np.arange(tau.size), np.zeros(tau.size)
    for _ in range(impacts):
        if not which.size:
            break
        moved = model.states_after_return(parameters, tau, v)
        time = time + moved.time
        going = moved.has_returned & (time <= periods)
        ended = accumulator.add(which[going], moved.tau[going], moved.v[going], time[going])
        if ended is not None:
            going[np.flatnonzero(going)[ended]] = False
        which, tau, v, time = which[going], moved.tau[going], moved.v[going], time[going]
        parameters = parameters.take(going)
    return accumulator.values()
