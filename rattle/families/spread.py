"""Stable periodic orbits of a grid of cells, continued from cell to cell until nothing new is found (compiled)."""

import math
from typing import Any, NamedTuple

import numpy as np

from rattle.attractors.recurrence import SAME_POINT, unit_at
from rattle.flight.first_impact import OK
from rattle.flight.law import wrapped
from rattle.numerics.compile import inline, kernel
from rattle.orbits.return_map import (
    between,
    fastest_point,
    log_multipliers,
    newton,
    point_of,
    power_map,
    shortest_return,
    step,
)

FARTHEST = 0.2  # from an orbit's point to that of its continuation in the next cell, speeds in their unit
LEAST_STEP = 2.0**-6  # share of the way from a cell to the next; a step that fails is halved down to it
ROUNDING = 2.0**-26  # of a point from which Newton's method starts again
NOWHERE = -1
#: Neighbours in the order of their links: one row or column on, and back.
ROWS, COLUMNS = (1, 0, -1, 0), (0, 1, 0, -1)


class Rectangle(NamedTuple):
    """Cells of a grid in rows top ≤ i < bottom and columns left ≤ j < right."""

    top: int
    bottom: int
    left: int
    right: int


#: What a table of attractors says of an orbit, in the order of `enter`.
OF_ORBIT = ("cell", "m", "n_plus", "n_minus", "tau", "v", "first", "second")


class Linked(NamedTuple):
    """Stable orbits of the cells of a grid, (room,), the used ones first.

    Cell, label, fastest point, both ln|multiplier|/m, and the orbit of the same cell that was entered before it.

    last (n_cells,): of each cell, the orbit that was entered last. to (room, 4): the orbit that it becomes in each
    neighbour. NOWHERE: there is none.
    """

    cell: Any
    m: Any
    n_plus: Any
    n_minus: Any
    tau: Any
    v: Any
    first: Any
    second: Any
    before: Any
    last: Any
    to: Any


@inline
def alike(i, k, orbits):
    """Return whether two orbits have the same label."""
    return (
        orbits.n_plus[i] == orbits.n_plus[k] and orbits.n_minus[i] == orbits.n_minus[k] and orbits.m[i] == orbits.m[k]
    )


@kernel
def orbit_at_point(tau, v, cell, k, near, orbits):
    """Return the orbit of this cell, labelled as orbit k, whose fastest point this is; NOWHERE if there is none."""
    i = orbits.last[cell]
    while i != NOWHERE:
        same = abs(wrapped(tau - orbits.tau[i])) < SAME_POINT and abs(v - orbits.v[i]) < near
        if same and alike(i, k, orbits):
            return i
        i = orbits.before[i]
    return NOWHERE


@kernel
def labelled(tau, v, k, orbits, point):
    """Return whether the orbit through a point that Newton's method has found is stable and labelled as orbit k.

    Returns
    -------
    tuple
        The answer, and the logarithms of both multipliers, NaN where it is no.
    """
    n_plus = np.int64(orbits.n_plus[k])  # as others call `power_map`, which is then compiled once
    status, _t, _v, time, below, a00, _b, _c, a11, log_det = power_map(tau, v, n_plus, point)
    if status != OK or below != orbits.n_minus[k] or int(np.rint(time)) != orbits.m[k]:
        return False, math.nan, math.nan
    first, second = log_multipliers(a00 + a11, log_det)
    return first < 0.0, first, second


@kernel
def settled(tau, v, n_plus, point):
    """Return the same point of an orbit once more, from nearby: so its bits seldom tell from where it was continued."""
    unit = unit_at(point)
    t, w = np.rint(tau / ROUNDING) * ROUNDING, np.rint(v / unit / ROUNDING) * ROUNDING * unit
    found, t, w = newton(t, w, n_plus, point)
    if found and abs(wrapped(t - tau)) < SAME_POINT and abs(w - v) < SAME_POINT * unit:
        return t, w
    return tau, v


@kernel
def followed(k, here, there, orbits):
    """Follow orbit k from one parameter point to another.

    A step for which Newton's method fails is halved. Between the points the orbit has to attract, with its label.

    Returns
    -------
    tuple
        (found, τ, v) at the second point.
    """
    n_plus, tau, v = np.int64(orbits.n_plus[k]), orbits.tau[k], orbits.v[k]
    share, size = 0.0, 1.0
    while size >= LEAST_STEP:
        point = there if share + size == 1.0 else between(share + size, here, there)
        found, t, w = newton(tau, v, n_plus, point)
        distance = math.hypot(wrapped(t - tau), (w - v) / unit_at(point))
        if not found or distance > (FARTHEST if size == 1.0 else 0.5 * FARTHEST):
            size *= 0.5
            continue
        if share + size == 1.0:
            return True, t, w
        is_stable, _first, _second = labelled(t, w, k, orbits, point)
        if is_stable:
            share, tau, v = share + size, t, w
        else:
            size *= 0.5
    return False, tau, v


