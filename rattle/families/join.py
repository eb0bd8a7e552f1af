"""Join the attractors of neighbouring cells: periodic orbits by continuation, chaotic attractors by visited cells."""

from __future__ import annotations

from functools import singledispatch
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.classify import Classifier
from rattle.attractors.samples import Outcome
from rattle.attractors.speeds import SampleSpec
from rattle.attractors.table import AttractorTable, attractors_of_samples
from rattle.errors import require, require_number, require_real_array
from rattle.families.family_table import Families, tabulate_families
from rattle.families.footprints import pairs_with_overlapping_footprints
from rattle.families.spread import (
    NOWHERE,
    ORBIT_COLUMNS,
    CellRectangle,
    LinkedOrbits,
    continue_orbits_into_neighbours,
    write_arrivals,
)
from rattle.families.sums import NO_FAMILY, QUIET_FAMILY, ComponentSums, assign_family_numbers, sum_over_components
from rattle.parameters import Parameters

#: The sides of a cell towards the next row and the next column, as columns of `LinkedOrbits.continuations`. They
#: suffice to visit each pair of neighbouring cells once.
AHEAD = (0, 1)
#: Orbit a in one cell may continue to orbit b in the next cell, while b does not continue to a. Then a is followed to
#: the cell of b once more, in this number of small steps.
STEPS = 64


