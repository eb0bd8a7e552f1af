"""The picture of a one-parameter diagram through the point."""

from __future__ import annotations

from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource, HoverTool
from bokeh.models.annotations import Span

from service.explorer.common.glyphs import empty
from service.explorer.point.figures import ink_of, new_figure
from service.explorer.point.parts import DiagramLines, Marks

MARKERS = {"SN": "circle", "PD": "diamond", "GR": "square"}
MEANINGS = {"SN": "saddle-node", "PD": "period doubling", "GR": "grazing"}
NAMES = {"epsilon": "eccentricity ε", "delta": "damping δ"}
SEEN = {"light": "#5b9bd5", "dark": "#7fb3e0"}


class DiagramPicture:
    """Impact speed against the parameter: stable solid, unstable dashed, events marked."""

    def __init__(self, theme: str) -> None:
        self.figure: Any = new_figure("diagram", theme, NAMES["epsilon"], "impact speed v", 320, (0.0, 1.0), (0.0, 7.0))
        ink = ink_of(theme)
        self._seen = ColumnDataSource({"x": [], "v": []})
        self.figure.scatter("x", "v", source=self._seen, size=2.2, color=SEEN[theme], alpha=0.7)
        self._strokes = {}
        drawn = []
        for stable, dash in ((False, "dashed"), (True, "solid")):
            self._strokes[stable] = ColumnDataSource({"x": [], "v": [], "motion": [], "stable": [], "width": []})
            drawn.append(
                self.figure.multi_line(
                    "x", "v", source=self._strokes[stable], line_color=ink, line_dash=dash, line_width="width"
                )
            )
        self._marks = {}
        for kind, marker in MARKERS.items():
            self._marks[kind] = ColumnDataSource({"x": [], "v": [], "tau": [], "what": [], "size": []})
            drawn_marks = self.figure.scatter(
                "x", "v", source=self._marks[kind], marker=marker, size="size", line_color=ink, fill_color="#e8862e"
            )
            tooltips = [("event", "@what"), ("at", "@x{%.7g}"), ("v", "@v{%.5g}"), ("τ", "@tau{%.4f}")]
            formatters: Any = {"@x": "printf", "@v": "printf", "@tau": "printf"}
            self.figure.add_tools(HoverTool(renderers=[drawn_marks], tooltips=tooltips, formatters=formatters))
        tooltips = [("motion", "@motion"), ("", "@stable"), ("at", "$x{%.6g}"), ("v", "$y{%.4g}")]
        formatters = {"$x": "printf", "$y": "printf"}
        self.figure.add_tools(HoverTool(renderers=drawn, tooltips=tooltips, formatters=formatters))
        self._here = Span(location=0.0, dimension="height", line_color="#d7191c", line_width=1.5, line_alpha=0.8)
        self.figure.add_layout(self._here)

    def clear(self) -> None:
        """Show nothing."""
        for source in (self._seen, *self._strokes.values(), *self._marks.values()):
            empty(source)

    def show(self, found: DiagramLines, at: float) -> None:
        """Draw a diagram; `at` is where the point is on its axis."""
        self.figure.x_range.update(start=found.span[0], end=found.span[1])
        self.figure.xaxis.axis_label = NAMES[found.direction]
        top = max([float(x.max()) for x in (found.v, *(each.v for each in found.strokes)) if x.size], default=7.0)
        self.figure.y_range.update(start=0.0, end=1.05 * top)
        self._here.location = at
        self._seen.data = {"x": found.x, "v": found.v}
        for stable, source in self._strokes.items():
            chosen = [each for each in found.strokes if each.stable == stable]
            source.data = {
                "x": [each.x for each in chosen],
                "v": [each.v for each in chosen],
                "motion": [each.motion for each in chosen],
                "width": [1.6 if each.motion.startswith("P(1,1,") else 0.8 for each in chosen],
                "stable": ["stable" if stable else "unstable"] * len(chosen),
            }
        kinds = np.array(found.marks.kind)
        for kind, source in self._marks.items():
            on = np.flatnonzero(kinds == kind)
            source.data = {
                "x": found.marks.x[on],
                "v": found.marks.v[on],
                "tau": found.marks.tau[on],
                "size": [9 if found.marks.name[i] else 5 for i in on],
                "what": [_what(found.marks, i) for i in on],
            }


def _what(marks: Marks, i: int) -> str:
    """An event in words: what happens to which motion, and the curve of the plane that it is on."""
    name = f"{marks.name[i]}, " if marks.name[i] else ""
    return f"{name}{MEANINGS[marks.kind[i]]} of {marks.motion[i]}"


def caption(found: DiagramLines) -> str:
    """A sentence on what the picture shows."""
    named = sorted({name for name in found.marks.name if name})
    motions = len({each.motion for each in found.strokes})
    curves = f", among them {', '.join(named)}" if named else ""
    events = len(set(zip(found.marks.kind, found.marks.x.tolist(), strict=True)))
    return (
        f"Impact speed against the {NAMES[found.direction]}, {found.span[0]:.4g} to {found.span[1]:.4g}: "
        f"{motions} periodic motions, {events} events{curves}. Solid: stable, dashed: unstable, dots: attractors "
        "followed both ways, red: here."
    )
