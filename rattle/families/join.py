"""Join the attractors of neighbouring cells: orbits are continued themselves, chaotic attractors by what they visit."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.table import CHAOTIC, PERIODIC, Attractors
from rattle.errors import real_array, require
from rattle.families.footprints import overlaps
from rattle.families.spread import NOWHERE, Linked, lead, spread
from rattle.families.table import Families, numbered, tabulated

AHEAD = (0, 1)  # sides of a cell, of which the others are the same seen from there
STEPS = 16  # from a cell to the next, of an orbit that leads to another and is not led back to


def axis(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """One axis of a grid; raises ParameterError unless its values rise or fall."""
    array = real_array(name, values)
    require(array.ndim == 1 and array.size > 0, f"{name} must be the values of an axis, got shape {array.shape}")
    steps = np.diff(array)
    require(bool(np.all(steps > 0) or np.all(steps < 0)), f"the values of {name} must rise or fall: sort them")
    return array


def joined(
    delta: NDArray[np.float64], epsilon: NDArray[np.float64], count: int, table: Attractors, cells: Any
) -> Families:
    """The families of the attractors of cells `epsilon` (m,) × `delta` (n,) with so many samples each, row by row of
    the grid; cells: as kernels take them.
    """
    attractors, entered, family = joined_rows(table, (epsilon.size, delta.size), cells)
    described = tabulated(delta, epsilon, count, attractors, family)
    return Families(delta, epsilon, count, attractors, entered, family, described)


def joined_rows(
    table: Attractors, shape: tuple[int, int], cells: Any
) -> tuple[Attractors, NDArray[np.bool_], NDArray[np.int64]]:
    """The table of the cells of a grid with what entered them, whether each row did (rows,), and its family (rows,)."""
    from scipy.sparse import coo_array  # an eighth of a second to load
    from scipy.sparse.csgraph import connected_components

    orbits, n = continued(table, shape, cells)
    periodic, chaotic = (np.flatnonzero(table.kind == kind) for kind in (PERIODIC, CHAOTIC))
    whole = _with_entered(table, orbits, periodic.size, n)
    row = np.append(periodic, np.arange(table.cell.size, whole.cell.size))  # of each orbit
    overlap = overlaps(table.cell[chaotic], table.tau[chaotic], table.v[chaotic], shape, cells)
    pairs = zip(linked(orbits, n, cells), overlap, strict=True)
    one, other = (np.append(row[orbit], chaotic[chaos]) for orbit, chaos in pairs)
    graph = coo_array((np.ones(one.size, np.int8), (one, other)), (whole.cell.size,) * 2)
    component = connected_components(graph, directed=False)[1]
    order = np.lexsort((whole.tau, whole.v, *whole[4:0:-1], -whole.samples, whole.cell))
    attractors, entered = Attractors._make(x[order] for x in whole), order >= table.cell.size
    return attractors, entered, numbered(attractors, component[order])


def continued(table: Attractors, shape: tuple[int, int], cells: Any) -> tuple[Linked, int]:
    """The periodic orbits of a table, and after them what they become in other cells, with the number of all."""
    periodic = np.flatnonzero(table.kind == PERIODIC)
    n = periodic.size
    orbits = _room(n + n // 4 + 64, shape[0] * shape[1])
    for column, values in zip(orbits[:8], (table[i] for i in (0, 2, 3, 4, 6, 7, 8, 9)), strict=True):
        column[:n] = values[periodic]
    cell = orbits.cell[:n]
    orbits.before[1:n] = np.where(cell[1:] == cell[:-1], np.arange(n - 1), NOWHERE)
    orbits.last[cell] = np.arange(n)  # of equal cells the last one stays
    done = 0
    while done < n:
        done, n = spread(done, n, *shape, cells, orbits)
        if done < n:
            orbits = _longer(orbits)
    return orbits, n


def linked(orbits: Linked, n: int, cells: Any) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of orbits, twice (pairs,), that are one in neighbouring cells: each leads to the other, or one does step by
    step. What leads to an orbit that leads elsewhere has jumped.
    """
    to = orbits.to[:n].astype(np.int64)
    ones, others = [], []
    for side in range(4):
        one = np.flatnonzero(to[:, side] != NOWHERE)
        other = to[one, side]
        back = to[other, (side + 2) % 4]
        sure = (back == one) & (side in AHEAD)
        doubtful = np.flatnonzero(back == NOWHERE)
        sure[doubtful] = _lead(one[doubtful], other[doubtful], orbits, cells)
        ones.append(one[sure])
        others.append(other[sure])
    return np.concatenate(ones), np.concatenate(others)


def _lead(one: NDArray[np.int64], other: NDArray[np.int64], orbits: Linked, cells: Any) -> NDArray[np.bool_]:
    share = np.arange(1, STEPS + 1) / STEPS
    here, there = orbits.cell[one], orbits.cell[other]
    way = type(cells)._make((x[here, None] * (1.0 - share) + x[there, None] * share).ravel() for x in cells)
    arrives = np.zeros(one.size, np.bool_)
    lead(one, other, STEPS, way, orbits, arrives)
    return arrives


def _room(n: int, n_cells: int) -> Linked:
    labels = (np.zeros(n, np.int32) for _ in range(4))
    values = (np.zeros(n) for _ in range(4))
    links = np.full(n, NOWHERE, np.int32), np.full(n_cells, NOWHERE, np.int32), np.full((n, 4), NOWHERE, np.int32)
    return Linked._make([*labels, *values, *links])


def _longer(orbits: Linked) -> Linked:
    """With half as much room again."""
    more = orbits.cell.size // 2 + 64
    wider = [np.concatenate([x, np.zeros((more, *x.shape[1:]), x.dtype)]) for x in orbits]
    return Linked._make(wider)._replace(last=orbits.last)


def _with_entered(table: Attractors, orbits: Linked, n_known: int, n: int) -> Attractors:
    """The table with a row more for each orbit that was entered."""
    new = slice(n_known, n)
    many = n - n_known
    zeros = np.zeros(many, np.int64)
    rows = Attractors(
        cell=orbits.cell[new].astype(np.int64),
        kind=np.full(many, PERIODIC),
        m=orbits.m[new].astype(np.int64),
        n_plus=orbits.n_plus[new].astype(np.int64),
        n_minus=orbits.n_minus[new].astype(np.int64),
        samples=zeros,
        tau=orbits.tau[new],
        v=orbits.v[new],
        first=orbits.first[new],
        second=orbits.second[new],
        error=np.zeros(many),
        impacts=zeros,
        watched=np.full(many, np.nan),
    )
    return Attractors._make(np.append(x, y) for x, y in zip(table, rows, strict=True))
