"""Axes of the map, with tick labels for windows of any width, down to 1e-9 and below.

The survey of a machine has speed and eccentricity as axes, and δ and ε on the opposite sides.
"""

from __future__ import annotations

import math
from typing import Any

from bokeh.models import CustomJS, CustomJSTicker, CustomJSTickFormatter, LinearAxis, NoOverlap
from bokeh.plotting import figure

from gear_rattle.service.explorer.common.address import Pair
from gear_rattle.service.explorer.design.fields import NUMBERS
from gear_rattle.service.explorer.files import read_asset
from gear_rattle.workers.survey.machine import SurveyedMachine

NAMES = ("damping δ", "eccentricity ε")
ROUND = "return String(Number((inverse ? scale / tick : scale * tick).toPrecision(7)))"
NARROW = 1e-5  # width of a window relative to its coordinates; below it the tick labels are distances from an offset
NARROWEST = 1e-13  # least width of a window, in δ or ε


class MapAxes:
    """Axes of a map: δ and ε, or a machine's speed and eccentricity with δ and ε above and on the right.

    Damping falls as speed rises, so for a machine δ rises to the left. is_follower: True if the ranges are those of
    another map, whose own `MapAxes` sets the direction of δ.
    """

    def __init__(self, plot: figure, is_follower: bool) -> None:
        self._spans: tuple[Any, Any] = (plot.x_range, plot.y_range)
        self._is_follower = is_follower
        own: tuple[Any, Any] = (plot.below[0], plot.left[0])
        self._own, self._second = own, (LinearAxis(visible=False), LinearAxis(visible=False))
        self._machine: dict[str, Any] = {}
        sides: tuple[Any, ...] = ("below", "left", "above", "right")
        for name, side in zip(("rpm", "eccentricity"), sides, strict=False):
            label = NUMBERS[name].label.lower()
            axis: Any = LinearAxis(axis_label=label, visible=False, name=name, major_label_policy=NoOverlap())
            axis.ticker = CustomJSTicker(major_code=read_asset("si_ticks.js"))
            axis.formatter = CustomJSTickFormatter(code=ROUND)
            plot.add_layout(axis, side)
            self._machine[name] = axis
        for axis, side in zip(self._second, sides[2:], strict=True):
            plot.add_layout(axis, side)
        for pair in (self._own, self._second):
            for axis, span, name in zip(pair, self._spans, NAMES, strict=True):
                axis.formatter = CustomJSTickFormatter(args={"range": span}, code=read_asset("ticks.js"))
                # Without this policy, labels of small dampings overlap on the narrow screen of a telephone.
                axis.major_label_policy = NoOverlap()
                naming = CustomJS(args={"axis": axis, "range": span, "name": name}, code=read_asset("axis_label.js"))
                span.js_on_change("start", naming)
                span.js_on_change("end", naming)
        self.show(None)

    def show(self, machine: SurveyedMachine | None) -> None:
        """Show the axes for the survey of a machine; if `machine` is None, only the axes of δ and ε."""
        scales = {"rpm": 1.0, "eccentricity": 1.0}
        if machine is not None:
            scales = {
                "rpm": machine.speed_at_damping(1.0),
                "eccentricity": NUMBERS["eccentricity"].field_units_per_library_unit
                * machine.eccentricity_in_metres(1.0),
            }
        for name, axis in self._machine.items():
            arguments: Any = {"scale": float(scales[name]), "inverse": name == "rpm"}
            axis.ticker.args = axis.formatter.args = arguments
        for axis in self._own:
            axis.visible = machine is None
        for axis in (*self._machine.values(), *self._second):
            axis.visible = machine is not None
        span = self._spans[0]
        if not self._is_follower and (span.start > span.end) != (machine is not None):
            span.update(start=span.end, end=span.start)

    def show_window(self, *window: Pair) -> None:
        """Set the ranges of δ and ε that the map shows, and the labels of both axes."""
        for pair, span, name, (low, high) in zip(
            zip(self._own, self._second, strict=True), self._spans, NAMES, window, strict=True
        ):
            start, end = (high, low) if span.start > span.end else (low, high)
            span.update(start=start, end=end)
            offset = tick_label_offset((low, high))
            for axis in pair:
                axis.axis_label = name if offset is None else f"{name} − {offset[0]!r}, in units of 1e{offset[1]}"


def tick_label_offset(window: Pair) -> tuple[float, int] | None:
    """Return (offset, n) for the tick labels of a narrow window; None for a wide window.

    A tick label of a narrow window is the distance from the offset in units of 10ⁿ.

    Returns
    -------
    tuple[float, int] | None
        The offset and the exponent n.
    """
    low, high = window
    span, scale = high - low, max(abs(low), abs(high))
    if span > NARROW * scale:
        return None
    digits = math.ceil(math.log10(scale / span)) + 1
    return float(f"{(low + high) / 2:.{digits}g}"), math.floor(math.log10(span) + 0.01)


def coordinate_text(value: float, window: Pair) -> str:
    """Return a coordinate with enough digits to distinguish the points of this window on a screen."""
    span = max(window[1] - window[0], 1e-300)
    return f"{value:.{min(max(math.ceil(3 - math.log10(span)), 3), 17)}f}"


def round_range_ends(low: float, high: float) -> Pair:
    """Return a range with rounded ends. An end changes by less than a thousandth of the width of the range."""
    if not low < high:
        return low, high
    digits = math.ceil(3 - math.log10(high - low))
    return round(low, digits), round(high, digits)
