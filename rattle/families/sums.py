"""The sums over cells that describe families. The sums of the pieces of a grid can be added.

A component is a set of connected attractors: one motion in several cells. Its number is arbitrary;
`assign_family_numbers` gives the number of the family that the component forms.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.table import AttractorTable

#: The family number of quiet motion, and the number that undecided samples have instead of a family.
QUIET_FAMILY, NO_FAMILY = 0, -1

Integers = NDArray[np.int64]


class ComponentSums(NamedTuple):
    """Sums and extremes over some cells of a grid: one entry for each component (a set of connected attractors).

    component: the number of the component; the entries are sorted by this number.
    kind, m, n_plus, n_minus: the kind and the label of the component's attractors.
    cells: the number of cells of the component. rows: the number of its attractors (rows of the table of attractors);
    larger than `cells` if two of its attractors are in one cell.
    unsampled: the number of its attractors that no sample reaches. samples: the number of samples that reach any of
    its attractors.
    top, bottom, left, right: the first and the last row and column of its cells.
    most: the largest number of samples of one of its attractors. at: the first cell with such an attractor.
    exponent: the largest Lyapunov exponent of its attractors, −∞ if none is known.
    first: the cell of its first attractor. place: the number of rows of the table before that attractor in this cell.
    """

    component: Integers
    kind: Integers
    m: Integers
    n_plus: Integers
    n_minus: Integers
    cells: Integers
    rows: Integers
    unsampled: Integers
    samples: Integers
    top: Integers
    bottom: Integers
    left: Integers
    right: Integers
    most: Integers
    at: Integers
    exponent: NDArray[np.float64]
    first: Integers
    place: Integers


def sum_over_components(table: AttractorTable, component: Integers, columns: int) -> ComponentSums:
    """Return the sums of a table of attractors over each component (a set of connected attractors).

    table: the attractors, in the order of their cells. component (rows,): the component of each row, or NO_FAMILY.
    columns: the number of columns of the grid.

    Returns
    -------
    ComponentSums
        An entry for each component.
    """
    place = np.arange(component.size) - np.searchsorted(table.cell, table.cell)
    of = np.flatnonzero(component != NO_FAMILY)
    component, cell, samples = component[of], table.cell[of], table.samples[of]
    here = np.lexsort((cell, component))  # rows of the same component and cell keep their order
    again = np.zeros(of.size, np.bool_)
    same = (component[here][1:] == component[here][:-1]) & (cell[here][1:] == cell[here][:-1])
    again[here[1:][same]] = True
    row, column = np.divmod(cell, columns)
    ones = np.ones(of.size, np.int64)
    each = ComponentSums(
        component=component,
        kind=table.kind[of],
        m=table.m[of],
        n_plus=table.n_plus[of],
        n_minus=table.n_minus[of],
        cells=ones - again,
        rows=ones,
        unsampled=(samples == 0).astype(np.int64),
        samples=samples,
        top=row,
        bottom=row,
        left=column,
        right=column,
        most=samples,
        at=cell,
        exponent=np.where(np.isnan(table.first[of]), -np.inf, table.first[of]),
        first=cell,
        place=place[of],
    )
    return merge_component_sums([each])


def merge_component_sums(parts: Iterable[ComponentSums]) -> ComponentSums:
    """Return the sums over the union of several sets of cells, from the sums over each set; no cell is in two sets."""
    all_ = ComponentSums._make(np.concatenate(columns) for columns in zip(*parts, strict=True))
    if not all_.component.size:
        return all_
    order = np.lexsort((all_.place, all_.first, all_.component))
    all_ = ComponentSums._make(x[order] for x in all_)
    begin = np.flatnonzero(np.diff(all_.component, prepend=all_.component[0] - 1))
    by_samples = np.lexsort((all_.at, -all_.most, all_.component))[begin]
    rules = {
        np.add: ("cells", "rows", "unsampled", "samples"),
        np.minimum: ("top", "left"),
        np.maximum: ("bottom", "right", "exponent"),
    }
    found = {name: rule.reduceat(getattr(all_, name), begin) for rule, names in rules.items() for name in names}
    found |= {name: getattr(all_, name)[by_samples] for name in ("most", "at")}
    return ComponentSums._make(x[begin] for x in all_)._replace(**found)


def assign_family_numbers(sums: ComponentSums) -> Integers:
    """Return an array whose entry i is the number of the family of component i.

    The last entry is NO_FAMILY, because undecided samples have the component −1. Families are numbered by falling
    number of cells, and families of equally many cells by their first attractors. So the numbers depend on the cells
    alone.

    Returns
    -------
    Integers
        The numbers of families: 0 for quiet motion, from 1 on for the others.
    """
    others = np.flatnonzero(sums.component != QUIET_FAMILY)
    order = others[np.lexsort((sums.place[others], sums.first[others], -sums.cells[others]))]
    family = np.full(int(sums.component.max(initial=QUIET_FAMILY)) + 2, NO_FAMILY)
    family[QUIET_FAMILY] = QUIET_FAMILY
    family[sums.component[order]] = 1 + np.arange(order.size)
    return family
