"""Form for a new survey: its plane, its model and its number of cells. It shows the cost before submission."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from html import escape
from typing import Any

import panel as pn
from pydantic import ValidationError

from gear_rattle.service.access.keys import Caller
from gear_rattle.service.database.tables import Scope
from gear_rattle.service.errors import KernelsNotReadyError
from gear_rattle.service.explorer.common.address import Ranges
from gear_rattle.service.explorer.common.changes import handler_in_event_loop
from gear_rattle.service.explorer.common.viewer import PageSession
from gear_rattle.service.explorer.common.watch import call_on_press
from gear_rattle.service.explorer.design.axes import round_range_ends
from gear_rattle.service.explorer.page.machine_axes import MachineSurveyFields
from gear_rattle.service.explorer.page.sample_fields import SampleFields
from gear_rattle.service.harmonics import EXAMPLE, SHAPE, harmonic_texts, read_harmonics
from gear_rattle.service.operations.estimate import CostEstimate, estimate_cost
from gear_rattle.service.operations.limits import require_within_service_limits
from gear_rattle.service.operations.surveys import submit_survey
from gear_rattle.service.operations.windows import clip_to_plane
from gear_rattle.service.web.problems import field_errors_of
from gear_rattle.workers import SurveyRequest
from gear_rattle.workers.survey.machine import SurveyedMachine
from gear_rattle.workers.survey.values.quantities import variable_groups_of_model
from rattle import RattleError
from rattle.models import ADDED, BETA, DEFAULT_MODEL, MODELS, Model
from rattle.plot import FIGURE_8

ESTIMATE_DELAY = 0.4  # seconds without a change of a field, after which the cost is estimated
OWN, MACHINE = "own", "machine"
#: Ranges of δ and ε that have a name; the first is the plane of the paper's Figure 7, without its edge ε = 0.
NAMED_RANGES: dict[str, Ranges] = {
    "Figure 7: δ 0.4 to 1, ε up to 0.3": ((0.4, 1.0), (0.005, 0.3)),
    "Figure 8: where curves meet": FIGURE_8,
}
PLANES = {name: name for name in NAMED_RANGES} | {"own ranges of δ and ε": OWN, "a machine: rpm, µm": MACHINE}
# numbers of values along δ and ε, or along the speed and the eccentricity of a machine
FINENESS = {"coarse": (31, 30), "medium": (61, 60), "fine": (121, 120)}
FINENESS_OPTIONS = {f"{name}: {across} × {up}, {across * up:,} cells": name for name, (across, up) in FINENESS.items()}
CELLS = FINENESS["medium"]  # numbers of values along δ and ε: the defaults of the form
ADVANCED = "Advanced settings"


class SurveyForm:
    """The form for a new survey; `on_submitted` is called with the id of each submitted survey."""

    def __init__(self, viewer: PageSession, on_submitted: Callable[[str], None], sheet: str) -> None:
        self._viewer, self._on_submitted = viewer, on_submitted
        self._estimating: asyncio.Task[None] | None = None
        row: dict[str, Any] = {"sizing_mode": "stretch_width"}
        style: dict[str, Any] = row | {"margin": (3, 4), "stylesheets": [sheet]}
        exact: dict[str, Any] = style | {"step": 0.05}
        self.plane = pn.widgets.Select(
            label="Plane", options=PLANES, **style,
            description="The part of the plane of damping and eccentricity that is mapped, or a machine's speeds.",
        )  # fmt: skip
        self.axes = {
            name: (
                pn.widgets.FloatInput(label=f"{letter} from", value=span[0], **exact),
                pn.widgets.FloatInput(label=f"{letter} to", value=span[1], **exact),
            )
            for name, letter, span in zip(("delta", "epsilon"), "δε", NAMED_RANGES[self.plane.value], strict=True)
        }
        self._ranges = pn.Column(*(pn.Row(*ends, **row) for ends in self.axes.values()), margin=0, visible=False, **row)
        self.machine, self.sample = MachineSurveyFields(sheet), SampleFields(sheet)
        self.model = pn.widgets.Select(
            label="Model", options={each.title: name for name, each in MODELS.items()}, **style,
            description="Impacting: rigid teeth, as in the paper. Stiff walls: teeth that give way. Inelastic impacts: "
            "restitution, load and a forcing of several harmonics.",
        )  # fmt: skip
        self.added = {
            name: pn.widgets.FloatInput(
                label=f"{each.label.capitalize()} {each.symbol}",
                value=each.example if each.default is None else each.default,
                start=each.least,
                visible=False,
                **style,
            )
            for name, each in ADDED.items()
        }
        self.fine = pn.widgets.Select(
            label="How fine", options=FINENESS_OPTIONS, value="medium", **style,
            description="Each cell is one point of the plane. Coarse is computed first to see where to look closer.",
        )  # fmt: skip
        self.submit = pn.widgets.Button(
            label="Submit", color="primary", css_classes=["submit"], margin=(8, 4), stylesheets=[sheet]
        )
        self.cost = pn.pane.HTML("", css_classes=["cost"], margin=(4, 4), stylesheets=[sheet], **row)
        self.name = pn.widgets.TextInput(
            label="Name", max_length=200, description="Shown in the list of surveys, and in its files.", **style
        )
        about = "Values along this axis, both ends included."
        self.counts = [
            pn.widgets.IntInput(label="", value=num, start=2, step=10, description=about, **style) for num in CELLS
        ]
        self.beta = pn.widgets.FloatInput(
            label="Half-backlash β", value=BETA.default, step=0.05, **style,
            description="Half of the clearance between the teeth; the paper has 0.6.",
        )  # fmt: skip
        self.harmonics = pn.widgets.TextInput(
            label=f"Harmonics, {SHAPE}", placeholder=f"none; several with spaces, such as {EXAMPLE}", visible=False,
            description="Harmonics of the transmission error: amplitude relative to the first, phase in turns.",
            **style,
        )  # fmt: skip
        self._advanced = pn.Column(
            self.name, pn.Row(*self.counts, **row), self.beta, self.machine.optional, self.harmonics, self.sample.panel,
            visible=False, margin=0, **row,
        )  # fmt: skip
        self._more = pn.widgets.Button(label=ADVANCED, css_classes=["advanced"], margin=(4, 4), stylesheets=[sheet])
        call_on_press(self._more, self._toggle_advanced)
        call_on_press(self.submit, self._start_submission)
        self.panel = pn.Column(
            self.plane, self._ranges, self.machine.panel, self.model, pn.Row(*self.added.values(), **row), self.fine,
            pn.Row(self.submit, self.cost, **row), self._more, self._advanced, css_classes=["form"], **row,
        )  # fmt: skip
        for widget, used in (
            (self.plane, self._on_plane_change),
            (self.model, self._on_model_change),
            (self.harmonics, self._on_model_change),
            (self.fine, self._on_fineness_change),
            *((count, self._on_count) for count in self.counts),
        ):
            widget.param.watch(handler_in_event_loop(used), "value")
        for widget in self.panel.select(pn.widgets.WidgetBase):
            if not isinstance(widget, pn.widgets.Button):
                widget.param.watch(handler_in_event_loop(self._estimate_cost_later), "value")
        self._on_plane_change()
        self._estimate_cost_later()

    def fill(self, request: SurveyRequest) -> None:
        """Set the fields to the settings of a survey."""
        self.name.value = request.name
        delta, epsilon = request.delta, request.epsilon
        spans = (delta.start, delta.stop), (epsilon.start, epsilon.stop)
        self._fill_plane_fields(spans, (delta.num, epsilon.num), request.gear_model, request.machine)
        self.sample.fill(request)

    def set_fields_to_window(self, window: Ranges, model: Model, machine: SurveyedMachine | None = None) -> None:
        """Set the fields to the part of a window that a survey may cover (δ > 0, ε ≥ 0), rounded to few digits.

        If a machine is given, set also its fields: its numbers, and its speeds and eccentricities in the window.
        """
        delta, epsilon = (round_range_ends(*span) for span in clip_to_plane(*window))
        self._fill_plane_fields((delta, epsilon), CELLS, model, machine, is_rounded=True)

    def _fill_plane_fields(
        self,
        window: Ranges,
        counts: tuple[int, int],
        model: Model,
        machine: SurveyedMachine | None,
        is_rounded: bool = False,
    ) -> None:
        for (start, stop), span in zip(self.axes.values(), window, strict=True):
            start.value, stop.value = span
        for widget, count in zip(self.counts, counts, strict=True):
            widget.value = count
        if machine is not None:
            self.machine.fill(*window, machine, is_rounded)
        named = next((name for name, ranges in NAMED_RANGES.items() if ranges == window), OWN)
        self.plane.value = named if machine is None else MACHINE
        self.beta.value, self.model.value = model.beta, model.name
        for each in model.added:
            self.added[each.name].value = model.numbers[each.name]
        self.harmonics.value = " ".join(harmonic_texts(model.parameters_at(1.0, 0.0).harmonics))

    @property
    def _is_machine_plane(self) -> bool:
        return bool(self.plane.value == MACHINE)

    def request_body(self) -> dict[str, Any]:
        """Return the settings as the body of `POST /v1/surveys`. Raises ParameterError if harmonics cannot be read."""
        counts = [widget.value for widget in self.counts]
        own = self._entered_parameters
        return {
            "name": self.name.value,
            **(self.machine.request_fields(counts) if self._is_machine_plane else self._fields_without_machine(counts)),
            "model": self.model.value,
            **{name: widget.value if name in own else None for name, widget in self.added.items()},
            "harmonics": read_harmonics(self._harmonic_texts),
            **self.sample.request_fields(),
        }

    def _fields_without_machine(self, counts: list[int | None]) -> dict[str, Any]:
        """Return the axes δ and ε and the half-backlash β, for a survey without a machine."""
        axes = {
            name: {"start": start.value, "stop": stop.value, "num": num}
            for (name, (start, stop)), num in zip(self.axes.items(), counts, strict=True)
        }
        return {"beta": self.beta.value, **axes}

    @property
    def _harmonic_texts(self) -> list[str]:
        return (self.harmonics.value or "").split() if MODELS[self.model.value].takes_harmonics else []

    @property
    def _entered_parameters(self) -> set[str]:
        """Names of the model's additional parameters that a viewer enters, because no machine determines them."""
        added = MODELS[self.model.value].added
        return {each.name for each in added if not (self._is_machine_plane and each.machine_number)}

    def _on_plane_change(self, *_: Any) -> None:
        """Show the fields of the chosen plane (ranges of δ and ε, or a machine), and offer the models it allows."""
        for ends, span in zip(self.axes.values(), NAMED_RANGES.get(self.plane.value, ()), strict=False):
            ends[0].value, ends[1].value = span
        self._ranges.visible = self.plane.value == OWN
        self.machine.panel.visible = self.machine.optional.visible = self._is_machine_plane
        self.beta.visible = not self._is_machine_plane
        for count, letter in zip(self.counts, ("rpm", "µm") if self._is_machine_plane else "δε", strict=True):
            count.label = f"{letter} values"
        options = {
            each.title: name
            for name, each in MODELS.items()
            if not (self._is_machine_plane and has_machine_parameter(each))
        }
        value = self.model.value if self.model.value in options.values() else DEFAULT_MODEL
        self.model.param.update(options=options, value=value)
        self._on_model_change()

    def _on_model_change(self, *_: Any) -> None:
        """Show the fields of the chosen model's parameters, and offer its quantities."""
        self.harmonics.visible = MODELS[self.model.value].takes_harmonics
        for name, widget in self.added.items():
            widget.visible = name in self._entered_parameters
        self.sample.offer_groups(
            [str(group) for group in variable_groups_of_model(self.model.value, bool(self._harmonic_texts))]
        )

    def _on_fineness_change(self, *_: Any) -> None:
        for widget, count in zip(self.counts, FINENESS.get(self.fine.value, ()), strict=False):
            widget.value = count

    def _on_count(self, *_: Any) -> None:
        counts = across, up = tuple(widget.value or 0 for widget in self.counts)
        known = next((name for name, each in FINENESS.items() if each == counts), OWN)
        own = {} if known != OWN else {f"own: {across} × {up}, {across * up:,} cells": OWN}
        self.fine.param.update(options=FINENESS_OPTIONS | own, value=known)

    def _toggle_advanced(self) -> None:
        self._advanced.visible = not self._advanced.visible
        self._more.label = "Hide advanced settings" if self._advanced.visible else ADVANCED

    def _start_submission(self) -> None:
        self._viewer.start(self._submit())

    def _estimate_cost_later(self, *_: Any) -> None:
        if self._estimating is not None:
            self._estimating.cancel()
        self._estimating = self._viewer.start(self._estimate_cost())

    async def _estimate_cost(self) -> None:
        await asyncio.sleep(ESTIMATE_DELAY)
        try:
            request = SurveyRequest.model_validate(self.request_body())
            require_within_service_limits(request, self._viewer.front.settings)
        except (ValidationError, RattleError) as error:
            self._show_cost(error_message(error), wrong=True)
            return
        size = f"{request.n_cells:,} cells"
        self._show_cost(f"{size}: the cost is being estimated …")
        try:
            while (found := await self._estimate_unless_compiling(request)) is None:
                self._show_cost(f"{size}; their cost is estimated when the kernels are compiled, once after an update")
                await asyncio.sleep(ESTIMATE_DELAY)
        except RattleError as error:
            self._show_cost(f"{size}; {error}")
        else:
            self._show_cost(f"{size}, {cost_in_words(found)}")

    async def _estimate_unless_compiling(self, request: SurveyRequest) -> CostEstimate | None:
        try:
            return await estimate_cost(self._viewer.front, request)
        except KernelsNotReadyError:  # after the longest wait of a request, which a compilation may exceed
            return None

    async def _submit(self) -> None:
        def submit(caller: Caller) -> str:
            return submit_survey(self._viewer.front, caller, SurveyRequest.model_validate(self.request_body())).id

        try:
            survey_id = await self._viewer.run_as_caller(submit, Scope.SUBMIT)
        except (ValidationError, RattleError) as error:
            self._show_cost(error_message(error), wrong=True)
        else:
            self._viewer.schedule_document_change(lambda: self._on_submitted(survey_id))

    def _show_cost(self, text: str, wrong: bool = False) -> None:
        said = f'<p role="{"alert" if wrong else "status"}" class="{"wrong" if wrong else ""}">{escape(text)}</p>'

        def write() -> None:
            self.cost.object = said
            self.submit.disabled = wrong or not self._viewer.may_submit()

        self._viewer.schedule_document_change(write)


