"""The (δ, ε) plane: its bifurcation curves, codimension-two points and regions. Figures 7 and 8 of the paper."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle
from matplotlib.text import Text

from rattle.curves import NAMES, CodimensionTwo, Curve, codimension_two, trace
from rattle.errors import ParameterError, RattleError
from rattle.impacting.orbits.period_one import regions
from rattle.orbits.period_one import REGIONS
from rattle.plot.drawing import HALO, Drawing, new_figure
from rattle.plot.labels import Array, Labels
from rattle.plot.paper_ranges import BETA, FIGURE_5, FIGURE_8, FIGURE_9

Range = tuple[float, float]

#: A colour for each kind of bifurcation, that of flips and the quiet limit's told apart by deuteranopes too.
STYLES = {
    "SN1": ("black", "-"),
    "SN2": ("black", (0, (4, 1.5))),
    "PD1": ("#7b3294", "-"),
    "PDC": ("#7b3294", (0, (4, 1.5))),
    "PD2": ("#7b3294", (0, (5, 1.5, 1, 1.5))),
    "G1": ("#c51b1b", "-"),
    "G2": ("#c51b1b", (0, (4, 1.5))),
    "quiet_limit": ("#1f9bd6", (0, (1, 1))),
}
MARKERS = {"COD20": "o", "COD21": "s", "COD22": "D", "COD23": "^"}
IN_PAPER = ("SN1", "SN2", "PD1", "G1", "G2")

THICK, THIN = 1.5, 0.8
CELLS = 240  # a side, of the grid on which regions are found
LEAST = 20  # cells of a part of a region that gets its number
MARKED: dict[str, Any] = {"color": "0.35", "linestyle": (0, (5, 3)), "linewidth": 1.0}


def polyline(curve: Curve) -> Array:
    """The points (δ, ε) of a curve (k, 2), NaN between pieces."""
    points = np.column_stack([curve.delta, curve.epsilon])
    return np.insert(points, np.flatnonzero(np.diff(curve.piece)) + 1, np.nan, axis=0)


def draw_curve(axes: Axes, curve: Curve, width: float = 1.4, halo: bool = True) -> Array:
    """Draw a bifurcation curve in its style; returns its `polyline`."""
    line = polyline(curve)
    draw_line(axes, curve.name, line, STYLES[curve.name], width, halo)
    return line


def draw_line(
    axes: Axes, name: str, line: Array, style: tuple[str, Any], width: float = 1.4, halo: bool = True
) -> None:
    """Draw a line (k, 2) of this name, NaN between its pieces, in this colour and with these dashes."""
    colour, dashes = style
    axes.plot(
        *line.T,
        color=colour,
        linestyle=dashes,
        linewidth=width,
        label=name.replace("_", " "),
        path_effects=HALO if halo else None,
    )


def draw_points(axes: Axes, points: Sequence[CodimensionTwo], lines: Sequence[Array]) -> Labels | None:
    """Mark and name the codimension-two points that are in the axes, away from these lines and from what is written.

    Returns the labels, for more of them; None if there are no points.
    """
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    points = [point for point in points if left <= point.delta <= right and bottom <= point.epsilon <= top]
    for point in points:
        marker = MARKERS[point.name]
        axes.plot(point.delta, point.epsilon, marker, color="white", markeredgecolor="black", markersize=4.5, zorder=4)
    if not points:
        return None
    labels = Labels(axes, [*lines, *(np.array([[point.delta, point.epsilon]]) for point in points)])
    for point in points:
        labels.add(point.name, (point.delta, point.epsilon))
    return labels


def plane(delta: Range, epsilon: Range, beta: float = BETA) -> Drawing:
    """The two-parameter bifurcation diagram of Figures 7 and 8: curves, points and regions in a window.

    delta, epsilon: (low, high). The curves that the paper has are thick, the others thin. At the paper's β, dashed
    lines show the ranges of its Figures 5 and 9, and a rectangle Figure 8. Raises ParameterError.
    """
    figure = new_figure(6.8, 5.0)
    axes = figure.add_subplot(xlim=delta, ylim=epsilon)
    axes.set_xlabel("damping δ", fontsize=11)
    axes.set_ylabel("eccentricity ε", fontsize=11)
    axes.ticklabel_format(useOffset=False)
    axes.locator_params(nbins=6)
    axes.tick_params(direction="in", top=True, right=True)
    lines, notes = {}, []
    for name in NAMES:
        try:
            with np.errstate(all="ignore"):
                curve = trace(name, beta, delta, epsilon)
        except ParameterError:
            raise
        except RattleError as error:
            notes.append(f"{name} is left out: {error}")
            continue
        if len(curve):
            lines[name] = draw_curve(axes, curve, THICK if name in IN_PAPER else THIN, halo=False)
    axes.set(xlim=delta, ylim=epsilon)
    marks = _paper_marks(axes) if beta == BETA else {}
    if beta != BETA:
        axes.set_title(f"half-backlash β = {beta:g}", fontsize=10)
    labels = draw_points(axes, codimension_two(beta), [*lines.values(), *marks.values()])
    labels = labels or Labels(axes, [*lines.values(), *marks.values()])
    _name_regions(labels, delta, epsilon, beta)
    for name, line in lines.items():
        labels.along(name.replace("_", " "), line, 10 if name in IN_PAPER else 8, STYLES[name][0])
    for name, line in marks.items():
        labels.along(name, line, 7, MARKED["color"])
    figure.set_layout_engine("none")  # labels lie where they were put
    return Drawing(figure, tuple(notes))


def _paper_marks(axes: Axes) -> dict[str, Array]:
    """The ranges of Figures 5 and 9 and the window of Figure 8, where the axes show them at a size that can be seen."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    marks = {}
    for name, (delta, (low, high)) in (("Figure 5", FIGURE_5), ("Figure 9", FIGURE_9)):
        low, high = max(low, bottom), min(high, top)
        if left < delta < right and high - low > (top - bottom) / 20:
            marks[name] = np.array([[delta, low], [delta, high]])
            axes.plot(*marks[name].T, **MARKED, zorder=1)
    (low, high), (floor, ceiling) = FIGURE_8
    if left < low and high < right and bottom < floor and ceiling < top:
        axes.add_patch(Rectangle((low, floor), high - low, ceiling - floor, fill=False, **MARKED, zorder=1))
        marks["Figure 8"] = np.array([[low, floor], [high, floor], [high, ceiling], [low, ceiling], [low, floor]])
    return marks


def _name_regions(labels: Labels, delta: Range, epsilon: Range, beta: float) -> None:
    """Write a region's name into each part of it that has room for it, and beside the largest if none has."""
    from scipy.ndimage import label

    x, y = (low + (high - low) * (np.arange(CELLS) + 0.5) / CELLS for low, high in (delta, epsilon))
    region = regions(x, y[:, None], beta)
    for number, name in enumerate(REGIONS):
        if not name:
            continue
        parts, count = label(region == number)
        sizes = np.bincount(parts.ravel())[1:]
        chosen = [part for part in np.argsort(-sizes) if sizes[part] >= LEAST]
        written = [labels.within(name, parts == part + 1) for part in chosen]
        if count and chosen and not any(written):
            point, _ = labels.widest(parts == chosen[0] + 1)
            Text.set(labels.add(name, point, size=13), weight="bold")
