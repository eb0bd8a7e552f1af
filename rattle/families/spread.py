"""Flood-fill continuation: stable periodic orbits are continued from cell to cell until nothing new is found."""

import math
from typing import Any, NamedTuple

import numpy as np

from rattle.attractors.recurrence import SAME_POINT, speed_unit_at
from rattle.flight.first_impact import OK
from rattle.flight.law import wrap_phase_difference
from rattle.numerics.compile import inline, kernel
from rattle.orbits.return_map import (
    apply_return_map_power,
    fastest_departure,
    find_fixed_point,
    least_return_period,
    log_multipliers,
    point_between,
    point_of_cell,
    step,
)

#: Largest distance from an orbit's point (τ, v) to the point of its continuation in the next cell, where speeds are in
#: units of `speed_unit_at`. For a step that is only a part of the way to this cell, half of this number is allowed.
FARTHEST = 0.2
#: Smallest step of continuation, as a share of the way from a cell to the next.
LEAST_STEP = 2.0**-6
#: `solve_orbit_from_rounded_state` rounds τ, and v in units of `speed_unit_at`, to multiples of this number.
ROUNDING = 2.0**-26
#: Value of an orbit's number that means "no orbit".
NOWHERE = -1
#: Offsets of the neighbours in rows and columns, in the order of `LinkedOrbits.continuations`.
ROWS, COLUMNS = (1, 0, -1, 0), (0, 1, 0, -1)


class CellRectangle(NamedTuple):
    """The cells of a grid in rows top ≤ i < bottom and columns left ≤ j < right."""

    top: int
    bottom: int
    left: int
    right: int


#: The columns of a table of attractors that describe an orbit, in the order of the arguments of `add_new_orbits`.
ORBIT_COLUMNS = ("cell", "m", "n_plus", "n_minus", "tau", "v", "first", "second")


class LinkedOrbits(NamedTuple):
    """The stable orbits of the cells of a grid, in arrays (room,) whose first n rows are used.

    cell: the number of the cell. m, n_plus, n_minus: the label. tau, v: the fastest departure from Σ⁺.
    first, second: ln|multiplier|/m of both Floquet multipliers.
    previous_in_cell: the number of the orbit that was added before this orbit in the same cell.
    last_in_cell (n_cells,): for each cell the number of the orbit that was added last.
    continuations (room, 4): the number of the orbit's continuation in each neighbouring cell.
    Entries of previous_in_cell, last_in_cell and continuations are NOWHERE if there is no such orbit.
    """

    cell: Any
    m: Any
    n_plus: Any
    n_minus: Any
    tau: Any
    v: Any
    first: Any
    second: Any
    previous_in_cell: Any
    last_in_cell: Any
    continuations: Any


@inline
def have_same_label(i, k, orbits):
    """Return whether two orbits have the same label."""
    return (
        orbits.n_plus[i] == orbits.n_plus[k] and orbits.n_minus[i] == orbits.n_minus[k] and orbits.m[i] == orbits.m[k]
    )


@kernel
def find_orbit_at_point(tau, v, cell, k, v_tolerance, orbits):
    """Return the number of the orbit in `cell` that has the label of orbit k and its fastest point at (tau, v).

    v_tolerance: the tolerance of v; the tolerance of τ is SAME_POINT.

    Returns
    -------
    int
        The number, NOWHERE if the cell has no such orbit.
    """
    i = orbits.last_in_cell[cell]
    while i != NOWHERE:
        same = abs(wrap_phase_difference(tau - orbits.tau[i])) < SAME_POINT and abs(v - orbits.v[i]) < v_tolerance
        if same and have_same_label(i, k, orbits):
            return i
        i = orbits.previous_in_cell[i]
    return NOWHERE


