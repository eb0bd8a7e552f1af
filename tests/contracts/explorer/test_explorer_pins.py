"""Points side by side: what the table and its CSV say of them, and that an address keeps them."""

import asyncio
import csv
import io
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

import pytest
from bokeh.document import Document
from service_support import BODY, no_cluster
from test_explorer_view import Shown, accepted, with_map

import rattle
from gear_rattle.service.access.keys import Caller
from gear_rattle.service.app import create_app
from gear_rattle.service.errors import UnavailableError
from gear_rattle.service.explorer.common.address import MOST_PINS, Pin, View, create_pin
from gear_rattle.service.explorer.common.viewer import PageSession
from gear_rattle.service.explorer.pins import pins_view
from gear_rattle.service.explorer.pins.pins_view import PinsView
from gear_rattle.service.explorer.pins.table import COMPUTED, PinResults, build_pin_table, compute_pin_results, csv_text
from gear_rattle.service.explorer.places.example import REQUEST as EXAMPLE
from gear_rattle.service.explorer.point.state import pin_of_open_point
from gear_rattle.service.explorer.state.events import PinAdded, PointOpened, SurveyChosen
from gear_rattle.service.explorer.state.store import PageStore
from gear_rattle.service.settings import Settings
from gear_rattle.service.state import ApplicationState
from gear_rattle.workers import SurveyRequest

HERE, QUIET, STIFF = Pin(0.6, 0.1, 0.6), Pin(0.9, 0.01, 0.6), Pin(1 / 3, 0.1, 0.6, (("kappa", 1e4),))
MESH = Pin(0.6, 0.25, 0.6, (("restitution", 0.9), ("load", 0.0)), ((20, 0.0033, 0.25),))
COUNT = 64


@pytest.fixture(scope="module")
def told() -> dict[Pin, PinResults | str]:
    return {pin: compute_pin_results(pin, COUNT) for pin in (HERE, QUIET)}


def parsed(view: View) -> View:
    return View.parse({name: [each.encode() for each in values] for name, values in parse_qs(view.query()[1:]).items()})


def test_an_address_keeps_the_pins_to_the_bit() -> None:
    assert parsed(View(pins=(HERE, STIFF))).pins == (HERE, STIFF)
    many = tuple(
        Pin(0.1234567890123456 + each, 1.2345678901234567e-05, 0.1234567890123456, (("kappa", 1e7 / 3),))
        for each in range(9)
    )
    assert parsed(View(pins=many)).pins == many[:MOST_PINS]
    assert View().query() == ""


def test_an_address_keeps_the_harmonics_of_a_pin() -> None:
    assert MESH.model.gear(0.6, 0.25).parameters.harmonics == MESH.harmonics
    assert create_pin(0.6, 0.25, MESH.model) == MESH
    shape = tuple((order, 0.01 / 3 / order, order / 7 % 1) for order in range(2, 30))
    pins = (MESH, *(MESH._replace(delta=0.1 * each, harmonics=shape) for each in range(1, MOST_PINS)))
    assert parsed(View(pins=pins)).pins == pins


@pytest.mark.parametrize("more", ["0.9,harmonic:1", "restitution:0.9,harmonic:1:0.1:0:0", "harmonic:20:0.1:0"])
def test_harmonics_that_cannot_be_read_are_no_pin(more: str) -> None:
    assert View.parse({"pins": [f"0.6,0.1,0.6,{more}".encode()]}).pins == ()


def test_a_pin_with_harmonics_and_contact_is_told_with_both() -> None:
    found = {MESH: compute_pin_results(MESH, 16)}
    gear = rattle.Gear(0.6, 0.25, restitution=0.9, harmonics=MESH.harmonics)
    lines = {name: cells for name, *cells in build_pin_table((MESH, HERE), found)}
    assert lines["Forcing"] == ["harmonic 20: 0.0033 at 0.25", "–"]
    assert lines["Region"] == ["–", COMPUTED]
    attractors = gear.attractors(16)
    assert any(each.contacts for each in attractors)
    assert {each.name for each in attractors} <= lines.keys()
    rows = list(csv.DictReader(io.StringIO(csv_text((MESH,), found))))
    assert [(row["attractor"], int(row["contacts"])) for row in rows] == [(x.name, x.contacts) for x in attractors]
    assert {(row["harmonics"], row["region"]) for row in rows} == {("20:0.0033:0.25", "")}


@pytest.mark.parametrize(
    "text", ["", "0.6", "0.6,0.1", "0,0.1,0.6", "0.6,-1,0.6", "nan,0.1,0.6", "0.6,0.1,0", "a;b", "0.6,0.1,0.6,1e4,5"]
)
def test_pins_that_cannot_be_read_are_none(text: str) -> None:
    assert View.parse({"pins": [text.encode()]}).pins == ()


def test_the_table_says_what_the_library_does(told: dict[Pin, PinResults | str]) -> None:
    lines = {name: cells for name, *cells in build_pin_table((HERE, QUIET, STIFF), told)}
    assert lines["Damping δ"] == ["0.6", "0.9", "0.333333"]
    assert lines["Stiffness κ"] == ["–", "–", "10000"]
    gear = rattle.Gear(0.6, 0.1)
    assert lines["Quiet up to ε"][:2] == [f"{each.quiet_limit:.4g}" for each in (gear, rattle.Gear(0.9, 0.01))]
    assert lines["Region"] == [f"region {rattle.REGIONS[gear.region()]}", "region I", COMPUTED]
    assert lines["quiet"][1].startswith("100 %")
    found = {each.kind: each for each in gear.attractors(COUNT)}
    assert lines["quiet"][0].startswith(f"{100 * found['quiet'].fraction:.3g} %")
    assert lines["Largest λ₁ of rattling"][1:] == ["–", ""]
    assert build_pin_table((STIFF,), {STIFF: "Too many points."})[4] == ["Region", "Too many points."]


