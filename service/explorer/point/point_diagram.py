"""Draw the one-parameter diagram through a point, and list its events."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import panel as pn
from bokeh.models import ColumnDataSource, HoverTool, Range1d
from bokeh.models.annotations import Span

from gear_rattle.service.explorer.common.address import Pair
from gear_rattle.service.explorer.common.changes import handler_in_event_loop
from gear_rattle.service.explorer.common.figures import LEFT_BORDER, foreground_colour, themed_figure
from gear_rattle.service.explorer.common.glyphs import remove_rows
from gear_rattle.service.explorer.common.watch import WidgetWatcher
from gear_rattle.service.explorer.files import read_asset
from gear_rattle.service.explorer.point.parts import DiagramContents, EventImpacts
from gear_rattle.service.explorer.point.words import (
    ChaosEvent,
    count_in_words,
    folded_html_table,
    multipliers_text,
    number_text,
)

MARKERS = {"SN": "circle", "PD": "diamond", "GR": "square"}
SIGNS = {"SN": "●", "PD": "◆", "GR": "■"}
EVENT_COLOUR, MOST_LISTED = "#f2c14e", 4  # colour of events; largest number of events that a tooltip lists
POSITION_COLOUR = "#d7191c"
MEANINGS = {"SN": "saddle-node", "PD": "period doubling", "GR": "grazing"}
LEAST_INFINITE = 1e12  # multipliers larger than this are written as ∞; they occur at grazes
NAMES = {"epsilon": "eccentricity ε", "delta": "damping δ"}
# colours of the states that upward and downward sweeps found
UPWARD, DOWNWARD = {"light": "#4a90d9", "dark": "#7fb3e0"}, "#e8862e"
# diameters in pixels of dots of upward and downward sweeps: where both sweeps find a state, both dots are visible
DOT_SIZES = 3.6, 1.8
SPEED_MARGIN = 0.04  # margin above and below the speeds, relative to their range
DENSE, ALL = "dense", "all"  # choices of a viewer: the axis shows the dense range of speeds, or all speeds
DENSE_EXCESS = 0.5  # a range of speeds is dense if its excess mass is larger than this, see `dense_speed_range`
ROUNDING_STEPS = 1e-7, 1e-3  # parameter and speed of states are rounded to these steps; equal states count once
# pixels: height of the figure, height of its speed axis, width that is assumed until a browser sends the true width
HEIGHT, INNER, NARROW = 360, 270, 300
# names of events: number of rows above the data; height of a row and width of a letter, in pixels; most names shown
NAME_ROWS, ROW, LETTER, MOST_NAMES = 4, 15, 6.2, 12


class DiagramPicture:
    """Picture of a diagram: impact speed against the parameter.

    Stable motions are solid lines, unstable motions dashed lines, states of sweeps dots. Events are marked.
    """

    def __init__(self, theme: str, x_range: Range1d | None = None) -> None:
        axis = x_range or (0.0, 1.0)
        name, speeds = NAMES["epsilon"], (0.0, 7.0)
        self.figure: Any = themed_figure("diagram", theme, name, "impact speed v", HEIGHT, axis, speeds)
        self.figure.min_border_left = LEFT_BORDER
        ink = foreground_colour(theme)
        self._seen = {}
        for upward, shade, size in zip((True, False), (UPWARD[theme], DOWNWARD), DOT_SIZES, strict=True):
            self._seen[upward] = ColumnDataSource({"x": [], "v": []})
            self.figure.scatter("x", "v", source=self._seen[upward], size=size, color=shade, alpha=0.8)
        self._strokes = ColumnDataSource({"x": [], "v": [], "motion": [], "stable": [], "dash": [], "width": []})
        drawn = self.figure.multi_line(
            "x", "v", source=self._strokes, line_color=ink, line_dash="dash", line_width="width"
        )
        self._names = ColumnDataSource({"x": [], "v": [], "top": [], "name": [], "align": [], "aside": []})
        self.figure.segment(
            "x", "v", "x", "top", source=self._names, line_color=ink, line_alpha=0.45, line_dash="dotted"
        )
        self.figure.text(
            "x", "top", "name", source=self._names, text_color=ink, text_font_size="11px", text_align="align",
            x_offset="aside", text_baseline="middle",
        )  # fmt: skip
        self._marks = ColumnDataSource({"x": [], "v": [], "tau": [], "what": [], "marker": [], "size": []})
        marked = self.figure.scatter(
            "x", "v", source=self._marks, marker="marker", size="size", line_color="#000000", fill_color=EVENT_COLOUR
        )
        # Motions have their tooltip on the left and events on the right, so that neither covers the other.
        of_motions = [("motion", "@motion"), ("", "@stable"), ("at", "$x{%.6g}"), ("v", "$y{%.4g}")]
        of_events = [("event", "@what"), ("at", "@x{%.7g}"), ("v", "@v{%.5g}"), ("τ", "@tau{%.4f}")]
        for what, tooltips, side, limit in ((drawn, of_motions, "left", 1), (marked, of_events, "right", MOST_LISTED)):
            formatters: Any = {text.split("{")[0]: "printf" for _, text in tooltips if "{" in text}
            place: Any = {"attachment": side, "limit": limit}
            hover = HoverTool(renderers=[what], tooltips=tooltips, formatters=formatters, **place)
            self.figure.add_tools(hover)
        self._here = Span(location=0.0, dimension="height", line_color=POSITION_COLOUR, line_width=1.5, line_alpha=0.8)
        self.figure.add_layout(self._here)
        self.speeds = pn.widgets.RadioButtonGroup(
            label="Speeds of the diagram", options={"Dense speeds": DENSE, "All speeds": ALL}, visible=False,
            color="primary", variant="outline", stylesheets=[read_asset("widgets.css")],
        )  # fmt: skip
        WidgetWatcher().call_on_change(self.speeds, self._fit_speed_axis)
        self._found: DiagramContents | None = None
        self._across: float = NARROW
        self.figure.on_change("inner_width", handler_in_event_loop(self._on_width))  # a browser sets this width

    def clear(self) -> None:
        """Remove all lines, dots and events from the picture."""
        self._found = None
        self.speeds.visible = False
        for source in (*self._seen.values(), self._strokes, self._marks, self._names):
            remove_rows(source)

    def show(self, found: DiagramContents, at: float) -> None:
        """Draw a diagram, and mark the point whose basins and motion are shown. at: its value on the parameter axis."""
        self._found = found
        self.figure.x_range.update(start=found.span[0], end=found.span[1])
        self.figure.xaxis.axis_label = diagram_axis_name(found)
        self._fit_speed_axis()
        self.mark_position(at)
        for upward, source in self._seen.items():
            which = found.upward == upward
            source.data = {"x": found.x[which], "v": found.v[which]}
        # stable branches are drawn last, over unstable ones
        strokes = sorted(found.branch_parts, key=lambda each: each.stable)
        self._strokes.data = {
            "x": [each.x for each in strokes],
            "v": [each.v for each in strokes],
            "motion": [each.motion for each in strokes],
            "width": [1.6 if each.motion.startswith("P(1,1,") else 0.8 for each in strokes],
            "stable": ["stable" if each.stable else "unstable" for each in strokes],
            "dash": ["solid" if each.stable else "dashed" for each in strokes],
        }
        marks = found.event_impacts
        self._marks.data = {
            "x": marks.x,
            "v": marks.v,
            "tau": marks.tau,
            "marker": [MARKERS[kind] for kind in marks.kind],
            "size": [9 if name else 5 for name in marks.name],
            "what": [_event_in_words(marks, i) for i in range(len(marks.kind))],
        }

    def _on_width(self, _attribute: str, _old: object, new: Any) -> None:
        self._across = float(new)
        self._fit_speed_axis()

    def _fit_speed_axis(self) -> None:
        """Fit the speed axis to `dense_speed_range` or to all speeds, as the viewer chose, and make room for names."""
        found = self._found
        if found is None:
            return
        dense = dense_speed_range(found)
        self.speeds.visible = dense is not None
        low, high = speed_range(found) if dense is None or self.speeds.value == ALL else dense
        names = place_event_names(found, self._across, (low, high))
        rows = 1 + max((each.row for each in names), default=-1)
        unit = (high - low) / (INNER - rows * ROW)  # height of a pixel, as a difference of speed
        self.figure.y_range.update(start=low, end=high + rows * ROW * unit)
        self._names.data = {
            "x": [each.x for each in names],
            "v": [each.v for each in names],
            "top": [high + (each.row + 0.5) * ROW * unit for each in names],
            "name": [each.text for each in names],
            "align": [each.align for each in names],
            "aside": [3 if each.align == "left" else -3 for each in names],
        }

    def mark_position(self, at: float) -> None:
        """Mark the point whose basins and motion are shown. at: the point's value on the parameter axis."""
        self._here.location = at


