"""What demanding users met on the page, one thing after the other."""

import re
from collections.abc import Iterator
from typing import Any
from urllib.parse import parse_qs, urlsplit

import httpx
import numpy as np
import pytest
from colour_difference import difference, lab_of
from depth import deep
from explorer_support import SURVEY, of_map, open_view, place_of, visiting, wait_for, wait_for_map
from faults import Faults
from playwright.sync_api import Browser, BrowserContext, Page, expect
from service_processes import get
from waiting import HANG, wait_until

import rattle
from gear_rattle.service.explorer.map.planes import ENLARGED_POINTS

MODEL = "Bokeh.documents.map((each) => each.get_model_by_name('{}')).find((each) => each)"
IDLE = "() => Bokeh.documents.every((each) => each.is_idle)"
#: Boxes of the words that tell of what is under the mouse.
TOOLTIPS = """() => {
    const found = [], look = (root) => root.querySelectorAll("*").forEach((each) => {
        if (each.classList.contains("bk-Tooltip")) found.push(each)
        if (each.shadowRoot) look(each.shadowRoot)
    })
    look(document)
    return found.map((each) => each.getBoundingClientRect()).filter((box) => box.width > 0)
        .map((box) => [box.left, box.top, box.right, box.bottom])
}"""
#: The values of the map that is drawn, and of finer cells over it.
VALUES, FINER = (
    f"renderers.find((each) => each.name === '{name}').data_source.data.image.map((each) => Array.from(each))[0]"
    for name in ("cells0", "fine0")
)


def submitted(service: str, **changes: Any) -> str:
    """The address of a new survey."""
    return str(httpx.post(f"{service}/v1/surveys", json=SURVEY | changes, timeout=HANG).json()["links"]["self"])


def done(service: str, here: str) -> str:
    """The id of a survey, once it is computed."""
    wait_until(lambda: get(service + here).json()["state"] == "successful")
    return here.rpartition("/")[2]


@pytest.fixture
def touched(browser: Browser, service: str) -> Iterator[BrowserContext]:
    """A browser on a screen for fingers."""
    with visiting(browser, service, has_touch=True, is_mobile=True) as context:
        yield context


@deep
def test_a_finger_opens_a_point_and_moves_the_map(touched: BrowserContext, service: str) -> None:
    page = touched.new_page()
    page.set_viewport_size({"width": 390, "height": 844})
    open_view(page, service, overlays="none")
    page.evaluate("() => document.querySelector('.plot').scrollIntoView()")
    page.touchscreen.tap(*place_of(page, 0.6, 0.1))
    page.wait_for_url("**point=**")
    at = [float(each) for each in parse_qs(urlsplit(page.url).query)["point"][0].split(",")]
    assert at == pytest.approx([0.6, 0.1], abs=0.01)  # a pixel or two
    expect(page.locator(".beside")).to_contain_text("Damping δ = ")
    page.evaluate("() => document.querySelector('.plot').scrollIntoView()")
    x, y = place_of(page, 0.6, 0.1)
    before = of_map(page, "x_range.start")
    drag(page, (x, y), (x - 60, y))
    wait_for_map(page, f"x_range.start > {before}")


def drag(page: Page, begin: tuple[float, float], end: tuple[float, float]) -> None:
    """Move a finger over the screen."""
    chrome = page.context.new_cdp_session(page)
    steps = [(begin[0] + (end[0] - begin[0]) * i / 8, begin[1] + (end[1] - begin[1]) * i / 8) for i in range(9)]
    kinds = ["touchStart", *["touchMove"] * 8]
    for kind, (x, y) in zip(kinds, steps, strict=True):
        chrome.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": x, "y": y}]})
    chrome.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    chrome.detach()


@deep
def test_the_picture_of_a_window_is_the_window_that_is_seen(page: Page, service: str, survey_id: str) -> None:
    """Colours of the page, cells as fine as they are there, and the family that is chosen."""
    window = {"delta": "0.6,0.61", "epsilon": "0.06,0.07"}
    open_view(page, service, survey=survey_id, variable="orbit_velocity", limits="full", family="1", **window)
    finer = "some((each) => each.name === 'fine0' && each.data_source.data.image[0]?.shape[0] > 200)"
    wait_for_map(page, f"renderers.{finer}")
    expect(page.get_by_text("Computing this window")).to_have_count(0)
    wait_for(page, IDLE)
    mapper = "renderers.find((each) => each.name === 'cells0').glyph.color_mapper"
    ends = [of_map(page, f"{mapper}.{end}") for end in ("low", "high")]
    link = page.locator(".side").get_by_role("link", name="PNG", exact=True)

    def asked() -> dict[str, str]:
        query = urlsplit(link.get_attribute("href") or "").query
        return {name: value for name, (value,) in parse_qs(query).items()}

    def told() -> bool:
        """Whether the link has the size of the map, which is still being laid out."""
        inner = [str(int(of_map(page, f"inner_{side}"))) for side in ("width", "height")]
        return [asked().get(f"pixels_{axis}") for axis in ("delta", "epsilon")] == inner

    wait_until(told)
    said = asked()
    assert [float(said["low"]), float(said["high"])] == ends
    assert (said["family"], said["delta_min"]) == ("1", "0.6")
    here = f"{service}/{link.get_attribute('href')}"
    whole = httpx.get(here, timeout=HANG)
    others = [httpx.get(re.sub(leave_out, "", here), timeout=HANG) for leave_out in (r"&pixels[^&]*", r"&family=1")]
    assert [each.status_code for each in (whole, *others)] == [200] * 3
    assert whole.content.startswith(b"\x89PNG")
    assert len({each.content for each in (whole, *others)}) == 3


