"""Check every state of the page with axe-core, light and dark, on the screens of a laptop and of a phone."""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import httpx
import pytest
from depth import deep
from explorer_support import SURVEY, assert_accessible, open_form, open_tab, open_view, wait_for
from playwright.sync_api import Page, expect
from service_processes import get
from waiting import HANG, wait_until

TABS = ("Answer", "Basins", "Motion", "Diagram", "Numbers")
FEW: dict[str, Any] = {"quantities": ["region", "attractors"], "initial_conditions": {"count": 2}}
FEW_CELLS = {axis: SURVEY[axis] | {"num": 3} for axis in ("delta", "epsilon")}
#: Surveys of a few cells by name, which the deep tests show.
SURVEYS: dict[str, dict[str, Any]] = {
    "machine": FEW | {
        "machine": {
            "inertia": 0.003, "drag": 0.05, "backlash": 300e-6, "radius": 0.05,
            "rpm": {"start": 1500.0, "stop": 6000.0, "num": 4},
            "eccentricity": {"start": 2e-6, "stop": 60e-6, "num": 4},
        },
    },
    "inelastic": FEW | FEW_CELLS | {
        "quantities": ["attractors"], "model": "inelastic", "restitution": {"start": 0.7, "stop": 0.9, "num": 2},
    },
    "stiff": FEW | FEW_CELLS | {"model": "stiff", "kappa": 2e4},
}  # fmt: skip
PHONE = {"width": 390, "height": 844}
FOLDS = "[...document.querySelectorAll('details.fold')]"
IDLE = "() => Bokeh.documents.every((each) => each.is_idle)"


def open_help(page: Page) -> None:
    page.get_by_role("button", name="Help", exact=True).click()
    expect(page.get_by_role("heading", name="What is good")).to_be_visible()


def open_machine_form(page: Page) -> None:
    open_form(page, "a machine: rpm, µm")
    expect(page.get_by_label("rpm from")).to_be_visible()


def open_machine_fields(page: Page) -> None:
    page.get_by_role("button", name="Go to a point").click()
    page.get_by_label("Enter as").select_option("a machine in SI units")
    expect(page.get_by_label("Eccentricity, µm", exact=True)).to_be_visible()


def open_notes(page: Page) -> None:
    page.locator("[data-action=describe]").click()
    expect(page.get_by_label("Notes")).to_be_visible()


def enter_wrong_limits(page: Page) -> None:
    page.get_by_label("Colour range").select_option("from … to")
    page.get_by_label("from", exact=True).fill("2")
    page.get_by_label("from", exact=True).press("Enter")
    expect(page.get_by_role("alert").filter(has_text="Colours cannot span")).to_be_visible()


def add_map(page: Page) -> None:
    page.get_by_role("button", name="Add a second map").click()
    expect(page.get_by_label("Survey of map 2")).to_be_visible()


def subtract_map(page: Page) -> None:
    add_map(page)
    page.get_by_role("checkbox", name="first map less this one").check()
    expect(page.get_by_text("small less small, the same cells")).to_be_visible()


def wait_for_pins(page: Page) -> None:
    table = page.get_by_role("table", name="Pinned points")
    expect(table).to_contain_text("%")
    expect(table).not_to_contain_text("computing")


def wait_for_family(page: Page) -> None:
    expect(page.locator(".keys")).to_contain_text("of all samples go to it")


class State(NamedTuple):
    """State of the page: the view in the address, in which a survey has its name, and the actions of a viewer."""

    query: dict[str, str]
    act: Callable[[Page], None] = lambda _page: None


STATES = {
    "survey": State({"variable": "region"}),
    "form": State({}, open_form),
    "help": State({}, open_help),
}
DEEP_STATES = {
    "machine form": State({}, open_machine_form),
    "machine fields": State({}, open_machine_fields),
    "notes": State({}, open_notes),
    "wrong limits": State({"variable": "quiet_fraction"}, enter_wrong_limits),
    "pins": State({"pins": "0.6,0.1,0.6;0.8,0.2,0.6"}, wait_for_pins),
    "comparison": State({}, add_map),
    "difference": State({"variable": "region"}, subtract_map),
    "family": State({"variable": "largest_family", "family": "1"}, wait_for_family),
    "machine": State({"survey": "machine", "variable": "quiet_fraction"}),
    "inelastic": State({"survey": "inelastic", "variable": "attractor_kind", "slice": "1"}),
    "stiff": State({"survey": "stiff", "variable": "attractor_kind"}),
}
POINTS = {
    "elastic": {"survey": "small", "variable": "region", "point": "0.6,0.1"},
    "inelastic": {"survey": "inelastic", "variable": "quiet_fraction", "point": "0.6,0.25"},
    "stiff": {"survey": "stiff", "variable": "region", "point": "0.6,0.1"},
    "machine": {
        "survey": "machine", "variable": "region", "point": "0.05305164769729845,0.2",
        "machine": "0.003,0.05,0.0003,6e-05,0.05,3000.0,torque,",
    },
}  # fmt: skip
both_themes = pytest.mark.parametrize("theme", ["light", "dark"])


