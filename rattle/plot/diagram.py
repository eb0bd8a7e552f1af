"""Draw bifurcation diagrams: impact speed and phase against the parameter, as in the paper's Figures 5 and 9."""

from collections.abc import Iterator
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from numpy.typing import NDArray

from rattle.attractors.table import KINDS, AttractorTable
from rattle.continuation.bifurcation_diagram import Diagram
from rattle.continuation.conditions import EventKind
from rattle.continuation.followed import FollowedBranch
from rattle.continuation.motions import ParameterSegment
from rattle.continuation.sweeps import SweepPoints
from rattle.errors import require
from rattle.flight.law import wrap_phase_difference
from rattle.impacting.bifurcations.diagram import diagram
from rattle.models import ADDED
from rattle.numerics.complex_step import Array
from rattle.plot import paper_ranges as ranges
from rattle.plot.colours import legend_name as name_of_type
from rattle.plot.drawing import Drawing, new_figure
from rattle.plot.labels import Labels
from rattle.stiff.bifurcations.diagram import diagram as stiff_diagram

FORWARD, BACKWARD = "#8fc7ee", "#e8862e"
MARKS = {EventKind.SADDLE_NODE: "o", EventKind.FLIP: "D", EventKind.GRAZING: "s"}
MEANINGS = {EventKind.SADDLE_NODE: "SN: saddle-node", EventKind.FLIP: "PD: flip", EventKind.GRAZING: "G: graze"}
STYLES = {True: "-", False: (0, (4.0, 2.0))}
#: Line width and colour: NAMED for the branches of A to D, OTHER[True] for stable parts of other branches and
#: OTHER[False] for their unstable parts.
NAMED, OTHER = (1.3, "black"), {True: (0.8, "#333333"), False: (0.5, "#777777")}
Limits = tuple[float, float] | None
ALL_PHASES = (0.0, 1.0)
#: A note about omitted branches names at most this many of them.
NAMED_LEFT_OUT = 4
#: MARGIN: margin of the v axis above and below a branch, as a share of the branch's range of v. The margin is at least
#: LEAST_MARGIN, in units of v.
MARGIN, LEAST_MARGIN = 0.1, 0.01
#: SIZE: font size of labels in points (1/72 inch). ANCHORS: least number of a curve's visible points at which its name
#: is tried; if fewer are visible, the name is tried at all of them.
SIZE, ANCHORS = 10, 40
#: Number of steps of each sweep for the impacting gear and for the stiff gear.
STEPS, STIFF_STEPS = 500, 250
#: {(δ, range of ε, β) of the paper's Figure 5 or 9: (steps of the sweeps, limits of v, limits of τ)}.
WINDOWS: dict[tuple[float, tuple[float, float], float], tuple[int, Limits, Limits]] = {
    (*ranges.FIGURE_5, ranges.BETA): (1000, (3.7, 4.9), (0.4, 1.0)),
    (*ranges.FIGURE_9, ranges.BETA): (500, (4.74, 4.94), (0.69, 0.77)),
}


class ImpactCurve(NamedTuple):
    """One impact on Σ⁺ along a branch.

    x, v, tau: the value on the parameter axis, the impact speed and the phase, at the points of the branch and at the
    events between these points. stable, admissible: flags of the piece between a point and the next point. name: the
    name A to D of the motion on this piece, or "" for other motions.
    """

    x: Array
    v: Array
    tau: Array
    stable: NDArray[np.bool_]
    admissible: NDArray[np.bool_]
    name: tuple[str, ...]


def diagram_figure(diagram: Diagram[Any, Any], v: Limits = None, tau: Limits = ALL_PHASES) -> Figure:
    """Draw a bifurcation diagram: (a) v and (b) τ against the parameter.

    Stable branches are solid, unstable branches are dashed, virtual parts are not drawn. Saddle-nodes, flips and grazes
    have marks.

    Parameters
    ----------
    v, tau : Limits
        Limits (low, high) of the panels; None: v from 0 to above all speeds, τ from 0 to 1.

    Returns
    -------
    Figure
        A matplotlib figure with two panels.
    """
    require(isinstance(diagram, Diagram), f"diagram must be a Diagram, got {type(diagram).__name__}")
    return _draw_diagram(diagram, v, tau or ALL_PHASES)


