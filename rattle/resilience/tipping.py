"""Find the fate of states when the parameters jump to another point."""

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

SLOW = 1e-4  # departure of what was at rest, in units of speed


@dataclass(frozen=True)
class Tipping:
    """The overlap of the basins of one parameter point with those of another.

    before, after: the attractors of both, by falling share. number (before, after): samples that go to one at first and
    to the other afterwards. goes (before,): the attractor afterwards of a motion that is on each one at first.
    """

    before: tuple[Attractor, ...]
    after: tuple[Attractor, ...]
    number: NDArray[np.int64]
    goes: NDArray[np.int64]

    @property
    def probability(self) -> NDArray[np.float64]:
        """The tipping probability (before, after): the share of a basin that belongs to another afterwards.

        Rows add up to 1. Source: Kaszás, Feudel and Tél, Scientific Reports 9 (2019) 8654.
        """
        return np.asarray(self.number / self.number.sum(axis=1, keepdims=True), np.float64)

    @property
    def interval(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The ends of the 95 % Wilson intervals of the probabilities."""
        return wilson_interval(self.number, np.broadcast_to(self.number.sum(axis=1, keepdims=True), self.number.shape))


def lift_off(gear: AnyGear) -> tuple[float, float]:
    """Return a departure of a motion at rest on Σ⁺, hardly faster than 0.

    It is where the contact force vanishes, or would first.

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
    """Return how a sample of states that is split among the attractors of one gear is split among those of another.

    The sample is that of `before.attractors`, or own states (τ, v). Both gears must be of one kind. Raises
    ParameterError.

    Returns
    -------
    Tipping
        Numbers of states (before, after) by the attractors of both.
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
