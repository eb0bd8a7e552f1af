"""Edge states: the states to which motions on the boundary between two basins converge, usually saddles.

Edge tracking: bisection brings two states on different sides of the boundary close together; both are followed until
they separate; then bisection brings them together again. Source: J. D. Skufca, J. A. Yorke and B. Eckhardt, Physical
Review Letters 96 (2006) 174101.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.errors import RattleError, require, require_integer, require_pair
from rattle.flight.law import wrapped
from rattle.models import AnyGear
from rattle.orbits.iterates import fold
from rattle.resilience.gears import unit_of

Array = NDArray[np.float64]
#: Distance of the two states after a bisection, and the distance at which they have separated.
TOGETHER, APART = 1e-12, 1e-6
#: Parts of the line between the states that are tried at once.
PARTS = 64
#: Default of `turns`, the number of bisections.
MOST_TURNS = 200
#: Most impacts on Σ⁺ of a saddle that is searched.
LONGEST = 8
#: A saddle of more impacts replaces one of fewer only if it is closer by this factor; else it may be its repetition.
TWICE = 0.1
#: Distances from a saddle at which it is solved for, and at which it is the edge state.
CLOSE, ARRIVED = 1e-2, 1e-5


@dataclass(frozen=True)
class EdgeState:
    """The edge state on the boundary between two basins.

    tau, v: phase and speed of a state of it. distance: the accuracy of this state.
    orbit: the unstable periodic motion, or None if it has more than eight impacts or the edge state is chaotic.
    impacts: the number of impacts on Σ⁺ that were followed to it.
    """

    tau: float
    v: float
    orbit: Any
    distance: float
    impacts: int


def edge_state(gear: AnyGear, one: ArrayLike, other: ArrayLike, turns: int = MOST_TURNS) -> EdgeState:
    """Return the edge state on the boundary between the basins of two states (τ, v) with different attractors.

    If the line between the states crosses several boundaries, the one nearest to `one` is followed.

    Parameters
    ----------
    one, other : ArrayLike
        The two states (τ, v).
    turns : int
        Most bisections.

    Returns
    -------
    EdgeState
        A state of it, and its unstable periodic motion if that was found.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    RattleError
        If the motion on the edge comes to rest.
    """
    turns = require_integer("turns", turns, 1, 100_000)
    pair = np.array([require_pair(name, state) for name, state in (("one", one), ("other", other))])
    require(bool((pair[:, 1] > 0.0).all()), "speeds must be greater than 0")
    pair[:, 0] = fold(pair[:, 0])
    unit, made = unit_of(gear), 0
    for _ in range(turns):
        pair = _together(gear, pair, unit)
        found = _saddle(gear, pair[0], unit)
        if found is not None and found[1] < ARRIVED:
            orbit, distance = found
            return EdgeState(orbit.tau, orbit.v, orbit, distance, made)
        while _distance(pair, unit) < APART:
            moved = gear.iterate(pair[:, 0], pair[:, 1], 1)
            if (moved.n_plus < 1).any():
                raise RattleError(
                    "the motion on the boundary comes to rest, so it has no edge state: choose two other states"
                )
            pair, made = np.column_stack([moved.tau, moved.v]), made + 1
    return EdgeState(float(pair[0, 0]), float(pair[0, 1]), None, _distance(pair, unit), made)


def _distance(pair: Array, unit: float) -> float:
    """Return the distance of two states, with speeds in the unit."""
    return float(np.hypot(wrapped(pair[1, 0] - pair[0, 0]), (pair[1, 1] - pair[0, 1]) / unit))


def _together(gear: AnyGear, pair: Array, unit: float) -> Array:
    """Return two states on different sides of the boundary, closer than TOGETHER, on the line between a pair."""
    share = np.arange(PARTS + 1) / PARTS
    while True:
        step = np.array([wrapped(pair[1, 0] - pair[0, 0]), pair[1, 1] - pair[0, 1]])
        line = pair[0] + share[:, None] * step
        line[:, 0] = fold(line[:, 0])
        which = gear.reached(line[:, 0], line[:, 1]).which
        require(which[0] != which[-1], "both states go to the same attractor: choose one of each basin")
        last = int(np.argmax(which != which[0]))
        pair = line[last - 1 : last + 1]
        distance = _distance(pair, unit)
        if distance < TOGETHER or distance >= np.hypot(step[0], step[1] / unit):
            return pair


def _saddle(gear: AnyGear, state: Array, unit: float) -> tuple[Any, float] | None:
    """Return the unstable periodic motion that is nearest to a state, if it is CLOSE, and its distance."""
    best = None
    for n in range(1, LONGEST + 1):
        after = gear.iterate(state[0], state[1], n)
        if np.hypot(wrapped(after.tau - state[0]), (after.v - state[1]) / unit) > CLOSE:
            continue
        try:
            orbit = gear.orbit(float(state[0]), float(state[1]), n)
        except RattleError:
            continue
        near = float(np.hypot(wrapped(orbit.tau - state[0]), (orbit.v - state[1]) / unit))
        if orbit.admissible and not orbit.stable and (best is None or near < TWICE * best[1]):
            best = orbit, near
    return best