def _draw_diagram(diagram: Diagram[Any, Any], v: Limits, tau: tuple[float, float], margin: float = 0.0) -> Figure:
    """Return the figure of a diagram. margin: margin at both ends of the parameter axis, as a share of its range."""
    figure = new_figure(7.2, 7.9)
    upper, lower = figure.subplots(2, 1, sharex=True)
    axis, scale, offset = parameter_axis(diagram)
    curves = [(branch, list(impact_curves_along_branch(diagram, branch, scale, offset))) for branch in diagram.branches]
    for panel, which, limits, label in ((upper, "v", v, "impact speed $v$"), (lower, "tau", tau, "impact phase $τ$")):
        _draw_sweep_points(panel, diagram, which, offset + scale * diagram.points.position)
        for branch, parts in curves:
            for curve in parts:
                _draw_impact_curve(panel, curve, getattr(curve, which), branch.label[:2] == (1, 1))
        panel.set_ylabel(label)
        panel.set_xlim(*sorted((offset - margin * scale, offset + (1.0 + margin) * scale)))
        panel.set_ylim(*(limits or _speed_axis_limits(diagram)))
        panel.tick_params(direction="in", top=True, right=True)
    upper.set_title(_fixed_parameters(diagram), fontsize=10)
    lower.set_xlabel(axis)
    lower.locator_params(axis="x", nbins=6)
    _add_diagram_legend(figure, has_sweeps=diagram.points.step.size > 0)
    for letter, panel, which in (("(a)", upper, "v"), ("(b)", lower, "tau")):
        panel.annotate(letter, (0.0, 1.0), (6, -6), "axes fraction", "offset points", va="top", fontsize=10)
        lines = [
            line
            for _, parts in curves
            for curve in parts
            for line in _visible_lines(panel, curve, getattr(curve, which))
        ]
        labels = Labels(panel, lines)
        _mark_events(panel, labels, diagram, which, scale, offset)
        _write_orbit_names(panel, labels, curves, which, has_common_curve=which == "v" and not diagram.added)
    figure.set_layout_engine("none")  # a further layout would move the axes away from labels already placed
    return figure


def branch_figure(branch: Any) -> Figure:
    """Return the figure of one branch: a diagram along its parameters, without attractors. Raises ParameterError."""
    require(isinstance(branch, FollowedBranch), f"branch must be a Branch, got {type(branch).__name__}")
    found: Any = branch
    at = found.parameters
    way = at[np.argmax(np.abs(at - at[0]).sum(axis=1))] - at[0]
    require(
        bool(way.any()),
        "all points of the branch have the same parameters, so it cannot be drawn: follow it over a larger span",
    )
    way = way * np.sign(way[np.argmax(np.abs(way))])
    first, last = np.argmin(at @ way), np.argmax(at @ way)
    ends = [first, last]
    alone = Diagram(
        ParameterSegment(at[first], at[last]),
        found.itinerary.beta,
        np.array([0.0, 1.0]),
        found.delta[ends],
        found.epsilon[ends],
        {name: values[ends] for name, values in found.added.items()},
        (found,),
        tuple(event for event in found.events if event.admissible),
        SweepPoints._make([np.empty(0)] * len(SweepPoints._fields)),
        AttractorTable.empty(),
        (),
        (),
    )
    speeds = found.speeds[found.admissible][:, np.array(found.itinerary.walls) > 0]
    margin = max(MARGIN * float(np.ptp(speeds)), LEAST_MARGIN) if speeds.size else 1.0
    v = (float(speeds.min()) - margin, float(speeds.max()) + margin) if speeds.size else None
    return _draw_diagram(alone, v, ALL_PHASES, MARGIN / 2)


