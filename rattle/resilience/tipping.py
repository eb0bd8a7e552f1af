"""Tipping: the attractors that states reach at the parameters before a jump, and at the parameters after it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.speeds import SpeedLimit
from rattle.attractors.table import Attractor
from rattle.errors import require
from rattle.flight.forcing import phase_of_arc_entry
from rattle.models import AnyGear
from rattle.numerics.sampling import wilson_interval
from rattle.resilience.gears import States, initial_states_of, speed_unit_of

#: Speed of the departure that stands for a motion at rest on Σ⁺, in units of `speed_unit_of`.
REST_SPEED = 1e-4


@dataclass(frozen=True)
class Tipping:
    """The overlap of the basins at one parameter point with the basins at another point.

    before, after: the attractors at the first and at the second point, the largest basin fraction first.
    number: for each pair (i, j) the number of samples in the basin of before[i] at the first point and in the basin of
    after[j] at the second point. goes: for each attractor in `before`, the index in `after` of the attractor to which
    its motion goes after the jump of the parameters.
    """

    before: tuple[Attractor, ...]
    after: tuple[Attractor, ...]
    number: NDArray[np.int64]
    goes: NDArray[np.int64]

    @property
    def probability(self) -> NDArray[np.float64]:
        """The tipping probabilities: row i has the shares of the basin of before[i] that lie in each basin of `after`.

        The sum of each row is 1. Source: Kaszás, Feudel and Tél, Scientific Reports 9 (2019) 8654.
        """
        return np.asarray(self.number / self.number.sum(axis=1, keepdims=True), np.float64)

    @property
    def interval(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The lower and the upper ends of the 95 % Wilson intervals of the tipping probabilities, two arrays."""
        return wilson_interval(self.number, np.broadcast_to(self.number.sum(axis=1, keepdims=True), self.number.shape))


def departure_from_rest(gear: AnyGear) -> tuple[float, float]:
    """Return a very slow departure that stands for a motion at rest on Σ⁺.

    The departure is at the phase at which the contact force becomes 0. Below the quiet limit, where the force is always
    positive, the departure is at the phase of least force.

    Returns
    -------
    tuple[float, float]
        Phase and speed.
    """
    most = min(1.0, gear.quiet_limit / gear.epsilon) if gear.epsilon > 0.0 else 1.0
    return phase_of_arc_entry(gear.delta, most), REST_SPEED * speed_unit_of(gear)


def tipping(
    before: AnyGear,
    after: AnyGear,
    count: int = 4096,
    v_max: SpeedLimit = None,
    seed: int = 0,
    states: States = None,
) -> Tipping:
    """Return the attractors that samples reach at the parameters before a jump and at the parameters after it.

    Parameters
    ----------
    before, after : AnyGear
        The gears at both parameter points, of the same model.
    count, v_max, seed
        The samples, as in `before.attractors`.
    states : States
        Initial states (τ, v), instead of drawn samples.

    Returns
    -------
    Tipping
        The attractors of both gears, and the number of states for each pair of them.

    Raises
    ------
    ParameterError
        If the gears are of different models, or an argument is outside its domain.
    """
    models = before.parameters.model, after.parameters.model
    require(models[0] == models[1], f"both gears must be of the same model, got {' and '.join(models)}")
    tau, v = initial_states_of(before, count, v_max, seed, states)
    first = before.reached(tau, v)
    on = [departure_from_rest(after) if each.kind == "quiet" else (each.tau, each.v) for each in first.attractors]
    then = after.reached(np.append(tau, [x for x, _ in on]), np.append(v, [y for _, y in on]))
    shape = len(first.attractors), len(then.attractors)
    each = first.which * shape[1] + then.which[: tau.size]
    number = np.bincount(each, minlength=shape[0] * shape[1]).reshape(shape)
    return Tipping(first.attractors, then.attractors, number, then.which[tau.size :])
