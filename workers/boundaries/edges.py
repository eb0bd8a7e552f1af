"""Find the ends of families of attractors in a survey, and the traced curve that passes there."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from gear_rattle.workers.boundaries.labels import labels_on_curve
from gear_rattle.workers.survey.crossings import Crossings
from rattle import FamilyTable
from rattle.attractors import CHAOTIC
from rattle.families import Rectangle


class Edges(NamedTuple):
    """Edges of families: pairs of neighbouring cells of which exactly one has the family.

    names (c,): the curves. number (families,): such pairs. on (families, c): such pairs with a curve between them that
    makes or ends motions of the family's label.
    """

    names: tuple[str, ...]
    number: np.ndarray
    on: np.ndarray


class FamilyEnds(NamedTuple):
    """Edges of some components (k,) in a part of a grid.

    number (k,): pairs. on (k, curves): pairs that each curve passes between.
    """

    component: np.ndarray
    number: np.ndarray
    on: np.ndarray


def ends_in(
    part: Rectangle, columns: int, cell: np.ndarray, component: np.ndarray, crossings: Sequence[Crossings]
) -> FamilyEnds:
    """Return the edges between the cells of a part of a grid and the next ones along δ and ε.

    The grid has so many columns, and its axes rise. cell, component (rows,): attractors of the part and of the next
    cells, with component −1 for undecided samples. A cell without any attractor was not computed, and one with
    undecided samples may have attractors that it does not list: pairs with such cells are left out.

    Returns
    -------
    FamilyEnds
        One row for each component that the part has.
    """
    width = part.right - part.left + 1
    row, column = np.divmod(cell, columns)
    row, column = row - part.top, column - part.left
    within = (row >= 0) & (row <= part.bottom - part.top) & (column >= 0) & (column < width)
    row, column, component = row[within], column[within], component[within]
    n = (part.bottom - part.top + 1) * width
    known = np.bincount(row * width + column, minlength=n) > 0
    known[(row * width + column)[component < 0]] = False
    named = component >= 0
    ids, which = np.unique(component[named], return_inverse=True)
    here = np.unique(which * n + (row * width + column)[named])
    which, at = np.divmod(here, n)
    row, column = np.divmod(at, width)
    number, on = np.zeros(ids.size, np.int64), np.zeros((ids.size, len(crossings)), np.int64)
    for axis, (down, right) in enumerate(((0, 1), (1, 0))):
        for back in (0, 1):  # whether the family has the pair's second cell
            i, j = row - back * down, column - back * right
            other = (row + (1 - 2 * back) * down) * width + column + (1 - 2 * back) * right
            pair = (i >= 0) & (i < part.bottom - part.top) & (j >= 0) & (j < part.right - part.left)
            other = np.where(pair, other, 0)
            has = here[np.minimum(np.searchsorted(here, which * n + other), here.size - 1)] == which * n + other
            ends = pair & known[at] & known[other] & ~has
            number += np.bincount(which[ends], minlength=ids.size)
            first = (part.top + i[ends]) * columns + part.left + j[ends]
            for k, crossing in enumerate(crossings):
                on[:, k] += np.bincount(which[ends][np.isin(first, crossing[axis])], minlength=ids.size)
    return FamilyEnds(ids, number, on)


def edges_of(parts: Iterable[FamilyEnds], family: np.ndarray, table: FamilyTable, names: Sequence[str]) -> Edges:
    """Return the edges of the families of a survey from those in its parts.

    family: the number of each component's family, which indexes the result.

    Returns
    -------
    Edges
        Numbers of pairs by family, and by family and curve.
    """
    n = table.cells.size
    number, on = np.zeros(n, np.int64), np.zeros((n, len(names)), np.int64)
    for part in parts:
        np.add.at(number, family[part.component], part.number)
        np.add.at(on, family[part.component], part.on)
    concerned = np.array([_concerned(table, name) for name in names]).reshape(len(names), n)
    return Edges(tuple(names), number, np.where(concerned.T, on, 0))


def _concerned(table: FamilyTable, name: str) -> np.ndarray:
    """Return whether a curve makes or ends motions of these families' labels; chaos has none."""
    known = labels_on_curve(name)
    labels = zip(*(column.tolist() for column in table[:4]), strict=True)
    return np.array([label in known for label in labels], bool) & (table.kind != CHAOTIC)
