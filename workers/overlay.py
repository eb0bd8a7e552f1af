"""The bifurcation curves and codimension-two points over a map, with labels that keep clear of them."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Annotation
from matplotlib.transforms import Bbox

from rattle.curves import NAMES, Curve, codimension_two
from workers.curves import Missing, Window, traced, window_around

#: Which curves explain which map.
CURVES_ON: dict[str, tuple[str, ...]] = {
    "region": NAMES,
    "quiet_fraction": ("SN1", "quiet_limit"),
    "lyapunov_max": ("SN1", "G1", "G2"),
}
#: A colour for each kind of bifurcation.
STYLES = {
    "SN1": ("black", "-"),
    "SN2": ("black", (0, (4, 1.5))),
    "PD1": ("#7b3294", "-"),
    "PDC": ("#7b3294", (0, (4, 1.5))),
    "PD2": ("#7b3294", (0, (5, 1.5, 1, 1.5))),
    "G1": ("#c51b1b", "-"),
    "G2": ("#c51b1b", (0, (4, 1.5))),
    "quiet_limit": ("#08519c", (0, (1, 1))),
}
MARKERS = {"COD20": "o", "COD21": "s", "COD22": "D", "COD23": "^"}
HALO = [patheffects.withStroke(linewidth=2.5, foreground="white")]

DISTANCES = (20, 30, 42, 56, 72, 90)  # of a label from its point, in points
DIRECTIONS = np.arange(24) / 24 * 2 * np.pi
ROOM = 3.0  # around a label, in pixels


def draw_curves(axes: Axes, dataset: xr.Dataset, names: Sequence[str]) -> list[np.ndarray]:
    """Draw the curves that cross the map; returns them, (k, 2) each, NaN between pieces."""
    beta, window, drawn = float(dataset.attrs["beta"]), _window(dataset), []
    limits = {"xlim": axes.get_xlim(), "ylim": axes.get_ylim()}
    for name in names:
        curve = traced(name, beta, window)
        if not isinstance(curve, Missing) and len(curve):
            colour, dashes = STYLES[name]
            drawn.append(_polyline(curve))
            axes.plot(
                *drawn[-1].T,
                color=colour,
                linestyle=dashes,
                linewidth=1.4,
                label=name.replace("_", " "),
                path_effects=HALO,
            )
    axes.set(**limits)
    return drawn


def _window(dataset: xr.Dataset) -> Window:
    return window_around(dataset["delta"].values, dataset["epsilon"].values)


def _polyline(curve: Curve) -> np.ndarray:
    points = np.column_stack([curve.delta, curve.epsilon])
    return np.insert(points, np.flatnonzero(np.diff(curve.piece)) + 1, np.nan, axis=0)


def draw_points(axes: Axes, dataset: xr.Dataset, curves: Sequence[np.ndarray]) -> None:
    """Mark and name the codimension-two points, away from the curves and from what is written already.

    The layout is made first: where a label is clear of a curve depends on the shape of the axes.
    """
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    points = [
        point
        for point in codimension_two(float(dataset.attrs["beta"]))
        if left <= point.delta <= right and bottom <= point.epsilon <= top
    ]
    for point in points:
        marker = MARKERS[point.name]
        axes.plot(point.delta, point.epsilon, marker, color="white", markeredgecolor="black", markersize=4.5, zorder=4)
    if not points:
        return
    figure = axes.get_figure(root=True)
    assert figure is not None
    canvas = figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    layout = figure.get_layout_engine()
    if layout is not None:
        layout.execute(figure)
    labels = _Labels(axes, canvas, [*curves, *(np.array([[point.delta, point.epsilon]]) for point in points)])
    for point in points:
        labels.add(point.name, (point.delta, point.epsilon))


class _Labels:
    """Labels of one map, each put where it covers least."""

    def __init__(self, axes: Axes, canvas: FigureCanvasAgg, lines: Sequence[np.ndarray]) -> None:
        self.axes, self.renderer = axes, canvas.get_renderer()
        self.frame = axes.get_window_extent(self.renderer)
        self.covered = np.concatenate([_dense(axes.transData.transform(line)) for line in lines])
        self.boxes = [text.get_window_extent(self.renderer) for text in axes.texts]
        self.leaders: list[np.ndarray] = []

    def add(self, name: str, point: tuple[float, float]) -> None:
        """Write a name next to a point, with a line to it."""
        text = self.axes.annotate(
            name,
            point,
            (0, 0),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=8,
            arrowprops={"arrowstyle": "-", "linewidth": 0.8, "shrinkA": 0, "shrinkB": 3},
            path_effects=HALO,
            zorder=5,
        )
        origin = self.axes.transData.transform(point)
        size = np.array(Annotation.get_window_extent(text, self.renderer).size) / 2 + ROOM
        pixels = self.renderer.points_to_pixels(1.0)
        offsets = [
            distance * np.array([np.cos(angle), np.sin(angle)]) for distance in DISTANCES for angle in DIRECTIONS
        ]
        best = min(offsets, key=lambda offset: self._cost(origin, origin + pixels * offset, size))
        text.set_position(tuple(best))
        centre = origin + pixels * best
        self.boxes.append(_box(centre, size))
        self.leaders.append(np.array([origin, centre]))

    def _cost(self, origin: np.ndarray, centre: np.ndarray, size: np.ndarray) -> float:
        box = _box(centre, size)
        leader = np.array([origin, centre])
        hidden = np.all(np.abs(self.covered - centre) < size, axis=1).sum()
        overlaps = sum(box.overlaps(other) for other in self.boxes)
        crossed = sum(_cross(leader, other) for other in self.leaders) + sum(
            other.count_contains(_dense(leader)) > 0 for other in self.boxes
        )
        outside = not (self.frame.contains(*box.min) and self.frame.contains(*box.max))
        return float(np.hypot(*(centre - origin)) + 20 * hidden + 1000 * (overlaps + crossed) + 1e5 * outside)


def _box(centre: np.ndarray, size: np.ndarray) -> Bbox:
    return Bbox([centre - size, centre + size])


def _dense(line: np.ndarray) -> np.ndarray:
    """Points of a line in pixels, at most some pixels apart."""
    steps = np.nan_to_num(np.hypot(*np.diff(line, axis=0).T))
    number = np.arange(len(line))
    along = np.concatenate([[0.0], np.cumsum(np.minimum(steps, 1e4) / 4 + 1e-9)])
    fine = np.interp(np.arange(0.0, along[-1] + 1.0), along, number)
    return np.column_stack([np.interp(fine, number, column) for column in line.T])


def _cross(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two segments cross."""
    (a, b), (c, d) = one, other
    return _side(a, b, c) * _side(a, b, d) < 0 and _side(c, d, a) * _side(c, d, b) < 0


def _side(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    """On which side of the line from a to b the point c is."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
