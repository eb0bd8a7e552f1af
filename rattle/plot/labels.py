"""Labels beside points of a panel, each where it covers least."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from rattle.impact_equations import Array

SIZE = 10.0  # of the letters, in points
WIDTH, HEIGHT = 0.62, 1.15  # of a letter, of its size
DISTANCES, DIRECTIONS = (9.0, 14.0, 21.0, 30.0), 12
BETWEEN = 4.0  # points of the page between two that count
CLEAR = 40.0  # farther from everything is no better
COVERED = 50.0  # what another label counts


class Labels:
    """Labels of one panel whose limits are set; places are in points of the page."""

    def __init__(self, panel: Axes) -> None:
        self.panel = panel
        self._points = np.empty((0, 4))  # x, y, weight, number of the curve
        self._boxes: list[tuple[float, float, float, float]] = []

    def avoid(self, x: Array, y: Array, weight: float = 1.0, number: int = -1) -> None:
        """Keep off a curve, or off points that count for less; curves that are labelled have a number."""
        at = self._page(np.column_stack([x, y])[self.seen(x, y)])
        if len(at) > 1 and weight == 1.0:
            length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(at, axis=0).T))])
            dense = np.arange(0.0, length[-1], BETWEEN)
            at = np.column_stack([np.interp(dense, length, at[:, i]) for i in (0, 1)])
        self._points = np.vstack(
            [self._points, np.column_stack([at, np.full(len(at), weight), np.full(len(at), number)])]
        )

    def clearest(self, x: Array, y: Array, number: int) -> int:
        """The point of curve `number` that is farthest from all other curves and from the frame."""
        at = self._page(np.column_stack([x, y]))
        others = self._points[(self._points[:, 2] == 1.0) & (self._points[:, 3] != number), :2]
        (left, low), (right, high) = self._page(np.column_stack([self.panel.get_xlim(), self.panel.get_ylim()]))
        frame = np.min([at[:, 0] - left, right - at[:, 0], at[:, 1] - low, high - at[:, 1]], axis=0)
        apart = np.hypot(*(at[:, None] - others[None]).T).min(axis=0, initial=CLEAR)
        return int(np.argmax(np.minimum(np.minimum(apart, frame), CLEAR) - 1e-3 * np.abs(at[:, 0] - at[:, 0].mean())))

    def seen(self, x: Array, y: Array) -> NDArray[np.bool_]:
        """Which points are inside the panel."""
        (left, right), (low, high) = self.panel.get_xlim(), self.panel.get_ylim()
        return np.asarray((x >= left) & (x <= right) & (y >= low) & (y <= high))

    def corner(self, text: str) -> None:
        """The panel's letter, in the upper left corner."""
        self.panel.annotate(text, (0.0, 1.0), (6, -6), "axes fraction", "offset points", va="top", fontsize=SIZE)
        left, top = self._page(np.array([[self.panel.get_xlim()[0], self.panel.get_ylim()[1]]]))[0]
        self._boxes.append((left, top - 24.0, left + 30.0, top))

    def place(self, text: str, x: float, y: float, style: str = "normal") -> None:
        """A label beside the point, if that is seen."""
        if not self.seen(np.array([x]), np.array([y])).all():
            return
        at = self._page(np.array([[x, y]]))[0]
        width, height = WIDTH * SIZE * len(text), HEIGHT * SIZE
        best, cost = None, np.inf
        for distance in DISTANCES:
            for angle in 2 * np.pi * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS:
                shift = np.array([(distance + width / 2) * np.cos(angle), (distance + height / 2) * np.sin(angle)])
                box = self._box(at + shift, width, height)
                found = self._cost(box) + 0.02 * distance
                if found < cost:
                    best, cost = (shift, box), found
        assert best is not None
        self._boxes.append(best[1])
        (dx, dy), _ = best
        arrow = {"arrowstyle": "-", "lw": 0.4, "shrinkA": 0.0, "shrinkB": 3.0} if np.hypot(dx, dy) > 26.0 else None
        self.panel.annotate(
            text,
            (x, y),
            (dx, dy),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=SIZE,
            style=style,
            arrowprops=arrow,
            zorder=6,
        )

    def _page(self, data: Array) -> Array:
        figure = self.panel.get_figure()
        assert figure is not None
        return np.asarray(self.panel.transData.transform(data) * 72.0 / figure.dpi).reshape(-1, 2)

    @staticmethod
    def _box(centre: Array, width: float, height: float) -> tuple[float, float, float, float]:
        return centre[0] - width / 2, centre[1] - height / 2, centre[0] + width / 2, centre[1] + height / 2

    def _cost(self, box: tuple[float, float, float, float]) -> float:
        """What a box covers: curves and points, other labels, the panel's frame."""
        left, low, right, high = box
        x, y, weight, _ = self._points.T
        covered = weight[(x > left - 1) & (x < right + 1) & (y > low - 1) & (y < high + 1)].sum()
        others = sum(left < b[2] and b[0] < right and low < b[3] and b[1] < high for b in self._boxes)
        frame = self._page(np.column_stack([self.panel.get_xlim(), self.panel.get_ylim()]))
        outside = left < frame[0, 0] + 2 or right > frame[1, 0] - 2 or low < frame[0, 1] + 2 or high > frame[1, 1] - 2
        return float(covered) + COVERED * (others + 2 * outside)