@kernel
def check_stability_and_label(tau, v, k, orbits, point):
    """Return whether the orbit through the state (τ, v) is stable and has the label of orbit k.

    point: the parameters of the gear.

    Returns
    -------
    tuple
        (whether the orbit is stable and has the label, ln|multiplier| of both its multipliers). The logarithms are NaN
        if the orbit has another label or cannot be computed.
    """
    n_plus = np.int64(
        orbits.n_plus[k]
    )  # np.int64 as in the other callers, so that numba compiles `apply_return_map_power` only once
    status, _t, _v, time, below, a00, _b, _c, a11, log_det = apply_return_map_power(tau, v, n_plus, point)
    if status != OK or below != orbits.n_minus[k] or int(np.rint(time)) != orbits.m[k]:
        return False, math.nan, math.nan
    first, second = log_multipliers(a00 + a11, log_det)
    return first < 0.0, first, second


@kernel
def solve_orbit_from_rounded_state(tau, v, n_plus, point):
    """Solve for an orbit's state again from rounded τ and v, so that its last bits hardly depend on the first guess.

    tau, v: the state that was found from the first guess. point: the parameters of the gear.

    Returns
    -------
    tuple
        (τ, v). This is the given state if Newton's method fails or finds a state that is not close to it.
    """
    unit = speed_unit_at(point)
    t, w = np.rint(tau / ROUNDING) * ROUNDING, np.rint(v / unit / ROUNDING) * ROUNDING * unit
    found, t, w = find_fixed_point(t, w, n_plus, point)
    if found and abs(wrap_phase_difference(t - tau)) < SAME_POINT and abs(w - v) < SAME_POINT * unit:
        return t, w
    return tau, v


@kernel
def continue_orbit_to_point(k, here, there, orbits):
    """Follow orbit k from one parameter point to another.

    A step is halved if Newton's method fails or finds a distant state, or if the orbit found there is unstable or has
    another label. Stability and label are not tested at the last point.

    Returns
    -------
    tuple
        (whether the orbit was followed all the way, τ, v), where (τ, v) is the last state of the orbit that was found.
    """
    n_plus, tau, v = np.int64(orbits.n_plus[k]), orbits.tau[k], orbits.v[k]
    share, size = 0.0, 1.0
    while size >= LEAST_STEP:
        point = there if share + size == 1.0 else point_between(share + size, here, there)
        found, t, w = find_fixed_point(tau, v, n_plus, point)
        distance = math.hypot(wrap_phase_difference(t - tau), (w - v) / speed_unit_at(point))
        if not found or distance > (FARTHEST if size == 1.0 else 0.5 * FARTHEST):
            size *= 0.5
            continue
        if share + size == 1.0:
            return True, t, w
        is_stable, _first, _second = check_stability_and_label(t, w, k, orbits, point)
        if is_stable:
            share, tau, v = share + size, t, w
        else:
            size *= 0.5
    return False, tau, v


@kernel
def continue_orbit(k, cell, n, orbits, cells):
    """Continue orbit k into the neighbouring cell `cell`. n: the number of orbits that are known so far.

    Returns
    -------
    int
        The orbit's number in that cell: n if it was not known there and was added, NOWHERE if it cannot be continued.
    """
    point, n_plus = point_of_cell(cell, cells), np.int64(orbits.n_plus[k])
    found, tau, v = continue_orbit_to_point(k, point_of_cell(orbits.cell[k], cells), point, orbits)
    if not found:
        return NOWHERE
    unit = speed_unit_at(point)
    near = SAME_POINT * unit
    known = find_orbit_at_point(tau, v, cell, k, near, orbits)
    if known != NOWHERE:
        return known
    is_stable, _first, _second = check_stability_and_label(tau, v, k, orbits, point)
    if not is_stable or least_return_period(tau, v, n_plus, point) != n_plus:
        return NOWHERE
    t, w = tau, v
    # an orbit is stored at its fastest departure; in the new cell, another of its departures may be the fastest
    for _ in range(n_plus):
        known = find_orbit_at_point(t, w, cell, k, near, orbits)
        if known != NOWHERE:
            return known
        _status, t, w, _time, _below = step(t, w, point)
    tau, v = fastest_departure(tau, v, n_plus, point)
    tau, v = solve_orbit_from_rounded_state(tau, v, n_plus, point)
    is_stable, first, second = check_stability_and_label(tau, v, k, orbits, point)
    if not is_stable:
        return NOWHERE
    m = orbits.m[k]
    orbits.cell[n], orbits.m[n], orbits.n_plus[n], orbits.n_minus[n] = cell, m, n_plus, orbits.n_minus[k]
    orbits.tau[n], orbits.v[n], orbits.first[n], orbits.second[n] = tau, v, first / m, second / m
    orbits.previous_in_cell[n], orbits.last_in_cell[cell] = orbits.last_in_cell[cell], n
    return n


