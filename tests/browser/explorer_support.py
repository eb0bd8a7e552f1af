"""What the tests of the explorer see of a page, and do on it."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

import axe_playwright_python
from depth import either
from playwright.sync_api import Browser, BrowserContext, Page, TimeoutError
from waiting import HANG, wait_until

EXPLORER = {"RATTLE_EXPLORER": "true", "RATTLE_MAX_POINT_SECONDS": str(HANG)}
CELLS = either(150, 600)  # a side of the basins of a point
BESIDE = either(100, 300)  # of another one on the way of its diagram
WINDOW = 80  # cells a side of a window that is computed finer
#: What a point and a window show, with fewer cells and steps.
COARSE = f"""
    @patch("gear_rattle.service.explorer.point.basins_tab")
    def coarse(basins):
        basins.RESOLUTIONS = ((100, "cells"), (50, "refined"), ({CELLS}, "refined"))
        basins.OTHER_POINT_RESOLUTIONS = ((50, "cells"), ({BESIDE}, "refined"))

    @patch("gear_rattle.service.operations.diagrams")
    def few(diagrams):
        diagrams.default_steps = lambda _: 20

    @patch("gear_rattle.service.operations.windows")
    def small(windows):
        whole = windows.request_for_window
        def some(request, window, pixels):
            return whole(request, window, tuple(min(each, {WINDOW}) for each in pixels))
        windows.request_for_window = some
