"""What the colours of a map span, in a browser, and what is clicked beside the map."""

from depth import deep
from explorer_support import open_view, place_of, wait_for_map
from playwright.sync_api import Page, expect
from waiting import wait_until

MAPPER = "renderers.find((each) => each.name === 'cells{:d}').glyph.color_mapper"

#: Of the colour bar that is shown: the room beside it, how wide its longest number would be there, some numbers.
BAR = """() => {
    const map = Bokeh.documents.map((each) => each.get_model_by_name("map")).find((each) => each)
    const bar = map.right.find((each) => each.color_mapper && each.visible), plot = Bokeh.index.find_one(map)
    const view = plot.computed_renderer_views.find((each) => each.model === bar)
    const ink = document.createElement("canvas").getContext("2d")
    ink.font = `${bar.major_label_text_font_size} ${bar.major_label_text_font}`
    const numbers = (ticks) => bar.formatter.doFormat(ticks, {loc: 0}).join(" ")
    return [
        plot.canvas_view.bbox.width - view._frame_view.bbox.right,
        bar.label_standoff + ink.measureText("−1.234e−5").width,
        [[-1.5, -1, -0.5, 0], [1.6e-4, 1.7e-4], [0, 5e4, 1e5], [0.60001, 0.60002], [2e-7, 3e-6]].map(numbers),
    ]
}"""


@deep
def test_the_scale_of_colours_is_whole_and_chosen(page: Page, service: str, survey_id: str) -> None:
    open_view(page, service, survey=survey_id, variable="attractor_fraction")
    page.get_by_label("Map", exact=True).select_option("lyapunov max")  # whose numbers are wider
    wait_for_map(page, "renderers.find((each) => each.name === 'cells0').glyph.color_mapper.low < -1")
    wait_until(lambda: page.evaluate("() => Bokeh.documents.every((each) => each.is_idle)"))
    room, width, numbers = page.evaluate(BAR)
    assert room >= width
    assert numbers == ["−1.5 −1 −0.5 0", "1.6e−4 1.7e−4", "0 50000 1e5", "0.60001 0.60002", "2e−7 3e−6"]
    page.get_by_label("Colour range").select_option("from … to")
    page.wait_for_url("**limits=**")
    enter(page, "from", "-0.1")
    page.wait_for_url("**limits=-0.1,**")
    expect(page.get_by_text("of the values are below the scale")).to_be_visible()
    wait_for_map(page, "right.find((each) => each.text === '▼').visible")
    enter(page, "to", "-1")
    expect(page.get_by_role("alert").filter(has_text="Colours cannot span -0.1 to -1")).to_be_visible()
    enter(page, "to", "1")
    page.wait_for_url("**limits=-0.1,1.0**")
    page.get_by_role("checkbox", name="log scale").check()
    wait_for_map(page, f"{MAPPER.format(True)}.low > 0")
    expect(page.locator(".keys")).to_contain_text("zero or below")
    page.wait_for_url(lambda url: "log=1" in url and "limits=-" not in url)  # from the least positive value on
    page.get_by_role("checkbox", name="log scale").uncheck()
    wait_for_map(page, "renderers.find((each) => each.name === 'cells0').visible")
    expect(page.locator(".keys")).not_to_contain_text("zero or below")
    page.wait_for_url(lambda url: "log=1" not in url and ",1.0" in url)
    page.get_by_label("Map", exact=True).select_option("attractor phase")
    expect(page.locator(".keys")).to_contain_text("no periodic attractor in this slot")
    expect(page.get_by_text("slot 0, by family")).to_be_visible()
    x, y = place_of(page, 0.42, 0.1)
    page.mouse.click(x - 40, y)  # a number of the axis
    page.get_by_role("checkbox", name="SN1", exact=True).uncheck()
    page.wait_for_url("**overlays=**")
    assert "point=" not in page.url


def enter(page: Page, label: str, number: str) -> None:
    field = page.get_by_label(label, exact=True)
    field.fill(number)
    field.press("Enter")
