"""Why an attractor is lost between two points of a path: its orbit is followed to where it ends."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rattle.errors import RattleError
from rattle.flight.law import wrapped
from rattle.models import AnyGear
from rattle.resilience.gears import gear_at, unit_of

Array = NDArray[np.float64]
SADDLE_NODE, FLIP, GRAZE = "saddle-node", "flip", "graze"
CRISIS, QUIET_LIMIT, SAMPLING, UNKNOWN = "crisis", "quiet limit", "sampling", "unknown"
LEAST_STEP = 1e-9  # of the way from one point to the next
FARTHEST = 0.1  # from an orbit's departure to that of its continuation, speeds in their unit
AT_ONE = 0.01  # a multiplier this near to ±1 is there, so near to where the orbit ends
BESIDE = 1e-3  # of the way, beyond its end, to where an orbit that grazes goes on as one that does not happen


@dataclass(frozen=True)
class End:
    """Why an orbit ends between two points of a path, and between which shares of the way."""

    cause: str
    low: float
    high: float


@dataclass(frozen=True)
class Orbit:
    """A periodic attractor: its label, and a departure."""

    label: tuple[int, int, int]
    tau: float
    v: float


def between(start: Array, end: Array, share: float) -> AnyGear:
    """The gear at a share of the way between two rows of parameters."""
    return gear_at(end if share == 1.0 else start + share * (end - start))


def end_of(start: Array, end: Array, orbit: Orbit) -> End:
    """Follow an orbit from one row of parameters towards another, as long as it happens and attracts, by steps that
    halve where they fail.
    """
    at, step, share = orbit, 1.0, 0.0
    last = _solved(between(start, end, 0.0), at)
    if last is None:
        return End(UNKNOWN, 0.0, 1.0)
    while step > LEAST_STEP:
        ahead = min(share + step, 1.0)
        found = _solved(between(start, end, ahead), at)
        if found is None or not (found.admissible and found.stable):
            step *= 0.5
            continue
        share, last, at = ahead, found, Orbit(orbit.label, found.tau, found.v)
        if share == 1.0:
            return End(SAMPLING, 1.0, 1.0)
        step *= 2.0
    return End(_cause(start, end, last, at, share), share, min(share + 2.0 * step, 1.0))


def _solved(gear: AnyGear, near: Orbit) -> Any:
    """The periodic motion with this label whose departure is near, or None."""
    try:
        found = gear.orbit(near.tau, near.v, near.label[1])
    except RattleError:
        return None
    far = np.hypot(wrapped(found.tau - near.tau), (found.v - near.v) / unit_of(gear))
    label = found.m, found.n_plus, found.n_minus
    return found if label == near.label and far < FARTHEST else None


def _cause(start: Array, end: Array, last: Any, at: Orbit, share: float) -> str:
    multipliers = np.array(last.multipliers)
    if np.abs(multipliers - 1.0).min() < AT_ONE:
        return SADDLE_NODE
    if np.abs(multipliers + 1.0).min() < AT_ONE:
        return FLIP
    beyond = _solved(between(start, end, min(share + BESIDE, 1.0)), at)
    if beyond is None or not beyond.admissible:  # it goes on where it does not happen, or meets another wall
        return GRAZE
    return UNKNOWN
