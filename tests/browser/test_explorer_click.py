"""The view of a point in a browser, beside the map that was clicked."""

import re
from typing import Any
from urllib.parse import parse_qs, urlsplit

import httpx
import numpy as np
import pytest
from depth import deep
from explorer_support import BESIDE, CELLS, assert_accessible, click_cell, open_tab, open_view, wait_for
from playwright.sync_api import Page, expect
from waiting import HANG

import rattle

FIGURE = "Bokeh.documents.map((each) => each.get_model_by_name('{}')).find((each) => each)"


def figure(page: Page, name: str, expression: str) -> Any:
    """What an expression on a figure is, once the figure is there."""
    model = FIGURE.format(name)
    wait_for(page, f"() => {{ const it = {model}; return it && Bokeh.index.find_one(it) }}")
    return page.evaluate(f"() => {model}.{expression}")


def column(page: Page, name: str, numbers: str) -> Any:
    """Numbers that a figure has, once it is there."""
    figure(page, name, "id")
    return np.array(page.evaluate(f"() => Array.from({FIGURE.format(name)}.{numbers})"))


def beside(page: Page, text: str) -> None:
    expect(page.locator(".beside")).to_contain_text(text)


def click_basins(page: Page, tau: float, v: float) -> None:
    """Click a state in the picture of the basins."""
    figure(page, "basins", "id")
    page.evaluate(f"() => Bokeh.index.find_one({FIGURE.format('basins')}).el.scrollIntoView()")
    x, y = page.evaluate(
        f"""([tau, v]) => {{
            const view = Bokeh.index.find_one({FIGURE.format("basins")})
            const box = view.canvas_view.el.getBoundingClientRect()
            return [box.x + view.frame.x_scale.compute(tau), box.y + view.frame.y_scale.compute(v)]
        }}""",
        [tau, v],
    )
    page.mouse.click(x, y)


def is_in_view(page: Page, name: str) -> bool:
    """Whether a figure, drawn, begins in the window as it was opened."""
    figure(page, name, "id")
    top, bottom = page.evaluate(
        f"() => {{ const box = Bokeh.index.find_one({FIGURE.format(name)}).el.getBoundingClientRect();"
        " return [box.top, box.bottom] }"
    )
    return 0 < top < bottom - 200 and top + 200 < page.evaluate("innerHeight")


def test_a_click_shows_the_point(page: Page, service: str) -> None:
    open_view(page, service, theme="light")
    click_cell(page, 0.6, 0.1)
    beside(page, "Damping δ = ")
    beside(page, "the gear runs quietly in 7")
    beside(page, "from 1,024 starts")
    expect(
        page.get_by_role("img", name=re.compile("^Shares of starts: quiet 7.*chaotic.*P\\(1,1,0\\) = C"))
    ).to_be_visible()
    expect(page.get_by_text("The loudest motion, chaotic, has")).to_be_visible()
    ends = page.get_by_role("table", name="Where each motion begins and ends")
    expect(ends.get_by_role("row", name=re.compile("P\\(1,1,0\\) = C"))).to_contain_text(
        "begins by a saddle-node (SN1)"
    )
    expect(ends.get_by_role("row", name=re.compile("chaotic"))).to_contain_text("ends in the boundary crisis")
    expect(page.get_by_text("The margin of quiet running is an impact of speed")).to_be_visible()
    assert page.evaluate(f"() => !{FIGURE.format('basins')}")  # nobody looks at them
    open_tab(page, "Basins")
    beside(page, f"{CELLS} × {CELLS} cells")
    assert is_in_view(page, "basins")
    assert figure(page, "basins", "background_fill_color") == "#ffffff"
    open_tab(page, "Numbers")
    expect(page.get_by_role("table", name=re.compile("Attractors from 1,024 starts"))).to_be_visible()
    expect(page.get_by_role("table", name="Period-one orbits").get_by_role("row")).to_have_count(5)
    page.get_by_role("button", name="Go to a point").click()
    expect(page.get_by_label("Enter as")).to_be_visible()
    assert_accessible(page)