class PlacedEventName(NamedTuple):
    """Name of an event, as text in one of the rows above the data, with a line down to the event.

    x, v: parameter and impact speed of the event. row: number of the row, 0 for the lowest. align: "left" if the text
    begins at the line, "right" if it ends there.
    """

    x: float
    v: float
    text: str
    row: int
    align: str
    left: float  # where the text begins, in pixels from the left edge of the picture
    line_x: float  # where the event is, in pixels from the left edge of the picture
    right: float  # where the text ends, in pixels from the left edge of the picture

    def collides_with(self, other: PlacedEventName) -> bool:
        """Return whether the texts of two event names overlap, or the line of one name crosses the other's text."""
        if self.row == other.row:
            return self.left < other.right and other.left < self.right
        upper, lower = (self, other) if self.row > other.row else (other, self)
        return lower.left <= upper.line_x <= lower.right


def speed_range(found: DiagramContents) -> Pair:
    """Return the range of all speeds in a diagram, with a margin at both ends."""
    speeds = [each for each in (found.v, found.event_impacts.v, *(one.v for one in found.branch_parts)) if each.size]
    if not speeds:
        return 0.0, 7.0
    return _add_margin(min(float(each.min()) for each in speeds), max(float(each.max()) for each in speeds))


def dense_speed_range(found: DiagramContents) -> Pair | None:
    """Return the range of speeds in which the states of attractors are dense, with a margin; None if there is none.

    States are dense where a chaotic attractor or a cascade of period doublings has many states at each parameter. The
    excess mass of a range is its share of the distinct states less its share of the range of all speeds.

    Returns
    -------
    tuple[float, float] | None
        Lowest and highest speed of the range with the largest excess mass; None if this mass is at most DENSE_EXCESS.
    """
    low, high = speed_range(found)
    distinct = np.unique(np.round(np.column_stack([found.x, found.v]) / ROUNDING_STEPS), axis=0)
    v = np.sort(distinct[:, 1]) * ROUNDING_STEPS[1]
    if not v.size:
        return None
    share, ranks = (v - low) / (high - low), np.arange(v.size) / v.size
    below = share - ranks
    excess = np.maximum.accumulate(below) + ranks + 1 / v.size - share
    end = int(excess.argmax())
    start = int(below[: end + 1].argmax())
    return _add_margin(float(v[start]), float(v[end])) if excess[end] > DENSE_EXCESS and end > start else None