def require_monotone_axis(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """Return the values of an axis as an array. Raises ParameterError unless they are rising or falling numbers."""
    array = require_real_array(name, values)
    require(
        array.ndim == 1 and array.size > 0,
        f"{name} must be a list of numbers, the values of an axis, got shape {array.shape}",
    )
    steps = np.diff(array)
    require(
        bool(np.all(steps > 0) or np.all(steps < 0)),
        f"the values of {name} must rise or fall throughout: sort them, each value once",
    )
    return array


def compute_families(
    classifier: type[Classifier],
    delta: ArrayLike,
    epsilon: ArrayLike,
    others: dict[str, float],
    sample: SampleSpec,
) -> Families:
    """Return the families of the attractors over a grid of cells, for any model.

    Parameters
    ----------
    classifier : type[Classifier]
        The classifier of the model.
    delta, epsilon : ArrayLike
        The axes of the grid.
    others : dict[str, float]
        β and the parameters that the model adds, by name.
    sample : SampleSpec
        The initial conditions of each cell.

    Returns
    -------
    Families
        The families, and the attractors of all cells.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    delta, epsilon = require_monotone_axis("delta", delta), require_monotone_axis("epsilon", epsilon)
    others = {name: require_number(name, x, positive=True) for name, x in others.items()}
    cells = Parameters.from_values(classifier.model, delta, epsilon[:, None], **others).flat()
    table = attractors_of_samples(classifier, cells, sample)
    return join_attractors(delta, epsilon, sample.count, table, classifier.cells_of(cells))


def join_attractors(
    delta: NDArray[np.float64], epsilon: NDArray[np.float64], count: int, table: AttractorTable, cells: Any
) -> Families:
    """Return the families of the attractors of a grid of cells `epsilon` (m,) × `delta` (n,).

    count: the number of samples of a cell. table: the attractors, in the order of their cells. cells: the cells, row by
    row of the grid, as kernels take them.

    Returns
    -------
    Families
        The families, and the attractors of all cells with the orbits that were continued from neighbours.
    """
    attractors, entered, family, sums = _join_and_sum_components(table, (epsilon.size, delta.size), cells)
    return Families(delta, epsilon, count, attractors, entered, family, tabulate_families(delta, epsilon, count, sums))


def join_into_families(
    table: AttractorTable, shape: tuple[int, int], cells: Any
) -> tuple[AttractorTable, NDArray[np.bool_], NDArray[np.int64]]:
    """Join the attractors of a grid to families; add the orbits that are found by continuation into its cells.

    Returns
    -------
    tuple[AttractorTable, NDArray[np.bool_], NDArray[np.int64]]
        The attractors; flags (rows,), true for orbits that were continued from neighbours; and the number (rows,) of
        each attractor's family.
    """
    return _join_and_sum_components(table, shape, cells)[:3]


def _join_and_sum_components(
    table: AttractorTable, shape: tuple[int, int], cells: Any
) -> tuple[AttractorTable, NDArray[np.bool_], NDArray[np.int64], ComponentSums]:
    """Return the results of `join_into_families`, and the sums from which `tabulate_families` makes its table."""
    orbits, n = continue_orbits(table, shape[1], CellRectangle(0, shape[0], 0, shape[1]), cells)
    periodic = np.flatnonzero(table.kind == Outcome.PERIODIC)
    attractors = concat_tables(table, table_of_continued_orbits(orbits, periodic.size, n))
    # row[i] is the row of orbit number i in the table `attractors`
    row = np.append(periodic, np.arange(table.cell.size, attractors.cell.size))
    component = assign_component_numbers(attractors, row, orbits, shape, cells)
    order = argsort_attractors(attractors)
    attractors, component = attractors.take(order), component[order]
    sums = sum_over_components(attractors, component, shape[1])
    return attractors, order >= table.cell.size, assign_family_numbers(sums)[component], sums


def concat_tables(*tables: AttractorTable) -> AttractorTable:
    """Return the rows of several tables as one table."""
    return AttractorTable.concat(list(tables))


def argsort_attractors(table: AttractorTable) -> NDArray[np.int64]:
    """Return the indices that sort the rows of a table: cell by cell, and in each cell by falling number of samples.

    Attractors of a cell with equal numbers of samples are sorted by kind, label and state, so that the result does not
    depend on their order in the table.

    Returns
    -------
    NDArray[np.int64]
        Indices (rows,): `table.take(indices)` is sorted.
    """
    keys = (table.tau, table.v, table.n_minus, table.n_plus, table.m, table.kind, -table.samples, table.cell)
    return np.lexsort(keys)


def assign_component_numbers(
    table: AttractorTable, row: NDArray[np.int64], orbits: LinkedOrbits, shape: tuple[int, int], cells: Any
) -> NDArray[np.int64]:
    """Return a number for each row of a table; rows with the same number are one attractor in several cells.

    Parameters
    ----------
    table : AttractorTable
        The attractors, whose chaotic rows are in the order of their cells.
    row : NDArray[np.int64]
        The row of each orbit in the table.
    orbits : LinkedOrbits
        The periodic orbits with their continuations.
    shape : tuple[int, int]
        The numbers of rows and columns of the grid.
    cells : NamedTuple of ndarray
        The cells of the grid as kernels take them.

    Returns
    -------
    NDArray[np.int64]
        The numbers (rows,): QUIET_FAMILY for quiet motion, NO_FAMILY for undecided samples.
    """
    from scipy.sparse import coo_array  # scipy is imported here, because this takes an eighth of a second
    from scipy.sparse.csgraph import connected_components

    chaotic = np.flatnonzero(table.kind == Outcome.CHAOTIC)
    overlap = pairs_with_overlapping_footprints(table.cell[chaotic], table.tau[chaotic], table.v[chaotic], shape, cells)
    pairs = zip(pairs_of_linked_orbits(orbits, row.size, cells), overlap, strict=True)
    one, other = (np.append(row[orbit], chaotic[chaos]) for orbit, chaos in pairs)
    graph = coo_array((np.ones(one.size, np.int8), (one, other)), (table.cell.size,) * 2)
    component = 1 + connected_components(graph, directed=False)[1].astype(np.int64)
    component[table.kind == Outcome.QUIET] = QUIET_FAMILY
    component[table.kind == Outcome.UNDECIDED] = NO_FAMILY
    return component


def continue_orbits(
    table: AttractorTable, columns: int, inside: CellRectangle, cells: Any, first: int = 0
) -> tuple[LinkedOrbits, int]:
    """Continue the periodic orbits of a table into the cells of a rectangle, until nothing new is found.

    Parameters
    ----------
    table : AttractorTable
        The attractors; rows of the same cell follow each other.
    columns : int
        The number of columns of the grid.
    inside : CellRectangle
        The cells into which orbits are continued.
    first : int
        The number of the first periodic orbit to continue; the orbits before it were continued already.

    Returns
    -------
    tuple[LinkedOrbits, int]
        The periodic orbits of the table, followed by the new orbits that were found; and the number of all these.
    """
    periodic = np.flatnonzero(table.kind == Outcome.PERIODIC)
    n = periodic.size
    orbits = allocate_orbits(n + n // 4 + 64, cells[0].size)
    for name in ORBIT_COLUMNS:
        getattr(orbits, name)[:n] = getattr(table, name)[periodic]
    cell = orbits.cell[:n]
    orbits.previous_in_cell[1:n] = np.where(cell[1:] == cell[:-1], np.arange(n - 1), NOWHERE)
    orbits.last_in_cell[cell] = np.arange(
        n
    )  # numpy keeps the last value if an index is repeated: the last orbit of the cell
    return continue_orbits_until_complete(first, n, columns, inside, cells, orbits)


def continue_orbits_until_complete(
    next_orbit: int, n: int, columns: int, inside: CellRectangle, cells: Any, orbits: LinkedOrbits
) -> tuple[LinkedOrbits, int]:
    """Continue the orbits number `next_orbit` to n − 1, and all new orbits that are found, from cell to cell.

    This repeats `continue_orbits_into_neighbours` until no new orbit is found; when the arrays are full, they are made
    larger.

    Returns
    -------
    tuple[LinkedOrbits, int]
        The orbits and their number.
    """
    while next_orbit < n:
        next_orbit, n = continue_orbits_into_neighbours(next_orbit, n, columns, inside, cells, orbits)
        if next_orbit < n:
            orbits = enlarge_orbit_arrays(orbits)
    return orbits, n


def pairs_of_linked_orbits(orbits: LinkedOrbits, n: int, cells: Any) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the pairs among the first n orbits that are one orbit in neighbouring cells.

    Two orbits count as one if each continues to the other. If only one of the two continues to the other, it must also
    arrive there in STEPS small steps, because a large step may have jumped to the wrong orbit.

    Returns
    -------
    tuple[NDArray[np.int64], NDArray[np.int64]]
        Number of the first and of the second orbit of each pair.
    """
    to = orbits.continuations[:n].astype(np.int64)
    to[to >= n] = NOWHERE
    ones, others = [], []
    for side in range(4):
        one = np.flatnonzero(to[:, side] != NOWHERE)
        other = to[one, side]
        back = to[other, (side + 2) % 4]
        sure = (back == one) & (side in AHEAD)
        doubtful = np.flatnonzero(back != one)
        sure[doubtful] = _are_continued_to(one[doubtful], other[doubtful], orbits, cells)
        ones.append(one[sure])
        others.append(other[sure])
    return np.concatenate(ones), np.concatenate(others)


@singledispatch
def interpolate_cells(cells: Any, here: NDArray[np.int64], there: NDArray[np.int64], share: NDArray[np.float64]) -> Any:
    """Return cells on the straight lines between pairs of cells, by default by linear interpolation of every column.

    A gear whose cells hold derived numbers besides their parameters registers its own function.

    Parameters
    ----------
    cells : NamedTuple of ndarray
        Cells as kernels take them.
    here, there : ndarray of int, (n,)
        The numbers of the cells at which the lines begin and end.
    share : ndarray, (k,)
        Positions along a line, from 0 to 1.

    Returns
    -------
    NamedTuple of ndarray
        n·k cells, line by line, as kernels take them.
    """
    return type(cells)._make((x[here, None] * (1.0 - share) + x[there, None] * share).ravel() for x in cells)


def _are_continued_to(
    one: NDArray[np.int64], other: NDArray[np.int64], orbits: LinkedOrbits, cells: Any
) -> NDArray[np.bool_]:
    """Return for each i whether orbit one[i] becomes orbit other[i] in STEPS small steps of continuation."""
    share = np.arange(1, STEPS + 1) / STEPS
    here, there = orbits.cell[one], orbits.cell[other]
    path = interpolate_cells(cells, here, there, share)
    arrives = np.zeros(one.size, np.bool_)
    write_arrivals(one, other, STEPS, path, orbits, arrives)
    return arrives


def allocate_orbits(n: int, n_cells: int) -> LinkedOrbits:
    """Return empty arrays with room for n orbits in n_cells cells."""
    labels = (np.zeros(n, np.int32) for _ in range(4))
    values = (np.zeros(n) for _ in range(4))
    links = np.full(n, NOWHERE, np.int32), np.full(n_cells, NOWHERE, np.int32), np.full((n, 4), NOWHERE, np.int32)
    return LinkedOrbits._make([*labels, *values, *links])


def enlarge_orbit_arrays(orbits: LinkedOrbits) -> LinkedOrbits:
    """Return the orbits in larger arrays, which have room for 1.5 times as many orbits and 64 more."""
    more = orbits.cell.size // 2 + 64
    wider = [np.concatenate([x, np.zeros((more, *x.shape[1:]), x.dtype)]) for x in orbits]
    return LinkedOrbits._make(wider)._replace(last_in_cell=orbits.last_in_cell)


def table_of_continued_orbits(orbits: LinkedOrbits, n_known: int, n: int) -> AttractorTable:
    """Return a table of the orbits n_known to n − 1, which were found by continuation and have 0 samples."""
    new = slice(n_known, n)
    many = n - n_known
    zeros = np.zeros(many, np.int64)
    return AttractorTable(
        cell=orbits.cell[new].astype(np.int64),
        kind=np.full(many, Outcome.PERIODIC),
        m=orbits.m[new].astype(np.int64),
        n_plus=orbits.n_plus[new].astype(np.int64),
        n_minus=orbits.n_minus[new].astype(np.int64),
        samples=zeros,
        tau=orbits.tau[new].copy(),
        v=orbits.v[new].copy(),
        first=orbits.first[new].copy(),
        second=orbits.second[new].copy(),
        error=np.zeros(many),
        impacts=zeros,
        watched=np.full(many, np.nan),
    )
