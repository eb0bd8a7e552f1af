"""The explorer in a browser, against a real server."""

import re
from pathlib import Path
from urllib.parse import parse_qs, urljoin, urlsplit

import httpx
import numpy as np
import xarray as xr
from depth import DEEP, deep, either
from explorer_support import (
    SURVEY,
    assert_accessible,
    of_map,
    open_form,
    open_view,
    place_of,
    point_at,
    visible_lines,
    wait_for,
    wait_for_map,
)
from faults import Faults
from playwright.sync_api import Page, expect
from service_processes import get
from waiting import HANG, wait_until

import rattle
from gear_rattle.service.explorer.map.planes import ENLARGED_POINTS
from rattle.curves import codimension_two
from rattle.orbits.orbits_a_to_d import REGIONS

DEFAULT_LINES = {"SN1", "G1", "quiet_limit"}


def query(page: Page) -> dict[str, str]:
    return {name: values[0] for name, values in parse_qs(urlsplit(page.url).query).items()}


def region_at(delta: float, epsilon: float) -> str:
    return REGIONS[int(rattle.regions(np.array([delta]), np.array([epsilon]), 0.6)[0])]


def test_a_survey_is_submitted_and_fills_in(page: Page, service: str, held: Faults) -> None:
    held.hold(1)
    open_view(page, service)
    open_form(page)
    page.get_by_label("Name", exact=True).fill("from the form")
    for label, value in {
        "δ values": 24,
        "ε values": 24,
        "Initial conditions": 8,
        "δ from": 0.5,
        "δ to": 0.8,
    }.items():
        page.get_by_label(label, exact=True).fill(str(value))
        page.get_by_label(label, exact=True).press("Enter")
    expect(page.get_by_text("576 cells, about")).to_be_visible()
    page.get_by_role("button", name="Submit").click()
    row = page.locator("button.survey", has_text="from the form")
    expect(row).to_have_attribute("aria-current", "true")
    part = "some((each) => each.name?.startsWith('cells') && each.data_source.data.image[0]?.shape?.[0] === 24"
    wait_for_map(page, f"renderers.{part})")
    expect(row).to_have_attribute("data-state", "running")  # shown before it is done, which it will never be
    listed = get(f"{service}/v1/surveys").json()["surveys"][0]
    assert query(page)["survey"] == listed["id"]
    expect(page.get_by_text("share of the sample that ends quiet")).to_be_visible()  # a map that fills in
    expect(page.get_by_role("list", name="colours of the map")).to_contain_text("not computed")
    page.get_by_label("Map", exact=True).select_option("region")
    expect(page.get_by_text("exact values, shown before the survey has computed them")).to_be_visible()
    wait_for_map(page, "renderers.find((each) => each.name === 'G1').data_source.data.xs.length > 0")
    other = {"quantities": ["attractors"], "name": "behind it"}  # nothing of it is known yet
    behind = httpx.post(f"{service}/v1/surveys", json=SURVEY | other, timeout=HANG).json()["links"]["self"]
    page.locator("button.survey", has_text="behind it").click()
    expect(page.get_by_text("This survey waits for its turn")).to_be_visible()
    shown = "flatMap((each) => [...each.data_source.data.image ?? [], ...each.data_source.data.xs ?? []])"
    wait_for_map(page, f"renderers.{shown}.length === 0")
    expect(page.get_by_role("list", name="colours of the map")).to_be_hidden()
    httpx.delete(service + behind, timeout=HANG)
    row.click()
    expect(row).to_have_attribute("aria-current", "true")  # before, the button is that of the other one
    page.locator("[data-action=cancel]").click()
    expect(row).to_have_attribute("data-state", "dismissed")
    assert get(service + listed["links"]["self"]).json()["state"] == "dismissed"
    page.locator("[data-action=resume]").click()
    expect(row).to_have_attribute("data-state", re.compile("accepted|running"))
    page.locator("[data-action=cancel]").click()
    expect(row).to_have_attribute("data-state", "dismissed")
    held.release()
    page.locator("[data-action=delete]").click()
    page.get_by_text("Delete for good?").click()
    expect(row).to_have_count(0)


@deep
def test_a_form_that_cannot_be_sent_says_why(page: Page, service: str) -> None:
    open_view(page, service)
    open_form(page)
    page.get_by_label("δ from", exact=True).fill("2")
    page.get_by_label("δ from", exact=True).press("Enter")
    expect(page.get_by_text("must be below stop")).to_be_visible()
    expect(page.get_by_role("button", name="Submit")).to_be_disabled()
    page.mouse.move(640, 10)  # a tooltip under the mouse is outside of all landmarks
    expect(page.locator(".bk-tooltip-content")).to_have_count(0)
    assert_accessible(page)


