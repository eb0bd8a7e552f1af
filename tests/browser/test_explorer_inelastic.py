"""Gears with restitution and harmonics in a browser: slices by restitution, links, pins, the form, contact phases."""

from typing import Any
from urllib.parse import parse_qs, urlsplit

import httpx
from explorer_support import of_map, open_form, open_view
from playwright.sync_api import Page, expect
from service_processes import get
from waiting import HANG, wait_until

import rattle

SMALL: dict[str, Any] = {
    "model": "inelastic",
    "delta": {"start": 0.58, "stop": 0.62, "num": 3},
    "epsilon": {"start": 0.24, "stop": 0.26, "num": 3},
    "quantities": ["attractors", "lyapunov", "families"],
    "initial_conditions": {"count": 8},
}
HARMONIC = (20, 0.0033, 0.25)
POINT = "0.6,0.25"
MACHINE = "0.003,0.05,0.0003,6e-05,0.05,3000.0,torque,,restitution:0.9,load_torque:0.1,mesh_error:1e-07,teeth:20.0"


def submitted(service: str, **more: Any) -> str:
    """The id of a survey that is done."""
    here = httpx.post(f"{service}/v1/surveys", json=SMALL | more, timeout=HANG).json()["links"]["self"]
    wait_until(lambda: get(service + here).json()["state"] == "successful")
    return str(here.rpartition("/")[2])


def test_a_slider_chooses_the_restitution_of_the_map_and_of_its_points(page: Page, service: str) -> None:
    survey_id = submitted(service, restitution={"start": 0.6, "stop": 0.9, "num": 2})
    open_view(page, service, survey=survey_id, variable="largest_family", point=POINT, **{"p.tab": "numbers"})
    beside = page.locator(".beside")
    expect(page.locator(".controls")).to_contain_text("r = 0.6")
    expect(beside).to_contain_text("restitution r = 0.6")
    contact = [each for each in rattle.Gear(0.6, 0.25, restitution=0.6).attractors(1024) if each.contacts]
    assert contact
    for each in contact:
        expect(beside.get_by_role("row", name=each.name).first).to_be_visible()
    expect(page.get_by_role("list", name="colours of the map")).to_contain_text(";1)")
    page.get_by_role("button", name="Pin δ 0.6, ε 0.25").click()
    page.wait_for_url("**pins=0.6,0.25,0.6,restitution%3A0.6,load%3A0.0**")
    for each in contact:
        expect(page.locator(".pinned")).to_contain_text(each.name)
    slider = page.get_by_role("slider").first
    slider.focus()
    slider.press("ArrowRight")
    expect(page.locator(".controls")).to_contain_text("r = 0.9")
    expect(beside).to_contain_text("restitution r = 0.9")
    page.wait_for_url("**slice=1**")
    assert of_map(page, "renderers.find((each) => each.name === 'pins').data_source.data.x.length") == 0  # of slice 0


def test_a_link_keeps_harmonics_and_a_machine_s_errors(page: Page, service: str) -> None:
    pin = "0.6,0.25,0.6,restitution:0.9,load:0.0,harmonic:20:0.0033:0.25"
    machine = rattle.Machine(
        0.003, 0.05, 300e-6, 60e-6, 0.05, rpm=3000, restitution=0.9, load_torque=0.1, mesh_error=1e-7, teeth=20
    )
    at = f"{machine.delta},{machine.epsilon}"
    open_view(page, service, pins=pin, point=at, machine=MACHINE)
    beside, table = page.locator(".beside"), page.locator(".pinned")
    expect(beside).to_contain_text("a load of 0.1 N m, mesh errors of 0.1 µm")
    expect(beside).to_contain_text("harmonic 20: 0.001667 at 0")
    expect(beside).to_contain_text("defined for a forcing of one cosine only")
    expect(table).to_contain_text("harmonic 20: 0.0033 at 0.25")
    gear = rattle.Gear(0.6, 0.25, restitution=0.9, harmonics=[HARMONIC])
    for each in gear.attractors(1024):
        expect(table).to_contain_text(each.name)
    asked = parse_qs(urlsplit(page.url).query)
    assert asked["machine"] == [MACHINE]
    assert asked["pins"] == [pin]
    link = page.get_by_role("link", name="A notebook").get_attribute("href")
    assert parse_qs(urlsplit(link or "").query)["harmonic"][0].startswith("20:0.00166666")


def test_a_survey_with_harmonics_is_submitted_and_asks_its_points_with_them(page: Page, service: str) -> None:
    open_view(page, service)
    open_form(page)
    page.get_by_label("Model", exact=True).select_option(label="inelastic impacts")
    field = page.get_by_label("Harmonics, ORDER:AMPLITUDE:PHASE")
    field.fill("20:0.0033")
    field.press("Enter")
    expect(page.get_by_text("harmonic '20:0.0033' is not ORDER:AMPLITUDE:PHASE")).to_be_visible()
    expect(page.get_by_role("button", name="Submit")).to_be_disabled()
    numbers = {"δ from": "0.58", "δ to": "0.62", "δ values": "3", "ε from": "0.24", "ε to": "0.26", "ε values": "3"}
    for label, value in (numbers | {"Initial conditions": "2", "Name": "with mesh errors"}).items():
        page.get_by_label(label, exact=True).fill(value)
        page.get_by_label(label, exact=True).press("Enter")
    field.fill("20:0.0033:0.25 40:0.001:0")
    field.press("Enter")
    expect(page.get_by_text("9 cells, about")).to_be_visible()
    page.get_by_role("button", name="Submit").click()
    row = page.locator("button.survey", has_text="with mesh errors")
    expect(row).to_have_attribute("data-state", "successful")
    listed = get(f"{service}/v1/surveys").json()["surveys"][0]
    asked = get(service + listed["links"]["self"]).json()["request"]
    assert (asked["model"], asked["restitution"], asked["load"]) == ("inelastic", 0.9, 0.0)
    assert asked["harmonics"] == [[20, 0.0033, 0.25], [40, 0.001, 0.0]]
    expect(page.locator(".detail")).to_contain_text("20:0.0033:0.25 40:0.001:0.0")
    open_view(page, service, survey=listed["id"], point=POINT)
    expect(page.locator(".beside")).to_contain_text("harmonics 20: 0.0033 at 0.25; 40: 0.001 at 0")