"""
SURVEY: dict[str, Any] = {
    "name": "small",
    "delta": {"start": 0.42, "stop": 0.98, "num": 29},
    "epsilon": {"start": 0.01, "stop": 0.29, "num": 29},
    "quantities": ["region", "orbits", "attractors", "lyapunov", "families"],
    "initial_conditions": {"count": 4},
}
PATIENCE_MS = 1000 * HANG

#: A condition on the map of a page, as JavaScript of the figure.
_MODELS = "Bokeh.documents.map((each) => each.get_model_by_name('map')).find((each) => each)"

#: What a page is like that does not show what is waited for.
_STATE = f"""async () => {{
    const painted = new Promise((resolve) => requestAnimationFrame(() => resolve("frames are painted")))
    const waited = new Promise((resolve) => setTimeout(() => resolve("no frame in 1 s"), 1000))
    const map = window.Bokeh && {_MODELS}
    return [
        await Promise.race([painted, waited]), location.href, Boolean(map && Bokeh.index.find_one(map)),
        map?.renderers.map((each) => [each.name, each.data_source.data.image?.length ?? ""].join(" ")),
        document.body.innerText,
    ].join("; ")
}}"""

STEADY_MS = 100
POLL_MS = 50


def open_view(page: Page, url: str, **query: str) -> None:
    """Open the explorer, and wait until its map has cells."""
    asked = "&".join(f"{name}={value}" for name, value in query.items())
    page.goto(f"{url}/?{asked}")
    wait_for_map(page, "renderers.some((each) => each.name?.startsWith('cells') && each.data_source.data.image.length)")


def open_form(page: Page, plane: str = "own ranges of δ and ε") -> None:
    """Open the form of a new survey over this plane, with its advanced settings."""
    page.get_by_role("button", name="New survey", exact=True).click()
    page.get_by_label("Plane", exact=True).select_option(label=plane)
    page.get_by_role("button", name="Advanced settings").click()
    page.get_by_label("Initial conditions").wait_for()


def open_tab(page: Page, name: str) -> None:
    """Open a tab of the point."""
    page.locator(".beside").get_by_role("button", name=name, exact=True).click()
    page.wait_for_url(lambda url: name == "Answer" or f"p.tab={name.lower()}" in url)


def wait_for(page: Page, asked: str) -> None:
    """Wait until a function of JavaScript is true. Not asked at every frame: a browser under load may paint none."""
    page.wait_for_function(asked, polling=POLL_MS)


def wait_for_map(page: Page, condition: str) -> None:
    """Wait until a condition on the figure holds, which begins with one of its properties."""
    shown = f"const map = window.Bokeh && {_MODELS}; return map && Bokeh.index.find_one(map)"
    try:
        wait_for(page, f"() => {{ {shown} && map.{condition} }}")
    except TimeoutError as error:
        raise AssertionError(f"{condition} did not hold: {page.evaluate(_STATE)}") from error


def of_map(page: Page, expression: str) -> Any:
    """What an expression on the figure is."""
    return page.evaluate(f"() => {_MODELS}.{expression}")


def visible_lines(page: Page) -> set[str]:
    """Names of the lines that the map shows."""
    names = of_map(page, "renderers.filter((each) => each.visible && each.name).map((each) => each.name)")
    return {name for name in names if not name.startswith(("cells", "fine", "names", "pins", "veil"))}


def place_of(page: Page, delta: float, epsilon: float) -> tuple[float, float]:
    """Where on the screen a point (δ, ε) is, once nothing is being laid out and it stays there."""
    places: list[list[float]] = []

    def settled() -> bool:
        found = page.evaluate(
            f"""([delta, epsilon]) => {{
                const model = {_MODELS}
                const view = Bokeh.index.find_one(model)
                const box = view.canvas_view.el.getBoundingClientRect()
                const idle = Bokeh.documents.every((each) => each.is_idle)
                return [
                    idle, box.x + view.frame.x_scale.compute(delta), box.y + view.frame.y_scale.compute(epsilon),
                ]
            }}""",
            [delta, epsilon],
        )
        places.append(found)
        page.wait_for_timeout(STEADY_MS)
        return len(places) > 2 and places[-1] == places[-2] == places[-3] and places[-1][0]

    wait_until(settled)
    _, x, y = places[-1]
    return float(x), float(y)


def point_at(page: Page, delta: float, epsilon: float, until: str) -> None:
    """Move the mouse to a point (δ, ε) until a text is read; again while the page is still being laid out."""

    def read() -> bool:
        x, y = place_of(page, delta, epsilon)
        page.mouse.move(x - 9, y)
        page.mouse.move(x, y)
        with suppress(TimeoutError):
            page.locator(".beside", has_text=until).wait_for(timeout=1000)
            return True
        return False

    wait_until(read)


def click_cell(page: Page, delta: float, epsilon: float) -> None:
    """Click a cell of the survey, once it is read that the mouse is there."""
    point_at(page, delta, epsilon, until=f"Cell at δ {delta:g}, ε {epsilon:g}")
    page.mouse.down()
    page.mouse.up()


@cache
def _axe() -> str:
    """The script that looks for what keeps people out."""
    return (Path(axe_playwright_python.__file__).parent / "axe.min.js").read_text()


def assert_accessible(page: Page) -> None:
    """axe-core finds nothing, targets are large enough for fingers, and every stop of the Tab key has a name."""
    page.evaluate(_axe())
    found = page.evaluate("() => axe.run({rules: {'target-size': {enabled: true}}})")
    faults = [(rule["id"], node["html"][:120]) for rule in found["violations"] for node in rule["nodes"]]
    assert not faults, faults
    chrome = page.context.new_cdp_session(page)
    chrome.send("Accessibility.enable")
    for node in chrome.send("Accessibility.getFullAXTree")["nodes"]:
        traits = {each["name"]: each["value"].get("value") for each in node.get("properties", ())}
        if traits.get("focusable") and not node["ignored"]:
            assert node["name"]["value"].strip(), chrome.send(
                "DOM.describeNode", {"backendNodeId": node["backendDOMNodeId"]}
            )["node"]
    chrome.detach()


@contextmanager
def visiting(browser: Browser, url: str, allowed: tuple[str, ...] = (), **options: Any) -> Iterator[BrowserContext]:
    """A browser with no memory, whose pages may complain of nothing, but for what holds one of the texts allowed, and
    ask nothing of anybody else.
    """
    complaints: list[str] = []

    def watch(page: Page) -> None:
        page.on("console", lambda said: complaints.append(said.text) if said.type in ("error", "warning") else None)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda sent: None if _own(sent.url, url) else complaints.append(f"asked {sent.url}"))
        page.on("websocket", lambda socket: None if _own(socket.url, url) else complaints.append(f"asked {socket.url}"))

    context = browser.new_context(viewport={"width": 1280, "height": 800}, **options)
    context.set_default_timeout(PATIENCE_MS)
    context.on("page", watch)
    try:
        yield context
    finally:
        context.close()
    heard = [each for each in complaints if not any(text in each for text in allowed)]
    assert not heard, heard


def _own(asked: str, url: str) -> bool:
    return asked.startswith((f"{url}/", f"{url.replace('http', 'ws', 1)}/", "blob:", "data:"))
