"""What belongs to a map, beside it: the profile above a diagram, further maps."""

from explorer_support import assert_accessible, open_view, wait_for
from playwright.sync_api import Page, expect

#: Left and right of the frames of the profile and of the diagram on the screen, and what they span.
FRAMES = """() => ["profile", "diagram"].map((name) => {
    const figure = Bokeh.documents.map((each) => each.get_model_by_name(name)).find((each) => each)
    const view = Bokeh.index.find_one(figure)
    const left = view.canvas_view.el.getBoundingClientRect().left
    const frame = view.frame.bbox
    return [left + frame.left, left + frame.right, figure.x_range.start, figure.x_range.end]
})"""
SHOWN = """() => ["profile", "diagram"].every((name) => {
    const figure = window.Bokeh && Bokeh.documents.map((each) => each.get_model_by_name(name)).find((each) => each)
    return figure && Bokeh.index.find_one(figure)?.frame.bbox.width > 0 && Bokeh.documents.every((each) => each.is_idle)
})"""


def test_a_profile_stands_above_the_diagram_with_its_axis(page: Page, service: str) -> None:
    open_view(page, service, point="0.6,0.1", **{"p.to": "0.8,0.2"})
    beside = page.locator(".beside")
    expect(beside).to_contain_text("along the diagram below: each cell that it crosses")
    expect(beside).to_contain_text("Impact speed against the way from here")
    wait_for(page, SHOWN)
    profile, diagram = page.evaluate(FRAMES)
    assert profile == diagram
    assert profile[2:] == [0.0, 1.0]
    page.get_by_label("Profile of").select_option("lyapunov max")
    expect(beside).to_contain_text("Largest Lyapunov exponent")
    page.wait_for_url("**profile=lyapunov_max,0**")
    page.get_by_label("way to ε").fill("0.15")
    page.get_by_label("way to ε").press("Enter")
    page.wait_for_url("**p.to=0.8,0.15**")
    assert_accessible(page)
