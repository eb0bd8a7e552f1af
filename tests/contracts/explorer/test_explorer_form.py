"""The form without a browser: which request it stands for, and back."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

import panel as pn
import pytest
from bokeh.document import Document
from pydantic import ValidationError
from service_support import BODY, no_cluster
from waiting import eventually

import rattle
from gear_rattle.service.access.keys import Caller
from gear_rattle.service.app import create_app
from gear_rattle.service.errors import KernelsNotReadyError
from gear_rattle.service.explorer.common.address import Ranges
from gear_rattle.service.explorer.common.viewer import PageSession
from gear_rattle.service.explorer.page import form as form_module
from gear_rattle.service.explorer.page.form import (
    CELLS,
    FINENESS,
    NAMED_RANGES,
    OWN,
    SurveyForm,
    duration_in_words,
    error_message,
)
from gear_rattle.service.explorer.page.form import MACHINE as IN_MACHINE
from gear_rattle.service.explorer.page.rows import machine_rows
from gear_rattle.service.explorer.places.example import REQUEST as EXAMPLE
from gear_rattle.service.explorer.state.store import window_of_request
from gear_rattle.service.operations.estimate import CostEstimate
from gear_rattle.service.settings import Settings
from gear_rattle.workers import SurveyRequest
from gear_rattle.workers.survey.refined.asked import RefineOptions
from rattle import ParameterError
from rattle.models import Impacting

MACHINE: dict[str, Any] = {
    "inertia": 0.003, "drag": 0.05, "backlash": 100e-6, "radius": 0.05, "drive": "speed",
    "rpm": {"start": 1500.0, "stop": 6000.0, "num": 5}, "eccentricity": {"start": 2e-6, "stop": 60e-6, "num": 4},
}  # fmt: skip
IN_SI = SurveyRequest.model_validate({"machine": MACHINE, "quantities": ["attractors"]})
ASKED = SurveyRequest.model_validate(
    {name: value for name, value in BODY.items() if name != "tile"} | {
        "quantities": ["attractors", "lyapunov", "families"], "slots": 5, "slots_by": "fraction",
        "initial_conditions": {"count": 9, "v_max": 5.0, "v_min": 1.5, "tau_min": 0.1, "tau_max": 0.35},
    }
)  # fmt: skip
STIFF = SurveyRequest.model_validate(
    {name: value for name, value in BODY.items() if name != "tile"}
    | {"model": "stiff", "kappa": 2e4, "quantities": ["region", "orbits"]}
)
MESH: dict[str, Any] = {
    "model": "inelastic", "restitution": 0.9, "harmonics": [(20, 1 / 300, 0.25), (40, 0.001, 0.0)],
    "quantities": ["attractors"],
}  # fmt: skip
HARMONIC = SurveyRequest.model_validate(
    {name: value for name, value in BODY.items() if name != "tile"} | MESH | {"load": 0.5}
)
HARMONIC_IN_SI = SurveyRequest.model_validate(
    {"machine": MACHINE | {"teeth": 20, "driven_teeth": 40, "driven_inertia": 0.02, "driven_drag": 0.06}} | MESH
)
REFINED = ASKED.model_copy(update={"refine": RefineOptions(audit=0.07)})


def with_form(data: Path, body: Callable[[SurveyForm], None]) -> None:
    async def main() -> None:
        app = create_app(Settings(data=data, preload=False, explorer=False), no_cluster)
        async with app.router.lifespan_context(app):
            viewer = PageSession(app.state.front, Caller(), Document())
            body(SurveyForm(viewer, lambda _: None, ""))
            viewer.end()

    asyncio.run(main())


@pytest.mark.parametrize(
    "request_",
    [IN_SI, ASKED, REFINED, STIFF, HARMONIC, HARMONIC_IN_SI],
    ids=["machine", "sample", "refined", "stiff", "harmonics", "harmonics of a machine"],
)
def test_the_form_stands_for_the_survey_that_fills_it(request_: SurveyRequest, tmp_path: Path) -> None:
    def body(form: SurveyForm) -> None:
        form.fill(request_)
        assert SurveyRequest.model_validate(form.request_body()) == request_  # to the bit: the same survey
        assert form.machine.panel.visible == (request_.machine is not None)

    with_form(tmp_path, body)


def test_three_questions_make_a_survey_and_all_else_is_folded(tmp_path: Path) -> None:
    def body(form: SurveyForm) -> None:
        asked = {
            each.label for each in form.panel.select(pn.widgets.WidgetBase) if each.visible and _is_shown(form, each)
        }
        assert asked == {"Plane", "Model", "How fine", "Submit", "Advanced settings"}
        for name, (delta, epsilon) in NAMED_RANGES.items():
            for fine, (across, up) in FINENESS.items():
                form.plane.value, form.fine.value = name, fine
                found = SurveyRequest.model_validate(form.request_body())
                assert (found.delta.start, found.delta.stop) == delta
                assert (found.epsilon.start, found.epsilon.stop) == epsilon
                assert found.shape == (up, across)
                assert f"{across * up:,} cells" in {value: label for label, value in form.fine.options.items()}[fine]
        form.counts[0].value = 7
        assert form.fine.value == OWN
        assert "own: 7 × 120, 840 cells" in form.fine.options
        form.plane.value = IN_MACHINE
        assert [each.label for each in form.counts] == ["rpm values", "µm values"]
        assert SurveyRequest.model_validate(form.request_body()).shape == (120, 7)

    with_form(tmp_path, body)


def test_every_field_has_a_tooltip(tmp_path: Path) -> None:
    def body(form: SurveyForm) -> None:
        own = form.machine.panel.select(pn.widgets.WidgetBase)  # numbers of a drawing, with their units
        ranges = [end for ends in form.axes.values() for end in ends]
        for each in form.panel.select(pn.widgets.WidgetBase):
            if "description" in each.param and each not in (*own, *ranges, *form.added.values()):
                assert isinstance(each, pn.widgets.Button) or each.description, each.label

    with_form(tmp_path, body)


def test_the_cost_follows_when_the_kernels_are_compiled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiling, estimated = asyncio.Event(), CostEstimate(90.0, 2, "measured")

    async def estimate(*_: object) -> CostEstimate:
        if not compiling.is_set():
            compiling.set()
            raise KernelsNotReadyError
        return estimated

    monkeypatch.setattr(form_module, "estimate_cost", estimate)

    async def main() -> None:
        app = create_app(Settings(data=tmp_path, preload=False, explorer=False), no_cluster)
        async with app.router.lifespan_context(app):
            viewer = PageSession(app.state.front, Caller(), Document())
            monkeypatch.setattr(viewer, "schedule_document_change", lambda do: do())  # the document of no browser
            form = SurveyForm(viewer, lambda _: None, "")
            await eventually(lambda: "when the kernels are compiled" in form.cost.object)
            await eventually(lambda: "about 90 s on 2 workers (measured)" in form.cost.object)
            viewer.end()

    asyncio.run(main())


def _is_shown(form: SurveyForm, widget: Any) -> bool:
    """Return whether no layout around a widget is hidden."""
    hidden = [each for each in form.panel.select(pn.Column) if not each.visible]
    return not any(widget in each.select(pn.widgets.WidgetBase) for each in hidden)


def test_harmonics_are_entered_of_the_model_that_takes_them(tmp_path: Path) -> None:
    def body(form: SurveyForm) -> None:
        assert not form.harmonics.visible
        form.model.value = "inelastic"
        assert form.harmonics.visible
        assert SurveyRequest.model_validate(form.request_body()).load == 0.0
        form.harmonics.value = " 20:0.0033:0  40:1e-3:0.25 "
        found = SurveyRequest.model_validate(form.request_body())
        assert found.harmonics == ((20, 0.0033, 0.0), (40, 1e-3, 0.25))
        assert set(found.quantities) == {"attractors", "lyapunov"}  # those of one cosine are not offered
        form.harmonics.value = "20:0.0033"
        with pytest.raises(ParameterError, match="is not ORDER:AMPLITUDE:PHASE: write three numbers, such as"):
            form.request_body()
        form.model.value = "impacting"
        assert SurveyRequest.model_validate(form.request_body()).harmonics == ()
        form.plane.value = IN_MACHINE
        assert "stiff" not in form.model.options.values()

    with_form(tmp_path, body)


def test_what_is_wrong_and_how_long_it_lasts_is_said_in_words() -> None:
    with pytest.raises(ValidationError) as wrong:
        SurveyRequest.model_validate(BODY | {"delta": {"start": 2.0, "stop": 1.0, "num": 3}})
    assert "must be below stop" in error_message(wrong.value)
    assert error_message(ValueError("said already")) == "said already"
    seconds = (0.2, 119.0, 121.0, 7300.0, 200_000.0)
    assert [duration_in_words(each) for each in seconds] == ["1 s", "119 s", "2 min", "2 hours", "2 days"]


def test_a_machine_is_entered_in_the_units_of_a_drawing(tmp_path: Path) -> None:
    def body(form: SurveyForm) -> None:
        form.plane.value = IN_MACHINE
        (backlash,) = (
            each for each in form.machine.panel.select(pn.widgets.FloatInput) if each.label == "Backlash, µm"
        )
        backlash.value = 120.0
        found = SurveyRequest.model_validate(form.request_body())
        machine = rattle.Machine(0.003, 5e-4, 120e-6, 60e-6, 0.05, rpm=1000)
        assert (found.beta, found.delta.stop, found.epsilon.stop) == (machine.beta, machine.delta, machine.epsilon)
        backlash.value = None
        with pytest.raises(ValueError, match=r"machine\.backlash"):
            SurveyRequest.model_validate(form.request_body())
        backlash.value = 120e3
        with pytest.raises(ValueError, match="backlash must be in metres"):
            SurveyRequest.model_validate(form.request_body())

    with_form(tmp_path, body)


def test_a_window_of_a_machine_s_survey_is_saved_in_si(tmp_path: Path) -> None:
    def body(form: SurveyForm) -> None:
        assert IN_SI.machine is not None
        form.set_fields_to_window(((0.05, 0.06), (2e-4, 3e-4)), Impacting(IN_SI.beta), IN_SI.machine)
        found = SurveyRequest.model_validate(form.request_body())
        assert found.machine == IN_SI.machine
        assert (found.delta.start, found.delta.stop) == pytest.approx((0.05, 0.06), rel=1e-3)
        assert (found.epsilon.start, found.epsilon.stop) == pytest.approx((2e-4, 3e-4), rel=1e-3)
        ends = {end.label: end.value for end in form.machine.panel.select(pn.widgets.FloatInput)}
        for label in ("rpm from", "rpm to", "µm from", "µm to"):
            assert len(f"{ends[label]!r}".replace(".", "")) <= 6, ends[label]  # no digits below a thousandth
        assert found.shape == CELLS[::-1]
        form.set_fields_to_window(((0.0, 0.06), (0.0, 3e-4)), Impacting(IN_SI.beta), IN_SI.machine)  # zoomed out
        assert SurveyRequest.model_validate(form.request_body()).delta.start == pytest.approx(6e-3, rel=1e-3)
        form.set_fields_to_window(((0.5, 0.6), (0.1, 0.2)), Impacting(0.6))
        assert SurveyRequest.model_validate(form.request_body()).machine is None

    with_form(tmp_path, body)


def test_a_window_becomes_ranges_that_a_survey_may_have_in_few_digits(tmp_path: Path) -> None:
    whole = window_of_request(SurveyRequest(delta=(0.4, 1.0, 31), epsilon=(0.005, 0.3, 30)))
    assert whole[1][0] < 0  # half a cell below the lowest
    cases: list[tuple[Ranges, Ranges]] = [
        (whole, ((0.39, 1.01), (0.0, 0.3051))),
        (window_of_request(EXAMPLE), ((0.4, 1.0), (0.0, 0.3))),
        (((-0.3, 0.9), (-0.5, 0.123456789)), ((0.0009, 0.9), (0.0, 0.1235))),
        (((0.7701518723, 0.7701518743), (0.0978, 0.0979)), ((0.7701518723, 0.7701518743), (0.0978, 0.0979))),
    ]

    def body(form: SurveyForm) -> None:
        for window, (delta, epsilon) in cases:
            form.set_fields_to_window(window, Impacting(0.6))
            found = SurveyRequest.model_validate(form.request_body())
            assert (found.delta.start, found.delta.stop) == delta
            assert (found.epsilon.start, found.epsilon.stop) == epsilon

    with_form(tmp_path, body)


def test_a_survey_of_a_machine_is_listed_in_si() -> None:
    said = dict(machine_rows(IN_SI))
    assert said["speed"] == "1500 … 6000 rpm"
    assert said["eccentricity"] == "2 … 60 µm"
    assert said["base radius"] == "50 mm"
    assert machine_rows(ASKED) == []
