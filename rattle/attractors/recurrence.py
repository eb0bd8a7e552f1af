"""Find the stable orbit of a recurrent trajectory by Newton's method, and look it up in a cell's list (compiled)."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.samples import (
    CaptureRegions,
    KnownOrbits,
    Outcome,
    Trajectories,
    bitmap_top_speed,
    find_capturing_orbit,
    mark_visited_cell,
)
from rattle.flight.first_impact import OK
from rattle.flight.impact_law import log_determinant
from rattle.flight.law import speed_unit, wrap_phase_difference
from rattle.numerics.compile import inline, kernel
from rattle.orbits.return_map import (
    apply_return_map_power,
    fastest_departure,
    find_fixed_point,
    least_return_period,
    log_multipliers,
    point_of_cell,
    step,
)

# A trajectory approaches the orbit that Newton's method found if its distance from the orbit falls below APPROACH_RATIO
# times the first distance, or below ARRIVAL_DISTANCE.
APPROACH_RATIO, ARRIVAL_DISTANCE = 0.5, 1e-9
RETURN_DISTANCE = 1e-5  # the first return this close, in τ and in v/`speed_unit`, gives the period for Newton's method
LONGEST_PERIOD = 4096  # Newton's method is not tried after a return that takes more impacts on Σ⁺ than this
SAME_POINT = 1e-6  # orbits with one label are the same if points of both are this close, in τ and in v/`speed_unit`


@inline
def speed_unit_at(point):
    """Return the unit of speed differences (`speed_unit`) at a parameter point."""
    return speed_unit(point.delta, point.epsilon, point.beta)


@kernel
def is_approaching_orbit(tau, v, star_tau, star_v, k, most, point):
    """Return whether the trajectory from (tau, v) is observed to approach an orbit.

    The orbit goes through (star_tau, star_v) and has k impacts on Σ⁺ in a period. The trajectory is followed for at
    most `most` impacts on Σ⁺.

    Returns
    -------
    bool
        True as soon as the distance from the orbit is below APPROACH_RATIO times the first distance, or below
        ARRIVAL_DISTANCE. False if the allowed impacts do not suffice, or if the distance exceeds 4 times the first one.
    """
    unit = speed_unit_at(point)
    start = math.hypot(wrap_phase_difference(tau - star_tau), (v - star_v) / unit)
    if start < ARRIVAL_DISTANCE:
        return True
    for _ in range(k, most + 1, k):
        for _ in range(k):
            status, tau, v, _time, _below = step(tau, v, point)
            if status != OK:
                return False
        distance = math.hypot(wrap_phase_difference(tau - star_tau), (v - star_v) / unit)
        if distance < max(APPROACH_RATIO * start, ARRIVAL_DISTANCE):
            return True
        if distance > 4.0 * start:
            return False
    return False


@kernel
def count_impacts_until_return(tau, v, gap, point):
    """Return the number of impacts on Σ⁺ until the trajectory from (τ, v) first returns close to (τ, v).

    gap: a number of impacts after which the trajectory is known to return close to (τ, v).

    Returns
    -------
    int
        At most `gap`.
    """
    t, speed, unit = tau, v, speed_unit_at(point)
    for j in range(1, gap):
        status, t, speed, _time, _below = step(t, speed, point)
        if status != OK:
            return gap
        if abs(speed - v) < RETURN_DISTANCE * unit and abs(wrap_phase_difference(t - tau)) < RETURN_DISTANCE:
            return j
    return gap


@kernel
def find_stable_orbit(tau, v, gap, most, point):
    """Return the stable orbit that attracts a trajectory which returns close to (τ, v) after `gap` impacts on Σ⁺.

    most: the number of impacts within which the trajectory must be observed to approach the orbit.

    Returns
    -------
    tuple
        (found, m, n₊, n₋, τ and v of the orbit's fastest point, ln|multiplier|/m of both multipliers). If `found` is
        False, the other values have no meaning.
    """
    nothing = (False, 0, 0, 0, tau, v, math.nan, math.nan)
    if gap > LONGEST_PERIOD:
        return nothing
    k = count_impacts_until_return(tau, v, gap, point)
    found, star_tau, star_v = find_fixed_point(tau, v, k, point)
    if not found or math.hypot(wrap_phase_difference(tau - star_tau), (v - star_v) / speed_unit_at(point)) > 0.05:
        return nothing
    k = least_return_period(star_tau, star_v, k, point)
    _status, _t, _v, time, n_minus, a00, _b, _c, a11, log_det = apply_return_map_power(star_tau, star_v, k, point)
    first, second = log_multipliers(a00 + a11, log_det)
    if not first < 0.0 or not is_approaching_orbit(tau, v, star_tau, star_v, k, most, point):
        return nothing
    star_tau, star_v = fastest_departure(star_tau, star_v, k, point)
    m = int(np.rint(time))
    return True, m, k, n_minus, star_tau, star_v, first / m, second / m


@kernel
def index_of_orbit(m, n_plus, n_minus, tau, v, cell, orbits, point):
    """Return the index of this orbit among the known orbits of the cell, −1 if it is new.

    All points of the orbit are compared with the fastest points of the known orbits, because rounding may decide which
    of two almost equally fast points counts as the fastest.

    Returns
    -------
    int
        Index in the cell's row of `orbits`.
    """
    near = SAME_POINT * speed_unit_at(point)
    for j in range(orbits.n[cell]):
        if orbits.m[cell, j] != m or orbits.n_plus[cell, j] != n_plus or orbits.n_minus[cell, j] != n_minus:
            continue
        t, speed = tau, v
        for _ in range(n_plus):
            if (
                abs(wrap_phase_difference(t - orbits.tau[cell, j])) < SAME_POINT
                and abs(speed - orbits.v[cell, j]) < near
            ):
                return j
            _status, t, speed, _time, _below = step(t, speed, point)
    return -1


@inline
def append_orbit(m, n_plus, n_minus, tau, v, first, second, cell, orbits):
    """Append an orbit to the table of its cell, which must have room, and return its index in this table.

    first, second: ln|multiplier|/m of both multipliers.

    Returns
    -------
    int
        Index in the cell's row of `orbits`.
    """
    j = orbits.n[cell]
    orbits.m[cell, j], orbits.n_plus[cell, j], orbits.n_minus[cell, j] = m, n_plus, n_minus
    orbits.tau[cell, j], orbits.v[cell, j] = tau, v
    orbits.first[cell, j], orbits.second[cell, j] = first, second
    orbits.n[cell] = j + 1
    return j


@kernel
def fill_visited_cell_bitmaps(which, impacts, cells, samples, footprints):
    """Mark the states of samples after each of their next `impacts` impacts in their bitmaps, in a compiled loop."""
    for j in range(which.size):
        k = which[j]
        point = point_of_cell(samples.cell[k], cells)
        tau, v = samples.tau[k], samples.v[k]
        for _ in range(impacts):
            status, tau, v, _time, _below = step(tau, v, point)
            if status != OK:
                break
            mark_visited_cell(tau, v, bitmap_top_speed(point.epsilon, speed_unit_at(point)), footprints[j])


def mark_states_in_bitmaps(
    which: NDArray[np.int64], impacts: int, cells: Any, samples: Trajectories, footprints: NDArray[np.uint64]
) -> None:
    """Mark every state of the next `impacts` impacts on Σ⁺ of these samples in their visited-cell bitmaps.

    While exponents are measured, a bitmap receives only the state after every few flights. If a chaotic set consists of
    several parts that a trajectory visits in turn, these states may miss some of the parts. Therefore this function
    marks every state.
    """
    fill_visited_cell_bitmaps(which, impacts, cells, samples.to_kernel_tuple(), footprints)


@kernel
def append_period_one_orbits(n, n_plus, n_minus, tau, v, trace, cells, orbits):
    """Append stable orbits of period one to the tables of their cells, which must have room.

    n (n_cells,): the number of new orbits of each cell. n_plus, n_minus, tau, v, trace (n_cells, most): in row i the
    impacts, a state, and the trace of the tangent map of the n[i] orbits of cell i.
    """
    for cell in range(n.size):
        for j in range(n[cell]):
            log_det = log_determinant(cells.delta[cell], 1.0, n_plus[cell, j] + n_minus[cell, j])
            first, second = log_multipliers(trace[cell, j], log_det)
            append_orbit(1, n_plus[cell, j], n_minus[cell, j], tau[cell, j], v[cell, j], first, second, cell, orbits)


@kernel
def find_orbits_of_recurrent_samples(which, cells, samples, orbits, balls, grown, waiting):
    """Find the orbits of the samples `which`, as `assign_orbits_to_recurrent_samples` describes, in a compiled loop.

    waiting: an array that receives the numbers of the samples whose orbits could not be searched yet.

    Returns
    -------
    int
        Number of samples that were written to `waiting`.
    """
    n = 0
    for k in which:
        cell = samples.cell[k]
        if orbits.n[cell] > grown[cell] or orbits.n[cell] == orbits.m.shape[1]:
            waiting[n] = k
            n += 1
            continue
        orbit = find_capturing_orbit(samples.tau[k], samples.v[k], cell, balls)
        if orbit < 0:
            gap = samples.gap[k]
            point = point_of_cell(cell, cells)
            most = max(samples.limit[k], 64 * gap)
            found, m, n_plus, n_minus, tau, v, first, second = find_stable_orbit(
                samples.tau[k], samples.v[k], gap, most, point
            )
            if found:
                orbit = index_of_orbit(m, n_plus, n_minus, tau, v, cell, orbits, point)
                if orbit < 0:
                    orbit = append_orbit(m, n_plus, n_minus, tau, v, first, second, cell, orbits)
            # the orbit of this sample is searched again only after a pause, which grows with the sample's impacts
            samples.pause[k] = 2 * samples.impacts[k] + 2 * gap
        samples.status[k] = Outcome.PERIODIC if orbit >= 0 else Outcome.UNRESOLVED
        samples.orbit[k] = orbit
    return n


def assign_orbits_to_recurrent_samples(
    which: NDArray[np.int64],
    cells: Any,
    samples: Trajectories,
    orbits: KnownOrbits,
    balls: CaptureRegions,
    grown: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Find the orbits of recurrent samples.

    A sample with a stable orbit becomes PERIODIC. Any other sample becomes UNRESOLVED, and does not become recurrent
    again until it has made a number of further impacts.

    The orbit of a sample is not searched if a known orbit of its cell has no capture regions yet, because the sample
    may be on that orbit. It is also not searched if the table has no room for another orbit of the cell.

    grown (n_cells,): the number of orbits of each cell that have capture regions.

    Returns
    -------
    NDArray[np.int64]
        Numbers of the samples whose orbits were not searched, in the order of `which`.
    """
    waiting = np.zeros_like(which)
    tables = samples.to_kernel_tuple(), orbits.to_kernel_tuple(), balls.to_kernel_tuple()
    return waiting[: find_orbits_of_recurrent_samples(which, cells, *tables, grown, waiting)]
