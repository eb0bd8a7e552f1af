"""The map by the keyboard, and the theme of the viewer's system."""

import numpy as np
import pytest
from depth import deep
from explorer_support import of_map, open_view, visiting, wait_for, wait_for_map
from playwright.sync_api import Browser, Page, Route, expect

import rattle
from rattle.orbits.orbits_a_to_d import REGIONS

COLUMN = "renderers.find((each) => each.glyph.marker?.value === 'circle' && each.glyph.size?.value === 17).data_source"


def test_the_map_is_used_with_the_keyboard(page: Page, service: str) -> None:
    open_view(page, service, variable="region")
    plot = page.get_by_role("application", name="map over damping")
    plot.focus()
    expect(plot).to_have_attribute("data-keys", "heard")
    said = page.get_by_role("status").filter(has_text="δ")
    for key in ("ArrowRight", "ArrowUp", "ArrowUp", "ArrowLeft", "ArrowRight", "ArrowDown"):  # from the middle
        page.keyboard.press(key)
    delta, epsilon = 0.72, 0.16
    region = REGIONS[int(rattle.regions(np.array([delta]), np.array([epsilon]), 0.6)[0])]
    expect(said).to_have_text(f"δ 0.7200, ε 0.1600: region of the plane, by the period-one orbits that exist, {region}")
    expect(said).to_have_attribute("aria-live", "polite")
    assert of_map(page, f"{COLUMN}.data.x[0]") == pytest.approx(delta)
    assert of_map(page, f"{COLUMN}.data.y[0]") == pytest.approx(epsilon)
    expect(page.locator(".beside")).to_contain_text("Cell at δ 0.72, ε 0.16")
    before = [of_map(page, f"{name}_range.{end}") for name in "xy" for end in ("start", "end")]
    page.keyboard.press("+")
    page.wait_for_url("**delta=**")
    after = [of_map(page, f"{name}_range.{end}") for name in "xy" for end in ("start", "end")]
    assert after == pytest.approx(
        [(old + at) / 2 for old, at in zip(before, (delta, delta, epsilon, epsilon), strict=True)]
    )
    for _ in range(9):  # a cell each: a tenth of the window is hardly more
        page.keyboard.press("Shift+ArrowLeft")
    at = delta - 9 * 0.02
    wait_for_map(page, f"{COLUMN}.data.x.some((x) => Math.abs(x - {at}) < 1e-9)")
    assert of_map(page, "x_range.start") < at < after[0]  # the window has come along
    assert of_map(page, "x_range.end - Bokeh.documents[0].get_model_by_name('map').x_range.start") == pytest.approx(
        after[1] - after[0]
    )
    page.keyboard.press("Enter")
    expect(page.locator(".beside")).to_contain_text(f"Damping δ = {at:.6g}, eccentricity ε = 0.16,")
    page.keyboard.press("Escape")
    expect(page.locator(".beside")).not_to_contain_text("Damping δ = ")
    page.keyboard.press("0")
    wait_for_map(page, f"x_range.start === {before[0]}")
    page.get_by_label("Named places").select_option("COD22, where SN1, G1 and G2 meet")
    wait_for_map(page, "x_range.start > 0.76 && map.x_range.end < 0.78")
    page.get_by_label("Named places").select_option("Figure 5: diagram at δ = 0.6")
    page.wait_for_url("**point=0.6,**p.span=**")
    wait_for_map(page, "x_range.start === 0.4")  # or the key would be pressed over the window before
    plot.focus()
    page.keyboard.press("Backspace")
    wait_for_map(page, "x_range.start > 0.76 && map.x_range.end < 0.78")
    page.keyboard.press("Backspace")
    wait_for_map(page, f"x_range.start === {before[0]}")
    page.keyboard.press("Shift+Backspace")
    wait_for_map(page, "x_range.start > 0.76 && map.x_range.end < 0.78")


def paper(page: Page) -> tuple[str, str]:
    """Colours of the page and of its map."""
    wait_for(page, "() => document.body && window.Bokeh?.documents?.some((each) => each.get_model_by_name('map'))")
    return page.evaluate("getComputedStyle(document.body).backgroundColor"), of_map(page, "background_fill_color")


@deep
def test_the_theme_is_the_system_s_unless_somebody_says_otherwise(browser: Browser, service: str) -> None:
    light, dark = ("rgb(244, 246, 248)", "#ffffff"), ("rgb(15, 19, 23)", "#171c22")
    with visiting(browser, service, color_scheme="dark") as context:
        page = context.new_page()
        asked: list[str] = []
        page.on(
            "request", lambda sent: asked.append(sent.url) if sent.resource_type in ("document", "script") else None
        )
        held: list[Route] = []
        page.route("**/*.js*", lambda route: held.append(route))
        page.goto(service, wait_until="commit")
        expect(page.get_by_role("status").filter(has_text="being loaded")).to_be_visible()  # without any script
        assert page.evaluate("getComputedStyle(document.body).backgroundColor") == dark[0]
        assert held
        page.unroute("**/*.js*")  # which lets them go
        wait_for_map(page, "renderers.some((each) => each.data_source.data.image?.length)")
        assert paper(page) == dark
        expect(page.get_by_text("being loaded")).to_have_count(0)
        assert len(asked) == len(set(asked))  # nor was there a page, or were there scripts, of the other theme
        assert page.evaluate("document.documentElement.dataset.theme") == "dark"
        assert "theme=" not in page.url
        open_view(page, service, theme="light")
        assert paper(page) == light
        page.get_by_role("button", name="Dark theme").click()
        page.wait_for_url(lambda url: "theme=" not in url)
        assert paper(page) == dark
        assert "theme=" not in page.url  # it is the system's again
        with page.expect_navigation():
            page.emulate_media(color_scheme="light")  # the sun rises
        assert paper(page) == light
