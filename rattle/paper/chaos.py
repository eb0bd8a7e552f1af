"""Find the end of the chaotic attractor, a boundary crisis, as an interval of ε.

Above the crisis the chaotic set still exists, but trajectories leave it. They leave more slowly if ε is closer to the
crisis. At the upper end of the interval trajectories left the set during the observation. At the lower end no
trajectory left, so the crisis is in the interval, or below it if the observation time was too short.
"""

import numpy as np
from numpy.typing import NDArray

import rattle
from rattle.attractors.samples import Outcome
from rattle.errors import RattleError
from rattle.flight.law import wrap_phase_difference
from rattle.impacting.attractors.classifier import attractors_of

#: Number of initial conditions among which the chaotic attractor is searched.
SAMPLES = 1024
#: Number of observed trajectories, and the impacts of each before and during the observation.
WATCHED, EARLIER_IMPACTS, IMPACTS = 128, 2_000, 100_000
#: A trajectory has settled if it is slow, or if it comes back to less than the distance CLOSED from its state within
#: RETURNS impacts (`flag_settled_states`).
CLOSED, RETURNS = 1e-6, 2

States = tuple[NDArray[np.float64], NDArray[np.float64]]


def chaotic_states(delta: float, epsilon: float, count: int) -> States:
    """Return `count` successive states (τ, v) on the chaotic attractor; RattleError if no such attractor is found."""
    found = attractors_of(delta, epsilon, count=SAMPLES)
    chaotic = np.flatnonzero(found.kind == Outcome.CHAOTIC)
    if not chaotic.size:
        raise RattleError(
            f"no chaotic attractor was found at delta = {delta}, epsilon = {epsilon}: report this as a bug"
        )
    i = chaotic[0]
    states = rattle.iterate(delta, epsilon, found.tau[i], found.v[i], np.arange(100, 100 + count))
    return states.tau, states.v


def flag_settled_states(
    delta: float, epsilon: float, tau: NDArray[np.float64], v: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return flags: True for a state with a speed v below 0.1, or with a motion that repeats within RETURNS impacts."""
    later = rattle.iterate(delta, epsilon, tau[:, None], v[:, None], np.arange(1, RETURNS + 1))
    moved = np.hypot(wrap_phase_difference(later.tau - tau[:, None]), later.v - v[:, None])
    return (moved < CLOSED).any(axis=1) | (v < 0.1)


def is_chaotic_set_leaking(delta: float, epsilon: float, start: States) -> bool:
    """Return whether trajectories leave the chaotic set during the observation.

    The states `start` are first iterated for EARLIER_IMPACTS impacts, then observed for IMPACTS impacts.

    Returns
    -------
    bool
        True if a trajectory settles during the observation, or if all trajectories settled before the observation.
    """
    near = rattle.iterate(delta, epsilon, *start, EARLIER_IMPACTS)
    left = ~flag_settled_states(delta, epsilon, near.tau, near.v)
    end = rattle.iterate(delta, epsilon, near.tau[left], near.v[left], IMPACTS)
    return bool(not left.any() or flag_settled_states(delta, epsilon, end.tau, end.v).any())


def bracket_end_of_chaos(delta: float, low: float, high: float, width: float) -> tuple[float, float]:
    """Return an interval of ε, at most `width` wide, that contains the end of the chaotic attractor, by bisection.

    The attractor exists at ε = low and not at ε = high.

    Returns
    -------
    tuple[float, float]
        Both ends of the interval.
    """
    start = chaotic_states(delta, low, WATCHED)
    while high - low > width:
        middle = (low + high) / 2
        low, high = (low, middle) if is_chaotic_set_leaking(delta, middle, start) else (middle, high)
    return low, high