@kernel
def continue_orbit(k, cell, n, orbits, cells):
    """Return the number of orbit k's continuation in a neighbouring cell, entered as number n if new; else NOWHERE."""
    point, n_plus = point_of(cell, cells), np.int64(orbits.n_plus[k])
    found, tau, v = followed(k, point_of(orbits.cell[k], cells), point, orbits)
    if not found:
        return NOWHERE
    unit = unit_at(point)
    near = SAME_POINT * unit
    known = orbit_at_point(tau, v, cell, k, near, orbits)
    if known != NOWHERE:
        return known
    is_stable, _first, _second = labelled(tau, v, k, orbits, point)
    if not is_stable or shortest_return(tau, v, n_plus, point) != n_plus:
        return NOWHERE
    t, w = tau, v
    for _ in range(n_plus):  # another impact of it may be the fastest here
        known = orbit_at_point(t, w, cell, k, near, orbits)
        if known != NOWHERE:
            return known
        _status, t, w, _time, _below = step(t, w, point)
    tau, v = fastest_point(tau, v, n_plus, point)
    tau, v = settled(tau, v, n_plus, point)
    is_stable, first, second = labelled(tau, v, k, orbits, point)
    if not is_stable:
        return NOWHERE
    m = orbits.m[k]
    orbits.cell[n], orbits.m[n], orbits.n_plus[n], orbits.n_minus[n] = cell, m, n_plus, orbits.n_minus[k]
    orbits.tau[n], orbits.v[n], orbits.first[n], orbits.second[n] = tau, v, first / m, second / m
    orbits.before[n], orbits.last[cell] = orbits.last[cell], n
    return n


@kernel
def enter(cell, m, n_plus, n_minus, tau, v, first, second, n, cells, orbits, which):
    """Enter orbits (k,) as numbers n and following, but for those that their cells know.

    Write to which (k,) the number of each. There is room for all of them.

    Returns
    -------
    result
        The next free number n.
    """
    for i in range(cell.size):
        orbits.cell[n], orbits.m[n], orbits.n_plus[n], orbits.n_minus[n] = cell[i], m[i], n_plus[i], n_minus[i]
        orbits.tau[n], orbits.v[n], orbits.first[n], orbits.second[n] = tau[i], v[i], first[i], second[i]
        near = SAME_POINT * unit_at(point_of(cell[i], cells))
        which[i] = orbit_at_point(tau[i], v[i], cell[i], n, near, orbits)
        if which[i] == NOWHERE:
            orbits.before[n], orbits.last[cell[i]] = orbits.last[cell[i]], n
            which[i] = n
            n += 1
    return n


@kernel
def spread(done, n, columns, inside, cells, orbits):
    """Continue the orbits from number `done` on, of n, into the neighbours of their cells.

    These are in a rectangle of a grid with so many columns; orbits found there are continued too.

    Returns
    -------
    result
        Both numbers again: equal when nothing remains, else there is no more room.
    """
    room = orbits.cell.size
    while done < n and n + 4 <= room:
        row, column = divmod(orbits.cell[done], columns)
        for side in range(4):
            i, j = row + ROWS[side], column + COLUMNS[side]
            found = NOWHERE
            if inside.top <= i < inside.bottom and inside.left <= j < inside.right:
                cell = i * columns + j
                found = continue_orbit(done, cell, n, orbits, cells)
                if found == n:
                    n += 1
            orbits.to[done, side] = found
        done += 1
    return done, n


@kernel
def lead(one, other, steps, way, orbits, arrives):
    """Write whether orbits one (k,) become the orbits other (k,) of cells beside theirs when followed in so many steps.

    Way: the parameters of these (k·steps,), as cells.
    """
    for i in range(one.size):
        n_plus, tau, v = np.int64(orbits.n_plus[one[i]]), orbits.tau[one[i]], orbits.v[one[i]]
        arrives[i] = False
        for j in range(steps):
            point = point_of(i * steps + j, way)
            unit, before, speed = unit_at(point), tau, v
            found, tau, v = newton(before, speed, n_plus, point)
            if not found or math.hypot(wrapped(tau - before), (v - speed) / unit) > 0.5 * FARTHEST:
                break
            if j == steps - 1:
                for _ in range(n_plus):
                    near = abs(wrapped(tau - orbits.tau[other[i]])) < SAME_POINT
                    if near and abs(v - orbits.v[other[i]]) < SAME_POINT * unit:
                        arrives[i] = True
                        break
                    _status, tau, v, _time, _below = step(tau, v, point)