def test_the_csv_is_read_back_to_the_same_bits(told: dict[Pin, PinResults | str]) -> None:
    rows = list(csv.DictReader(io.StringIO(csv_text((HERE, QUIET, STIFF), told))))
    expected = [
        (pin, each) for pin, gear in ((HERE, rattle.Gear(0.6, 0.1)), (QUIET, rattle.Gear(0.9, 0.01)))
        for each in gear.attractors(COUNT)
    ]  # fmt: skip
    assert len(rows) == len(expected)
    for row, (pin, each) in zip(rows, expected, strict=True):
        assert (float(row["delta"]), float(row["epsilon"]), float(row["beta"]), row["kappa"]) == (*pin[:3], "")
        assert (row["kind"], int(row["m"]), float(row["fraction"])) == (each.kind, each.m, each.fraction)
        others = {"lyapunov_1": each.lyapunov[0], "v": each.v, "fraction_low": each.fraction_interval[0]}
        for name, value in others.items():
            assert float(row[name]) == pytest.approx(value, rel=0, abs=0, nan_ok=True)


def test_pins_are_taken_and_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a viewer presses; the numbers come from nowhere."""
    stopped: list[int] = []
    at_work: list[Pin] = []
    said: list[str] = []

    class PointTasks:
        def __init__(self, *_: Any) -> None:
            self._task: asyncio.Task[None] | None = None

        def start(self, work: Any) -> asyncio.Task[None]:
            self._task = asyncio.get_running_loop().create_task(work)
            return self._task

        async def compute(self, _function: Any, pin: Pin, *_: Any, **__: Any) -> PinResults:
            at_work.append(pin)
            await asyncio.sleep(0)
            assert at_work.pop() == pin
            assert not at_work  # one after the other
            if pin == QUIET:
                raise ZeroDivisionError
            raise UnavailableError(f"{pin.delta} is busy.")

        async def apply_document_change(self, what: Callable[[], None]) -> None:
            what()

        def stop(self) -> None:
            stopped.append(1)

    async def main() -> None:
        app = create_app(Settings(data=tmp_path, preload=False, explorer=False), no_cluster)
        async with app.router.lifespan_context(app):
            viewer = PageSession(app.state.front, Caller(), Document())
            viewer.show_message = said.append
            await several(PageStore(View(pins=(HERE, STIFF)), EXAMPLE), viewer)
            await use(PageStore(View(pins=(HERE,)), EXAMPLE), viewer)
            viewer.end()

    async def several(store: PageStore, viewer: PageSession) -> None:
        pins = PinsView(viewer, store)
        store.update_surveys({})
        await settled()
        assert pins.table.lines[4] == ["Region", "0.6 is busy.", f"{STIFF.delta} is busy."]

    async def settled() -> None:
        for _ in range(20):
            await asyncio.sleep(0)

    async def use(store: PageStore, viewer: PageSession) -> None:
        pins = PinsView(viewer, store)

        def open_pin(pin: Pin) -> None:
            store.dispatch(PointOpened((pin.delta, pin.epsilon)))

        def press(action: str, number: int = 0) -> Awaitable[None]:
            pins.table.handle_message({"action": action, "pin": number})
            return settled()

        await settled()
        assert pins.table.lines[3] == ["Region", COMPUTED]  # a page that nobody tells anything computes nothing
        store.update_surveys({})
        await settled()
        assert pins.table.lines[3] == ["Region", "0.6 is busy."]
        assert pins.table.offered == ""
        open_pin(QUIET)
        assert pins.table.offered == QUIET.label
        await press("pin")
        assert (store.view.pins, pins.table.offered) == ((HERE, QUIET), "")
        assert pins.table.heads == [f"1: {HERE.label}", f"2: {QUIET.label}"]
        assert pins.table.lines[3] == ["Region", "0.6 is busy.", pins_view.FAILED]
        await press("pin")
        open_pin(HERE)
        await press("go", 7)
        assert store.view.point == HERE[:2]
        await press("go", 1)
        assert (store.view.pins, store.view.point) == ((HERE, QUIET), QUIET[:2])
        await press("remove", 0)
        assert (store.view.pins, stopped) == ((QUIET,), [1])
        for number in range(MOST_PINS):
            open_pin(Pin(0.5, number / 100, 0.6))
            await press("pin")
        assert len(store.view.pins) == MOST_PINS
        assert said == [pins_view.FULL]
        pins.end()
        assert len(stopped) == 1 + MOST_PINS

    monkeypatch.setattr(pins_view, "PointTasks", PointTasks)
    asyncio.run(main())


def test_the_point_that_a_page_is_opened_with_is_offered_once_its_gear_is_known(tmp_path: Path) -> None:
    other = SurveyRequest(**BODY | {"beta": 0.5, "quantities": ["region"]})

    async def body(front: ApplicationState, shown: Shown) -> None:
        job = accepted(front, other)
        shown.store.dispatch(SurveyChosen(job.id))
        shown.open((0.6, 0.1))
        for pin in (QUIET, Pin(0.55, 0.1, 0.5)):
            shown.store.dispatch(PinAdded(pin))
        assert pin_of_open_point(shown.store) is None
        shown.follow(job)  # as news does
        assert pin_of_open_point(shown.store) == Pin(0.6, 0.1, 0.5)
        assert shown.map.pins_at.data["name"] == ["2"]  # that of its gear

    with_map(tmp_path, body)