def draw_along_epsilon(delta: float, epsilon: tuple[float, float], beta: float = ranges.BETA) -> Drawing:
    """Draw Figure 5 or 9 of the paper: the bifurcation diagram along ε at one damping.

    With the parameters of a paper's figure the axes have the limits of that figure.

    Returns
    -------
    Drawing
        The figure, and notes on parts that are left out or differ from the request.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    steps, *limits = WINDOWS.get((delta, epsilon, beta), (STEPS, None, ALL_PHASES))
    found = diagram((delta, epsilon[0]), (delta, epsilon[1]), beta, steps)
    return Drawing(diagram_figure(found, *limits), _note_on_omitted_branches(found))


def draw_stiff_along_epsilon(delta: float, epsilon: tuple[float, float], beta: float, kappa: float) -> Drawing:
    """Draw the stiff gear's diagram along ε, with the axes limits of `draw_along_epsilon`. Raises ParameterError."""
    _steps, *limits = WINDOWS.get((delta, epsilon, beta), (STEPS, None, ALL_PHASES))
    found = stiff_diagram((delta, epsilon[0]), (delta, epsilon[1]), beta, kappa, STIFF_STEPS)
    return Drawing(diagram_figure(found, *limits), _note_on_omitted_branches(found))


def _note_on_omitted_branches(diagram: Diagram[Any, Any]) -> tuple[str, ...]:
    """Return a note that names the branches that the diagram leaves out, or no note if it leaves out none."""
    if not diagram.left_out:
        return ()
    some, more = diagram.left_out[:NAMED_LEFT_OUT], len(diagram.left_out) - NAMED_LEFT_OUT
    names = ", ".join(map(name_of_type, some)) + (f" and {more} more" if more > 0 else "")
    return (f"{len(diagram.left_out)} branches left out, which are too long or too many: {names}",)


def _fixed_parameters(diagram: Diagram[Any, Any]) -> str:
    """Return the parameters that do not change along a diagram, as text."""
    added = {ADDED[name].symbol: values for name, values in diagram.added.items()}
    names = {"δ": diagram.delta, "ε": diagram.epsilon, "β": np.array([diagram.beta]), **added}
    return ", ".join(f"{name} = {values[0]:g}" for name, values in names.items() if values[0] == values[-1])


def parameter_axis(diagram: Diagram[Any, Any]) -> tuple[str, float, float]:
    """Return the parameter axis of a diagram.

    Returns
    -------
    tuple[str, float, float]
        The axis label, and a scale and an offset: the value on the axis is offset + scale · position, where the
        position runs from 0 to 1 along the diagram.
    """
    (delta, epsilon), (last_delta, last_epsilon) = diagram.start, diagram.end
    rest, changing = f"β = {diagram.beta:g}", []
    for name, values in diagram.added.items():
        added, first, last = ADDED[name], *values[[0, -1]]
        rest += f", {added.symbol} = {first:g}" if first == last else f", {added.symbol} {first:g} to {last:g}"
        if first != last:
            changing.append((added, first**added.path_power, last**added.path_power))
    if (delta, epsilon) == (last_delta, last_epsilon):
        added, start, end = changing[0]
        power = f"^{{{Fraction(added.path_power)}}}" if added.path_power != 1.0 else ""
        label = f"{added.path_label or added.label} ${added.symbol}{power}$"
        return f"{label} (δ = {delta:g}, ε = {epsilon:g}, {rest})", end - start, start
    if not changing and delta == last_delta:
        return f"eccentricity $ε$ (δ = {delta:g}, {rest})", last_epsilon - epsilon, epsilon
    if not changing and epsilon == last_epsilon:
        return f"damping $δ$ (ε = {epsilon:g}, {rest})", last_delta - delta, delta
    return f"way from (δ, ε) = ({delta:g}, {epsilon:g}) to ({last_delta:g}, {last_epsilon:g}), {rest}", 1.0, 0.0


def impacts_at_event(event: Any) -> tuple[Array, Array]:
    """Return the phases and the speeds (n,) of the impacts on Σ⁺ of the motion at an event (a bifurcation)."""
    orbit = event.orbit
    upper = np.array(orbit.walls) > 0
    return orbit.departures[upper] % 1.0, orbit.speeds[upper]


