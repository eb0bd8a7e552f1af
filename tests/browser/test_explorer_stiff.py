"""A survey of the stiff gear in a browser: from the form to the motions of a point."""

import re

import numpy as np
import pytest
from depth import deep
from explorer_support import click_cell, of_map, open_form, open_tab, open_view, point_at
from playwright.sync_api import Page, expect
from service_processes import get
from waiting import wait_until

import rattle
from rattle.orbits.orbits_a_to_d import REGIONS

DELTA, EPSILON, KAPPA = 0.6, 0.1, 2e4


def sn1_at(page: Page, delta: float) -> float:
    """ε of the drawn SN1; NaN while it is not drawn."""
    line = "renderers.find((each) => each.name === 'SN1').data_source.data"
    x, y = (of_map(page, f"{line}.{axis}.flatMap((piece) => Array.from(piece))") for axis in ("xs", "ys"))
    order = np.argsort(x)
    return float(np.interp(delta, np.array(x)[order], np.array(y)[order])) if len(x) == len(y) > 0 else np.nan


@deep
def test_a_stiff_survey_is_submitted_shown_and_clicked(page: Page, service: str) -> None:
    open_view(page, service)
    open_form(page)
    expect(page.get_by_label("Stiffness κ")).to_be_hidden()
    page.get_by_label("Name", exact=True).fill("stiff")
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
    request = get(service + get(f"{service}/v1/surveys").json()["surveys"][0]["links"]["self"]).json()
    assert (request["request"]["model"], request["request"]["kappa"]) == ("stiff", KAPPA)

    born, limit = rattle.stiff.saddle_node_1(DELTA, KAPPA).epsilon, rattle.Gear(DELTA, EPSILON).sn1
    assert abs(born - limit) > 2e-4
    wait_until(lambda: sn1_at(page, DELTA) == pytest.approx(born, abs=5e-5))  # at first it is the survey's before

    point_at(page, DELTA, EPSILON, until=f"Cell at δ {DELTA:g}, ε {EPSILON:g}")
    expect(page.get_by_text("COD20–23")).to_have_count(0)
    sn1 = page.get_by_role("checkbox", name="SN1", exact=True)
    expect(sn1).to_have_attribute("aria-description", re.compile("goes on as G2"))  # of this gear, not of the other one
    region = int(rattle.stiff.regions(np.array([DELTA]), np.array([EPSILON]), 0.6, KAPPA)[0])
    expect(page.locator(".beside")).to_contain_text(f"region here{REGIONS[region]}")

    click_cell(page, DELTA, EPSILON)
    beside = page.locator(".beside")
    expect(beside).to_contain_text(f"walls of stiffness κ = {KAPPA:.0f}")
    expect(beside).to_contain_text("of cases")
    orbits = rattle.stiff.StiffGear(DELTA, EPSILON, 0.6, KAPPA).orbits()
    open_tab(page, "Numbers")
    expect(page.get_by_role("table", name="Period-one orbits").get_by_role("row")).to_have_count(len(orbits) + 1)
    attractors = page.get_by_role("table", name=re.compile("Attractors from"))
    (stable,) = {orbit.name for orbit in orbits if orbit.stable}
    expect(attractors).to_contain_text(f" = {stable}")
    told = page.get_by_role("table", name="Events of the diagram")
    expect(told.get_by_role("row").nth(1)).to_contain_text(
        re.compile(r"(saddle-node|period doubling|grazing).*P\(\d+,\d+,\d+\)")
    )
