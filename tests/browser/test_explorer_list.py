"""What a viewer keeps: pinned points, names and notes of surveys, and a form that asks for a refined survey."""

import csv
from pathlib import Path

import httpx
from depth import deep
from explorer_support import SURVEY, assert_accessible, open_view
from playwright.sync_api import Page, expect
from service_processes import get
from waiting import HANG

import rattle


def test_the_example_stays_in_the_list_and_what_a_survey_lacks_is_said(
    page: Page, service: str, survey_id: str
) -> None:
    open_view(page, service)
    page.wait_for_url(f"**survey={survey_id}**")
    loudness = page.get_by_role("button", name="Loudness")
    expect(loudness).to_have_attribute("aria-disabled", "true")  # the survey has no intensities
    loudness.focus()
    expect(page.get_by_role("status").filter(has_text="Loudness: not computed in this survey")).to_be_visible()
    loudness.click(force=True)
    expect(page.get_by_role("button", name="Quiet")).to_have_attribute("aria-pressed", "true")
    entries = page.locator("button.survey")
    expect(entries.last).to_contain_text("Example: the paper's plane at β = 0.6")
    entries.last.click()
    page.wait_for_url("**survey=example**")
    expect(page.get_by_text("which comes with the explorer")).to_be_visible()
    expect(entries.last).to_have_attribute("aria-current", "true")
    expect(page.get_by_role("link", name="NetCDF")).to_have_count(0)
    expect(loudness).not_to_have_attribute("aria-disabled", "true")
    assert_accessible(page)
    loudness.click()
    page.wait_for_url("**variable=worst_level**")
    expect(loudness).to_have_attribute("aria-pressed", "true")
    borders = page.get_by_role("checkbox", name="SN2", exact=True)
    expect(borders).not_to_be_checked()
    expect(borders).to_have_attribute("aria-description", "B and D begin as ε grows")
    page.get_by_role("button", name="Regions").click()
    expect(borders).to_be_checked()  # of the regions
    page.get_by_label("Named places").select_option("Figure 8: about COD21 and COD22")
    page.wait_for_url("**delta=**")
    page.get_by_role("button", name="New survey from this view").click()
    expect(page.get_by_label("δ from")).to_have_value("0.74")
    expect(page.get_by_label("Named places").locator("option:checked")).to_have_text("Figure 8: about COD21 and COD22")
    page.get_by_role("button", name="Use its settings").click()
    expect(page.get_by_label("δ from")).to_have_value("0.4015")
    first = page.locator("button.survey").first
    first.click()
    page.wait_for_url(f"**survey={survey_id}**")
    sample = page.locator("pre").first
    assert sample.evaluate("(each) => each.scrollWidth <= each.clientWidth")  # nothing is cut off


@deep
def test_points_are_pinned_compared_and_found_again(page: Page, service: str, survey_id: str, tmp_path: Path) -> None:
    open_view(page, service, survey=survey_id, point="0.6,0.1", pins="0.9,0.01,0.6")
    pinned = page.locator(".pinned")
    table = pinned.get_by_role("table", name="Pinned points")
    expect(table).to_contain_text("100 %")
    page.get_by_role("button", name="Pin δ 0.6, ε 0.1").click()
    quiet = table.locator("tr", has=page.get_by_role("rowheader", name="quiet", exact=True))
    expect(quiet.get_by_role("cell")).to_have_count(2)
    page.wait_for_url("**pins=0.9,0.01,0.6;0.6,0.1,0.6**")
    assert_accessible(page)
    page.reload()
    expect(table.get_by_role("columnheader")).to_have_count(2)
    expect(table).not_to_contain_text("computing")
    with page.expect_download() as download:
        pinned.get_by_role("link", name="CSV").click()
    download.value.save_as(tmp_path / "points.csv")
    with (tmp_path / "points.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    found = rattle.Gear(0.6, 0.1).attractors(1024)
    assert [float(row["fraction"]) for row in rows if row["epsilon"] == "0.1"] == [each.fraction for each in found]
    page.get_by_role("button", name="1: δ 0.9, ε 0.01", exact=True).click()
    page.wait_for_url("**point=0.9,0.01**")
    expect(page.locator(".beside")).to_contain_text("Damping δ = 0.9")
    page.get_by_role("button", name="take 1: δ 0.9, ε 0.01 away").click()
    expect(table.get_by_role("columnheader")).to_have_count(1)


@deep
def test_a_survey_gets_a_name_and_notes_and_its_settings_are_refined(page: Page, service: str) -> None:
    asked = SURVEY | {"seed": 77, "quantities": ["region"], "name": "nameless"}
    here = httpx.post(f"{service}/v1/surveys", json=asked, timeout=HANG).json()["links"]["self"]
    open_view(page, service, survey=here.rpartition("/")[2])
    row = page.locator("button.survey", has_text="nameless")
    expect(row).to_have_attribute("data-state", "successful")
    page.locator("[data-action=describe]").click()
    page.get_by_label("New name").fill("of the drawing")
    page.get_by_label("Notes").fill("agrees with Figure 7\nsee the <b>minutes</b>")
    assert_accessible(page)
    page.get_by_role("button", name="Save", exact=True).click()
    expect(page.locator("button.survey", has_text="of the drawing")).to_have_attribute("aria-current", "true")
    expect(page.locator(".notes")).to_have_text("agrees with Figure 7\nsee the <b>minutes</b>")
    shown = get(service + here).json()
    assert (shown["name"], shown["notes"]) == ("of the drawing", "agrees with Figure 7\nsee the <b>minutes</b>")
    page.get_by_role("button", name="Use its settings").click()
    page.get_by_role("button", name="Advanced settings").click()
    page.get_by_label("Cells", exact=True).select_option("adaptive refinement")
    expect(page.get_by_label("Share of filled cells that is checked")).to_have_value("0.02")
    expect(
        page.get_by_text("if all cells were computed").or_(page.get_by_text("cells of the same kind"))
    ).to_be_visible()
    httpx.delete(service + here, timeout=HANG)
