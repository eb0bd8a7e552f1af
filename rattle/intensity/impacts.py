"""The impacts of a motion, one by one."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from rattle.errors import require, require_number
from rattle.flight.first_impact import OK
from rattle.intensity.motions import (
    ENDLESS,
    ROUNDING,
    Motion,
    checked_motion_kind,
    one_period_limits_of_motion,
    require_closed_orbit,
    require_full_observation,
)
from rattle.intensity.visit import Impacts, write_impacts_of_motion
from rattle.orbits.iterates import MOST_IMPACTS

ROOM, GROWTH = 1024, 8  # first length of the arrays, and factor by which they grow when they are full


def allocate_impact_arrays(count: int) -> Impacts:
    """Return arrays of zeros with room for `count` impacts."""
    return Impacts(np.zeros(count), np.zeros(count, np.int64), *(np.zeros(count) for _ in range(4)))


def impacts_of_motion(motion: Motion, point: Any, periods: float | None) -> Impacts:
    """Return the impacts of a motion (`RattlingGear.impacts`). point: the gear's parameter point for kernels."""
    kind = checked_motion_kind(motion)
    require(
        periods is not None or kind in ("quiet", "periodic"),
        f"periods must be given: a {kind} motion has no period of its own",
    )
    periods = math.inf if periods is None else require_number("periods", periods, positive=True)
    if kind == "quiet":
        return allocate_impact_arrays(0)
    if kind == "periodic":
        return _repeat_period(_impacts_of_period(motion, point), motion, periods)
    status, _tau, _v, found = collect_impacts(
        motion.tau, motion.v, ENDLESS, periods, partial(_list_impacts_at_point, point)
    )
    time = float(found.time[-1]) - motion.tau if found.time.size else 0.0
    require_full_observation(status, time if status != OK or found.time.size == MOST_IMPACTS else periods, periods)
    return Impacts(*(column[found.time <= motion.tau + periods] for column in found))


def _impacts_of_period(motion: Motion, point: Any) -> Impacts:
    status, tau, v, found = collect_impacts(
        motion.tau, motion.v, *one_period_limits_of_motion(motion), partial(_list_impacts_at_point, point)
    )
    require_closed_orbit(motion, status, tau, v, float(found.speed.max(initial=0.0)))
    return found


def _list_impacts_at_point(point: Any, tau: float, v: float, returns: int, periods: float, arrays: Impacts) -> Any:
    return write_impacts_of_motion(tau, v, returns, periods, point, arrays)


def collect_impacts(
    tau: float, v: float, returns: int, periods: float, lister: Callable[..., Any]
) -> tuple[int, float, float, Impacts]:
    """Follow a motion from (tau, v) and return its status, its final state, and at most MOST_IMPACTS impacts.

    Parameters
    ----------
    tau, v, returns, periods
        The arguments of `rattle.intensity.visit.write_impacts_of_motion`.
    lister : callable
        The kernel `write_impacts_of_motion`, bound to a point or a cell. It takes these four arguments and the arrays
        to fill.

    Returns
    -------
    tuple
        Status, final τ and v, and `Impacts`.
    """
    room = ROOM
    while True:
        found = allocate_impact_arrays(room)
        status, tau1, v1, count = lister(tau, v, returns, periods, found)
        if count <= room or room == MOST_IMPACTS:
            return int(status), float(tau1), float(v1), Impacts(*(column[:count] for column in found))
        room = min(GROWTH * room, MOST_IMPACTS)


def _repeat_period(impacts: Impacts, motion: Motion, periods: float) -> Impacts:
    """Return the impacts of one period, repeated over `periods` forcing periods, or once if `periods` is infinite."""
    if periods == math.inf:
        return impacts
    times = math.ceil(periods / motion.m)
    require(
        times * impacts.time.size <= MOST_IMPACTS,
        f"the motion makes more than {MOST_IMPACTS} impacts: give fewer periods",
    )
    time = (impacts.time + motion.m * np.arange(times)[:, None]).ravel()
    kept = time <= motion.tau + periods + ROUNDING
    return Impacts(time[kept], *(np.tile(column, times)[kept] for column in impacts[1:]))
