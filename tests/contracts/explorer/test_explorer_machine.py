"""The map of a machine's survey, and points that are entered, without a browser."""

import re
from collections.abc import Coroutine
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

import numpy as np
import panel as pn
import pytest
import test_explorer_view as views
from service_support import BODY
from test_explorer_view import Shown, accepted, cells, done, with_map
from waiting import eventually

import rattle
from gear_rattle.service.explorer.common.address import EnteredMachine, View
from gear_rattle.service.explorer.common.point_state import PointTabsState, PointTolerances
from gear_rattle.service.explorer.design.fields import POINT, MachineFields
from gear_rattle.service.explorer.design.tolerance import numbers_with_tolerances, tolerance_outline
from gear_rattle.service.explorer.map.overlays import curve_pieces
from gear_rattle.service.explorer.map.readout import cell_tables
from gear_rattle.service.explorer.point.state import machine_and_model
from gear_rattle.service.explorer.point.work import PointTasks
from gear_rattle.service.explorer.state.store import window_of_request
from gear_rattle.service.state import ApplicationState
from gear_rattle.workers import SurveyRequest
from gear_rattle.workers.pictures.look import LINES
from rattle.models import Impacting, model_of_gear

pytestmark = pytest.mark.usefixtures("templates_once")

NUMBERS: dict[str, Any] = {"inertia": 0.003, "drag": 0.05, "backlash": 100e-6, "radius": 0.05}
MACHINE = SurveyRequest.model_validate(
    {
        "machine": NUMBERS
        | {
            "rpm": {"start": 1500.0, "stop": 6000.0, "num": 3},
            "eccentricity": {"start": 2e-6, "stop": 60e-6, "num": 3},
        },
        "quantities": ["region"],
    }
)
ENTERED = EnteredMachine(**NUMBERS, eccentricity=20e-6, rpm=3000.0, stiffness=3e8)


