"""Find why an attractor ends between two points of a path: follow its periodic orbit to its end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rattle.errors import RattleError
from rattle.flight.law import wrap_phase_difference
from rattle.models import AnyGear, gear_at_point
from rattle.parameters import Parameters
from rattle.resilience.gears import SAME_POINT, speed_unit_of

Array = NDArray[np.float64]
SADDLE_NODE, FLIP, GRAZE = "saddle-node", "flip", "graze"
CRISIS, QUIET_LIMIT, SAMPLING, CONTINUES, UNKNOWN = "crisis", "quiet limit", "sampling", "continues", "unknown"
#: Smallest step of continuation, as a share of the distance between two neighbouring points of the path.
LEAST_STEP = 1e-9
#: Orbits with more impacts are not followed, because an orbit of a hundred impacts would take half a minute.
MOST_ORBIT_IMPACTS = 32
#: Largest distance between the departures of an orbit and of its continuation, with speeds in units of `speed_unit_of`.
FARTHEST_CONTINUATION = 0.1
#: Where the continuation of an orbit stops, a multiplier that is closer to ±1 than this counts as ±1: the orbit ends at
#: a saddle-node or a flip.
NEAR_ONE = 0.01
#: `_distance_to_bifurcation` extrapolates from the last value and an earlier value that is larger by more than this
#: factor, because the extrapolation from two closer values would be too inexact.
LEAST_RATIO = 1.5
#: An orbit is sought again at this distance beyond the last position at which it was found, as a share of the distance
#: between two points of the path. If the orbit is virtual there, or is not found, a graze ended it.
BEYOND_END = 1e-3


@dataclass(frozen=True)
class TrackedOrbit:
    """A periodic orbit that is followed: its label, and the phase and speed of one of its departures from Σ⁺."""

    label: tuple[int, int, int]
    tau: float
    v: float


@dataclass(frozen=True)
class OrbitEnd:
    """The end of an orbit between two points of a path.

    cause: why the orbit ends. low, high: the orbit ends between these shares of the way from the first point to the
    second. orbit: None if the orbit ends. If the orbit exists at the second point after all, and only the samples
    there missed it, cause is "sampling", low and high are 1, and `orbit` is the orbit at the second point.
    """

    cause: str
    low: float
    high: float
    orbit: TrackedOrbit | None = None


def gear_between(start: Parameters, end: Parameters, share: float) -> AnyGear:
    """Return the gear whose parameters are at a share of the way from `start` (share 0) to `end` (share 1)."""
    return gear_at_point(start.interpolate(end, share))


def find_orbit_end(start: Parameters, end: Parameters, orbit: TrackedOrbit) -> OrbitEnd:
    """Follow an orbit from one point towards another, as long as it is admissible and attracts.

    A step that fails is halved. Where a multiplier is close to ±1 Newton's method loses digits and stops before the
    orbit's end. The end is then extrapolated from the multipliers. The estimated end is the middle between `low` and
    `high`, unless `high` is 1.

    Returns
    -------
    OrbitEnd
        The cause, and the shares of the way between which the orbit ends.
    """
    at, step, share = orbit, 1.0, 0.0
    last = (
        _find_tracked_orbit(gear_between(start, end, 0.0), at) if sum(orbit.label[1:]) <= MOST_ORBIT_IMPACTS else None
    )
    if last is None:
        return OrbitEnd(UNKNOWN, 0.0, 1.0)
    trail = [(share, last.multipliers)]
    while step > LEAST_STEP:
        ahead = min(share + step, 1.0)
        found = _find_tracked_orbit(gear_between(start, end, ahead), at)
        if found is None or not (found.admissible and found.stable):
            step *= 0.5
            continue
        share, last, at = ahead, found, TrackedOrbit(orbit.label, found.tau, found.v)
        trail.append((share, last.multipliers))
        if share == 1.0:
            return OrbitEnd(SAMPLING, 1.0, 1.0, at)
        step *= 2.0
    cause, distance = _cause_of_end(start, end, last, at, trail)
    return OrbitEnd(cause, share, min(share + 2.0 * max(step, distance), 1.0))


def _distance_to_bifurcation(trail: list[tuple[float, Any]], sign: float, power: int) -> float:
    """Extrapolate linearly to the position at which ((1 + sign λ₁)(1 + sign λ₂))^power is 0 on an orbit's branch.

    λ₁ and λ₂ are the orbit's multipliers: the product is 0 where one of them is −1 (sign 1) or 1 (sign −1). trail: for
    each position at which the orbit was found, the position and both multipliers. A position is the share of the way
    from one point of the path to the next.

    Returns
    -------
    float
        The distance from the last position to the zero, as a share of the way; 0 if the values do not differ enough.
    """
    known = [(share, float(np.real(np.prod(1.0 + sign * np.array(pair)))) ** power) for share, pair in trail]
    last, rest = known[-1]
    for share, value in reversed(known):
        if value > LEAST_RATIO * rest:
            return (last - share) * rest / (value - rest)
    return 0.0


def _find_tracked_orbit(gear: AnyGear, tracked: TrackedOrbit) -> Any:
    """Return the gear's periodic motion with the label of `tracked`, near its state; None if there is none."""
    try:
        found = gear.orbit(tracked.tau, tracked.v, tracked.label[1])
    except RattleError:
        return None
    far = np.hypot(wrap_phase_difference(found.tau - tracked.tau), (found.v - tracked.v) / speed_unit_of(gear))
    label = found.m, found.n_plus, found.n_minus
    if (
        label != tracked.label
        or far > FARTHEST_CONTINUATION
        or distance_to_shorter_motion(gear, tracked, found) < SAME_POINT
    ):
        return None
    return found


