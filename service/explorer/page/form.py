"""The form that submits a survey, with what it will cost said before."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from html import escape
from typing import Any

import panel as pn
from pydantic import ValidationError

from gear_rattle.service.database.tables import Scope
from gear_rattle.service.explorer.common.address import Pair
from gear_rattle.service.explorer.common.changes import in_event_loop
from gear_rattle.service.explorer.common.viewer import Viewer
from gear_rattle.service.explorer.common.watch import on_press
from gear_rattle.service.explorer.page.machine_axes import MachineAxes
from gear_rattle.service.explorer.page.sample_fields import RefineFields, SampleFields
from gear_rattle.service.harmonics import EXAMPLE, SHAPE, read_harmonics, written_harmonics
from gear_rattle.service.operations.estimate import CostEstimate, estimate
from gear_rattle.service.operations.limits import check_limits
from gear_rattle.service.operations.surveys import submit_survey
from gear_rattle.service.web.problems import field_errors_of
from gear_rattle.workers import SurveyRequest
from gear_rattle.workers.survey.machine import SurveyedMachine
from gear_rattle.workers.survey.values.quantities import groups_of
from gear_rattle.workers.survey.values.schema import DEFAULT, Group
from rattle import RattleError
from rattle.attractors import BUDGET, read_speed
from rattle.models import ADDED, BETA, DEFAULT_MODEL, MODELS, Model
from rattle.parameters import Harmonic

PATIENCE = 0.4  # seconds without a change, then the cost is estimated
CELLS = 61  # along each axis of a window that is to be saved


class Form:
    """The form; `on_submitted` is called with the id of the survey."""

    def __init__(self, viewer: Viewer, on_submitted: Callable[[str], None], sheet: str) -> None:
        self._viewer, self._on_submitted = viewer, on_submitted
        self._estimating: asyncio.Task[None] | None = None
        number: dict[str, Any] = {"sizing_mode": "stretch_width", "margin": (3, 4), "stylesheets": [sheet]}
        self.name = pn.widgets.TextInput(label="Name", max_length=200, **number)
        ways = {"damping δ, eccentricity ε": False, "a machine: rpm, µm": True}
        self.in_si = pn.widgets.Select(label="Axes", options=ways, **number)
        self.machine, self.sample, self.refine = MachineAxes(sheet), SampleFields(sheet), RefineFields(sheet)
        self.beta = pn.widgets.FloatInput(label="Half-backlash β", value=BETA.default, step=0.05, **number)
        self.model = pn.widgets.Select(
            label="Model", options={each.title: name for name, each in MODELS.items()}, **number
        )
        self.added = {
            name: pn.widgets.FloatInput(
                label=f"{each.label.capitalize()} {each.symbol}",
                value=each.example if each.default is None else each.default,
                start=each.least,
                visible=False,
                **number,
            )
            for name, each in ADDED.items()
        }
        self.harmonics = pn.widgets.TextInput(
            label=f"Harmonics, {SHAPE}", placeholder=f"none; several with spaces, such as {EXAMPLE}", visible=False,
            **number,
        )  # fmt: skip
        exact: dict[str, Any] = number | {"step": 0.05, "format": "0[.][0000000000000000]"}
        self.axes = {
            name: (
                pn.widgets.FloatInput(label=f"{letter} from", value=start, **exact),
                pn.widgets.FloatInput(label=f"{letter} to", value=stop, **exact),
                pn.widgets.IntInput(label=f"{letter} values", value=num, start=2, step=10, **number),
            )
            for name, letter, start, stop, num in (("delta", "δ", 0.4, 1.0, 61), ("epsilon", "ε", 0.005, 0.3, 60))
        }  # fmt: skip
        self.quantities = pn.widgets.CheckBoxGroup(
            label="Quantities", options=[str(group) for group in Group], value=[str(group) for group in DEFAULT],
            inline=True, margin=(0, 4), stylesheets=[sheet],
        )  # fmt: skip
        self.count = pn.widgets.IntInput(label="Initial conditions", value=64, start=1, step=64, **number)
        self.v_max = pn.widgets.TextInput(label="Highest speed", placeholder="7, or natural", **number)
        self.budget = pn.widgets.IntInput(label="Max. impacts", value=BUDGET, start=1, step=BUDGET, **number)
        self.seed = pn.widgets.IntInput(label="Seed", value=0, start=0, **number)
        self.submit = pn.widgets.Button(
            label="Submit", color="primary", css_classes=["submit"], margin=(8, 4), stylesheets=[sheet]
        )
        self.cost = pn.pane.HTML(
            "", css_classes=["cost"], margin=(4, 4), sizing_mode="stretch_width", stylesheets=[sheet]
        )
        for widget in (self.model, self.harmonics):
            widget.param.watch(in_event_loop(lambda _event: self._on_model()), "value")
        self.in_si.param.watch(in_event_loop(lambda _event: self._on_way()), "value")
        for widget in self._widgets():
            widget.param.watch(in_event_loop(lambda _event: self._changed()), "value")
        on_press(self.submit, lambda: viewer.start(self._submit()))
        self._plain = pn.Column(
            *(pn.Row(*three, sizing_mode="stretch_width") for three in self.axes.values()),
            self.beta,
            sizing_mode="stretch_width", margin=0,
        )  # fmt: skip
        self.panel = pn.Column(
            self.name,
            self.in_si,
            self._plain,
            self.machine.panel,
            self.model,
            pn.Row(*self.added.values(), sizing_mode="stretch_width"),
            self.harmonics,
            pn.Row(self.count, self.v_max, sizing_mode="stretch_width"),
            self.sample.panel,
            pn.Row(self.budget, self.seed, sizing_mode="stretch_width"),
            pn.pane.HTML("<span id=quantities>Quantities</span>", margin=(6, 4, 0, 4)),
            self.quantities,
            self.refine.panel,
            self.cost,
            self.submit,
            css_classes=["form"],
            sizing_mode="stretch_width",
        )
        self._changed()

    def _widgets(self) -> list[Any]:
        return [
            self.name, self.model, *self.added.values(), self.harmonics, self.beta,
            *(widget for three in self.axes.values() for widget in three),
            self.quantities, self.count, self.v_max, self.budget, self.seed, self.in_si, *self.machine.widgets,
            *self.sample.widgets, *self.refine.widgets,
        ]  # fmt: skip

    def fill(self, request: SurveyRequest) -> None:
        """Take over the settings of a survey."""
        self.name.value = request.name
        self.in_si.value = request.machine is not None
        self.fill_model(request.gear_model)
        for name, (start, stop, num) in self.axes.items():
            axis = getattr(request, name)
            start.value, stop.value, num.value = axis.start, axis.stop, axis.num
        if request.machine is not None:
            self.machine.fill(request, request.machine)
        self.fill_sample(request)

    def fill_model(self, model: Model) -> None:
        """Take over a model with its parameters."""
        self.beta.value, self.model.value = model.beta, model.name
        for each in model.added:
            self.added[each.name].value = model.numbers[each.name]
        self.harmonics.value = " ".join(written_harmonics(model.at(1.0, 0.0).harmonics))

    def fill_window(self, delta: Pair, epsilon: Pair, model: Model, machine: SurveyedMachine | None = None) -> None:
        """Take over a window of the plane, of a machine where the survey is of one."""
        self.in_si.value = machine is not None
        self.fill_model(model)
        if machine is not None:
            self.machine.fill_window(delta, epsilon, machine)
            self.machine.fill_counts(CELLS)
        for (start, stop, num), window in zip(self.axes.values(), (delta, epsilon), strict=True):
            start.value, stop.value, num.value = *window, CELLS

    def fill_sample(self, request: SurveyRequest) -> None:
        """Take over what a survey computes in a cell."""
        self.quantities.value = [str(group) for group in request.quantities]
        sample = request.initial_conditions
        self.count.value, self.budget.value = sample.count, sample.budget
        self.v_max.value = "" if sample.v_max is None else str(sample.v_max)
        self.sample.fill(request)
        self.refine.fill(request)
        self.seed.value = request.seed

    def fields(self) -> dict[str, Any]:
        """Return the body of `POST /v1/surveys` that the form stands for."""
        return {
            "name": self.name.value,
            **(self.machine.fields() if self.in_si.value else self._plain_fields()),
            **self._model_fields(),
            "quantities": self.quantities.value,
            "initial_conditions": {
                "count": self.count.value,
                "v_max": read_speed(self.v_max.value),
                "budget": self.budget.value,
                **self.sample.box(),
            },
            **self.sample.slots(),
            **self.refine.fields(),
            "seed": self.seed.value,
        }

    def _plain_fields(self) -> dict[str, Any]:
        """Return the axes and the backlash in the model's own numbers."""
        axes = {
            name: {"start": start.value, "stop": stop.value, "num": num.value}
            for name, (start, stop, num) in self.axes.items()
        }
        return {"beta": self.beta.value, **axes}

    def _model_fields(self) -> dict[str, Any]:
        """Return the model with its numbers and harmonics. Raises ParameterError on harmonics that are none."""
        own = self._own
        added = {name: widget.value if name in own else None for name, widget in self.added.items()}
        return {"model": self.model.value, **added, "harmonics": self._written_harmonics()}

    def _written_harmonics(self) -> tuple[Harmonic, ...]:
        takes = MODELS[self.model.value].takes_harmonics
        return read_harmonics(self._harmonic_texts) if takes else ()

    @property
    def _harmonic_texts(self) -> list[str]:
        return (self.harmonics.value or "").split()

    @property
    def _own(self) -> set[str]:
        """Numbers of the model; without those that a machine has at each speed another one of."""
        added = MODELS[self.model.value].added
        return {each.name for each in added if not (self.in_si.value and each.machine_number)}

    def _on_way(self) -> None:
        """Ask for the numbers of a machine, or for the model's."""
        in_si = bool(self.in_si.value)
        self._plain.visible, self.machine.panel.visible = not in_si, in_si
        options = {each.title: name for name, each in MODELS.items() if not (in_si and is_stiff(each))}
        value = self.model.value if self.model.value in options.values() else DEFAULT_MODEL
        self.model.param.update(options=options, value=value)
        self._on_model()

    def _on_model(self) -> None:
        """Offer what the model has."""
        has_harmonics = MODELS[self.model.value].takes_harmonics and bool(self._harmonic_texts)
        offered = [str(group) for group in groups_of(self.model.value, has_harmonics)]
        left = [name for name in self.quantities.value if name in offered]
        self.harmonics.visible = MODELS[self.model.value].takes_harmonics
        for name, widget in self.added.items():
            widget.visible = name in self._own
        self.quantities.param.update(options=offered, value=left)

    def _changed(self) -> None:
        if self._estimating is not None:
            self._estimating.cancel()
        self._estimating = self._viewer.start(self._estimate())

    async def _estimate(self) -> None:
        await asyncio.sleep(PATIENCE)
        try:
            request = SurveyRequest.model_validate(self.fields())
            check_limits(request, self._viewer.front.settings)
        except (ValidationError, RattleError) as error:
            self._say(what_is_wrong(error), wrong=True)
            return
        size = f"{request.n_cells:,} cells"
        self._say(f"{size}: the cost is being estimated …")
        try:
            found = await estimate(self._viewer.front, request)
        except RattleError as error:
            self._say(f"{size}; {error}")
        else:
            self._say(f"{size}, {cost_in_words(found)}")

    async def _submit(self) -> None:
        def submit() -> str:
            request = SurveyRequest.model_validate(self.fields())
            return submit_survey(self._viewer.front, self._viewer.require(Scope.SUBMIT), request).id

        try:
            survey_id = await self._viewer.read(submit, Scope.SUBMIT)
        except (ValidationError, RattleError) as error:
            self._say(what_is_wrong(error), wrong=True)
        else:
            self._viewer.change(lambda: self._on_submitted(survey_id))

    def _say(self, text: str, wrong: bool = False) -> None:
        said = f'<p role="{"alert" if wrong else "status"}" class="{"wrong" if wrong else ""}">{escape(text)}</p>'

        def write() -> None:
            self.cost.object = said
            self.submit.disabled = wrong or not self._viewer.may_submit()

        self._viewer.change(write)


def is_stiff(model: type[Model]) -> bool:
    """Return whether a model needs a number that a machine has at each speed another one of, as a stiffness is."""
    return any(each.machine_number and each.default is None for each in model.added)


def what_is_wrong(error: Exception) -> str:
    """Return the first thing that is wrong with a request, in words."""
    if isinstance(error, ValidationError):
        first = field_errors_of(error.errors())[0]
        return f"{first.field}: {first.message}" if first.field else first.message
    return str(error)


def cost_in_words(found: CostEstimate) -> str:
    """Return a cost, and what it rests on."""
    about = "at most about" if found.is_most else "about"
    return f"{about} {lasting(found.seconds)} on {found.workers} worker{'s' * (found.workers != 1)} ({found.basis})"


def lasting(seconds: float) -> str:
    """Return a duration in the unit that suits it."""
    for unit, size in (("days", 172_800.0), ("hours", 7200.0), ("min", 120.0)):
        if seconds >= size:
            whole = {"days": 86_400.0, "hours": 3600.0, "min": 60.0}[unit]
            return f"{seconds / whole:.0f} {unit}"
    return f"{max(seconds, 1.0):.0f} s"
