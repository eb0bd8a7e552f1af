"""Pictures of one motion: the time trace Φ(t) between the walls, and the phase portrait."""

from __future__ import annotations

from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource, HoverTool
from bokeh.models.annotations import Span

import rattle
from gear_rattle.service.explorer.common.figures import foreground_colour, line_colour, themed_figure
from gear_rattle.service.explorer.common.glyphs import remove_rows
from gear_rattle.service.explorer.point.words import PERIOD, count_in_words, repetition_in_words

# half the extent of an axis of Φ, relative to β, and of the axis of Φ', relative to the largest speed
AXIS_EXTENT = 1.12


class MotionPictures:
    """The time trace Φ(t) and the phase portrait of a motion between the walls, as two figures."""

    def __init__(self, theme: str) -> None:
        self._theme = theme
        walls = (-1.0, 1.0)
        self.trace: Any = themed_figure("trace", theme, "", "Φ", 260, (0.0, 1.0), walls)
        self.portrait: Any = themed_figure("portrait", theme, "Φ", "", 260, walls, (-7.0, 7.0))
        self.trajectory_source = ColumnDataSource({"t": [], "phi": [], "velocity": []})
        self._impacts = ColumnDataSource({"t": [], "phi": [], "speed": []})
        ink = foreground_colour(theme)
        style: dict[str, Any] = {"line_color": ink, "line_width": 3, "line_alpha": 0.55}
        self._walls = {
            side: [Span(location=side, dimension=dimension, **style) for dimension in ("width", "height")]
            for side in (1, -1)
        }
        for over, under in self._walls.values():
            self.trace.add_layout(over)
            self.portrait.add_layout(under)
        self._drawn = [
            self.trace.line("t", "phi", source=self.trajectory_source, line_width=1.6),
            self.portrait.line("phi", "velocity", source=self.trajectory_source, line_width=1.2),
        ]
        impacts = self.trace.scatter("t", "phi", source=self._impacts, size=4, color=ink, alpha=0.8)
        tooltips = [("impact at", "@t{%.4f}"), ("speed", "@speed{%.4g}")]
        formatters: Any = {"@t": "printf", "@speed": "printf"}
        self.trace.add_tools(HoverTool(renderers=[impacts], tooltips=tooltips, formatters=formatters))

    def clear(self) -> None:
        """Remove the motion from both pictures."""
        for source in (self.trajectory_source, self._impacts):
            remove_rows(source)

    def show(self, found: rattle.Trajectory, beta: float, colour: str, period: str) -> None:
        """Draw a motion between walls at ±beta in a colour. period: the name of the forcing period."""
        self.trace.xaxis.axis_label, self.portrait.yaxis.axis_label = f"{period}s", f"Φ′, per {period}"
        for side, spans in self._walls.items():
            for span in spans:
                span.location = side * beta
        for across in (self.trace.y_range, self.portrait.x_range):
            across.update(start=-AXIS_EXTENT * beta, end=AXIS_EXTENT * beta)
        self.trace.x_range.update(start=0.0, end=float(found.time[-1]))
        fastest = AXIS_EXTENT * max(float(np.abs(found.velocity).max()), 1e-3 * beta)
        self.portrait.y_range.update(start=-fastest, end=fastest)
        self.trajectory_source.data = {"t": found.time, "phi": found.phi, "velocity": found.velocity}
        shown = slice(0, 2000)
        self._impacts.data = {
            "t": found.impact_time[shown],
            "phi": beta * found.impact_wall[shown].astype(float),
            "speed": found.impact_speed[shown],
        }
        for each in self._drawn:
            each.glyph.line_color = line_colour(colour, self._theme)


def motion_caption(
    found: rattle.Trajectory, what: str, period: str = PERIOD, attractor: rattle.Attractor | None = None
) -> str:
    """Return the caption of a motion. what: the motion in words.

    The caption gives the time until rest if the motion comes to rest. Otherwise it counts impacts: those of one period
    of a periodic `attractor`, and those in the picture for any other motion.

    Returns
    -------
    str
        The sentence.
    """
    upper = int(np.count_nonzero(found.impact_wall == 1))
    lower = found.impact_wall.size - upper
    if found.rest < np.inf:
        return f"{what}: at rest against the wall Φ = β after {_periods_in_words(found.rest, period)}."
    speeds = found.impact_speed
    fastest = f", the fastest at a speed of {speeds.max():.4g}" if speeds.size else ""
    how_long = f"in {_periods_in_words(found.time[-1], period)}"
    if attractor is not None and attractor.kind == "periodic":
        upper, lower = attractor.n_plus, attractor.n_minus
        how_long = repetition_in_words(attractor.m, period)
    return f"{what}: {count_in_words(upper, 'impact')} on the wall Φ = β and {lower} on Φ = −β {how_long}{fastest}."


def _periods_in_words(number: float, period: str) -> str:
    """Return a number of periods, not always whole, with its noun `period`: 1 revolution, 2.5 revolutions."""
    shown = f"{number:.3g}"
    return f"{shown} {period}{'' if shown == '1' else 's'}"
