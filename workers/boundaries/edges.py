"""Where families of attractors end in a survey, and which of its traced curves passes there."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from rattle import Families
from rattle.attractors.table import CHAOTIC, UNDECIDED
from workers.boundaries.labels import labels_of

Polyline = tuple[np.ndarray, np.ndarray, np.ndarray]  # δ, ε and piece of the points of a curve, in their order


class Edges(NamedTuple):
    """The edges of families: pairs of neighbouring cells of which one has the family.

    names (c,): of the curves. number (families,): of such pairs. on (families, c): those between which a curve passes
    that makes or ends motions of this label.
    """

    names: tuple[str, ...]
    number: np.ndarray
    on: np.ndarray


def edges_of(families: Families, curves: Mapping[str, Polyline]) -> Edges:
    """The edges of the families of a survey, whose axes rise, and the curves that these are on.

    A cell without a single attractor was not computed, and one with undecided samples may have what it does not list:
    pairs with these are left out.
    """
    rows, shape = families.attractors, (families.epsilon.size, families.delta.size)
    n_cells, n_families = shape[0] * shape[1], families.table.cells.size
    known = np.bincount(rows.cell, minlength=n_cells) > 0
    known[rows.cell[rows.kind == UNDECIDED]] = False
    named = families.family >= 0
    here = np.unique(families.family[named] * n_cells + rows.cell[named])
    family, cell = np.divmod(here, n_cells)
    number, on = np.zeros(n_families, np.int64), np.zeros((n_families, len(curves)), np.int64)
    concerned = np.array([_concerned(families, name) for name in curves]).reshape(len(curves), n_families)
    passed = [_passed(curve, families.delta, families.epsilon) for curve in curves.values()]
    row, column = np.divmod(cell, shape[1])
    for axis, step in ((0, (0, 1)), (0, (0, -1)), (1, (1, 0)), (1, (-1, 0))):
        i, j = row + step[0], column + step[1]
        inside = (i >= 0) & (i < shape[0]) & (j >= 0) & (j < shape[1])
        other = np.where(inside, i * shape[1] + j, 0)
        key = family * n_cells + other
        has = here[np.minimum(np.searchsorted(here, key), here.size - 1)] == key
        ends = inside & known[cell] & known[other] & ~has
        number += np.bincount(family[ends], minlength=n_families)
        at = np.minimum(row, i)[ends], np.minimum(column, j)[ends]
        for k in range(len(curves)):
            on[:, k] += np.bincount(family[ends], passed[k][axis][at], n_families).astype(np.int64)
    return Edges(tuple(curves), number, np.where(concerned.T, on, 0))


def _concerned(families: Families, name: str) -> np.ndarray:
    """Whether a curve makes or ends motions of these families' labels; chaos has none."""
    table, known = families.table, labels_of(name)
    labels = zip(*(column.tolist() for column in table[:4]), strict=True)
    return np.array([label in known for label in labels], bool) & (table.kind != CHAOTIC)


def _passed(curve: Polyline, delta: np.ndarray, epsilon: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whether a curve passes between each cell and the next one along δ (m, n − 1), and along ε (m − 1, n)."""
    return _along(curve, delta, epsilon), _along((curve[1], curve[0], curve[2]), epsilon, delta).T


def _along(curve: Polyline, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Whether a polyline of (x, y) meets the line of each y between each x and the next: (y, x − 1)."""
    found = np.zeros((y.size, max(x.size - 1, 0)), bool)
    if len(curve[0]) < 2 or x.size < 2:
        return found
    (x0, x1), (y0, y1) = ((values[:-1], values[1:]) for values in curve[:2])
    begin = np.searchsorted(y, np.minimum(y0, y1), "left")
    end = np.searchsorted(y, np.maximum(y0, y1), "right")
    end = np.where(curve[2][:-1] == curve[2][1:], end, begin)  # pieces are not joined
    many = end - begin
    segment = np.repeat(np.arange(many.size), many)
    line = np.arange(segment.size) - np.repeat(np.cumsum(many) - many, many) + begin[segment]
    rise = (y1 - y0)[segment]
    share = np.where(rise != 0.0, (y[line] - y0[segment]) / np.where(rise != 0.0, rise, 1.0), 0.0)
    at = x0[segment] + share * (x1 - x0)[segment]
    inside = (x[0] <= at) & (at <= x[-1])
    between = np.clip(np.searchsorted(x, at[inside], "right") - 1, 0, x.size - 2)
    found[line[inside], between] = True
    return found
