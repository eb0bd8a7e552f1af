"""Axes of the map: tick labels for any width, down to 1e-9 and below.

Of a machine's survey speeds and eccentricities beside them.
"""

from __future__ import annotations

import math
from typing import Any

from bokeh.models import CustomJS, CustomJSTicker, CustomJSTickFormatter, LinearAxis, NoOverlap, Range1d
from bokeh.plotting import figure

from gear_rattle.service.explorer.common.address import Pair
from gear_rattle.service.explorer.design.fields import NUMBERS
from gear_rattle.service.explorer.files import asset
from gear_rattle.workers.survey.machine import SurveyedMachine

NAMES = ("damping δ", "eccentricity ε")
ROUND = "return String(Number((inverse ? scale / tick : scale * tick).toPrecision(7)))"
NARROW = 1e-5  # of the values: narrower windows have an offset
NARROWEST = 1e-13


def dress(plot: figure) -> None:
    """Give the axes of a map their labels and ticks."""
    axes: Any = plot.below[0], plot.left[0]
    for axis, span, name in zip(axes, (plot.x_range, plot.y_range), NAMES, strict=True):
        axis.formatter = CustomJSTickFormatter(args={"range": span}, code=asset("ticks.js"))
        axis.major_label_policy = NoOverlap()  # on a telephone those of small dampings would lie over each other
        naming = CustomJS(args={"axis": axis, "range": span, "name": name}, code=asset("axis_label.js"))
        span.js_on_change("start", naming)
        span.js_on_change("end", naming)


class AxesInSI:
    """Axes above the map and on its right, of speed and of eccentricity; hidden without a machine."""

    def __init__(self, plot: figure) -> None:
        self._axes: dict[str, Any] = {}
        sides: tuple[tuple[str, Any], ...] = (("rpm", "above"), ("eccentricity", "right"))
        for name, side in sides:
            label = NUMBERS[name].label.lower()
            axis: Any = LinearAxis(axis_label=label, visible=False, name=name, major_label_policy=NoOverlap())
            axis.ticker = CustomJSTicker(major_code=asset("si_ticks.js"))
            axis.formatter = CustomJSTickFormatter(code=ROUND)
            plot.add_layout(axis, side)
            self._axes[name] = axis
        self.show(None)

    def show(self, machine: SurveyedMachine | None) -> None:
        """Show the axes of a machine, or none."""
        scales = {"rpm": 1.0, "eccentricity": 1.0}
        if machine is not None:
            scales = {
                "rpm": machine.rpm(1.0),
                "eccentricity": NUMBERS["eccentricity"].per * machine.eccentricity(1.0),
            }
        for name, axis in self._axes.items():
            arguments: Any = {"scale": float(scales[name]), "inverse": name == "rpm"}
            axis.ticker.args = axis.formatter.args = arguments
            axis.visible = machine is not None


def show_axes(axis: LinearAxis, span: Range1d, name: str, window: Pair) -> None:
    """Set a window, and the label of its axis."""
    span.update(start=window[0], end=window[1])
    offset = offset_of(window)
    axis.axis_label = name if offset is None else f"{name} − {offset[0]!r}, in units of 1e{offset[1]}"


def offset_of(window: Pair) -> tuple[float, int] | None:
    """Offset and power of ten of the tick labels of a narrow window; None of a wide one."""
    low, high = window
    span, scale = high - low, max(abs(low), abs(high))
    if span > NARROW * scale:
        return None
    digits = math.ceil(math.log10(scale / span)) + 1
    return float(f"{(low + high) / 2:.{digits}g}"), math.floor(math.log10(span) + 0.01)


def written(value: float, window: Pair) -> str:
    """Return a coordinate with the digits that tell points of this window apart on a screen."""
    span = max(window[1] - window[0], 1e-300)
    return f"{value:.{min(max(math.ceil(3 - math.log10(span)), 3), 17)}f}"
