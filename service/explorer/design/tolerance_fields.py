"""Fields in which a viewer enters the tolerances of a point and requests its yield."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import panel as pn

from gear_rattle.service.explorer.common.point_state import PointTolerances
from gear_rattle.service.explorer.common.text import TextPane, alert_html
from gear_rattle.service.explorer.common.watch import call_on_press
from gear_rattle.service.explorer.design.fields import NUMBERS
from gear_rattle.service.explorer.state.events import Event, YieldRequested
from gear_rattle.workers.pictures.look import USUAL_SHARE
from rattle import Machine
from rattle.models import AnyGear

DEFAULT_DEVIATION = 0.1  # default standard deviation of a number, as a share of the number's value at the point


class ToleranceFields:
    """Fields for the tolerances of a point, and a button that requests its yield.

    The fields are the standard deviations of δ and ε, or of a machine's speed and eccentricity, and the probability of
    quiet running that a gear needs to pass.
    """

    def __init__(self, dispatch: Callable[[Event], None], sheets: list[str]) -> None:
        self._dispatch = dispatch
        style: dict[str, Any] = {"width": 150, "margin": (2, 4), "stylesheets": sheets}
        first, second, share = (pn.widgets.FloatInput(start=0.0, **style) for _ in range(3))
        share.label = "Passes: P(quiet) ≥"
        self.widgets = first, second, share
        self._per = 1.0, 1.0
        self._button = pn.widgets.Button(label="Compute yield", **style)
        call_on_press(self._button, self.request_yield)
        self.said = TextPane("", *sheets, margin=(0, 4))
        heading = TextPane("<h2>Tolerances</h2>", *sheets, margin=(0, 4))
        self.panel = pn.Column(
            heading.pane, pn.FlexBox(*self.widgets, self._button, align_items="flex-end", margin=0), self.said.pane,
            sizing_mode="stretch_width", margin=0,
        )  # fmt: skip

    def fill(self, gear: AnyGear, machine: Machine | None, widths: PointTolerances | None) -> None:
        """Set the fields for a point: tolerances of speed and eccentricity if it has a machine, else of δ and ε.

        widths: the values of the fields; None for the defaults DEFAULT_DEVIATION and USUAL_SHARE.
        """
        first, second, share = self.widgets
        if machine is None:
            first.label, second.label, self._per = "σ of δ", "σ of ε", (1.0, 1.0)
            means = gear.delta, gear.epsilon
        else:
            speed, eccentricity = NUMBERS["rpm"], NUMBERS["eccentricity"]
            first.label, second.label = f"σ of {speed.label.lower()}", f"σ of {eccentricity.label.lower()}"
            self._per, means = (
                (speed.field_units_per_library_unit, eccentricity.field_units_per_library_unit),
                (machine.rpm, machine.eccentricity),
            )
        given = widths or PointTolerances(DEFAULT_DEVIATION * means[0], DEFAULT_DEVIATION * means[1], USUAL_SHARE)
        for widget, value, per in zip((first, second), given, self._per, strict=False):
            widget.value = float(f"{value * per:.{3 if widths is None else 12}g}")
        share.value = given.share
        self.said.html = ""

    def request_yield(self) -> None:
        """Request the yield with the entered tolerances, or say that a field is empty."""
        first, second, share = (each.value for each in self.widgets)
        if first is None or second is None or share is None:
            self.said.html = alert_html("A tolerance needs a number in each field.", "wrong")
        else:
            entered = PointTolerances(first / self._per[0], second / self._per[1], share)
            self._dispatch(YieldRequested(entered))
