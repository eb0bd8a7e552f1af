"""Find the end of the chaotic attractor: a boundary crisis.

Above it the chaotic set still exists but leaks, ever more slowly towards the crisis, so sampling gives an interval. At
its upper end trajectories were seen to leave; at its lower end none did, and the end of the attractor lies below the
interval only if that watch was too short.
"""

import numpy as np
from numpy.typing import NDArray

import rattle
from rattle.attractors.samples import Outcome
from rattle.errors import RattleError
from rattle.flight.law import wrapped
from rattle.impacting.attractors.classifier import attractors_of

SAMPLES = 1024  # initial conditions among which the chaotic attractor is looked for
WATCHED, BEFORE, IMPACTS = 128, 2_000, 100_000  # trajectories on the chaotic set; impacts before the watch, and in it
CLOSED, RETURNS = 1e-6, 2  # what comes back this close after so many impacts has settled: quiet, or P(1,1,0), P(1,2,0)

States = tuple[NDArray[np.float64], NDArray[np.float64]]


def on_chaos(delta: float, epsilon: float, count: int) -> States:
    """(τ, v) of so many states on the chaotic attractor: one trajectory of it, impact by impact."""
    found = attractors_of(delta, epsilon, count=SAMPLES)
    chaotic = np.flatnonzero(found.kind == Outcome.CHAOTIC)
    if not chaotic.size:
        raise RattleError(f"no chaotic attractor was found at delta = {delta}, epsilon = {epsilon}")
    i = chaotic[0]
    states = rattle.iterate(delta, epsilon, found.tau[i], found.v[i], np.arange(100, 100 + count))
    return states.tau, states.v


def has_settled(delta: float, epsilon: float, tau: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return flags of states on a motion that repeats after RETURNS impacts at most, or bounces at hardly any speed."""
    later = rattle.iterate(delta, epsilon, tau[:, None], v[:, None], np.arange(1, RETURNS + 1))
    moved = np.hypot(wrapped(later.tau - tau[:, None]), later.v - v[:, None])
    return (moved < CLOSED).any(axis=1) | (v < 0.1)


def leaks(delta: float, epsilon: float, start: States) -> bool:
    """Return whether the chaotic set that these states have reached after BEFORE impacts leaks in IMPACTS more.

    True as well where all have gone before the watch.

    Returns
    -------
    bool
        True if any of them goes.
    """
    near = rattle.iterate(delta, epsilon, *start, BEFORE)
    left = ~has_settled(delta, epsilon, near.tau, near.v)
    end = rattle.iterate(delta, epsilon, near.tau[left], near.v[left], IMPACTS)
    return bool(not left.any() or has_settled(delta, epsilon, end.tau, end.v).any())


def end_of_chaos(delta: float, low: float, high: float, width: float) -> tuple[float, float]:
    """Return an interval of ε that holds the end of the chaotic attractor that exists at low and not at high.

    It is at most `width` wide, by bisection on `leaks`.

    Returns
    -------
    tuple[float, float]
        Both ends.
    """
    start = on_chaos(delta, low, WATCHED)
    while high - low > width:
        middle = (low + high) / 2
        low, high = (low, middle) if leaks(delta, middle, start) else (middle, high)
    return low, high