@kernel
def add_new_orbits(cell, m, n_plus, n_minus, tau, v, first, second, n, cells, orbits, which):
    """Add k orbits under the numbers from n on, except orbits that are already known in their cells.

    The arrays of `orbits` must have room for all of them. The number of each orbit, new or known, is written to
    which (k,).

    Returns
    -------
    int
        The next free number.
    """
    for i in range(cell.size):
        orbits.cell[n], orbits.m[n], orbits.n_plus[n], orbits.n_minus[n] = cell[i], m[i], n_plus[i], n_minus[i]
        orbits.tau[n], orbits.v[n], orbits.first[n], orbits.second[n] = tau[i], v[i], first[i], second[i]
        near = SAME_POINT * speed_unit_at(point_of_cell(cell[i], cells))
        which[i] = find_orbit_at_point(tau[i], v[i], cell[i], n, near, orbits)
        if which[i] == NOWHERE:
            orbits.previous_in_cell[n], orbits.last_in_cell[cell[i]] = orbits.last_in_cell[cell[i]], n
            which[i] = n
            n += 1
    return n


@kernel
def continue_orbits_into_neighbours(next_orbit, n, columns, inside, cells, orbits):
    """Continue the orbits number `next_orbit` to n − 1 into their neighbouring cells, then the new orbits found there.

    Orbits are continued only into cells in the rectangle `inside`. columns: the number of columns of the grid.

    Returns
    -------
    tuple[int, int]
        (next_orbit, n): the number of the first orbit that is not yet continued, and the number of all known orbits. If
        they differ, the arrays of `orbits` have no room for further orbits.
    """
    room = orbits.cell.size
    while next_orbit < n and n + 4 <= room:
        row, column = divmod(orbits.cell[next_orbit], columns)
        for side in range(4):
            i, j = row + ROWS[side], column + COLUMNS[side]
            found = NOWHERE
            if inside.top <= i < inside.bottom and inside.left <= j < inside.right:
                cell = i * columns + j
                found = continue_orbit(next_orbit, cell, n, orbits, cells)
                if found == n:
                    n += 1
            orbits.continuations[next_orbit, side] = found
        next_orbit += 1
    return next_orbit, n


@kernel
def write_arrivals(one, other, steps, path, orbits, arrives):
    """Continue orbit one[i] to the cell of orbit other[i], and write to arrives[i] whether it becomes orbit other[i].

    one, other (k,): numbers of orbits. Each orbit is followed in `steps` small steps. path: the parameters (k·steps,)
    at the steps, in the form of cells: first all steps for i = 0, then all steps for i = 1, and so on.
    """
    for i in range(one.size):
        n_plus, tau, v = np.int64(orbits.n_plus[one[i]]), orbits.tau[one[i]], orbits.v[one[i]]
        arrives[i] = False
        for j in range(steps):
            point = point_of_cell(i * steps + j, path)
            unit, before, speed = speed_unit_at(point), tau, v
            found, tau, v = find_fixed_point(before, speed, n_plus, point)
            if not found or math.hypot(wrap_phase_difference(tau - before), (v - speed) / unit) > 0.5 * FARTHEST:
                break
            if j == steps - 1:
                for _ in range(n_plus):
                    near = abs(wrap_phase_difference(tau - orbits.tau[other[i]])) < SAME_POINT
                    if near and abs(v - orbits.v[other[i]]) < SAME_POINT * unit:
                        arrives[i] = True
                        break
                    _status, tau, v, _time, _below = step(tau, v, point)
