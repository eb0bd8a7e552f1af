"""Find where a curve passes between neighbouring cells of a grid."""

from typing import NamedTuple

import numpy as np

Polyline = tuple[np.ndarray, np.ndarray, np.ndarray]  # for each point of a curve: δ, ε, and the number of its piece


class Crossings(NamedTuple):
    """The pairs of neighbouring cells of a grid between which a curve passes.

    delta: the numbers of the cells, in ascending order, for which the curve passes between the cell and the next one
    along δ. epsilon: the same for the next cell along ε. Cells are numbered row by row.
    """

    delta: np.ndarray
    epsilon: np.ndarray


def crossings_of(curve: Polyline, delta: np.ndarray, epsilon: np.ndarray) -> Crossings:
    """Return the pairs of neighbouring cells between which a curve passes, in the grid epsilon (m,) × delta (n,)."""
    row, column = _along(curve, delta, epsilon)
    line, before = _along((curve[1], curve[0], curve[2]), epsilon, delta)
    return Crossings(np.unique(row * delta.size + column), np.unique(before * delta.size + line))


def _along(curve: Polyline, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return where a curve crosses the horizontal grid lines at the heights `y`, between the least and largest `x`.

    Returns
    -------
    tuple[np.ndarray, np.ndarray]
        For each crossing: the index in `y` of the grid line, and the index in `x` of the last value before it.
    """
    if len(curve[0]) < 2 or x.size < 2:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    (x0, x1), (y0, y1) = ((values[:-1], values[1:]) for values in curve[:2])
    begin = np.searchsorted(y, np.minimum(y0, y1), "left")
    end = np.searchsorted(y, np.maximum(y0, y1), "right")
    end = np.where(curve[2][:-1] == curve[2][1:], end, begin)  # no segment joins two pieces
    many = end - begin
    segment = np.repeat(np.arange(many.size), many)
    line = np.arange(segment.size) - np.repeat(np.cumsum(many) - many, many) + begin[segment]
    rise = (y1 - y0)[segment]
    share = np.where(rise != 0.0, (y[line] - y0[segment]) / np.where(rise != 0.0, rise, 1.0), 0.0)
    at = x0[segment] + share * (x1 - x0)[segment]
    inside = (x[0] <= at) & (at <= x[-1])
    return line[inside], np.clip(np.searchsorted(x, at[inside], "right") - 1, 0, x.size - 2)
