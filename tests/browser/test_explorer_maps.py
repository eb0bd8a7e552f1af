"""What belongs to a map, beside it: the profile above a diagram, further maps."""

from depth import deep
from explorer_support import assert_accessible, open_view, place_of, point_at, wait_for, wait_for_map
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

#: Whether the second and the third map have cells, and how many windows there are.
FURTHER = """() => ["further2", "further3"].every((name) => {
    const figure = Bokeh.documents.map((each) => each.get_model_by_name(name)).find((each) => each)
    return figure?.renderers.some((each) => each.name?.startsWith("cells") && each.data_source.data.image.length)
})"""
#: How many maps reach into what comes below them.
OVERLAPS = """() => {
    const boxes = [...document.querySelectorAll(".plot, .further:has(.shown), .keys")]
        .map((each) => [each.getBoundingClientRect(), each.scrollHeight])
    const across = (box, other) => other.left < box.right && other.right > box.left
    return boxes.filter(([box, height], i) => boxes.slice(i + 1).some(([other]) =>
        across(box, other) && other.top >= box.top && other.top < box.top + height - 1)).length
}"""
PINNED = "renderers.find((each) => each.name === 'pins').data_source.data"
WINDOWS = """() => new Set(["map", "further2", "further3"].map((name) => {
    const figure = Bokeh.documents.map((each) => each.get_model_by_name(name)).find((each) => each)
    return [figure.x_range.start, figure.x_range.end, figure.y_range.start, figure.y_range.end].join()
})).size"""


@deep
def test_a_profile_has_the_axis_of_the_diagram_and_further_maps_the_window_of_the_first(
    page: Page, service: str
) -> None:
    open_view(page, service, point="0.6,0.1", **{"p.to": "0.8,0.2"})
    beside = page.locator(".beside")
    expect(beside).to_contain_text("along the diagram above: each cell that it crosses")
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
    page.get_by_role("button", name="Pin δ 0.6, ε 0.1").click()
    wait_for_map(page, f"{PINNED}.name.join() === '1'")
    page.get_by_role("button", name="take 1: δ 0.6, ε 0.1 away").click()
    wait_for_map(page, f"{PINNED}.name.length === 0")
    page.get_by_label("Map", exact=True).select_option("largest family")
    family = page.get_by_label("Family", exact=True)
    family.select_option(family.locator("option", has_text=" = C").first.text_content())
    expect(page.locator(".keys")).to_contain_text("of all samples go to it")
    wait_for_map(page, "renderers.some((each) => each.name === 'veil' && each.data_source.data.image.length)")
    page.get_by_role("button", name="Its diagram along δ").click()
    page.wait_for_url("**p.direction=delta**")
    assert_accessible(page)
    family.select_option("all of them")
    page.get_by_label("Map", exact=True).select_option("region")
    page.get_by_role("button", name="Close the point").click()
    page.get_by_role("button", name="Add a second map").click()
    page.get_by_label("Map 2", exact=True).select_option("attractor fraction, 0")
    page.get_by_role("button", name="Add a second map").click()
    page.wait_for_url("**map3=**")
    expect(page.locator(".further.shown, .further:has(.shown)")).to_have_count(2)
    wait_for(page, FURTHER)
    page.mouse.move(*place_of(page, 0.6, 0.06))
    for _ in range(3):
        page.mouse.wheel(0, -400)
    page.wait_for_url("**delta=**")
    assert page.evaluate(WINDOWS) == 1
    point_at(page, 0.604, 0.0622, until="δ0.604")
    expect(page.locator(".further").first).to_contain_text("δ 0.604")
    page.get_by_role("button", name="Add a second map").click()
    page.wait_for_url("**map4=**")
    expect(page.get_by_role("button", name="Add a second map")).to_be_hidden()  # four are as many as there is room for
    page.get_by_role("checkbox", name="first map less this one").last.check()
    expect(page.get_by_text("small less small, the same cells")).to_be_visible()
    page.get_by_role("button", name="Remove map 4").click()
    assert_accessible(page)
    for width in (390, 1024, 1920):
        page.set_viewport_size({"width": width, "height": 900})
        assert page.evaluate("() => document.documentElement.scrollWidth") <= width
        wait_for(page, "() => Bokeh.documents.every((each) => each.is_idle)")
        wait_for(page, f"() => ({OVERLAPS})() === 0")