@pytest.fixture(scope="module")
def surveys(service: str, survey_id: str) -> Iterator[dict[str, str]]:
    """Ids of the surveys by name; all of them are done."""
    ids = {}
    for name, request in SURVEYS.items():
        answer = httpx.post(f"{service}/v1/surveys", json=request | {"name": name}, timeout=HANG).raise_for_status()
        ids[name] = str(answer.json()["id"])
    for each in ids.values():
        wait_until(lambda each=each: get(f"{service}/v1/surveys/{each}").json()["state"] == "successful")
    yield ids | {"small": survey_id}
    for each in ids.values():
        httpx.delete(f"{service}/v1/surveys/{each}", timeout=HANG)


def check(page: Page) -> None:
    """Check the page that is open on the screen of a laptop, and then with all its folds open on that of a phone."""
    page.mouse.move(640, 10)  # a tooltip under the mouse is outside all landmarks
    expect(page.locator(".bk-tooltip-content")).to_have_count(0)
    assert_accessible(page)
    page.set_viewport_size(PHONE)
    wait_for(page, f"() => {FOLDS}.every((each) => !each.open)")
    page.evaluate(f"() => {FOLDS}.forEach((each) => {{ each.open = true }})")
    wait_for(page, IDLE)
    assert_accessible(page)


@both_themes
@pytest.mark.parametrize("state", STATES.values(), ids=STATES.keys())
def test_a_state_is_accessible(page: Page, service: str, survey_id: str, state: State, theme: str) -> None:
    open_view(page, service, theme=theme, survey=survey_id, **state.query)
    state.act(page)
    check(page)


@deep
@both_themes
@pytest.mark.parametrize("state", DEEP_STATES.values(), ids=DEEP_STATES.keys())
def test_every_state_is_accessible(page: Page, service: str, surveys: dict[str, str], state: State, theme: str) -> None:
    shown = surveys[state.query.get("survey", "small")]
    open_view(page, service, **state.query | {"theme": theme, "survey": shown})
    state.act(page)
    check(page)


@deep
@both_themes
@pytest.mark.parametrize("size", [{"width": 1280, "height": 800}, PHONE], ids=["laptop", "phone"])
@pytest.mark.parametrize("point", POINTS.values(), ids=POINTS.keys())
def test_every_tab_of_a_point_is_accessible(
    page: Page, service: str, surveys: dict[str, str], point: dict[str, str], size: Any, theme: str
) -> None:
    page.set_viewport_size(size)
    open_view(page, service, **point | {"theme": theme, "survey": surveys[point["survey"]]})
    expect(page.locator(".beside")).to_contain_text(" starts")
    if size == PHONE:
        assert_accessible(page)  # the sheet as it opens
        page.get_by_role("button", name="More", exact=True).click()
    for tab in TABS:
        open_tab(page, tab)
        for each in TABS:
            button = page.get_by_role("button", name=each, exact=True)
            expect(button).to_have_attribute("aria-pressed", str(each == tab).lower())
        wait_for(page, IDLE)
        assert_accessible(page)


def test_rows_of_buttons_say_which_is_chosen(page: Page, service: str) -> None:
    open_view(page, service, variable="region")

    def expect_chosen(name: str) -> None:
        for each in ("Quiet", "Motions", "Chaos", "Regions"):
            button = page.get_by_role("button", name=each, exact=True)
            expect(button).to_have_attribute("aria-pressed", str(each == name).lower())

    expect_chosen("Regions")
    page.get_by_role("button", name="Quiet", exact=True).focus()
    page.keyboard.press("Enter")
    expect_chosen("Quiet")
