"""A survey of the stiff gear in a browser: from the form to the motions of a point."""

import re

import httpx
import numpy as np
import pytest
from explorer_support import of_map, open_view, place_of, point_at, wait_for_map
from playwright.sync_api import Page, expect

import rattle
from rattle.plot.plane import REGIONS

expect.set_options(timeout=60_000)
DELTA, EPSILON, KAPPA = 0.6, 0.1, 2e4


def test_a_stiff_survey_is_submitted_shown_and_clicked(page: Page, service: str) -> None:
    open_view(page, service)
    page.get_by_role("button", name="New survey").click()
    expect(page.get_by_label("Stiffness κ")).to_be_hidden()
    page.get_by_label("Name").fill("stiff")
    page.get_by_label("Model").select_option("stiff walls")
    expect(page.get_by_role("checkbox", name="grazing")).to_have_count(0)  # a group that the stiff model lacks
    for label, value in {
        "Stiffness κ": KAPPA,
        **{"δ values": 6, "ε values": 8, "Initial conditions": 4},
        **{"δ from": 0.4, "δ to": 0.9, "ε from": 0.04, "ε to": 0.18},
    }.items():
        page.get_by_label(label, exact=True).fill(f"{value:g}")
        page.get_by_label(label, exact=True).press("Enter")
    expect(page.get_by_text("48 cells, about")).to_be_visible()
    page.get_by_role("button", name="Submit").click()
    row = page.locator("button.survey", has_text="stiff")
    expect(row).to_have_attribute("data-state", "successful")
    request = httpx.get(service + httpx.get(f"{service}/v1/surveys").json()["surveys"][0]["links"]["self"]).json()
    assert (request["request"]["model"], request["request"]["kappa"]) == ("stiff", KAPPA)

    wait_for_map(page, "renderers.find((each) => each.name === 'SN1')?.data_source.data.xs.length > 0")
    line = "renderers.find((each) => each.name === 'SN1').data_source.data"
    drawn = {axis: of_map(page, f"{line}.{axis}.map((piece) => Array.from(piece))") for axis in ("xs", "ys")}
    delta, epsilon = (np.concatenate([np.array(part, float) for part in drawn[name]]) for name in ("xs", "ys"))
    at = np.interp(DELTA, delta[np.argsort(delta)], epsilon[np.argsort(delta)])
    assert at == pytest.approx(rattle.stiff.saddle_node_1(DELTA, KAPPA).epsilon, abs=5e-5)
    assert at != pytest.approx(rattle.Gear(DELTA, EPSILON).sn1, abs=2e-4)

    point_at(page, DELTA, EPSILON, until=f"Cell at δ {DELTA:g}, ε {EPSILON:g}")
    region = int(rattle.stiff.regions(np.array([DELTA]), np.array([EPSILON]), 0.6, KAPPA)[0])
    expect(page.locator(".beside")).to_contain_text(f"region here{REGIONS[region]}")

    page.mouse.click(*place_of(page, DELTA, EPSILON))
    beside = page.locator(".beside")
    expect(beside).to_contain_text(f"walls of stiffness κ = {KAPPA:.0f}")
    expect(beside).to_contain_text("probability")
    orbits = rattle.stiff.StiffGear(DELTA, EPSILON, 0.6, KAPPA).orbits()
    expect(page.get_by_role("table", name="Period-one orbits").get_by_role("row")).to_have_count(len(orbits) + 1)
    expect(page.get_by_role("table", name=re.compile("Attractors from"))).to_be_visible()
