"""A machine in SI units in a browser: a survey of it, a point with its sound and tolerances, the design limit."""

import httpx
import pytest
from depth import deep
from explorer_support import of_map, open_form, open_tab, open_view, wait_for, wait_for_map
from playwright.sync_api import Page, expect
from service_processes import get
from waiting import HANG, wait_until

import rattle

MACHINE = rattle.Machine(0.003, 0.05, 300e-6, 60e-6, 0.05, rpm=3000)
ENTERED = "0.003,0.05,0.0003,6e-05,0.05,3000.0,torque,"


def field(page: Page, label: str, value: str) -> None:
    page.get_by_label(label, exact=True).fill(value)
    page.get_by_label(label, exact=True).press("Enter")


@deep
def test_a_survey_of_a_machine_is_submitted_and_has_its_speeds_beside_it(page: Page, service: str) -> None:
    open_view(page, service)
    open_form(page, "a machine: rpm, µm")
    field(page, "Name", "in SI")
    for label, value in {"rpm from": "1500", "Drag, N m s/rad": "0.05", "Initial conditions": "1"}.items():
        field(page, label, value)
    for label in ("rpm values", "µm values"):
        field(page, label, "4")
    for name in ("attractors", "lyapunov", "grazing", "orbits"):
        page.get_by_role("checkbox", name=name, exact=True).uncheck()
    expect(page.get_by_text("16 cells, about")).to_be_visible()
    page.get_by_role("button", name="Submit").click()
    expect(page.locator("button.survey", has_text="in SI")).to_have_attribute("data-state", "successful")
    listed = get(f"{service}/v1/surveys").json()["surveys"][0]
    asked = get(service + listed["links"]["self"]).json()["request"]
    assert asked["machine"] == {
        "inertia": 0.003, "drag": 0.05, "backlash": 1e-4, "radius": 0.05, "drive": "torque",
    }  # fmt: skip
    assert asked["delta"]["start"] == MACHINE.delta
    wait_for_map(page, "above[0].visible")
    ticks = "() => { const view = Bokeh.index.find_one(Bokeh.documents.map((each) => each.get_model_by_name('rpm'))" \
        ".find((each) => each)); const [at] = view?.tick_coords.major ?? [[]]; " \
        "return at.length > 1 && at.every((each, k) => !k || each > at[k - 1]) }"  # fmt: skip
    wait_for(page, ticks)
    httpx.delete(service + listed["links"]["self"], timeout=HANG)


@deep
def test_a_machine_that_is_entered_is_heard_and_has_a_yield(page: Page, service: str) -> None:
    where = f"{MACHINE.delta},{MACHINE.epsilon}"
    open_view(page, service, point=where, machine=ENTERED)
    beside = page.locator(".beside")
    expect(beside).to_contain_text("A machine at 3000 rpm with an eccentricity of 60 µm")
    expect(beside).to_contain_text("J per revolution")
    expect(beside).to_contain_text("the gear runs quietly in 100 %")
    open_tab(page, "Motion")
    expect(beside).to_contain_text("Order spectrum of the force between the teeth")
    page.get_by_role("button", name="Play", exact=True).click()
    page.locator("audio").wait_for(state="attached")
    open_tab(page, "Answer")
    field(page, "σ of eccentricity, µm", "4")
    page.get_by_role("button", name="Compute yield").click()
    expect(beside).to_contain_text("of the gears pass")
    page.wait_for_url("**p.tolerance=**")


@deep
def test_the_design_limit_is_drawn_when_it_is_asked_for(page: Page, service: str) -> None:
    open_view(page, service, share="0.8", overlays="none")
    page.get_by_role("checkbox", name="design limit").check()
    of_limit = "renderers.find((each) => each.name === 'design_limit').data_source.data"
    wait_for_map(page, f"{of_limit}.ys.flatMap((each) => [...each]).length > 8")
    delta, epsilon = (of_map(page, f"{of_limit}.{axis}.flatMap((each) => [...each])") for axis in ("xs", "ys"))
    exact = rattle.design_limit({"delta": delta[0]}, "epsilon", 0.8, count=512)
    assert epsilon[0] == pytest.approx(exact.value)
    expect(page.get_by_role("checkbox", name="design limit")).to_be_focused()  # although the key was written anew
    page.wait_for_url("**overlays=design_limit**")
    wait_until(lambda: page.get_by_label("Design limit: P(quiet) ≥").input_value() == "0.8")
