"""A machine in the form: its numbers, and speeds and eccentricities as the axes of a survey."""

from __future__ import annotations

from typing import Any

import panel as pn

from gear_rattle.service.explorer.common.address import Pair
from gear_rattle.service.explorer.design.fields import EXACT, NUMBERS, PAIR, MachineFields, spans_of
from gear_rattle.workers import SurveyRequest
from gear_rattle.workers.survey.machine import SurveyedMachine

LEAST_DELTA = 0.1  # of the upper end
FIRST = {"rpm": (1000.0, 3000.0, 61), "eccentricity": (1.0, 60.0, 60)}
ABOUT = "<p class=faint>Teeth that do not give way: with a stiffness, another one belongs to each speed.</p>"


class MachineAxes:
    """Fields of a machine in place of δ, ε and β."""

    def __init__(self, sheet: str) -> None:
        style: dict[str, Any] = {"sizing_mode": "stretch_width", "margin": (3, 4), "stylesheets": [sheet]}
        self._machine = MachineFields(PAIR, sheet)
        self._axes = {
            name: (
                pn.widgets.FloatInput(label=f"{NUMBERS[name].unit} from", value=start, format=EXACT, **style),
                pn.widgets.FloatInput(label=f"{NUMBERS[name].unit} to", value=stop, format=EXACT, **style),
                pn.widgets.IntInput(label="values", value=num, start=2, step=10, **style),
            )
            for name, (start, stop, num) in FIRST.items()
        }
        self.widgets = [*self._machine.widgets, *(each for three in self._axes.values() for each in three)]
        self.panel = pn.Column(
            *(pn.Row(*three, sizing_mode="stretch_width") for three in self._axes.values()),
            self._machine.panel,
            pn.pane.HTML(ABOUT, stylesheets=[sheet], margin=(0, 4)),
            sizing_mode="stretch_width", margin=0, visible=False,
        )  # fmt: skip

    def fields(self) -> dict[str, Any]:
        """Return the machine of a request, with its axes."""
        axes = {
            name: {
                "start": NUMBERS[name].meant(start.value),
                "stop": NUMBERS[name].meant(stop.value),
                "num": num.value,
            }
            for name, (start, stop, num) in self._axes.items()
        }
        return {"machine": self._machine.given() | axes}

    def fill(self, request: SurveyRequest, machine: SurveyedMachine) -> None:
        """Take over the machine of a survey, and its axes."""
        delta, epsilon = request.delta, request.epsilon
        self.fill_window((delta.start, delta.stop), (epsilon.start, epsilon.stop), machine)
        for name, num in (("rpm", delta.num), ("eccentricity", epsilon.num)):
            self._axes[name][2].value = num

    def fill_window(self, delta: Pair, epsilon: Pair, machine: SurveyedMachine) -> None:
        """Take over a machine and a window of the plane."""
        self._machine.show(machine.model_dump())
        delta = max(delta[0], LEAST_DELTA * delta[1]), delta[1]  # a window may show more than the plane
        for name, span in spans_of(machine, delta, epsilon).items():
            for widget, value in zip(self._axes[name], span, strict=False):
                widget.value = NUMBERS[name].entered(value)

    def fill_counts(self, num: int) -> None:
        """Set the same number of values along each axis."""
        for three in self._axes.values():
            three[2].value = num