def _add_margin(low: float, high: float) -> Pair:
    room = SPEED_MARGIN * (high - low or high or 1.0)
    return low - room, high + room


def place_event_names(found: DiagramContents, across: float, shown: Pair = (-np.inf, np.inf)) -> list[PlacedEventName]:
    """Return the event names that fit above a diagram. Names of events on curves of the (δ, ε) plane are placed first.

    Parameters
    ----------
    across : float
        Width of the picture in pixels.
    shown : (low, high)
        Range of speeds that the axis shows; an event gets no name if the speeds of all its impacts are outside.

    Returns
    -------
    list[PlacedEventName]
        Names that do not overlap.
    """
    marks, (low, high) = found.event_impacts, found.span
    events: dict[tuple[float, str, str, str], list[float]] = {}
    for x, v, kind, name, motion in zip(
        marks.x.tolist(), marks.v.tolist(), marks.kind, marks.name, marks.motion, strict=True
    ):
        if shown[0] <= v <= shown[1]:
            events.setdefault((x, kind, name, motion), []).append(v)
    placed: list[PlacedEventName] = []
    for (x, kind, name, motion), speeds in sorted(events.items(), key=lambda each: (not each[0][2], len(each[1]))):
        text = f"{MEANINGS[kind]} {name or motion}"
        line, width = across * (x - low) / (high - low), LETTER * len(text) + 3
        align, left = ("left", line) if line + width < across else ("right", line - width)
        tried = (
            PlacedEventName(x, max(speeds), text, row, align, left, line, left + width + ROW / 2)
            for row in range(NAME_ROWS)
        )
        free = next((each for each in tried if not any(each.collides_with(other) for other in placed)), None)
        if free is not None and left >= 0 and len(placed) < MOST_NAMES:
            placed.append(free)
    return placed