def impact_curves_along_branch(
    diagram: Diagram[Any, Any], branch: Any, scale: float, offset: float
) -> Iterator[ImpactCurve]:
    """Yield for each impact on Σ⁺ its curve along a branch. scale, offset: results of `parameter_axis`."""
    x, name = offset + scale * diagram.positions(branch), branch.names
    for impact in np.flatnonzero(np.array(branch.itinerary.walls) > 0):
        tau, v = branch.departures[:, impact] % 1.0, branch.speeds[:, impact]
        rows = []
        for i in range(len(branch)):
            rows.append((x[i], v[i], tau[i], branch.stable[i], branch.admissible[i], name[i]))
            for event in branch.events:
                if event.after == i and i + 1 < len(branch) and event.admissible:
                    at = offset + scale * float(diagram.positions(event))
                    there = impacts_at_event(event)
                    off = np.abs(wrap_phase_difference(there[0] - tau[i])) + np.abs(there[1] - v[i])
                    state = there[1][np.argmin(off)], there[0][np.argmin(off)]
                    rows.append((at, *state, branch.stable[i + 1], branch.admissible[i + 1], name[i + 1]))
        columns = list(zip(*rows, strict=True))
        where, v, tau, stable, admissible = (np.array(column) for column in columns[:5])
        yield ImpactCurve(where, v, tau, stable, admissible, columns[5])


def admissible_curve_parts(curve: ImpactCurve) -> Iterator[tuple[bool, slice]]:
    """Yield the admissible parts of a curve, cut where the stability changes or τ jumps by 1.

    Yields
    ------
    tuple[bool, slice]
        Whether the part is stable, and its points.
    """
    parts = zip(curve.admissible[:-1], curve.stable[:-1], np.abs(np.diff(curve.tau)) > 0.5, strict=True)
    kinds = [None if jumps or not is_admissible else bool(stable) for is_admissible, stable, jumps in parts]
    first = 0
    while first < len(kinds):
        last = first
        while last < len(kinds) and kinds[last] is kinds[first]:
            last += 1
        kind = kinds[first]
        if kind is not None:
            yield kind, slice(first, last + 1)
        first = last


def _draw_impact_curve(panel: Axes, curve: ImpactCurve, y: Array, named: bool) -> None:
    """Draw the admissible parts of a curve. y: v or τ of its points. named: whether to use the style of A to D."""
    for stable, part in admissible_curve_parts(curve):
        width, colour = NAMED if named else OTHER[stable]
        panel.plot(curve.x[part], y[part], color=colour, lw=width, ls=STYLES[stable], zorder=3)


def _draw_sweep_points(panel: Axes, diagram: Diagram[Any, Any], which: str, x: Array) -> None:
    """Draw the attractors of the forward sweep and, on top of them as smaller points, those of the backward sweep.

    which: "v" or "tau", the quantity of the panel. x: the values of the points on the parameter axis.
    """
    points = diagram.points
    y, chaotic = getattr(points, which), points.kind == KINDS.index("chaotic")
    for forward, colour, size in ((True, FORWARD, 2.4), (False, BACKWARD, 1.0)):
        for on, factor in ((~chaotic, 2.0), (chaotic, 0.35)):
            at = on & (points.forward == forward)
            panel.scatter(x[at], y[at], s=size * factor, c=colour, lw=0, rasterized=True, zorder=2)


def _mark_events(
    panel: Axes, labels: Labels, diagram: Diagram[Any, Any], which: str, scale: float, offset: float
) -> None:
    """Mark the events of a diagram in the panel of `which`, "v" or "tau".

    Events on a named bifurcation curve have larger marks and the curve's name. scale, offset: from `parameter_axis`.
    """
    for event in diagram.events:
        phases, speeds = impacts_at_event(event)
        y = speeds if which == "v" else phases
        x = np.full(y.size, offset + scale * float(diagram.positions(event)))
        name = diagram.curve_of(event)
        size, face = (26.0, "black") if name else (5.0, "white")
        panel.scatter(x, y, s=size, marker=MARKS[event.kind], c=face, ec="black", lw=0.5, zorder=5 if name else 4)
        if name:
            seen = _flag_visible_points(panel, x, y)
            if seen.any():
                labels.add(name, (float(x[seen][0]), float(y[seen][0])), size=SIZE)