@deep
def test_the_picture_has_the_crisis_and_the_design_limit_and_maps_beside_have_theirs(
    page: Page, service: str, survey_id: str
) -> None:
    beside = {"map2": f"{survey_id},lyapunov_max,0,0"}
    open_view(page, service, survey=survey_id, overlays="crisis,design_limit", share="0.8", **beside)
    lines = "filter((each) => ['crisis', 'design_limit'].includes(each.name) && each.data_source.data.xs.length)"
    wait_for_map(page, f"renderers.{lines}.length === 2")
    expect(page.locator(".keys")).not_to_contain_text("is being computed")
    for place, told in ((".side", True), (".further", False)):
        link = page.locator(place).get_by_role("link", name="SVG", exact=True).first
        drawing = httpx.get(f"{service}/{link.get_attribute('href')}", timeout=HANG).text
        for colour in ("#00695c", "#b8860b"):
            assert (f"stroke: {colour}" in drawing) == told
    link = page.locator(".further").get_by_role("link", name="PDF", exact=True)
    assert "variable=lyapunov_max" in (link.get_attribute("href") or "")
    page.get_by_role("checkbox", name="first map less this one").check()
    expect(link).to_have_count(0)  # a difference is no map of a survey


@deep
def test_an_open_point_is_printed_on_sheets_of_its_own(page: Page, service: str) -> None:
    open_view(page, service, point="0.6,0.1", **{"p.tab": "motion"})
    beside = page.locator(".beside")
    expect(beside).to_contain_text("Order spectrum of the force between the teeth")
    wait_for(page, IDLE)
    sheet = page.pdf(format="A4", margin=dict.fromkeys(("top", "bottom", "left", "right"), "12mm"))
    assert len(re.findall(rb"/Type /Page\b", sheet)) >= 2  # of the map, and of the open tab
    page.emulate_media(media="print")
    key, point = (page.locator(each).bounding_box() for each in (".keys", ".beside"))
    assert key is not None
    assert point is not None
    assert 600 < point["width"] < 720  # CSS pixels across A4 less its margins
    assert point["y"] >= key["y"] + key["height"]
    expect(page.get_by_label("Motion shown")).to_be_hidden()
    for each in ("Close the point", "Diagram"):
        expect(page.get_by_role("button", name=each, exact=True)).to_be_hidden()
    expect(page.get_by_role("heading", name="Motion", exact=True)).to_be_visible()


@deep
def test_events_and_motions_of_a_diagram_are_told_side_by_side(page: Page, service: str) -> None:
    open_view(page, service, point="0.6,0.089", overlays="none", **{"p.tab": "diagram"})
    expect(page.get_by_role("list", name="Key of the diagram")).to_contain_text("saddle-node")
    model = MODEL.format("diagram")
    marks = f"{model}.renderers.find((each) => each.data_source.data.what).data_source.data"
    wait_for(page, f"() => {marks}?.what.length > 0")
    page.evaluate(f"() => Bokeh.index.find_one({model}).el.scrollIntoView({{block: 'center'}})")
    wait_for(page, IDLE)
    place = f"""(i) => {{
        const view = Bokeh.index.find_one({model}), box = view.canvas_view.el.getBoundingClientRect(), data = {marks}
        return [box.x + view.frame.x_scale.compute(data.x[i]), box.y + view.frame.y_scale.compute(data.v[i])]
    }}"""
    number = page.evaluate(f"() => {marks}.what.findIndex((each) => each.includes('saddle-node'))")

    def told() -> bool:
        x, y = page.evaluate(place, number)
        page.mouse.move(x - 5, y)
        page.mouse.move(x, y)
        page.wait_for_timeout(100)
        return len(page.evaluate(TOOLTIPS)) >= 2

    wait_until(told)
    boxes = page.evaluate(TOOLTIPS)
    for i, (left, top, right, bottom) in enumerate(boxes):
        for other in boxes[i + 1 :]:
            assert other[0] >= right or other[2] <= left or other[1] >= bottom or other[3] <= top


