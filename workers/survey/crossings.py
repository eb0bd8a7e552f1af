"""Find where a curve passes between neighbouring cells of a grid."""

from typing import NamedTuple

import numpy as np

#: A curve as arrays over its points: δ, ε, and the number of the connected piece that each point is on.
Polyline = tuple[np.ndarray, np.ndarray, np.ndarray]


class CurveCrossings(NamedTuple):
    """The pairs of neighbouring cells of a grid between which a curve passes.

    delta: the number of the first cell of each pair along δ. epsilon: the number of the first cell of each pair along
    ε. Cells are numbered row by row, and the numbers are in ascending order.
    """

    delta: np.ndarray
    epsilon: np.ndarray


def find_curve_crossings(curve: Polyline, delta: np.ndarray, epsilon: np.ndarray) -> CurveCrossings:
    """Return the pairs of neighbouring cells of the grid epsilon (m,) × delta (n,) between which a curve passes."""
    row, column = _grid_line_crossings(curve, delta, epsilon)
    line, before = _grid_line_crossings((curve[1], curve[0], curve[2]), epsilon, delta)
    return CurveCrossings(np.unique(row * delta.size + column), np.unique(before * delta.size + line))


def _grid_line_crossings(curve: Polyline, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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
    end = np.where(curve[2][:-1] == curve[2][1:], end, begin)  # no crossing between two pieces of the curve
    many = end - begin
    segment = np.repeat(np.arange(many.size), many)
    line = np.arange(segment.size) - np.repeat(np.cumsum(many) - many, many) + begin[segment]
    rise = (y1 - y0)[segment]
    share = np.where(rise != 0.0, (y[line] - y0[segment]) / np.where(rise != 0.0, rise, 1.0), 0.0)
    at = x0[segment] + share * (x1 - x0)[segment]
    inside = (x[0] <= at) & (at <= x[-1])
    return line[inside], np.clip(np.searchsorted(x, at[inside], "right") - 1, 0, x.size - 2)