def has_machine_parameter(model: type[Model]) -> bool:
    """Return whether a model has a parameter that follows from a machine and has no default, such as κ."""
    return any(each.machine_number and each.default is None for each in model.added)


def error_message(error: Exception) -> str:
    """Return the message of an error; if several fields of a request are invalid, the message of the first one."""
    if isinstance(error, ValidationError):
        first = field_errors_of(error.errors())[0]
        return f"{first.field}: {first.message}" if first.field else first.message
    return str(error)


def cost_in_words(found: CostEstimate) -> str:
    """Return an estimated cost in words: the duration, the number of workers and the basis of the estimate."""
    about = "at most about" if found.is_upper_bound else "about"
    workers = f"{found.workers} worker{'s' * (found.workers != 1)}"
    return f"{about} {duration_in_words(found.seconds)} on {workers} ({found.basis})"


def duration_in_words(seconds: float) -> str:
    """Return a duration in words, in seconds, minutes, hours or days."""
    for unit, size in (("days", 172_800.0), ("hours", 7200.0), ("min", 120.0)):
        if seconds >= size:
            whole = {"days": 86_400.0, "hours": 3600.0, "min": 60.0}[unit]
            return f"{seconds / whole:.0f} {unit}"
    return f"{max(seconds, 1.0):.0f} s"
