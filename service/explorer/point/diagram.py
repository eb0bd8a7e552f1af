"""The picture of a one-parameter diagram through the point."""

from __future__ import annotations

from typing import Any

from bokeh.models import ColumnDataSource, HoverTool, Range1d
from bokeh.models.annotations import Span

from gear_rattle.service.explorer.common.figures import BESIDE, ink_of, themed_figure
from gear_rattle.service.explorer.common.glyphs import clear
from gear_rattle.service.explorer.point.parts import DiagramLines, Marks
from gear_rattle.service.explorer.point.words import pair

MARKERS = {"SN": "circle", "PD": "diamond", "GR": "square"}
SIGNS = {"SN": "●", "PD": "◆", "GR": "■"}
EVENT, MOST_TOLD = "#e8862e", 4  # colour of events, and how many of them are told of one place
MEANINGS = {"SN": "saddle-node", "PD": "period doubling", "GR": "grazing"}
INFINITE = 1e12  # multipliers beyond are infinite: at a graze
NAMES = {"epsilon": "eccentricity ε", "delta": "damping δ"}
SEEN = {"light": "#5b9bd5", "dark": "#7fb3e0"}


class DiagramPicture:
    """Impact speed against the parameter: stable solid, unstable dashed, events marked."""

    def __init__(self, theme: str, x_range: Range1d | None = None) -> None:
        axis = x_range or (0.0, 1.0)
        self.figure: Any = themed_figure("diagram", theme, NAMES["epsilon"], "impact speed v", 320, axis, (0.0, 7.0))
        self.figure.min_border_left = BESIDE
        ink = ink_of(theme)
        self._seen = ColumnDataSource({"x": [], "v": []})
        self.figure.scatter("x", "v", source=self._seen, size=2.2, color=SEEN[theme], alpha=0.7)
        self._strokes = ColumnDataSource({"x": [], "v": [], "motion": [], "stable": [], "dash": [], "width": []})
        drawn = self.figure.multi_line(
            "x", "v", source=self._strokes, line_color=ink, line_dash="dash", line_width="width"
        )
        self._marks = ColumnDataSource({"x": [], "v": [], "tau": [], "what": [], "marker": [], "size": []})
        marked = self.figure.scatter(
            "x", "v", source=self._marks, marker="marker", size="size", line_color=ink, fill_color=EVENT
        )
        # Each has one tooltip, on a side of its own: neither covers the other.
        of_motions = [("motion", "@motion"), ("", "@stable"), ("at", "$x{%.6g}"), ("v", "$y{%.4g}")]
        of_events = [("event", "@what"), ("at", "@x{%.7g}"), ("v", "@v{%.5g}"), ("τ", "@tau{%.4f}")]
        for what, tooltips, side, limit in ((drawn, of_motions, "left", 1), (marked, of_events, "right", MOST_TOLD)):
            formatters: Any = {text.split("{")[0]: "printf" for _, text in tooltips if "{" in text}
            place: Any = {"attachment": side, "limit": limit}
            hover = HoverTool(renderers=[what], tooltips=tooltips, formatters=formatters, **place)
            self.figure.add_tools(hover)
        self._here = Span(location=0.0, dimension="height", line_color="#d7191c", line_width=1.5, line_alpha=0.8)
        self.figure.add_layout(self._here)

    def clear(self) -> None:
        """Show nothing."""
        for source in (self._seen, self._strokes, self._marks):
            clear(source)

    def show(self, found: DiagramLines, at: float) -> None:
        """Draw a diagram; `at` is where the point is on its axis."""
        self.figure.x_range.update(start=found.span[0], end=found.span[1])
        self.figure.xaxis.axis_label = along(found)
        top = max([float(x.max()) for x in (found.v, *(each.v for each in found.strokes)) if x.size], default=7.0)
        self.figure.y_range.update(start=0.0, end=1.05 * top)
        self.mark(at)
        self._seen.data = {"x": found.x, "v": found.v}
        strokes = sorted(found.strokes, key=lambda each: each.stable)  # the stable ones above
        self._strokes.data = {
            "x": [each.x for each in strokes],
            "v": [each.v for each in strokes],
            "motion": [each.motion for each in strokes],
            "width": [1.6 if each.motion.startswith("P(1,1,") else 0.8 for each in strokes],
            "stable": ["stable" if each.stable else "unstable" for each in strokes],
            "dash": ["solid" if each.stable else "dashed" for each in strokes],
        }
        marks = found.marks
        self._marks.data = {
            "x": marks.x,
            "v": marks.v,
            "tau": marks.tau,
            "marker": [MARKERS[kind] for kind in marks.kind],
            "size": [9 if name else 5 for name in marks.name],
            "what": [_what(marks, i) for i in range(len(marks.kind))],
        }

    def mark(self, at: float) -> None:
        """Mark where on the axis is what is looked at."""
        self._here.location = at


