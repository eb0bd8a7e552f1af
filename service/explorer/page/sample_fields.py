"""Fields of the form for what a survey computes in each cell: quantities, samples, attractors, refinement."""

from __future__ import annotations

from typing import Any

import panel as pn

from gear_rattle.workers import SurveyRequest
from gear_rattle.workers.survey.refined.asked import AUDITED_SHARE
from gear_rattle.workers.survey.request import BY_FAMILY, BY_FRACTION, MAX_SLOTS
from gear_rattle.workers.survey.values.schema import DEFAULT, Group
from rattle.attractors import BUDGET, parse_speed_limit

NO_CHOICE = ""
QUANTITIES = (
    "Groups of variables to store. Attractors has the quiet fraction; intensity has loudness; families joins the "
    "motions of neighbouring cells."
)


class SampleFields:
    """Fields for quantities, samples, attractors and refinement, most of them with a tooltip."""

    def __init__(self, sheet: str) -> None:
        style: dict[str, Any] = {"sizing_mode": "stretch_width", "margin": (3, 4), "stylesheets": [sheet]}
        groups = [str(group) for group in Group]
        self.quantities = pn.widgets.CheckBoxGroup(
            label="Quantities", options=groups, value=[str(group) for group in DEFAULT], inline=True, margin=(0, 4),
            stylesheets=[sheet],
        )  # fmt: skip
        count = pn.widgets.IntInput(
            label="Initial conditions", value=64, start=1, step=64, **style,
            description="Samples in each cell. More of them find rarer motions, and take longer in proportion.",
        )  # fmt: skip
        self._v_max = pn.widgets.TextInput(
            label="Highest speed", placeholder="7, or natural", **style,
            description="Samples start at speeds up to this value, or up to the natural speed of each cell.",
        )  # fmt: skip
        phase: dict[str, Any] = {"start": 0.0, "end": 1.0, "step": 0.05} | style
        about = "Samples start at phases between these two values; 0 to 1 is a whole forcing period."
        tau_min = pn.widgets.FloatInput(label="Phases from", value=0.0, description=about, **phase)
        tau_max = pn.widgets.FloatInput(label="Phases to", value=1.0, description=about, **phase)
        v_min = pn.widgets.FloatInput(
            label="Least speed", value=0.0, start=0.0, step=0.5, **style,
            description="Samples start at speeds of at least this value.",
        )  # fmt: skip
        self._slots = pn.widgets.IntInput(
            label="Attractors listed", value=None, start=1, end=MAX_SLOTS, placeholder="8 or 24", **style,
            description="Largest number of attractors stored for a cell; by default 8, or 24 with families.",
        )  # fmt: skip
        self._by = pn.widgets.Select(
            label="Order attractors by", **style,
            options={"default": NO_CHOICE, "by share": BY_FRACTION, "by family": BY_FAMILY},
            description="By share, the first attractor is the one that most samples reach; by family, each family has "
            "a place of its own.",
        )  # fmt: skip
        budget = pn.widgets.IntInput(
            label="Max. impacts", value=BUDGET, start=1, step=BUDGET, **style,
            description="A sample that makes more impacts before it reaches an attractor is undecided.",
        )  # fmt: skip
        self._seed = pn.widgets.IntInput(
            label="Seed", value=0, start=0, **style,
            description="The same seed draws the same samples; other seeds show how results depend on the samples.",
        )  # fmt: skip
        self._refined = pn.widgets.Select(
            label="Cells", options={"all of them": False, "adaptive refinement": True}, **style,
            description="Adaptive refinement computes few cells first, and more where they differ.",
        )  # fmt: skip
        self._audit = pn.widgets.FloatInput(
            label="Share of filled cells that is checked", value=AUDITED_SHARE, start=0.0, end=1.0, step=0.01,
            visible=False,
            description="This share of filled cells is computed all the same, to bound how many of them are wrong.",
            **style,
        )  # fmt: skip
        self._refined.param.watch(lambda event: self._audit.param.update(visible=bool(event.new)), "value")
        self._sample = {"count": count, "budget": budget, "tau_min": tau_min, "tau_max": tau_max, "v_min": v_min}
        row: dict[str, Any] = {"sizing_mode": "stretch_width"}
        self.panel = pn.Column(
            pn.Row(count, budget, **row),
            pn.Row(v_min, self._v_max, **row),
            pn.Row(tau_min, tau_max, **row),
            pn.Row(self._slots, self._seed, **row),
            self._by,
            pn.Row(
                pn.pane.HTML("<span id=quantities>Quantities</span>", stylesheets=[sheet], margin=(6, 4, 0, 4)),
                pn.widgets.TooltipIcon(value=QUANTITIES, margin=(6, 0, 0, 0)),
            ),
            self.quantities,
            self._refined,
            self._audit,
            margin=0,
            **row,
        )

    def offer_groups(self, groups: list[str]) -> None:
        """Offer these groups of quantities. A chosen group stays chosen if it is offered."""
        self.quantities.param.update(options=groups, value=[each for each in self.quantities.value if each in groups])

    def request_fields(self) -> dict[str, Any]:
        """Return the entered settings as fields of a request."""
        return {
            "quantities": self.quantities.value,
            "initial_conditions": {name: widget.value for name, widget in self._sample.items()}
            | {"v_max": parse_speed_limit(self._v_max.value)},
            "slots": self._slots.value,
            "slots_by": self._by.value or None,
            "refine": {"audit": self._audit.value} if self._refined.value else None,
            "seed": self._seed.value,
        }

    def fill(self, request: SurveyRequest) -> None:
        """Set the fields to the settings of a survey."""
        sample = request.initial_conditions
        self.quantities.value = [str(group) for group in request.quantities]
        for name, widget in self._sample.items():
            widget.value = getattr(sample, name)
        self._v_max.value, self._seed.value = "" if sample.v_max is None else str(sample.v_max), request.seed
        self._slots.value, self._by.value = request.slots, request.slots_by or NO_CHOICE
        self._refined.value = request.refine is not None
        self._audit.value = request.refine.audit if request.refine is not None else AUDITED_SHARE
