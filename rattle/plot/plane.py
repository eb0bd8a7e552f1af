"""Draw the (δ, ε) plane with bifurcation curves, codimension-two points and regions: the paper's Figures 7 and 8."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.text import Text

from rattle.curves import NAMES, CodimensionTwo, Curve, codimension_two, trace
from rattle.errors import ParameterError, RattleError
from rattle.impacting.orbits.period_one import regions
from rattle.orbits.orbits_a_to_d import REGIONS
from rattle.plot.drawing import HALO, Drawing, new_figure
from rattle.plot.labels import Array, Labels
from rattle.plot.paper_ranges import BETA, FIGURE_5, FIGURE_8, FIGURE_9

Range = tuple[float, float]
Box = tuple[float, float, float, float]

#: Colour and dashes of each curve; deuteranopes can distinguish flips from the quiet limit.
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
#: Size of a marker, in points.
MARKER_SIZE = 4.5
#: The curves that the paper's figures show.
IN_PAPER = ("SN1", "SN2", "PD1", "G1", "G2")

#: Line widths of the paper's curves and of other curves.
THICK, THIN = 1.5, 0.8
#: Cells along each axis of the grid on which regions are determined.
CELLS = 240
#: A connected part of a region is labelled if it has at least this number of cells.
LEAST_LABELLED_CELLS = 20
#: Width and height of the inset including its tick labels, as shares of the axes.
INSET = 0.42, 0.44
#: Least and largest distance in δ from COD23 at which the inset's curves are drawn, in units of the distance from COD21
#: to COD23.
INSET_NEAREST, INSET_FARTHEST = 0.15, 9.0
#: Number of points of the inset's curves.
INSET_POINTS = 60
#: An inset is drawn only in windows up to this wide along δ, in units of the distance from COD21 to COD23.
WIDEST_WINDOW = 200.0
#: Style of the lines that mark the ranges of the paper's other figures.
MARKED_RANGE: dict[str, Any] = {"color": "0.35", "linestyle": (0, (5, 3)), "linewidth": 1.0}


def polyline(curve: Curve) -> Array:
    """Return the points (δ, ε) of a curve (k, 2), NaN between pieces."""
    points = np.column_stack([curve.delta, curve.epsilon])
    return np.insert(points, np.flatnonzero(np.diff(curve.piece)) + 1, np.nan, axis=0)


def draw_curve(axes: Axes, curve: Curve, width: float = 1.4, halo: bool = True) -> Array:
    """Draw a bifurcation curve in its style, with a white outline if `halo`, and return its `polyline`."""
    line = polyline(curve)
    draw_line(axes, curve.name, line, STYLES[curve.name], width, halo)
    return line


def draw_line(
    axes: Axes, name: str, line: Array, style: tuple[str, Any], width: float = 1.4, halo: bool = True
) -> None:
    """Draw a line (k, 2) whose pieces are separated by NaN, with a white outline if `halo`.

    style: colour and dashes. name: the line's legend entry.
    """
    colour, dashes = style
    axes.plot(
        *line.T,
        color=colour,
        linestyle=dashes,
        linewidth=width,
        label=name.replace("_", " "),
        path_effects=HALO if halo else None,
    )


def mark_codimension_two_points(axes: Axes, points: Sequence[CodimensionTwo], lines: Sequence[Array]) -> Labels | None:
    """Mark and name the codimension-two points that are inside the axes, at places free of `lines` and other texts.

    Returns
    -------
    Labels | None
        The object that places labels in these axes, for further names; None if no point is inside the axes.
    """
    (left, right), (bottom, top) = sorted(axes.get_xlim()), sorted(axes.get_ylim())
    points = [point for point in points if left <= point.delta <= right and bottom <= point.epsilon <= top]
    for point in points:
        marker = MARKERS[point.name]
        axes.plot(
            point.delta, point.epsilon, marker, color="white", markeredgecolor="black", markersize=MARKER_SIZE, zorder=4
        )
    if not points:
        return None
    labels = Labels(axes, [*lines, *(np.array([[point.delta, point.epsilon]]) for point in points)])
    size = MARKER_SIZE + 1  # the line around a marker makes its diameter one point (1/72 inch) larger
    labels.keep_clear_of([(point.delta, point.epsilon) for point in points], size)
    for point in points:
        labels.add(point.name, (point.delta, point.epsilon))
    return labels


def plane_figure(delta: Range, epsilon: Range, beta: float = BETA) -> Drawing:
    """Draw the bifurcation diagram of Figures 7 and 8: curves, codimension-two points and regions in a window.

    Curves that the paper has are thick, other curves thin. At the paper's β dashed lines show the ranges of its Figures
    5 and 9, and a rectangle shows the window of Figure 8. If COD21 and COD23 are well inside the window and at least
    1/200 of its width apart in δ, an inset in a free corner shows the distances of PD1 and G1 from SN2.

    Parameters
    ----------
    delta, epsilon : Range
        The window, (low, high) each.
    beta : float
        The half-backlash.

    Returns
    -------
    Drawing
        The figure, and notes on curves that are left out.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    figure = new_figure(6.8, 5.2)
    axes = figure.add_subplot(xlim=delta, ylim=epsilon)
    axes.set_xlabel("damping δ", fontsize=11)
    axes.set_ylabel("eccentricity ε", fontsize=11)
    axes.ticklabel_format(useOffset=False)
    axes.locator_params(nbins=6)
    axes.tick_params(direction="in", top=True, right=True, pad=6)
    curves, lines, notes = {}, {}, []
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
            curves[name] = curve
            lines[name] = draw_curve(axes, curve, THICK if name in IN_PAPER else THIN, halo=False)
    axes.set(xlim=delta, ylim=epsilon)
    marks = _mark_ranges_of_paper_figures(axes) if beta == BETA else {}
    axes.set_title(f"half-backlash β = {beta:g}", fontsize=10)
    _add_line_width_legend(axes, lines)
    points = codimension_two(beta)
    covered = _draw_inset(axes, curves, lines, {point.name: point for point in points})
    taken = [*lines.values(), *marks.values(), *([] if covered is None else _lines_that_fill_box(covered))]
    labels = mark_codimension_two_points(axes, points, taken) or Labels(axes, taken)
    _write_region_names(labels, delta, epsilon, beta, covered)
    for name, line in lines.items():
        labels.add_along_line(name.replace("_", " "), line, 10 if name in IN_PAPER else 8, STYLES[name][0])
    for name, line in marks.items():
        labels.add_along_line(name, line, 7, MARKED_RANGE["color"])
    figure.set_layout_engine("none")  # a later layout would move the axes, but not the labels that are placed
    return Drawing(figure, tuple(notes))