def _what(marks: Marks, i: int) -> str:
    """Return an event in words: its kind, its motion, and the curve of the plane that it is on."""
    name = f"{marks.name[i]}, " if marks.name[i] else ""
    return f"{name}{MEANINGS[marks.kind[i]]} of {marks.motion[i]}"


def along(found: DiagramLines) -> str:
    """Return the name of a diagram's axis."""
    if found.to is None:
        return NAMES[found.direction]
    return f"way from here to δ {found.to[0]:.6g}, ε {found.to[1]:.6g}"


def diagram_table(found: DiagramLines) -> str:
    """Return the events in HTML, those on curves of the map first; a click on one goes there."""
    if not found.events:
        return ""
    rows = []
    for each in sorted(found.events, key=lambda each: (not each.name, each.delta, each.epsilon)):
        at = f"{each.delta!r},{each.epsilon!r}"
        numbers = f"δ {each.delta:.10g}, ε {each.epsilon:.10g}"
        multipliers = pair(each.multipliers) if abs(each.multipliers[0]) < INFINITE else "∞, 0"
        rows.append(
            f"<tr><td>{MEANINGS[each.kind]}{f', {each.name}' if each.name else ''}</td><td>{each.motion}</td>"
            f'<td><a href="?point={at}" data-point="{at}">{numbers}</a></td><td>{multipliers}</td></tr>'
        )
    head = "".join(f"<th scope=col>{title}</th>" for title in ("Event", "Motion", "Where", "Multipliers"))
    return (
        f'<details><summary>{len(rows)} events, exactly</summary><table aria-label="Events of the diagram">'
        f"<thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table></details>"
    )


def diagram_caption(found: DiagramLines) -> str:
    """Return a sentence on what the picture shows."""
    named = sorted({name for name in found.marks.name if name})
    motions = len({each.motion for each in found.strokes})
    curves = f", among them {', '.join(named)}" if named else ""
    events = len(set(zip(found.marks.kind, found.marks.x.tolist(), strict=True)))
    return (
        f"Impact speed against the {along(found)}, {found.span[0]:.4g} to {found.span[1]:.4g}: "
        f"{motions} periodic motions, {events} events{curves}. Solid: stable, dashed: unstable, dots: attractors "
        "followed both ways, red: here."
    )


def legend(found: DiagramLines) -> str:
    """Return the meaning of the markers, in HTML."""
    kinds = [kind for kind in MARKERS if kind in found.marks.kind]
    parts = [
        f'<li><span style="color:{EVENT}" aria-hidden="true">{SIGNS[kind]}</span> {MEANINGS[kind]}</li>'
        for kind in kinds
    ]
    if any(found.marks.name):
        parts.append("<li>large: on a curve of the map, small: of another motion</li>")
    return f'<ul class="legend" aria-label="Events of the diagram">{"".join(parts)}</ul>' if parts else ""
