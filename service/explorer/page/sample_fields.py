"""Parts of the form: where samples begin, in which slot of a cell an attractor is, and which cells are computed."""

from __future__ import annotations

from typing import Any

import panel as pn

from gear_rattle.workers import SurveyRequest
from gear_rattle.workers.survey.refined.asked import AUDIT
from gear_rattle.workers.survey.request import BY_FAMILY, BY_FRACTION, MAX_SLOTS

UNSAID = ""
REFINED = "Adaptive refinement"
WHOLE = (0.0, 1.0, 0.0)  # phases from and to, and the least speed


class SampleFields:
    """The box of initial conditions but for its highest speed, and the slots."""

    def __init__(self, sheet: str) -> None:
        style: dict[str, Any] = {"sizing_mode": "stretch_width", "margin": (3, 4), "stylesheets": [sheet]}
        tau_min, tau_max, v_min = WHOLE
        phase: dict[str, Any] = {"start": 0.0, "end": 1.0, "step": 0.05} | style
        self._tau_min = pn.widgets.FloatInput(label="Phases from", value=tau_min, **phase)
        self._tau_max = pn.widgets.FloatInput(label="to", value=tau_max, **phase)
        self._v_min = pn.widgets.FloatInput(label="Least speed", value=v_min, start=0.0, step=0.5, **style)
        self._slots = pn.widgets.IntInput(
            label="Attractors listed",
            value=None,
            start=1,
            end=MAX_SLOTS,
            placeholder="8 or 24",
            **style,
        )
        options = {"default": UNSAID, "by share": BY_FRACTION, "by family": BY_FAMILY}
        self._by = pn.widgets.Select(label="Order attractors by", options=options, **style)
        self.widgets = [self._tau_min, self._tau_max, self._v_min, self._slots, self._by]
        self.panel = pn.Column(
            pn.Row(self._tau_min, self._tau_max, self._v_min, sizing_mode="stretch_width"),
            pn.Row(self._slots, self._by, sizing_mode="stretch_width"),
            sizing_mode="stretch_width", margin=0,
        )  # fmt: skip

    def box(self) -> dict[str, Any]:
        """Return the box of the initial conditions."""
        return {"tau_min": self._tau_min.value, "tau_max": self._tau_max.value, "v_min": self._v_min.value}

    def slots(self) -> dict[str, Any]:
        """Return how many slots, and what decides which."""
        return {"slots": self._slots.value, "slots_by": self._by.value or None}

    def fill(self, request: SurveyRequest) -> None:
        """Take over the settings of a survey."""
        sample = request.initial_conditions
        self._tau_min.value, self._tau_max.value, self._v_min.value = sample.tau_min, sample.tau_max, sample.v_min
        self._slots.value, self._by.value = request.slots, request.slots_by or UNSAID


class RefineFields:
    """Fields of adaptive refinement, and of its audit fraction."""

    def __init__(self, sheet: str) -> None:
        style: dict[str, Any] = {"sizing_mode": "stretch_width", "margin": (3, 4), "stylesheets": [sheet]}
        self._chosen = pn.widgets.CheckBoxGroup(label="Cells", options=[REFINED], value=[], **style)
        self._audit = pn.widgets.FloatInput(
            label="Share of filled cells that is checked",
            value=AUDIT,
            start=0.0,
            end=1.0,
            step=0.01,
            visible=False,
            **style,
        )
        self._chosen.param.watch(lambda event: self._audit.param.update(visible=bool(event.new)), "value")
        self.widgets = [self._chosen, self._audit]
        self.panel = pn.Column(*self.widgets, sizing_mode="stretch_width", margin=0)

    def fields(self) -> dict[str, Any]:
        """Return the fields of a request."""
        return {"refine": {"audit": self._audit.value} if self._chosen.value else None}

    def fill(self, request: SurveyRequest) -> None:
        """Take over the settings of a survey."""
        self._chosen.value = [REFINED] if request.refine is not None else []
        self._audit.value = request.refine.audit if request.refine is not None else AUDIT
