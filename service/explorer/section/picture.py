"""Draw the profile of a map as steps, in a figure that stands below the diagram and shares its parameter axis."""

from __future__ import annotations

from typing import Any

import numpy as np
from bokeh.models import BasicTicker, ColumnDataSource, FixedTicker, HoverTool, Range1d

from gear_rattle.service.explorer.common.address import Pair
from gear_rattle.service.explorer.common.figures import LEFT_BORDER, foreground_colour, themed_figure
from gear_rattle.service.explorer.common.glyphs import remove_rows
from gear_rattle.service.explorer.section.profile import MapProfile

HEIGHT = 190
VALUE_MARGIN = 0.06  # margin above and below the values, as a share of their range


class ProfileFigure:
    """Figure of a map's values along the line of a diagram, drawn against the diagram's parameter."""

    def __init__(self, theme: str, x_range: Range1d) -> None:
        self.figure: Any = themed_figure("profile", theme, "", "", HEIGHT, x_range, (0.0, 1.0))
        self.figure.min_border_left = LEFT_BORDER
        self.steps = ColumnDataSource({"x": [], "value": [], "what": []})
        drawn = self.figure.line("x", "value", source=self.steps, line_color=foreground_colour(theme), line_width=1.8)
        tooltips = [("", "@what"), ("at", "$x{%.6g}")]
        self.figure.add_tools(
            HoverTool(renderers=[drawn], tooltips=tooltips, formatters={"$x": "printf"}, mode="vline")
        )

    def clear(self) -> None:
        """Remove the profile from the figure."""
        remove_rows(self.steps)

    def show(self, profile: MapProfile, span: Pair, limits: Pair | None) -> Pair:
        """Draw a profile over the parameter of the diagram.

        Parameters
        ----------
        profile : MapProfile
            Values along the line.
        span : Pair
            Parameter at the two ends of the line.
        limits : Pair | None
            Range of the axis of values, None for the default of `value_range`.

        Returns
        -------
        Pair
            Range of the axis of values.
        """
        x = np.repeat(span[0] + profile.positions * (span[1] - span[0]), 2)[1:-1]
        values = np.repeat(profile.values.astype(float), 2)
        texts = [_value_text(profile, each) for each in profile.values.tolist() for _ in range(2)]
        self.steps.data = {"x": x, "value": values, "what": texts}
        axis = self.figure.yaxis
        axis.ticker = FixedTicker(ticks=list(profile.names)) if profile.names else BasicTicker()
        axis.major_label_overrides = dict(profile.names)
        low, high = limits or value_range(profile)
        self.figure.y_range.update(start=low, end=high)
        return low, high


def _value_text(profile: MapProfile, value: float) -> str:
    if not np.isfinite(value):
        return ""
    return profile.names[int(value)] if profile.names else f"{value:.6g}"


def value_range(profile: MapProfile) -> Pair:
    """Return the default (low, high) of the axis of values, with a margin around all codes or all finite values."""
    if profile.names:
        return min(profile.names) - 0.5, max(profile.names) + 0.5
    known = profile.values[np.isfinite(profile.values)].astype(float)
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    room = VALUE_MARGIN * (high - low or abs(high) or 1.0)
    return low - room, high + room
