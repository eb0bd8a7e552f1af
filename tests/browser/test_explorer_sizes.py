"""The page on small and large screens, and on paper."""

import re

import pytest
from depth import deep
from explorer_support import assert_accessible, open_view, place_of, visiting
from playwright.sync_api import Browser, Page, expect
from waiting import wait_until

PLACES = """() => Object.fromEntries([".side", ".middle", ".beside"].map((each) => {
    const box = document.querySelector(each).getBoundingClientRect()
    return [each, [box.left, box.top, box.right, box.bottom]]
}))"""
#: What the page reaches to on the right, and the map.
ACROSS = "() => [document.documentElement.scrollWidth, document.querySelector('.plot').getBoundingClientRect().right]"
#: What the picture of a motion on the right reaches to.
PORTRAIT = """() => {
    const figure = Bokeh.documents.map((each) => each.get_model_by_name("portrait")).find((each) => each)
    const view = figure && Bokeh.index.find_one(figure)
    return view ? view.el.getBoundingClientRect().right : Infinity
}"""


#: The sides on which the bar of colours is.
BAR = """() => {
    const map = Bokeh.documents.map((each) => each.get_model_by_name("map")).find((each) => each)
    return ["right", "below"].filter((side) => map[side].some((each) => each.color_mapper))
}"""


def height_of(page: Page, text: str) -> float:
    """Where a text begins, from above; −1 while it is not drawn."""
    box = page.get_by_text(text).bounding_box()
    return -1.0 if box is None else box["y"]


def test_no_screen_is_too_small_and_an_open_point_hides_nothing(page: Page, service: str) -> None:
    open_view(page, service, point="0.6,0.1", **{"p.tab": "motion"})
    expect(page.locator(".beside")).to_contain_text("Damping δ = ")
    for width, height in ((390, 844), (640, 400), (768, 1024), (1024, 768), (1280, 800), (1920, 1080)):  # 640: at 200 %
        page.set_viewport_size({"width": width, "height": height})
        wait_until(lambda width=width: max(page.evaluate(ACROSS)) <= width)  # the map follows by itself
        wait_until(lambda width=width: page.evaluate(BAR) == ["below" if width < 500 else "right"])
        at = page.evaluate(PLACES)
        if width < 900:
            assert at[".side"][0] == at[".middle"][0] == 0.0
            assert at[".middle"][1] >= at[".side"][3]
            assert page.locator(".plot").bounding_box()["width"] > 0.95 * width  # type: ignore[index]
            page.get_by_text("Surveys, and a new one").click()
        else:
            assert at[".side"][2] <= at[".middle"][0]
        if width < 1200:  # the point is a sheet at the lower edge
            assert at[".beside"][3] == height
            wait_until(
                lambda top=at[".beside"][1], height=height: top < height_of(page, "From a random start") < height
            )
        expect(page.get_by_role("button", name="New survey", exact=True)).to_be_visible()
        expect(page.locator("button.survey").first).to_be_visible()
        if width < 900:
            page.get_by_text("Surveys, and a new one").click()
    page.set_viewport_size({"width": 390, "height": 844})
    wait_until(lambda: page.evaluate(PORTRAIT) <= 390)  # of two pictures side by side the second one is not cut off


def test_a_telephone_needs_no_mouse(browser: Browser, service: str) -> None:
    with visiting(browser, service, has_touch=True, is_mobile=True) as context:
        page = context.new_page()
        page.set_viewport_size({"width": 390, "height": 844})
        open_view(page, service)
        page.wait_for_url("**survey=**")
        for name in ("Quiet", "Motions", "Chaos", "Regions"):
            button = page.get_by_role("button", name=name, exact=True).bounding_box()
            assert button is not None
            assert button["x"] >= 0
            assert button["x"] + button["width"] <= 390
        x, y = place_of(page, 0.6, 0.03)  # low on the map, where the sheet would hide it
        page.touchscreen.tap(x, y)
        beside = page.locator(".beside")
        expect(beside.get_by_text("Damping δ = ")).to_be_in_viewport()
        beside.get_by_role("button", name="More", exact=True).tap()
        wait_until(lambda: beside.bounding_box()["height"] > 600)  # type: ignore[index]
        beside.get_by_role("button", name="Less", exact=True).tap()
        wait_until(lambda: beside.bounding_box()["height"] < 400)  # type: ignore[index]
        wait_until(lambda: place_of(page, 0.6, 0.03)[1] < beside.bounding_box()["y"])  # type: ignore[index]
        assert_accessible(page)
        beside.get_by_role("button", name="Close", exact=True).tap()
        page.wait_for_url(lambda url: "point=" not in url)
        page.get_by_text("Surveys, and a new one").tap()
        page.get_by_role("button", name="New survey", exact=True).tap()
        expect(page.get_by_text("cells, about")).to_be_visible()
        assert max(page.evaluate(ACROSS)) <= 390


@pytest.mark.parametrize("width", [pytest.param(1280, marks=deep), 1920])
def test_a_view_is_printed_whole_with_its_key(page: Page, service: str, width: int) -> None:
    page.set_viewport_size({"width": width, "height": 1000})
    open_view(page, service)
    expect(page.get_by_text("COD20–23")).to_be_visible()
    page.wait_for_url("**survey=**")  # the one that was chosen
    sheet = page.pdf(format="A4", margin=dict.fromkeys(("top", "bottom", "left", "right"), "12mm"))
    assert len(re.findall(rb"/Type /Page\b", sheet)) == 1
    page.emulate_media(media="print")
    wait_until(lambda: 600 < page.evaluate(ACROSS)[1] < 720)  # CSS pixels across A4 less its margins
    key = page.locator(".keys").bounding_box()
    assert key is not None
    address = page.evaluate("() => getComputedStyle(document.querySelector('header'), '::after').content")
    assert address == f'"{page.url}"'
    assert key["y"] + key["height"] < 1030
    expect(page.get_by_role("button", name="New survey", exact=True)).to_be_hidden()
    expect(page.get_by_text("COD20–23")).to_be_visible()