#: Counts what pictures ask the style of the page for: the style may have to be worked out anew for every answer; and
#: those that are first drawn while the page is laid out, when nobody is answered.
COUNTED = """
window.asked = 0
const answer = CSSStyleDeclaration.prototype.getPropertyValue
CSSStyleDeclaration.prototype.getPropertyValue = function (name) {
  window.asked += /^--bk-.*(line|fill|text|hatch|image)-/.test(name)
  return answer.call(this, name)
}
window.drawn = {later: 0, atOnce: 0}
const drawn = new WeakSet(), write = CanvasRenderingContext2D.prototype.fillText
Error.stackTraceLimit = 100
CanvasRenderingContext2D.prototype.fillText = function (...what) {
  if (!drawn.has(this.canvas)) window.drawn[new Error().stack.includes("after_layout") ? "atOnce" : "later"] += 1
  drawn.add(this.canvas)
  return write.apply(this, what)
}
"""


def test_lines_are_switched_and_the_address_says_so(page: Page, service: str) -> None:
    page.add_init_script(COUNTED)
    open_view(page, service)
    wait_for(page, "() => drawn.later + drawn.atOnce > 0")  # the cells are there before they are drawn
    assert visible_lines(page) == DEFAULT_LINES
    wait_for_map(page, "renderers.find((each) => each.name === 'G1').data_source.data.xs.length > 0")
    page.get_by_role("checkbox", name="G1").uncheck()
    wait_for_map(page, "renderers.find((each) => each.name === 'G1').visible === false")
    assert visible_lines(page) == DEFAULT_LINES - {"G1"}
    page.wait_for_url("**overlays=**")
    if DEEP:  # what an address says is shown in the next but one
        page.reload()
        wait_for_map(page, "renderers.find((each) => each.name === 'G1').visible === false")
    expect(page.get_by_role("checkbox", name="G1")).not_to_be_checked()
    expect(page.get_by_role("checkbox", name="SN1", exact=True)).to_be_checked()
    expect(page.get_by_role("checkbox", name="G2")).not_to_be_checked()


def test_what_is_pointed_at_is_read_and_zooming_shows_more_than_the_survey_has(page: Page, service: str) -> None:
    open_view(page, service, variable="region")
    beside = page.locator(".beside")
    for delta, epsilon in either(((0.6, 0.1), (0.9, 0.05)), ((0.6, 0.1), (0.5, 0.06), (0.9, 0.05), (0.8, 0.25))):
        point_at(page, delta, epsilon, until=f"Cell at δ {delta:g}, ε {epsilon:g}")
        expect(beside).to_contain_text(f"region here{region_at(delta, epsilon)}")
        for orbit in rattle.Gear(delta, epsilon).orbits():
            expect(beside).to_contain_text(f"{orbit.name}{'stable' if orbit.stable else 'unstable'}")
    page.mouse.move(*place_of(page, 0.6, 0.06))
    for _ in range(8):
        page.mouse.wheel(0, -400)
    page.wait_for_url("**delta=**")
    wait_for_map(page, "renderers.some((each) => each.name === 'fine0' && each.data_source.data.image.length > 0)")
    delta = [float(part) for part in query(page)["delta"].split(",")]
    assert 0.55 < delta[0] < delta[1] < 0.65
    shares = dict(zip(*np.unique(assert_fine_regions(page), return_counts=True), strict=True))
    (most,) = (REGIONS[int(code)] for code, count in shares.items() if count == max(shares.values()))
    expect(
        page.get_by_role("list", name="colours of the map")
        .get_by_role("listitem")
        .filter(has_text=re.compile(rf"^{most}(?![IV])"))
    ).to_contain_text("%")


@deep
def test_a_window_of_1e9_at_cod22_is_right(page: Page, service: str, survey_id: str) -> None:
    (point,) = (each for each in codimension_two(0.6) if each.name == "COD22")
    delta, epsilon = ((value - 5e-10, value + 5e-10) for value in (point.delta, point.epsilon))
    window = {"delta": f"{delta[0]!r},{delta[1]!r}", "epsilon": f"{epsilon[0]!r},{epsilon[1]!r}"}
    open_view(page, service, survey=survey_id, variable="region", **window)
    # at first there is one cell of the survey, enlarged
    finer = f"each.name === 'fine0' && each.data_source.data.image[0]?.shape[0] > {ENLARGED_POINTS}"
    wait_for_map(page, f"renderers.some((each) => {finer})")
    assert of_map(page, "x_range.start") == delta[0]
    assert of_map(page, "below[0].axis_label") == "damping δ − 0.7701471309, in units of 1e-9"
    assert {1, 5} <= set(assert_fine_regions(page).ravel().tolist())  # both sides of G1 and G2
    point_at(page, delta[0] + 2e-10, epsilon[1] - 1e-10, until="δ0.7701471306")


