"""Tipping: the attractors that states reach after a jump of the parameters, by the attractors before the jump."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.speeds import SpeedLimit
from rattle.attractors.table import Attractor
from rattle.errors import require
from rattle.flight.forcing import phase_of_entry
from rattle.models import AnyGear
from rattle.numerics.sampling import wilson_interval
from rattle.resilience.gears import States, sample_of, unit_of

#: Speed of the departure of a motion that was at rest, in units of `unit_of`.
SLOW = 1e-4


@dataclass(frozen=True)
class Tipping:
    """The overlap of the basins of one parameter point with those of another.

    before, after: the attractors at both points, the largest basin fraction first.
    number (before, after): the number of samples that are in the basin of one before the jump and of the other after
    it. goes (before,): for a motion on each attractor before the jump, the index of its attractor after it.
    """

    before: tuple[Attractor, ...]
    after: tuple[Attractor, ...]
    number: NDArray[np.int64]
    goes: NDArray[np.int64]

    @property
    def probability(self) -> NDArray[np.float64]:
        """The tipping probabilities (before, after): the shares of a basin that belong to each basin after the jump.

        Each row adds up to 1. Source: Kaszás, Feudel and Tél, Scientific Reports 9 (2019) 8654.
        """
        return np.asarray(self.number / self.number.sum(axis=1, keepdims=True), np.float64)

    @property
    def interval(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The ends of the 95 % Wilson intervals of the tipping probabilities."""
        return wilson_interval(self.number, np.broadcast_to(self.number.sum(axis=1, keepdims=True), self.number.shape))


def lift_off(gear: AnyGear) -> tuple[float, float]:
    """Return a very slow departure that stands for a motion at rest on Σ⁺.

    Its phase is the one at which the contact force becomes 0, or is least below the quiet limit.

    Returns
    -------
    tuple[float, float]
        Phase and speed.
    """
    most = min(1.0, gear.quiet_limit / gear.epsilon) if gear.epsilon > 0.0 else 1.0
    return phase_of_entry(gear.delta, most), SLOW * unit_of(gear)


def tipping(
    before: AnyGear,
    after: AnyGear,
    count: int = 4096,
    v_max: SpeedLimit = None,
    seed: int = 0,
    states: States = None,
) -> Tipping:
    """Return the attractors that a sample of states reaches before and after the parameters jump.

    Parameters
    ----------
    before, after : AnyGear
        The gears at both parameter points, of the same model.
    count, v_max, seed
        The sample, as in `before.attractors`.
    states : States
        Initial states (τ, v) instead of the sample.

    Returns
    -------
    Tipping
        The attractors of both gears, and the number of states for each pair of them.

    Raises
    ------
    ParameterError
        If the gears are of different models, or an argument is outside its domain.
    """
    require(before.parameters.model == after.parameters.model, "both gears must be of one model")
    tau, v = sample_of(before, count, v_max, seed, states)
    first = before.reached(tau, v)
    on = [lift_off(after) if each.kind == "quiet" else (each.tau, each.v) for each in first.attractors]
    then = after.reached(np.append(tau, [x for x, _ in on]), np.append(v, [y for _, y in on]))
    shape = len(first.attractors), len(then.attractors)
    each = first.which * shape[1] + then.which[: tau.size]
    number = np.bincount(each, minlength=shape[0] * shape[1]).reshape(shape)
    return Tipping(first.attractors, then.attractors, number, then.which[tau.size :])