def _write_orbit_names(
    panel: Axes, labels: Labels, curves: list[tuple[Any, list[ImpactCurve]]], which: str, *, has_common_curve: bool
) -> None:
    """Write the names A to D beside their curves in the panel of `which`, "v" or "tau".

    has_common_curve: whether A and C have the same curve in this panel. Then the curve gets the name "A, C".
    """
    places: dict[str, list[tuple[float, float]]] = {}
    for _, parts in curves:
        for curve in parts:
            y = getattr(curve, which)
            for name in sorted(set(curve.name) - {""}):
                on = np.flatnonzero(
                    _flag_visible_points(panel, curve.x, y) & curve.admissible & (np.array(curve.name) == name)
                )
                on = on[:: max(1, on.size // ANCHORS)]
                places.setdefault(name, []).extend(zip(curve.x[on].tolist(), y[on].tolist(), strict=True))
    if has_common_curve and {"A", "C"} <= set(places):
        places["A, C"] = places.pop("C")
        del places["A"]
    for name, points in places.items():
        if points:
            Text.set(labels.add(name, *points, size=SIZE), style="italic")


def _flag_visible_points(panel: Axes, x: Array, y: Array) -> NDArray[np.bool_]:
    """Return flags of points inside the limits of the panel."""
    (left, right), (low, high) = panel.get_xlim(), panel.get_ylim()
    return np.asarray((x >= left) & (x <= right) & (y >= low) & (y <= high))


def _visible_lines(panel: Axes, curve: ImpactCurve, y: Array) -> list[Array]:
    """Return the admissible parts of a curve inside the panel as one line, in a list; [] if there are no such parts.

    y: v or τ of the points of the curve.

    Returns
    -------
    list[Array]
        At most one line (k, 2), with NaN between its parts.
    """
    on = _flag_visible_points(panel, curve.x, y) & curve.admissible
    return [np.column_stack([curve.x, np.where(on, y, np.nan)])] if on.any() else []


def _speed_axis_limits(diagram: Diagram[Any, Any]) -> tuple[float, float]:
    """Return limits of v from 0 to above all speeds of a diagram."""
    speeds = [diagram.points.v, *(branch.speeds[branch.admissible].ravel() for branch in diagram.branches)]
    top = max((float(each.max()) for each in speeds if each.size), default=1.0)
    return 0.0, 1.05 * top


def _add_diagram_legend(figure: Figure, has_sweeps: bool) -> None:
    """Add the legend of lines and marks. has_sweeps: whether the diagram also has points of attractors to explain."""
    (width, colour), (thin, dark), (thinnest, grey) = NAMED, OTHER[True], OTHER[False]
    entries = [
        Line2D([], [], color=colour, lw=width, label="A to D, stable"),
        Line2D([], [], color=colour, lw=width, ls=STYLES[False], label="A to D, unstable"),
        Line2D([], [], color=dark, lw=thin, label="other motions, stable"),
        Line2D([], [], color=grey, lw=thinnest, ls=STYLES[False], label="other motions, unstable"),
    ]
    entries += [
        Line2D([], [], ls="", marker=mark, color="black", ms=4.5, label=MEANINGS[kind]) for kind, mark in MARKS.items()
    ]
    entries.append(
        Line2D([], [], ls="", marker="o", mfc="white", mec="black", mew=0.5, ms=3, label="white: on no named curve")
    )
    if has_sweeps:
        sweeps = (FORWARD, 6, "attractors, followed forward"), (BACKWARD, 4, "followed backward")
        entries += [Line2D([], [], ls="", marker="o", color=ink, ms=size, label=name) for ink, size, name in sweeps]
    figure.legend(handles=entries, loc="outside upper center", ncols=3, frameon=False, fontsize=8)