def assert_fine_regions(page: Page) -> np.ndarray:
    """The finer block holds the regions of its own cells."""
    # In one question: between two the next finer block may come.
    parts = "[Array.from(image[0]), image[0].shape, x[0], y[0], dw[0], dh[0]]"
    fine = "renderers.filter((each) => each.name === 'fine0')"
    data = "{data_source: {data: {image, x, y, dw, dh}}}"
    values, shape, x, y, dw, dh = of_map(page, f"{fine}.map(({data}) => {parts})[0]")
    values = np.reshape(values, shape)
    rows, columns = np.linspace(0, shape[0] - 1, 23).astype(int), np.linspace(0, shape[1] - 1, 23).astype(int)
    delta, epsilon = x + (columns + 0.5) * dw / shape[1], y + (rows + 0.5) * dh / shape[0]
    expected = rattle.regions(delta, epsilon[:, None], 0.6)
    found = values[np.ix_(rows, columns)]
    assert (found != expected).mean() < 0.02  # where a line goes through the middle of a cell, rounding decides
    return found


def test_a_saved_address_shows_the_same_view(page: Page, service: str, survey_id: str) -> None:
    view = {
        "survey": survey_id, "variable": "attractor_fraction", "index": "1", "limits": "0.1,0.7", "log": "1",
        "overlays": "SN1,quiet_limit", "delta": "0.5,0.75", "epsilon": "0.05,0.2", "theme": "dark",
    }  # fmt: skip
    open_view(page, service, **view)
    assert visible_lines(page) == {"SN1", "quiet_limit"}
    wait_for_map(page, "renderers.find((each) => each.name === 'cells1').visible")
    assert of_map(page, "x_range.start") == 0.5
    assert of_map(page, "y_range.end") == 0.2
    mapper = "renderers.find((each) => each.name === 'cells1').glyph.color_mapper"
    assert (of_map(page, f"{mapper}.low"), of_map(page, f"{mapper}.high")) == (0.1, 0.7)
    expect(page.get_by_label("Map", exact=True)).to_have_value("attractor fraction")
    expect(page.get_by_role("checkbox", name="log scale")).to_be_checked()
    assert query(page) == view
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(15, 19, 23)"
    page.get_by_role("button", name="New survey from this view").click()
    expect(page.get_by_label("Plane", exact=True)).to_have_value("own ranges of δ and ε")
    for label, value in {"δ from": "0.5", "δ to": "0.75", "ε from": "0.05", "ε to": "0.2"}.items():
        expect(page.get_by_label(label, exact=True)).to_have_value(value)
    for form, begin in {"PNG": b"\x89PNG", "SVG": b"<?xml", "PDF": b"%PDF"}.items():
        link = page.get_by_role("link", name=form, exact=True).get_attribute("href")
        asked = parse_qs(urlsplit(link or "").query)
        assert asked.items() >= {"index": ["1"], "delta_min": ["0.5"], "low": ["0.1"], "caption": ["true"]}.items()
        # Half a minute of a processor is what the finer cells of the whole window take.
        few = link if DEEP else re.sub(r"(pixels_\w+)=\d+", r"\1=90", link or "")
        assert httpx.get(urljoin(page.url, few or ""), timeout=HANG).content.startswith(begin)
    page.get_by_role("button", name="Light theme").click()
    wait_for(page, "() => document.body && getComputedStyle(document.body).backgroundColor === 'rgb(244, 246, 248)'")


@deep
def test_nonsense_in_the_address_is_left_out(page: Page, service: str) -> None:
    nonsense = "delta=nan,1&epsilon=9,1&limits=<b>&index=-5&overlays=x&point=1&theme=%22&variable=__class__&p.x=%00"
    page.goto(f"{service}/?{nonsense}")
    wait_for_map(page, "renderers.some((each) => each.name?.startsWith('cells') && each.data_source.data.image.length)")
    expect(page.get_by_label("Map", exact=True)).to_have_value("quiet fraction")