def test_the_open_tab_is_in_the_address_and_back_opens_the_one_before(page: Page, service: str) -> None:
    open_view(page, service, point="0.6,0.1", **{"p.tab": "motion"})
    expect(page.get_by_label("Motion shown")).to_be_visible()
    beside(page, "Order spectrum of the force between the teeth")
    assert is_in_view(page, "trace")
    assert page.evaluate(f"() => !{FIGURE.format('basins')} && !{FIGURE.format('diagram')}")
    expect(page.get_by_text("The margin of quiet running")).to_be_hidden()
    open_tab(page, "Numbers")
    expect(page.get_by_label("Motion shown")).to_be_hidden()
    table = page.get_by_role("table", name="Events of the diagram")
    expect(table).to_contain_text("beginning of chaos")  # after which the table stays
    events = table.get_by_role("row")
    expect(events).to_have_count(7)  # six, and the heads
    whole = page.get_by_text(re.compile(r"All \d+ rows")).last
    whole.click()
    expect(events).to_have_count(1 + int(re.findall(r"\d+", whole.text_content() or "")[0]))
    assert_accessible(page)
    page.go_back()
    page.wait_for_url("**p.tab=motion**")
    expect(page.get_by_label("Motion shown")).to_be_visible()
    page.locator(".beside").get_by_role("button", name="Diagram", exact=True).focus()
    page.keyboard.press("Enter")
    page.wait_for_url("**p.tab=diagram**")
    key = page.get_by_role("list", name="Key of the diagram")
    for each in ("stable", "unstable", "swept upward", "swept downward", "saddle-node", "period doubling", "grazing"):
        expect(key.get_by_role("listitem").filter(has_text=re.compile(rf"(^|\s){each}$"))).to_be_visible()
    assert is_in_view(page, "diagram")
    dense = figure(page, "diagram", "y_range.start")
    page.get_by_role("button", name="All speeds").click()
    wait_for(page, f"() => {FIGURE.format('diagram')}.y_range.start < {dense}")
    expect(page.get_by_role("button", name="All speeds")).to_have_attribute("aria-pressed", "true")
    expect(page.get_by_role("button", name="Dense speeds")).to_have_attribute("aria-pressed", "false")
    low, high = (figure(page, "diagram", f"y_range.{end}") for end in ("start", "end"))
    speeds = column(page, "diagram", "renderers.find((each) => each.data_source.data.what).data_source.data.v")
    assert low < speeds.min() < low + 0.2 * (high - low)
    names = "renderers.find((each) => each.glyph.type === 'Text').data_source.data.name"
    assert {each.rpartition(" ")[0] for each in column(page, "diagram", names)} <= {
        "saddle-node", "period doubling", "grazing",
    }  # fmt: skip
    assert column(page, "diagram", names).size >= 3


@deep
def test_a_motion_is_chosen_in_the_basins_and_its_address_shows_it_again(page: Page, service: str) -> None:
    open_view(page, service, point="0.6,0.1", theme="dark", **{"p.tab": "basins"})
    beside(page, f"{CELLS} × {CELLS} cells")
    assert figure(page, "basins", "background_fill_color") != "#ffffff"
    assert_accessible(page)
    click_basins(page, 0.3, 4.9)
    beside(page, "From the chosen initial condition")
    page.wait_for_url("**p.tau=**")
    said = {name: values[0] for name, values in parse_qs(urlsplit(page.url).query).items()}
    tau, v = float(said["p.tau"]), float(said["p.v"])
    assert tau == pytest.approx(0.3, abs=0.01)  # a pixel
    assert v == pytest.approx(4.9, abs=0.05)
    page.goto(page.url)
    beside(page, "From the chosen initial condition")
    source = "renderers[0].data_source.data.phi"
    wait_for(page, f"() => {FIGURE.format('trace')}?.{source}.length > 0")
    phi = np.array(figure(page, "trace", f"{source}.slice ? Array.from({FIGURE.format('trace')}.{source}) : []"))
    periods = figure(page, "trace", "x_range.end")
    expected = rattle.Gear(0.6, 0.1).trajectory(tau, v, periods, phi.size)
    np.testing.assert_array_equal(phi, expected.phi)