def _add_line_width_legend(axes: Axes, lines: Mapping[str, Array]) -> None:
    """Add a legend below the axes for thick lines (curves of the paper) and thin lines (others), if both are drawn."""
    widths = ((True, THICK, "curves of the paper"), (False, THIN, "other curves"))
    entries = [
        Line2D([], [], color="0.2", lw=width, label=text)
        for of_paper, width, text in widths
        if any((name in IN_PAPER) is of_paper for name in lines)
    ]
    if len(entries) > 1:
        axes.legend(handles=entries, loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=2, fontsize=8, frameon=False)


def _draw_inset(
    axes: Axes, curves: Mapping[str, Curve], lines: Mapping[str, Array], points: Mapping[str, CodimensionTwo]
) -> Box | None:
    """Draw the distances in ε of PD1 and G1 from SN2 as an inset, in a corner of the axes that has no curves.

    The inset shows these distances at δ below COD23, where SN2, PD1 and G1 meet.

    Returns
    -------
    Box | None
        The box of the inset in data coordinates, or None if no inset is drawn. An inset needs the curves SN2, PD1 and
        G1, the points COD21 and COD23, and a free corner. The window must contain COD23 and the δ range of the inset,
        and its width along δ must be at most WIDEST_WINDOW times the distance from COD21 to COD23.
    """
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    if not {"COD21", "COD23"} <= set(points) or not {"SN2", "PD1", "G1"} <= set(curves):
        return None
    first, last = points["COD21"], points["COD23"]
    apart = last.delta - first.delta
    begin = last.delta - INSET_FARTHEST * apart
    if (
        not (left <= begin < last.delta <= right and bottom <= last.epsilon <= top)
        or apart < (right - left) / WIDEST_WINDOW
    ):
        return None
    drawn = np.concatenate([line[~np.isnan(line[:, 0])] for line in lines.values()])
    share = (drawn - [left, bottom]) / [right - left, top - bottom]
    width, height = INSET
    corners = [(x, y) for x in (1.0 - width, 0.0) for y in (0.0, 1.0 - height)]
    free = [
        (x, y)
        for x, y in corners
        if not np.any((share[:, 0] > x) & (share[:, 0] < x + width) & (share[:, 1] > y) & (share[:, 1] < y + height))
    ]
    if not free:
        return None
    x, y = free[0]
    inset = axes.inset_axes((x + 0.3 * width, y + 0.24 * height, 0.64 * width, 0.62 * height))
    delta = last.delta - np.geomspace(INSET_NEAREST, INSET_FARTHEST, INSET_POINTS) * apart
    base = np.array([curves["SN2"].at(each)[0] for each in delta])
    for name in ("PD1", "G1"):
        above = np.array([curves[name].at(each)[0] for each in delta]) - base
        inset.plot(delta, above, color=STYLES[name][0], linewidth=THICK, label=name)
        inset.annotate(
            name, (delta[-5], above[-5]), (0, 2), textcoords="offset points", fontsize=8, color=STYLES[name][0]
        )
    meets = float(curves["SN2"].at(first.delta)[0])
    inset.plot(first.delta, first.epsilon - meets, MARKERS["COD21"], color="white", mec="black", ms=4.5)
    inset.annotate("COD21", (first.delta, first.epsilon - meets), (-18, 12), textcoords="offset points", fontsize=7)
    inset.axvline(last.delta, color="0.5", linewidth=THIN, linestyle=":")
    inset.annotate(
        "COD23",
        (last.delta, 0.5),
        (3, 0),
        ("data", "axes fraction"),
        "offset points",
        rotation=90,
        va="center",
        fontsize=7,
    )
    inset.set(yscale="log", xlim=(begin, last.delta + 1.2 * apart))
    inset.set_ylim(top=10.0 * inset.get_ylim()[1])
    inset.set_title("ε above SN2", fontsize=8, pad=3)
    inset.locator_params(axis="x", nbins=3)
    inset.tick_params(labelsize=7)
    across, up = right - left, top - bottom
    return left + x * across, left + (x + width) * across, bottom + y * up, bottom + (y + height) * up