@pytest.fixture(autouse=True)
def _no_points(monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts of points are not computed."""

    def start(_work: Any, part: Coroutine[Any, Any, None], _instead_of: Any = None) -> None:
        part.close()

    monkeypatch.setattr(PointTasks, "start", start)


def test_speed_and_eccentricity_are_the_axes_of_a_machine_only(tmp_path: Path) -> None:
    async def body(front: ApplicationState, shown: Shown) -> None:
        plot = shown.map.figure
        speed, eccentricity = (plot.select_one({"name": name}) for name in ("rpm", "eccentricity"))

        def visible(*sides: str) -> list[list[str | None]]:
            return [[each.axis_label for each in getattr(plot, side) if each.visible] for side in sides]

        shown.choose(done(front, MACHINE))
        await eventually(lambda: cells(shown) == 1)
        assert visible("below", "left", "above") == [["speed, rpm"], ["eccentricity, µm"], ["damping δ"]]
        assert "eccentricity ε" in visible("right")[0]
        machine = rattle.Machine(**NUMBERS, eccentricity=20e-6, rpm=3000)
        assert speed.ticker.args["scale"] / machine.delta == pytest.approx(3000)
        assert eccentricity.ticker.args["scale"] * machine.epsilon == pytest.approx(20)
        assert plot.x_range.start > plot.x_range.end  # speeds grow to the right
        assert plot.y_range.start < plot.y_range.end
        shown.moved((machine.delta, 1.1 * machine.delta), (0.0, machine.epsilon))
        shown.reset()
        assert (plot.x_range.end, plot.x_range.start) == shown.store.window[0]
        shown.choose(accepted(front, views.REGIONS))
        assert visible("below", "left", "above") == [["damping δ"], ["eccentricity ε"], []]
        assert plot.x_range.start < plot.x_range.end

    with_map(tmp_path, body)


def test_an_arrow_to_the_right_goes_to_a_higher_speed(tmp_path: Path) -> None:
    async def body(front: ApplicationState, shown: Shown) -> None:
        def cursor(number: int, steps: list[int]) -> tuple[float, float]:
            shown.map.figure.tags[0].data = {"steps": steps, "word": [""] * 4, "number": [number] * 4}
            said = shown.panel.parts["said"].object.text
            (speed,), (eccentricity,) = re.findall(r"([\d.]+) rpm", said), re.findall(r"([\d.]+) µm", said)
            return float(speed), float(eccentricity)

        shown.choose(done(front, MACHINE))
        await eventually(lambda: cells(shown) == 1)
        (slow, below), (fast, same), (still, above) = (
            cursor(number, steps) for number, steps in enumerate(([-1, 0, 0, 0], [2, 0, 0, 0], [0, 2, 0, 0]))
        )
        assert slow < fast == still
        assert below == same < above

    with_map(tmp_path, body)


def test_the_key_of_a_machine_lists_lines_of_its_plane_only(tmp_path: Path) -> None:
    async def body(front: ApplicationState, shown: Shown) -> None:
        def listed() -> set[str]:
            return {each["name"] for each in shown.panel.parts["key"][0].overlays}

        shown.choose(done(front, MACHINE))
        window = window_of_request(MACHINE)
        there = {name for name in MACHINE.gear_model.curve_names if curve_pieces(name, MACHINE.gear_model, *window)[0]}
        assert there < set(MACHINE.gear_model.curve_names)
        await eventually(lambda: listed() == there | {"crisis", "design_limit"})
        shown.choose(accepted(front, views.REGIONS))
        assert listed() == set(LINES)

    with_map(tmp_path, body)


def test_the_tolerances_of_an_open_point_are_drawn(tmp_path: Path) -> None:
    async def body(front: ApplicationState, shown: Shown) -> None:
        shown.choose(done(front, MACHINE))
        await eventually(lambda: cells(shown) == 1)
        machine = rattle.Machine(**NUMBERS, eccentricity=20e-6, rpm=3000)
        shown.open((machine.delta, machine.epsilon))
        drawn = shown.map.ellipse_at
        assert not len(drawn.data["x"])
        widths = PointTolerances(100.0, 2e-6, 0.9)
        shown.change_point(PointTabsState(tolerance=widths))
        expected = tolerance_outline(machine.delta, machine.epsilon, machine, widths)
        np.testing.assert_allclose(np.column_stack([drawn.data["x"], drawn.data["y"]]), expected, rtol=1e-9)
        shown.close()
        assert not len(drawn.data["x"])

    with_map(tmp_path, body)


def test_a_machine_that_is_entered_is_looked_at_with_its_own_model(tmp_path: Path) -> None:
    async def body(front: ApplicationState, shown: Shown) -> None:
        shown.choose(done(front, MACHINE))
        await eventually(lambda: cells(shown) == 1)
        machine = ENTERED.machine
        shown.open((machine.delta, machine.epsilon), ENTERED)
        view: Any = shown.beside.point
        assert view.gear == ENTERED.machine.gear
        assert view.gear.kappa == ENTERED.machine.kappa
        assert not len(shown.map.cross_at.data["x"])  # it is not in this plane
        assert shown.view.machine == ENTERED
        rigid = ENTERED._replace(stiffness=None)
        shown.open((machine.delta, machine.epsilon), rigid)
        assert len(shown.map.cross_at.data["x"]) == 1
        shown.open((machine.delta, machine.epsilon))
        assert shown.view.machine is None

    with_map(tmp_path, body)


def test_what_is_entered_of_a_machine_is_checked(tmp_path: Path) -> None:
    async def body(_front: ApplicationState, shown: Shown) -> None:
        go = shown.beside.panel[0]
        go[0][1].clicks += 1
        (select, plain, machine, show), said = go[1], go[2]
        select.value = True
        assert machine.visible
        assert not plain.visible
        fields = {each.label: each for each in machine.select(pn.widgets.FloatInput)}
        fields["Base radius, mm"].value = None
        show.clicks += 1
        assert "enter radius too" in said.object.text
        fields["Base radius, mm"].value = 50e3
        show.clicks += 1
        assert "radius must be in metres" in said.object.text
        fields["Base radius, mm"].value = 50.0
        show.clicks += 1
        assert shown.view.machine == EnteredMachine(0.003, 5e-4, 100e-6, 15e-6, 0.05, 3000.0)
        select.value = False
        show.clicks += 1
        assert (shown.view.machine, shown.view.point) == (None, (0.6, 0.1))

    with_map(tmp_path, body)


def test_a_point_of_a_machine_s_survey_is_read_in_si() -> None:
    machine = rattle.Machine(**NUMBERS, eccentricity=20e-6, rpm=3000)
    window = (0.02, 0.08), (0.0, 1e-3)
    said = cell_tables(None, machine.delta, machine.epsilon, MACHINE, window)
    assert "<dd>3000 rpm</dd>" in said
    assert "<dd>20 µm</dd>" in said
    assert said.index("3000 rpm") < said.index("δ")
    assert "rpm" not in cell_tables(None, 0.6, 0.1, SurveyRequest(**BODY), ((0.4, 1.0), (0.0, 0.3)))


def test_fields_of_a_machine_give_what_the_library_takes() -> None:
    fields = MachineFields(POINT, "")
    said = [pane.object for pane in fields.panel.select(pn.pane.HTML)]
    assert any("numbers of the first gear" in text for text in said)
    entered = {each.label: each for each in fields.panel.select(pn.widgets.FloatInput)}
    for label, value in {
        "Restitution (none: elastic)": 0.9, "Load torque, N m": 0.2, "Mesh error, µm": 0.08, "Teeth": 20,
        "Teeth 2": 40, "Inertia 2, kg m²": 0.01, "Drag 2, N m s/rad": 6e-4,
    }.items():  # fmt: skip
        entered[label].value = value
    given = fields.entered_numbers()
    expected: dict[str, Any] = {"restitution": 0.9, "load_torque": 0.2, "mesh_error": 0.08e-6, "teeth": 20}
    expected |= {"driven_teeth": 40, "driven_inertia": 0.01, "driven_drag": 6e-4}
    assert given == {**NUMBERS, **given} | {"drive": "torque"} | expected
    assert not {"stiffness", "mesh_error_2", "driven_radius"} & given.keys()
    assert EnteredMachine(**given).machine == rattle.Machine(**given)


def test_an_address_keeps_a_machine_of_two_gears() -> None:
    given = EnteredMachine(
        0.003, 5e-4, 100e-6, 15e-6, 0.05, 3000.0, restitution=0.9, load_torque=0.2, mesh_error=1e-7, teeth=20,
        driven_teeth=41, driven_inertia=0.003, driven_drag=5e-4,
    )  # fmt: skip
    query = View(point=(0.6, 0.1), machine=given).query()
    address = {name: [each.encode() for each in values] for name, values in parse_qs(query[1:]).items()}
    assert View.parse(address).machine == given
    machine, model = machine_and_model((given.machine.delta, given.machine.epsilon), given, None, Impacting())
    assert machine == given.machine
    assert model == model_of_gear(given.machine.gear)
    old = "0.003,0.0005,0.0001,1.5e-05,0.05,3000.0,torque,"
    assert View.parse({"point": [b"0.6,0.1"], "machine": [old.encode()]}).machine == given._replace(
        **dict.fromkeys(EnteredMachine._fields[8:])
    )
    for more in ("wear:1", "restitution:2", "restitution:", "teeth:1.5"):
        assert View.parse({"point": [b"0.6,0.1"], "machine": [f"{old},{more}".encode()]}).machine is None


def test_a_machine_s_survey_with_mesh_errors_asks_its_points_with_them() -> None:
    asked: dict[str, Any] = {"model": "inelastic", "restitution": 0.9, "harmonics": [(20, 0.0033, 0.0)]}
    asked["quantities"] = ["attractors"]
    request = SurveyRequest.model_validate(MACHINE.model_dump(exclude_unset=True) | asked)
    point = request.delta.start, request.epsilon.stop
    machine, model = machine_and_model(point, None, request.machine, request.gear_model)
    assert machine is not None
    assert model == request.gear_model
    assert machine.harmonics == ((20, pytest.approx(0.0033), 0.0),)
    assert machine.added == {"restitution": 0.9, "load": 0.0}
    found = numbers_with_tolerances(model.gear(*point), machine, PointTolerances(10.0, 1e-6, 0.9))
    assert found["restitution"] == 0.9
    assert found["error_20"] == machine.errors[0][1]
    assert rattle.population(found, gears=2, count=2).gears.verdict.size == 2
