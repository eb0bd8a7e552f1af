"""Stable orbits that recurrent trajectories are on: how they are solved for, and found in a cell's list (compiled)."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.samples import Balls, Orbits, Outcome, Trajectories, capturing_orbit, mark, top_speed
from rattle.flight.first_impact import OK
from rattle.flight.impact_law import log_determinant
from rattle.flight.law import speed_unit, wrapped
from rattle.numerics.compile import inline, kernel
from rattle.orbits.return_map import fastest_point, log_multipliers, newton, point_of, power_map, shortest_return, step

APPROACH = 0.5  # a trajectory must come this much closer to the orbit that Newton's method found ...
ARRIVED = 1e-9  # ... or be here already
CANDIDATE = 1e-5  # the first return this close gives the period to try
LONGEST_PERIOD = 4096  # impacts; longer recurrences are left to go on
SAME_POINT = 1e-6  # two orbits of one label closer than this are one


@inline
def unit_at(point):
    """Return the scale of speeds at a parameter point."""
    return speed_unit(point.delta, point.epsilon, point.beta)


@kernel
def approaches(tau, v, star_tau, star_v, k, most, point):
    """Return whether the trajectory is seen to approach the orbit."""
    unit = unit_at(point)
    start = math.hypot(wrapped(tau - star_tau), (v - star_v) / unit)
    if start < ARRIVED:
        return True
    for _ in range(k, most + 1, k):
        for _ in range(k):
            status, tau, v, _time, _below = step(tau, v, point)
            if status != OK:
                return False
        distance = math.hypot(wrapped(tau - star_tau), (v - star_v) / unit)
        if distance < max(APPROACH * start, ARRIVED):
            return True
        if distance > 4.0 * start:
            return False
    return False


@kernel
def first_return(tau, v, gap, point):
    """Impacts to the first return to (τ, v), at most the gap that is known to lead back."""
    t, speed, unit = tau, v, unit_at(point)
    for j in range(1, gap):
        status, t, speed, _time, _below = step(t, speed, point)
        if status != OK:
            return gap
        if abs(speed - v) < CANDIDATE * unit and abs(wrapped(t - tau)) < CANDIDATE:
            return j
    return gap


@kernel
def stable_orbit(tau, v, gap, most, point):
    """Return the stable orbit that attracts a trajectory which is at (τ, v) and again after `gap` impacts.

    Returns
    -------
    tuple
        (found, m, n₊, n₋, τ and v of its fastest point, both ln|multiplier|/m); numbers are 0 or NaN if it is not
        found.
    """
    nothing = (False, 0, 0, 0, tau, v, math.nan, math.nan)
    if gap > LONGEST_PERIOD:
        return nothing
    k = first_return(tau, v, gap, point)
    found, star_tau, star_v = newton(tau, v, k, point)
    if not found or math.hypot(wrapped(tau - star_tau), (v - star_v) / unit_at(point)) > 0.05:
        return nothing
    k = shortest_return(star_tau, star_v, k, point)
    _status, _t, _v, time, n_minus, a00, _b, _c, a11, log_det = power_map(star_tau, star_v, k, point)
    first, second = log_multipliers(a00 + a11, log_det)
    if not first < 0.0 or not approaches(tau, v, star_tau, star_v, k, most, point):
        return nothing
    star_tau, star_v = fastest_point(star_tau, star_v, k, point)
    m = int(np.rint(time))
    return True, m, k, n_minus, star_tau, star_v, first / m, second / m


@kernel
def known(m, n_plus, n_minus, tau, v, cell, orbits, point):
    """Return the index of this orbit among those of the cell, −1 if it is new.

    A near tie for the fastest point may be broken either way, so all points are compared.

    Returns
    -------
    int
        Index in the cell's row of `orbits`.
    """
    near = SAME_POINT * unit_at(point)
    for j in range(orbits.n[cell]):
        if orbits.m[cell, j] != m or orbits.n_plus[cell, j] != n_plus or orbits.n_minus[cell, j] != n_minus:
            continue
        t, speed = tau, v
        for _ in range(n_plus):
            if abs(wrapped(t - orbits.tau[cell, j])) < SAME_POINT and abs(speed - orbits.v[cell, j]) < near:
                return j
            _status, t, speed, _time, _below = step(t, speed, point)
    return -1


@inline
def remember(m, n_plus, n_minus, tau, v, first, second, cell, orbits):
    """Add an orbit to those that the cell knows, which have room for it; its index."""
    j = orbits.n[cell]
    orbits.m[cell, j], orbits.n_plus[cell, j], orbits.n_minus[cell, j] = m, n_plus, n_minus
    orbits.tau[cell, j], orbits.v[cell, j] = tau, v
    orbits.first[cell, j], orbits.second[cell, j] = first, second
    orbits.n[cell] = j + 1
    return j


@kernel
def fill_footprints(which, impacts, cells, samples, footprints):
    """Fill the arrays of `mark_footprints` in a compiled loop over its samples."""
    for j in range(which.size):
        k = which[j]
        point = point_of(samples.cell[k], cells)
        tau, v = samples.tau[k], samples.v[k]
        for _ in range(impacts):
            status, tau, v, _time, _below = step(tau, v, point)
            if status != OK:
                break
            mark(tau, v, top_speed(point.epsilon, unit_at(point)), footprints[j])


def mark_footprints(
    which: NDArray[np.int64], impacts: int, cells: Any, samples: Trajectories, footprints: NDArray[np.uint64]
) -> None:
    """Enter every impact of a further stretch of these samples into their footprints.

    A measured lane is seen every few flights only, and a set of bands that are visited in turn may keep step with that.
    """
    fill_footprints(which, impacts, cells, samples.for_kernels(), footprints)


@kernel
def remember_period_one(n, n_plus, n_minus, tau, v, trace, cells, orbits):
    """Enter stable orbits of period one into those that the cells know.

    So many (n_cells,) of arrays (n_cells, room), which have room for them.
    """
    for cell in range(n.size):
        for j in range(n[cell]):
            log_det = log_determinant(cells.delta[cell], 1.0, n_plus[cell, j] + n_minus[cell, j])
            first, second = log_multipliers(trace[cell, j], log_det)
            remember(1, n_plus[cell, j], n_minus[cell, j], tau[cell, j], v[cell, j], first, second, cell, orbits)


@kernel
def resolve_all(which, cells, samples, orbits, balls, grown, waiting):
    """`resolve`, with room for those that wait; how many there are."""
    n = 0
    for k in which:
        cell = samples.cell[k]
        if orbits.n[cell] > grown[cell] or orbits.n[cell] == orbits.m.shape[1]:
            waiting[n] = k
            n += 1
            continue
        orbit = capturing_orbit(samples.tau[k], samples.v[k], cell, balls)
        if orbit < 0:
            gap = samples.gap[k]
            point = point_of(cell, cells)
            most = max(samples.limit[k], 64 * gap)
            found, m, n_plus, n_minus, tau, v, first, second = stable_orbit(
                samples.tau[k], samples.v[k], gap, most, point
            )
            if found:
                orbit = known(m, n_plus, n_minus, tau, v, cell, orbits, point)
                if orbit < 0:
                    orbit = remember(m, n_plus, n_minus, tau, v, first, second, cell, orbits)
            samples.pause[k] = 2 * samples.impacts[k] + 2 * gap  # what only seems to recur is tried a few times
        samples.status[k] = Outcome.PERIODIC if orbit >= 0 else Outcome.UNRESOLVED
        samples.orbit[k] = orbit
    return n


def resolve(
    which: NDArray[np.int64], cells: Any, samples: Trajectories, orbits: Orbits, balls: Balls, grown: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Find the orbits that recurrent samples go to: PERIODIC, or UNRESOLVED if there is none, to go on with a pause.

    Some samples must wait: what of a cell comes after an orbit without balls, as those from number grown[cell] on are,
    or after the cell has no room for one more.

    Returns
    -------
    NDArray[np.int64]
        Numbers of the samples that wait, in their order.
    """
    waiting = np.zeros_like(which)
    tables = samples.for_kernels(), orbits.for_kernels(), balls.for_kernels()
    return waiting[: resolve_all(which, cells, *tables, grown, waiting)]