@deep
def test_a_survey_is_downloaded(page: Page, service: str, survey_id: str, tmp_path: Path) -> None:
    body = SURVEY | {"quantities": ["region"]}
    other = httpx.post(f"{service}/v1/surveys", json=body, timeout=HANG).json()["links"][
        "self"
    ]  # newer: the first in the list
    wait_until(lambda: get(service + other).json()["state"] == "successful")
    open_view(page, service, survey=survey_id)
    expect(page.locator("button.survey:not(.example)")).to_have_count(2)
    store = xr.open_zarr(f"{service}/v1/surveys/{survey_id}/store")
    with page.expect_download() as download:
        page.get_by_role("link", name="NetCDF").click()
    assert download.value.suggested_filename == f"survey-{survey_id}.nc"
    download.value.save_as(tmp_path / "survey.nc")
    with xr.open_dataset(tmp_path / "survey.nc", engine="h5netcdf") as found:
        np.testing.assert_array_equal(found["lyapunov_max"], store["lyapunov_max"])
    expect(page.locator("pre")).to_contain_text(f'"{service}/v1/surveys/{survey_id}/store"')
    httpx.delete(service + other, timeout=HANG)


@deep
def test_a_survey_that_nobody_chose_and_that_is_deleted_gives_way_to_the_next(
    page: Page, service: str, survey_id: str
) -> None:
    small = SURVEY | {"quantities": ["region"], "delta": SURVEY["delta"] | {"num": 20}}
    here = httpx.post(f"{service}/v1/surveys", json=small, timeout=HANG).json()["links"]["self"]
    wait_until(lambda: get(service + here).json()["state"] == "successful")
    open_view(page, service)
    page.wait_for_url(f"**survey={here.rpartition('/')[2]}**")
    assert httpx.delete(service + here, timeout=HANG).status_code == 204
    page.wait_for_url(f"**survey={survey_id}**")
    shape = "some((each) => each.name?.startsWith('cells') && each.data_source.data.image[0]?.shape?.[1] === 29)"
    wait_for_map(page, f"renderers.{shape}")
    open_view(page, service)


@deep
def test_a_page_is_used_with_the_keyboard_and_a_screen_reader(page: Page, service: str) -> None:
    open_view(page, service)
    for role, name in (("button", "New survey"), ("checkbox", "SN1"), ("combobox", "Map"), ("region", "surveys")):
        expect(page.get_by_role(role, name=name, exact=True)).to_be_visible()
    page.get_by_role("checkbox", name="SN1", exact=True).focus()
    page.keyboard.press("Space")
    wait_for_map(page, "renderers.find((each) => each.name === 'SN1').visible === false")
    expect(page.get_by_text("SN1: ")).to_be_visible()  # what the line means, which a mouse reads in its title
    again = page.locator("[data-action=again]")
    again.focus()
    small = SURVEY | {"quantities": ["region"], "delta": SURVEY["delta"] | {"num": 20}}
    here = httpx.post(f"{service}/v1/surveys", json=small, timeout=HANG).json()["links"]["self"]
    row = page.locator(f"button.survey[data-survey='{here.rpartition('/')[2]}']")
    expect(row).to_have_attribute("data-state", "successful")
    expect(again).to_be_focused()  # although the list was written anew
    httpx.delete(service + here, timeout=HANG)


@deep
def test_surveys_are_searched_and_sorted(page: Page, service: str) -> None:
    open_view(page, service)
    small = SURVEY | {"quantities": ["region"]}
    named = {"zeta": 6, "Alpha": 4, "mu": 5}
    made = []
    for name, num in named.items():
        body = small | {"name": name, "delta": SURVEY["delta"] | {"num": num}}
        made.append(httpx.post(f"{service}/v1/surveys", json=body, timeout=HANG).json()["links"]["self"])
    rows = page.locator("button.survey:not(.example) .name")
    expect(rows.filter(has_text="mu")).to_be_visible()
    page.get_by_label("search surveys").fill("ALPH")
    expect(rows).to_have_text(["Alpha"])
    httpx.patch(service + made[2], json={"notes": "Ask Anna."}, timeout=HANG)
    page.get_by_label("search surveys").fill("anna")
    expect(rows).to_have_text(["mu"])
    page.get_by_label("search surveys").fill("nowhere")
    expect(page.get_by_text("No survey has this text")).to_be_visible()
    page.get_by_label("search surveys").fill("29")  # of δ or ε, in their settings
    page.get_by_label("order of the surveys").select_option("by name")
    wait_until(lambda: [name for name in rows.all_inner_texts() if name in named] == ["Alpha", "mu", "zeta"])
    page.get_by_label("order of the surveys").select_option("largest first")
    wait_until(lambda: [name for name in rows.all_inner_texts() if name in named] == ["zeta", "mu", "Alpha"])
    assert_accessible(page)
    for here in made:  # one that is not done would be dismissed, and stay
        wait_until(lambda here=here: get(service + here).json()["state"] == "successful")
        httpx.delete(service + here, timeout=HANG)
