"""Every state of the page, light and dark: axe-core finds nothing, and tabs and rows of buttons say which is chosen."""

from collections.abc import Callable
from typing import Any, NamedTuple

import pytest
from depth import deep
from explorer_support import SURVEY, assert_accessible, open_form, open_tab, open_view, visiting
from playwright.sync_api import Browser, Page, expect
from test_explorer_details import done, submitted

TABS = ("Answer", "Basins", "Motion", "Diagram", "Numbers")
GEARS = {"inertia": 0.003, "drag": 0.05, "backlash": 300e-6, "radius": 0.05}
AXES = {"rpm": {"start": 1500.0, "stop": 6000.0, "num": 4}, "eccentricity": {"start": 2e-6, "stop": 60e-6, "num": 4}}
FEW: dict[str, Any] = {"quantities": ["region", "attractors"], "initial_conditions": {"count": 2}}
#: Surveys of a few cells.
MACHINE: dict[str, Any] = FEW | {"machine": GEARS | AXES, "name": "a machine"}
INELASTIC: dict[str, Any] = FEW | {
    "model": "inelastic", "restitution": 0.8, "name": "losses",
    "delta": SURVEY["delta"] | {"num": 3}, "epsilon": SURVEY["epsilon"] | {"num": 3},
}  # fmt: skip
PHONE = {"width": 390, "height": 844}


def second_map(page: Page) -> None:
    page.get_by_role("button", name="Add a second map").click()
    expect(page.get_by_label("Survey of map 2")).to_be_visible()


def difference(page: Page) -> None:
    second_map(page)
    page.get_by_role("checkbox", name="first map less this one").check()


def help_drawer(page: Page) -> None:
    page.get_by_role("button", name="Help", exact=True).click()
    expect(page.get_by_role("heading", name="What is good")).to_be_visible()


class State(NamedTuple):
    """A state: the address, and what is done there."""

    query: dict[str, str]
    act: Callable[[Page], object] = lambda _page: None


STATES = {
    "a survey": State({"variable": "region"}),
    "the form": State({}, open_form),
    "the form of a machine": State({}, lambda page: open_form(page, "a machine: rpm, µm")),
    "help": State({}, help_drawer),
    "pins": State({"pins": "0.6,0.1,0.6;0.8,0.2,0.6"}),
    "a comparison map": State({}, second_map),
    "a difference": State({"variable": "region"}, difference),
    "a family": State({"variable": "largest_family", "family": "1"}),
}


def is_pressed(page: Page, *names: str) -> list[str | None]:
    return [page.get_by_role("button", name=name, exact=True).first.get_attribute("aria-pressed") for name in names]


@deep
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_every_state_is_accessible(browser: Browser, service: str, survey_id: str, theme: str) -> None:
    with visiting(browser, service) as context:
        for state in STATES.values():
            page = context.new_page()
            open_view(page, service, theme=theme, survey=survey_id, **state.query)
            state.act(page)
            assert_accessible(page)
            page.close()


@deep
@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("size", [None, PHONE], ids=["laptop", "telephone"])
def test_every_tab_of_a_point_is_accessible(browser: Browser, service: str, theme: str, size: Any) -> None:
    with visiting(browser, service) as context:
        page = context.new_page()
        if size is not None:
            page.set_viewport_size(size)
        open_view(page, service, theme=theme, variable="region", point="0.6,0.1")
        expect(page.get_by_text("from 1,024 starts").first).to_be_visible()
        if size is not None:
            page.get_by_role("button", name="More", exact=True).click()
        for tab in TABS:
            open_tab(page, tab)
            wanted = [str(name == tab).lower() for name in TABS]
            expect(page.get_by_role("button", name=tab, exact=True).first).to_have_attribute("aria-pressed", "true")
            assert is_pressed(page, *TABS) == wanted
            assert_accessible(page)


@deep
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_surveys_of_machines_and_of_losses_are_accessible(browser: Browser, service: str, theme: str) -> None:
    surveys = [done(service, submitted(service, **asked)) for asked in (MACHINE, INELASTIC)]
    with visiting(browser, service) as context:
        for survey in surveys:
            page = context.new_page()
            open_view(page, service, theme=theme, survey=survey, variable="quiet_fraction")
            assert_accessible(page)
            page.set_viewport_size(PHONE)
            assert_accessible(page)
            page.close()


def test_rows_of_buttons_say_which_is_chosen(page: Page, service: str) -> None:
    open_view(page, service, variable="region")
    expect(page.get_by_role("button", name="Regions", exact=True)).to_have_attribute("aria-pressed", "true")
    chosen = page.get_by_role("button", name="Quiet", exact=True)
    chosen.focus()
    page.keyboard.press("Enter")
    expect(chosen).to_have_attribute("aria-pressed", "true")
    assert is_pressed(page, "Quiet", "Motions", "Chaos", "Regions") == ["true", "false", "false", "false"]
