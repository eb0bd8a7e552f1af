"""Find the edges of families of attractors in a survey, and the bifurcation curves at these edges."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from gear_rattle.workers.boundaries.labels import labels_changed_at_curve
from gear_rattle.workers.survey.crossings import CurveCrossings
from rattle import FamilyTable
from rattle.attractors import CHAOTIC
from rattle.families import CellRectangle


class FamilyEdges(NamedTuple):
    """Edges of families. An edge is a pair of neighbouring cells of which exactly one has the family.

    names: the names of the bifurcation curves. n_edges (families,): how many edges each family has.
    n_edges_on_curve (families, curves): at how many of these edges each curve passes between the two cells; 0 for a
    curve that neither makes nor ends motions of the family's label.
    """

    names: tuple[str, ...]
    n_edges: np.ndarray
    n_edges_on_curve: np.ndarray


class ComponentEdges(NamedTuple):
    """Edges of components (connected parts of families) in a part of a grid.

    An edge is a pair of neighbouring cells of which exactly one has the component. component (k,): the numbers of the
    components in the part. n_edges (k,): how many edges each component has.
    n_edges_on_curve (k, curves): at how many of these edges each curve passes between the two cells.
    """

    component: np.ndarray
    n_edges: np.ndarray
    n_edges_on_curve: np.ndarray


def find_edges_in_part(
    part: CellRectangle, columns: int, cell: np.ndarray, component: np.ndarray, crossings: Sequence[CurveCrossings]
) -> ComponentEdges:
    """Return the edges between the cells of a part of a grid and the next cells along δ and ε.

    columns: the number of columns of the grid. cell, component (attractors,): the cell and the component of each
    attractor in the part and in the next cells; component −1 stands for undecided samples. A pair of cells is left out
    in two cases: one cell has no attractor, so it is not computed; or one cell has undecided samples, so it may have
    attractors that are not listed.

    Returns
    -------
    ComponentEdges
        One row for each component in the part.
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
        for back in (0, 1):  # 0: the first cell of the pair has the component and the second lacks it; 1: the reverse
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
    return ComponentEdges(ids, number, on)


def count_edges(
    parts: Iterable[ComponentEdges], family: np.ndarray, table: FamilyTable, names: Sequence[str]
) -> FamilyEdges:
    """Count the edges of each family (see `FamilyEdges`) in the whole survey, from the edges in the parts of its grid.

    family: for each component (a connected part of a family), the number of its family. table: the families. names: the
    names of the curves.

    Returns
    -------
    FamilyEdges
        The numbers of edges for each family, and for each family and curve.
    """
    n = table.cells.size
    number, on = np.zeros(n, np.int64), np.zeros((n, len(names)), np.int64)
    for part in parts:
        np.add.at(number, family[part.component], part.n_edges)
        np.add.at(on, family[part.component], part.n_edges_on_curve)
    concerned = np.array([_families_with_label_of_curve(table, name) for name in names]).reshape(len(names), n)
    return FamilyEdges(tuple(names), number, np.where(concerned.T, on, 0))


def _families_with_label_of_curve(table: FamilyTable, name: str) -> np.ndarray:
    """Return for each family whether a curve makes or ends motions with the family's label; False for chaos."""
    known = labels_changed_at_curve(name)
    labels = zip(*(column.tolist() for column in table[:4]), strict=True)
    return np.array([label in known for label in labels], bool) & (table.kind != CHAOTIC)