def _event_in_words(marks: EventImpacts, i: int) -> str:
    """Return in words the event of impact number `i`: its curve of the (δ, ε) plane, its kind, and its motion."""
    name = f"{marks.name[i]}, " if marks.name[i] else ""
    return f"{name}{MEANINGS[marks.kind[i]]} of {marks.motion[i]}"


def diagram_axis_name(found: DiagramContents) -> str:
    """Return the name of a diagram's parameter axis."""
    if found.to is None:
        return NAMES[found.direction]
    return f"way from here to δ {found.to[0]:.6g}, ε {found.to[1]:.6g}"


def diagram_table_html(found: DiagramContents, chaos: Sequence[ChaosEvent] = ()) -> str:
    """Return a table of events in HTML. The link of an event opens the point (δ, ε) at which it happens.

    Events on curves of the (δ, ε) plane stand before the other events of branches.

    Parameters
    ----------
    found : DiagramContents
        The diagram.
    chaos : Sequence[ChaosEvent]
        Beginnings and ends of chaos along ε, see `chaos_events`. They are the first rows for a diagram along ε, and
        are left out for any other diagram.

    Returns
    -------
    str
        The table, or a sentence if there are no events.
    """
    rows = []
    if found.to is None and found.direction == "epsilon":
        for what, motion, at, epsilon in chaos:
            rows.append((what, motion, _link_to_point(*at, f"δ {at[0]:.10g}, ε {epsilon}"), "–"))
    for each in sorted(found.events, key=lambda each: (not each.name, each.delta, each.epsilon)):
        link = _link_to_point(each.delta, each.epsilon, f"δ {each.delta:.10g}, ε {each.epsilon:.10g}")
        multipliers = multipliers_text(each.multipliers) if abs(each.multipliers[0]) < LEAST_INFINITE else "∞, 0"
        rows.append((f"{MEANINGS[each.kind]} {each.name}".rstrip(), each.motion, link, multipliers))
    if not rows:
        return f"<p>The diagram along the {diagram_axis_name(found)} has no events.</p>"
    return folded_html_table("Events of the diagram", ("Event", "Of which motion", "Where", "Multipliers"), rows)


def _link_to_point(delta: float, epsilon: float, text: str) -> str:
    at = f"{delta!r},{epsilon!r}"
    return f'<a href="?point={at}" data-point="{at}">{text}</a>'


def diagram_caption(found: DiagramContents) -> str:
    """Return the caption of a diagram: its axis and range, and how many periodic motions and events it has."""
    named = sorted({name for name in found.event_impacts.name if name})
    motions = count_in_words(len({each.motion for each in found.branch_parts}), "periodic motion")
    curves = f", among them {', '.join(named)}" if named else ""
    events = count_in_words(len(found.events), "event")
    span = f"{number_text(found.span[0])} to {number_text(found.span[1])}"
    return (
        f"Impact speed against the {diagram_axis_name(found)}, {span}: {motions}, {events}{curves}. "
        "The tab Numbers lists the events."
    )


def diagram_legend_html(found: DiagramContents, theme: str) -> str:
    """Return the key of a diagram's lines, dots and event markers, in HTML."""
    there = {each.stable for each in found.branch_parts}
    lines = [
        (f"3px {dash} currentColor", name)
        for is_stable, dash, name in ((True, "solid", "stable"), (False, "dashed", "unstable"))
        if is_stable in there
    ]
    lines.append((f"3px solid {POSITION_COLOUR}", "here"))
    parts = [
        f'<li><span class="stroke" style="border-top:{style};outline:0"></span>{name}</li>' for style, name in lines
    ]
    sweeps = ((True, UPWARD[theme], "swept upward"), (False, DOWNWARD, "swept downward"))
    signs = [("●", shade, name) for is_upward, shade, name in sweeps if (found.upward == is_upward).any()]
    signs += [(SIGNS[kind], EVENT_COLOUR, MEANINGS[kind]) for kind in MARKERS if kind in found.event_impacts.kind]
    parts += [
        f'<li><span class="sign" style="color:{shade}" aria-hidden="true">{sign}</span> {name}</li>'
        for sign, shade, name in signs
    ]
    if any(found.event_impacts.name):
        parts.append("<li>large: on a curve of the map, small: of another motion</li>")
    return f'<ul class="legend" aria-label="Key of the diagram">{"".join(parts)}</ul>'