@deep
def test_one_long_period_does_not_take_the_colours_of_all_others(page: Page, service: str, survey_id: str) -> None:
    open_view(page, service, survey=survey_id, variable="attractor_m")
    low, high = (
        of_map(page, f"renderers.find((each) => each.name === 'cells0').glyph.color_mapper.{end}")
        for end in ("low", "high")
    )
    drawn = np.array(of_map(page, VALUES))
    values = drawn[np.isfinite(drawn)]
    assert values.max() > high
    assert high == pytest.approx(max(np.quantile(values, 0.98), low + 1))
    expect(page.get_by_text("of the values are above the scale")).to_be_visible()


@deep
def test_a_deep_window_tells_above_the_map_what_it_waits_for_and_is_not_white(
    page: Page, service: str, survey_id: str, held: Faults
) -> None:
    held.hold(0)  # the only worker is busy until this test is over
    here = submitted(service, quantities=["region"], name="in the way", seed=5)
    wait_until(lambda: get(service + here).json()["state"] == "running")
    window = {"delta": "0.6,0.60001", "epsilon": "0.15,0.15001"}  # its cells are cheap
    open_view(page, service, survey=survey_id, variable="quiet_fraction", **window)
    said = page.get_by_text("Computing this window")
    expect(said).to_be_visible()
    words, plot = said.bounding_box(), page.locator(".plot").bounding_box()
    assert words is not None
    assert plot is not None
    assert plot["y"] - 60 < words["y"] + words["height"] <= plot["y"] + 1
    wait_for_map(page, f"{FINER}?.length === {ENLARGED_POINTS**2}")
    assert np.isfinite(of_map(page, FINER)).all()
    held.release()
    expect(said).to_have_count(0)
    httpx.delete(service + here, timeout=HANG)


@deep
def test_colours_that_stand_for_something_are_told_apart_without_green(page: Page, service: str) -> None:
    open_view(page, service, variable="region")
    keys = page.get_by_role("list", name="colours of the map").get_by_role("listitem")
    found = {}
    for item in keys.all():
        name = re.match(r"[IV]+", item.inner_text().strip())
        fill = item.evaluate(
            "(each) => [each, ...each.querySelectorAll('*')].map((one) => getComputedStyle(one).backgroundColor)"
            ".find((one) => one.startsWith('rgb(') )"
        )
        if name and fill:
            found[name[0]] = lab_of(hexadecimal(fill))
    assert difference(found["III"], found["V"]) > 20
    lines = {
        name: lab_of(of_map(page, f"renderers.find((each) => each.name === '{name}').glyph.line_color.value"))
        for name in ("PD1", "quiet_limit")
    }
    assert difference(lines["PD1"], lines["quiet_limit"]) > 20


def hexadecimal(colour: str) -> str:
    """A colour as CSS computes it, in the other notation."""
    return "#" + "".join(f"{int(each):02x}" for each in re.findall(r"\d+", colour)[:3])


@deep
def test_a_small_survey_does_not_wait_behind_a_long_one(page: Page, service: str) -> None:
    axes = {name: SURVEY[name] | {"num": 1000} for name in ("delta", "epsilon")}
    long = submitted(service, **axes, quantities=["attractors"], name="long", seed=6)  # minutes, whatever the machine
    wait_until(lambda: get(service + long).json()["state"] == "running")
    small = submitted(service, quantities=["region"], name="short", seed=7)
    open_view(page, service, survey=long.rpartition("/")[2])
    expect(page.locator("button.survey", has_text="short")).to_have_attribute("data-state", "successful")
    expect(page.locator("button.survey", has_text="long")).to_have_attribute("data-state", "running")
    for here in (long, small):
        httpx.delete(service + here, timeout=HANG)


@deep
def test_two_gears_stand_side_by_side(page: Page, service: str, survey_id: str) -> None:
    grid = {"quantities": ["region"], "delta": SURVEY["delta"], "epsilon": SURVEY["epsilon"]}
    other = done(service, submitted(service, **grid, beta=0.3, name="narrow", seed=8))
    open_view(page, service, survey=survey_id, variable="region")
    page.get_by_role("button", name="Add a second map").click()
    choice = page.get_by_label("Survey of map 2")
    choice.select_option(choice.locator("option", has_text="narrow").first.text_content())
    page.wait_for_url(f"**map2={other}**")
    second = f"({MODEL.format('further2')})"
    cells = f"{second}?.renderers.find((each) => each.name === 'cells0')?.data_source.data.image[0]"
    delta, epsilon = (np.linspace(*SURVEY[name].values()) for name in ("delta", "epsilon"))
    expected = rattle.regions(delta, epsilon[:, None], 0.3)
    wait_until(lambda: page.evaluate(f"() => {cells} ? Array.from({cells}) : []") == expected.ravel().tolist())
    np.testing.assert_array_equal(of_map(page, VALUES), rattle.regions(delta, epsilon[:, None], 0.6).ravel())
    page.mouse.move(*place_of(page, 0.6, 0.06))
    page.mouse.wheel(0, -400)
    page.wait_for_url("**delta=**")
    for end in ("start", "end"):
        wait_until(lambda end=end: page.evaluate(f"() => {second}.x_range.{end}") == of_map(page, f"x_range.{end}"))