def distance_to_shorter_motion(gear: AnyGear, tracked: TrackedOrbit, motion: Any) -> float:
    """Return the least distance between the start of a motion and its states after 1/2, 1/3, … of its period.

    The fractions are 1/k for all k ≥ 2 that divide m, n₊ and n₋ of the motion. A motion that closes after 1/k of its
    period is a shorter motion, run through k times. motion: the gear's periodic motion. tracked: a record with
    the label (m, n₊, n₋) of this motion.

    Returns
    -------
    float
        The distance, with speeds in units of `speed_unit_of`; 0 for a motion that closes after 1/k of its period,
        inf if no k divides m, n₊ and n₋.
    """
    m, n_plus, n_minus = tracked.label
    parts = [n for n in range(2, m + 1) if not (m % n or n_plus % n or n_minus % n)]
    after = gear.iterate(motion.tau, motion.v, np.array([n_plus // n for n in parts], np.int64))
    far = np.maximum(abs(wrap_phase_difference(after.tau - motion.tau)), abs(after.v - motion.v) / speed_unit_of(gear))
    return float(far.min(initial=np.inf))


def _is_near_doubling_flip(gear: AnyGear, orbit: TrackedOrbit) -> bool:
    """Return whether an orbit is close to the flip at which it branched from an orbit with half its period.

    Returns
    -------
    bool
        True if an orbit with half of m, n₊ and n₋ has a multiplier close to −1 and departs from Σ⁺ near `orbit`.
    """
    if any(n % 2 for n in orbit.label):
        return False
    m, n_plus, n_minus = (n // 2 for n in orbit.label)
    half = _find_tracked_orbit(gear, TrackedOrbit((m, n_plus, n_minus), orbit.tau, orbit.v))
    return half is not None and bool(np.abs(np.array(half.multipliers) + 1.0).min() < 2.0 * NEAR_ONE)


def _cause_of_end(
    start: Parameters, end: Parameters, motion: Any, orbit: TrackedOrbit, trail: list[tuple[float, Any]]
) -> tuple[str, float]:
    """Return why an orbit that was followed from `start` towards `end` ends, and how far ahead its end is.

    motion, orbit: the orbit at the last position at which it was found, once as the gear's periodic motion and once as
    a record. trail: for each position at which the orbit was found, the position and the orbit's multipliers there. A
    position is the share of the way from `start` to `end`.

    Returns
    -------
    tuple[str, float]
        The cause, and the distance to the end as a share of the way; 0 if the distance is unknown.
    """
    multipliers, share = np.array(motion.multipliers), trail[-1][0]
    if np.abs(multipliers - 1.0).min() < NEAR_ONE:
        if _is_near_doubling_flip(gear_between(start, end, share), orbit):
            return FLIP, _distance_to_bifurcation(trail, -1.0, 1)
        return SADDLE_NODE, _distance_to_bifurcation(trail, -1.0, 2)
    if np.abs(multipliers + 1.0).min() < NEAR_ONE:
        return FLIP, _distance_to_bifurcation(trail, 1.0, 1)
    beyond = _find_tracked_orbit(gear_between(start, end, min(share + BEYOND_END, 1.0)), orbit)
    # beyond a graze the orbit is virtual, or Newton's method does not find it because its flight meets another wall
    return (GRAZE if beyond is None or not beyond.admissible else UNKNOWN), 0.0
