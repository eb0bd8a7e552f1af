"""The page on small and large screens, and on paper."""

import re

import pytest
from depth import deep
from explorer_support import open_view
from playwright.sync_api import Page, expect
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


def test_no_screen_is_too_small_and_an_open_point_hides_nothing(page: Page, service: str) -> None:
    open_view(page, service, point="0.6,0.1", **{"p.tab": "motion"})
    expect(page.locator(".beside")).to_contain_text("Damping δ = ")
    for width, height in ((390, 844), (640, 400), (1024, 768), (1280, 800), (1920, 1080)):  # 640: 1280 at 200 %
        page.set_viewport_size({"width": width, "height": height})
        wait_until(lambda width=width: max(page.evaluate(ACROSS)) <= width)  # the map follows by itself
        at = page.evaluate(PLACES)
        left, top, right, bottom = zip(*at.values(), strict=True)
        if width < 900:
            assert set(left) == {0.0}
            assert list(top) == sorted(top)
            assert top[1] >= bottom[0]
            assert top[2] >= bottom[1]
        else:
            assert right[0] <= left[1]
        expect(page.get_by_role("button", name="New survey", exact=True)).to_be_visible()
        expect(page.locator("button.survey").first).to_be_visible()
    page.set_viewport_size({"width": 390, "height": 844})
    wait_until(lambda: page.evaluate(PORTRAIT) <= 390)  # of two pictures side by side the second one is not cut off


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