def _lines_that_fill_box(box: Box) -> list[Array]:
    """Return lines that fill a box. Labels keep clear of lines, and so of the box."""
    left, right, bottom, top = box
    return [np.array([[left, height], [right, height]]) for height in np.linspace(bottom, top, 24)]


def _mark_ranges_of_paper_figures(axes: Axes) -> dict[str, Array]:
    """Mark the ranges of Figures 5, 8 and 9 that are visible in the axes, and return their lines."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    marks = {}
    for name, (delta, (low, high)) in (("Figure 5", FIGURE_5), ("Figure 9", FIGURE_9)):
        low, high = max(low, bottom), min(high, top)
        if left < delta < right and high - low > (top - bottom) / 20:
            marks[name] = np.array([[delta, low], [delta, high]])
            axes.plot(*marks[name].T, **MARKED_RANGE, zorder=1)
    (low, high), (floor, ceiling) = FIGURE_8
    if left < low and high < right and bottom < floor and ceiling < top:
        axes.add_patch(Rectangle((low, floor), high - low, ceiling - floor, fill=False, **MARKED_RANGE, zorder=1))
        marks["Figure 8"] = np.array([[low, floor], [high, floor], [high, ceiling], [low, ceiling], [low, floor]])
    return marks


def _write_region_names(labels: Labels, delta: Range, epsilon: Range, beta: float, covered: Box | None) -> None:
    """Write the name of each region into its parts that have room for it; if no part has, beside the largest part.

    covered: a box in which no names are written, or None.
    """
    from scipy.ndimage import label

    x, y = (low + (high - low) * (np.arange(CELLS) + 0.5) / CELLS for low, high in (delta, epsilon))
    region = regions(x, y[:, None], beta)
    if covered is not None:
        left, right, bottom, top = covered
        region = np.where((x > left) & (x < right) & (y[:, None] > bottom) & (y[:, None] < top), 0, region)
    for number, name in enumerate(REGIONS):
        if not name:
            continue
        parts, count = label(region == number)
        sizes = np.bincount(parts.ravel())[1:]
        chosen = [part for part in np.argsort(-sizes) if sizes[part] >= LEAST_LABELLED_CELLS]
        written = [labels.add_name_within(name, parts == part + 1) for part in chosen]
        if count and chosen and not any(written):
            point, _ = labels.widest_free_position(parts == chosen[0] + 1)
            Text.set(labels.add(name, point, size=13), weight="bold")