@deep
def test_the_diagram_turns_and_the_point_is_closed(page: Page, service: str) -> None:
    open_view(page, service, point="0.6,0.1", **{"p.tab": "diagram"})
    beside(page, "against the eccentricity ε")
    page.get_by_role("button", name="along damping δ").click()
    beside(page, "against the damping δ")
    page.wait_for_url("**p.direction=delta**")
    assert figure(page, "diagram", "x_range.start") == pytest.approx(0.55)
    page.get_by_role("button", name="Close the point").click()
    expect(page.locator(".beside")).not_to_contain_text("Damping δ = ")


@deep
def test_a_slider_takes_basins_and_motion_along_the_diagram(page: Page, service: str) -> None:
    open_view(page, service, point="0.6,0.089", overlays="none", **{"p.tab": "diagram"})
    beside(page, "periodic motions")
    expect(page.get_by_role("list", name="Key of the diagram")).to_contain_text("saddle-node")
    open_tab(page, "Basins")
    beside(page, f"{CELLS} × {CELLS} cells")
    open_tab(page, "Motion")
    motions = page.get_by_label("Motion shown")
    motions.select_option(motions.locator("option", has_text="P(8,8,6)").text_content())
    beside(page, "P(8,8,6): 8 impacts on the wall Φ = β and 6 on Φ = −β every 8 forcing periods")
    motions.select_option(motions.locator("option", has_text="P(1,1,0)").text_content())
    beside(page, "P(1,1,0): 1 impact on the wall Φ = β and 0 on Φ = −β every forcing period")
    here = "center.find((each) => each.dimension === 'height').location"
    slider = page.get_by_role("slider")
    slider.focus()
    for _ in range(5):
        slider.press("ArrowRight")
    low, high = (figure(page, "diagram", f"x_range.{end}") for end in ("start", "end"))
    epsilon = (1.0 - 0.55) * low + 0.55 * high
    expect(page.get_by_role("slider", name=f"Along the diagram, at δ 0.6, ε {epsilon:.5g}")).to_be_focused()
    beside(page, f"{BESIDE} × {BESIDE} cells")
    page.wait_for_url("**p.at=0.55**")
    gear = rattle.Gear(0.6, epsilon)
    basins = gear.basins(BESIDE, None, "refined")
    cells = "renderers.find((each) => each.data_source.data.label).data_source.data.label[0]"
    np.testing.assert_array_equal(column(page, "basins", cells), basins.labels.ravel())
    assert figure(page, "diagram", here) == epsilon
    (orbit,) = (each for each in basins.attractors if each.name == "P(1,1,0)")
    wait_for(page, f"() => {FIGURE.format('trace')}.x_range.end === 12")
    phi = column(page, "trace", "renderers[0].data_source.data.phi")
    np.testing.assert_array_equal(phi, gear.trajectory(orbit.tau, orbit.v, 12.0, phi.size).phi)
    assert_accessible(page)
    for _ in range(5):
        slider.press("ArrowLeft")  # to where the point is
    page.wait_for_url(lambda url: "p.at=" not in url)
    beside(page, f"{CELLS} × {CELLS} cells")
    assert figure(page, "diagram", here) == 0.089
    open_tab(page, "Numbers")
    notebook = page.get_by_role("link", name="A notebook").get_attribute("href")
    assert "gear(0.6, 0.089)" in httpx.get(f"{service}/{notebook}", timeout=HANG).text
    page.get_by_text(re.compile(r"All \d+ rows")).last.click()
    event = page.get_by_role("row", name="saddle-node").first.get_by_role("link")
    place = event.get_attribute("data-point")
    event.click()
    page.wait_for_url(f"**point={place}**")
