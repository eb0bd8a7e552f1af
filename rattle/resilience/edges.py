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
from rattle.flight.law import wrap_phase_difference
from rattle.models import AnyGear
from rattle.orbits.iterates import fold_phases
from rattle.resilience.gears import speed_unit_of

Array = NDArray[np.float64]
#: A bisection ends when its two states are closer than CLOSEST_PAIR. Both states are then followed until their distance
#: exceeds FARTHEST_PAIR. Speeds in distances are in units of `speed_unit_of`.
CLOSEST_PAIR, FARTHEST_PAIR = 1e-12, 1e-6
#: Number of parts into which each step of a bisection divides the line between the states.
PARTS = 64
#: Default of `turns`, the largest number of bisections.
MOST_TURNS = 200
#: Largest number of impacts on Σ⁺ per period of the saddles that are sought.
MOST_SADDLE_IMPACTS = 8
#: A saddle with more impacts replaces a saddle with fewer impacts only if its distance from the state on the boundary
#: is less than this share of the other saddle's distance: otherwise both may be one orbit.
REPLACING_RATIO = 0.1
#: Newton's method seeks a saddle with n impacts on Σ⁺ per period from a state on the boundary, if the distance between
#: this state and its n-th iterate is at most RETURN_DISTANCE. The saddle is the edge state if its distance from the
#: state is below EDGE_DISTANCE. Speeds in distances are in units of `speed_unit_of`.
RETURN_DISTANCE, EDGE_DISTANCE = 1e-2, 1e-5


@dataclass(frozen=True)
class EdgeState:
    """The edge state on the boundary between two basins.

    tau, v: phase and speed of one departure from Σ⁺ on the edge state. distance: the accuracy of this state.
    orbit: the edge state as an unstable periodic motion; None if no such motion was found, because it has more than
    eight impacts on Σ⁺ or the edge state is chaotic.
    impacts: the number of impacts on Σ⁺ that the search followed.
    """

    tau: float
    v: float
    orbit: Any
    distance: float
    impacts: int


def edge_state(gear: AnyGear, one: ArrayLike, other: ArrayLike, turns: int = MOST_TURNS) -> EdgeState:
    """Return the edge state on the boundary between the basins of two states (τ, v) with different attractors.

    If the line between the states crosses several basin boundaries, the boundary nearest to the state `one` is
    followed.

    Parameters
    ----------
    one, other : ArrayLike
        The two states (τ, v).
    turns : int
        Largest number of bisections.

    Returns
    -------
    EdgeState
        One departure from Σ⁺ on the edge state, and the unstable periodic motion if it was found.

    Raises
    ------
    ParameterError
        If an argument is outside its domain, or both states go to the same attractor.
    RattleError
        If the motion on the boundary becomes quiet.
    """
    turns = require_integer("turns", turns, 1, 100_000)
    pair = np.array([require_pair(name, state) for name, state in (("one", one), ("other", other))])
    require(bool((pair[:, 1] > 0.0).all()), "the speeds of one and other must be greater than 0")
    pair[:, 0] = fold_phases(pair[:, 0])
    unit, made = speed_unit_of(gear), 0
    for _ in range(turns):
        pair = _bisect_to_boundary(gear, pair, unit)
        found = _find_saddle(gear, pair[0], unit)
        if found is not None and found[1] < EDGE_DISTANCE:
            orbit, distance = found
            return EdgeState(orbit.tau, orbit.v, orbit, distance, made)
        while _distance_between_states(pair, unit) < FARTHEST_PAIR:
            moved = gear.iterate(pair[:, 0], pair[:, 1], 1)
            if (moved.n_plus < 1).any():
                raise RattleError(
                    "the motion on the boundary between the basins becomes quiet or cannot be followed, so no edge "
                    "state is found: choose two other states"
                )
            pair, made = np.column_stack([moved.tau, moved.v]), made + 1
    return EdgeState(float(pair[0, 0]), float(pair[0, 1]), None, _distance_between_states(pair, unit), made)


def _distance_between_states(pair: Array, unit: float) -> float:
    """Return the distance of two states (τ, v), with speeds in units of `unit`."""
    return float(np.hypot(wrap_phase_difference(pair[1, 0] - pair[0, 0]), (pair[1, 1] - pair[0, 1]) / unit))


def _bisect_to_boundary(gear: AnyGear, pair: Array, unit: float) -> Array:
    """Return two states between the states of `pair`, on both sides of a basin boundary, less than CLOSEST_PAIR apart.

    The states are farther apart than CLOSEST_PAIR if rounding stops the bisection earlier.

    Returns
    -------
    Array
        The states (2, 2), the one in the basin of pair[0] first.
    """
    share = np.arange(PARTS + 1) / PARTS
    while True:
        step = np.array([wrap_phase_difference(pair[1, 0] - pair[0, 0]), pair[1, 1] - pair[0, 1]])
        line = pair[0] + share[:, None] * step
        line[:, 0] = fold_phases(line[:, 0])
        which = gear.reached(line[:, 0], line[:, 1]).which
        require(which[0] != which[-1], "both states go to the same attractor: choose states of two basins")
        last = int(np.argmax(which != which[0]))
        pair = line[last - 1 : last + 1]
        distance = _distance_between_states(pair, unit)
        if distance < CLOSEST_PAIR or distance >= np.hypot(step[0], step[1] / unit):
            return pair


def _find_saddle(gear: AnyGear, state: Array, unit: float) -> tuple[Any, float] | None:
    """Return an unstable periodic motion near a state, and its distance from the state; None if none is found.

    All numbers n of impacts on Σ⁺ up to MOST_SADDLE_IMPACTS are tried. If the motion from the state returns
    after n impacts to within RETURN_DISTANCE of the state, Newton's method seeks a periodic motion with n impacts from
    there. A motion replaces a motion with fewer impacts only if its distance is less than REPLACING_RATIO times the
    other's distance.

    Returns
    -------
    tuple[Any, float] | None
        The motion and the distance, with speeds in the given unit.
    """
    best = None
    for n in range(1, MOST_SADDLE_IMPACTS + 1):
        after = gear.iterate(state[0], state[1], n)
        if np.hypot(wrap_phase_difference(after.tau - state[0]), (after.v - state[1]) / unit) > RETURN_DISTANCE:
            continue
        try:
            orbit = gear.orbit(float(state[0]), float(state[1]), n)
        except RattleError:
            continue
        near = float(np.hypot(wrap_phase_difference(orbit.tau - state[0]), (orbit.v - state[1]) / unit))
        if orbit.admissible and not orbit.stable and (best is None or near < REPLACING_RATIO * best[1]):
            best = orbit, near
    return best
