"""Fields of the form for a machine: its numbers, and ranges of speed and eccentricity as the axes of a survey."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import panel as pn

from gear_rattle.service.explorer.common.address import Pair
from gear_rattle.service.explorer.design.axes import round_range_ends
from gear_rattle.service.explorer.design.fields import (
    NUMBERS,
    SURVEY_NUMBERS,
    MachineFields,
    speed_and_eccentricity_ranges,
)
from gear_rattle.workers.survey.machine import SurveyedMachine

LEAST_DELTA = 0.1  # least lower end of the range of δ, relative to its upper end
#: The ranges of a new form, in the units of the fields: speed in rpm, eccentricity in µm.
DEFAULT_AXES = {"rpm": (1000.0, 3000.0), "eccentricity": (1.0, 60.0)}


class MachineSurveyFields:
    """Fields of the survey form for a machine; they replace the fields of δ, ε and β."""

    def __init__(self, sheet: str) -> None:
        style: dict[str, Any] = {"sizing_mode": "stretch_width", "margin": (3, 4), "stylesheets": [sheet]}
        self._machine = MachineFields(SURVEY_NUMBERS, sheet)
        self._axes = {
            name: [
                pn.widgets.FloatInput(label=f"{NUMBERS[name].unit} {end}", value=value, **style)
                for end, value in zip(("from", "to"), span, strict=True)
            ]
            for name, span in DEFAULT_AXES.items()
        }
        self.optional = self._machine.optional
        self.panel = pn.Column(
            *(pn.Row(*ends, sizing_mode="stretch_width") for ends in self._axes.values()),
            self._machine.needed,
            sizing_mode="stretch_width", margin=0, visible=False,
        )  # fmt: skip

    def request_fields(self, counts: Sequence[int | None]) -> dict[str, Any]:
        """Return {"machine": numbers and axes of the machine} for a request. counts: of speeds, of eccentricities."""
        axes = {
            name: {
                "start": NUMBERS[name].to_library_unit(start.value),
                "stop": NUMBERS[name].to_library_unit(stop.value),
                "num": num,
            }
            for (name, (start, stop)), num in zip(self._axes.items(), counts, strict=True)
        }
        return {"machine": self._machine.entered_numbers() | axes}

    def fill(self, delta: Pair, epsilon: Pair, machine: SurveyedMachine, is_rounded: bool = False) -> None:
        """Set the fields to a machine, and to the ranges of its speed and eccentricity in a window of the plane.

        is_rounded: True if the ends of both ranges are rounded to few digits, False if they are exact.
        """
        self._machine.fill_from_machine(machine.model_dump())
        delta = max(delta[0], LEAST_DELTA * delta[1]), delta[1]  # a window may reach to δ ≤ 0, where no speed exists
        for name, (low, high) in speed_and_eccentricity_ranges(machine, delta, epsilon).items():
            span = NUMBERS[name].to_field_unit(low), NUMBERS[name].to_field_unit(high)
            for widget, value in zip(self._axes[name], round_range_ends(*span) if is_rounded else span, strict=True):
                widget.value = value
