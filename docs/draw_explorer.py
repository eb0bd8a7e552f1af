"""Take the pictures of the explorer in docs/images, every view on four screens, light and dark: `make screenshots`.

    python docs/draw_explorer.py [VIEW …] [--kept FOLDER] [--data FOLDER] [--chromium PATH]

explorer-VIEW.png is the laptop's screen of a view, light, as pages of the documentation show it.
explorer-VIEW-screens.webp has all screens of the view, side by side and half as large; the end of docs/explorer.md
lists these pictures. --kept keeps each screen at full size.
"""

from __future__ import annotations

import argparse
import io
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import httpx
from explorer_actions import DRAWN, IDLE, POLL_MS
from explorer_times import CHROMIUM, FLAGS, PLACE
from PIL import Image
from playwright.sync_api import Browser, Page, Request, sync_playwright
from server import server

PAGE, IMAGES = Path(__file__).parent / "explorer.md", Path(__file__).parent / "images"
HEADING = "## On every screen\n"
LEAD = "1920, 1280, 768 and 390 pixels wide, light and dark. `make screenshots` takes them.\n"
THEMES = ("light", "dark")
WIDE, LAPTOP, TABLET, PHONE = SCREENS = ((1920, 1080), (1280, 800), (768, 1024), (390, 844))
#: Screens of a sheet: in each row the sizes, and how many screens of a page at most.
ROWS = (((WIDE, 1),), ((LAPTOP, 1),), ((TABLET, 1), (PHONE, 2)))
GAP = 16
PATIENCE_MS, STEADY_MS, POLL_SECONDS = 300_000, 1500, 1.0
LINES_MS = 8000  # without another line, after which there are no more: those of teeth that give way take a while
LARGEST = 250_000  # bytes of a picture

#: How many of the lines that are switched on are drawn.
LINES = """() => {
  const map = Bokeh.documents.map((each) => each.get_model_by_name("map")).find((each) => each)
  return map.renderers.filter((each) => each.visible && each.data_source.data.xs?.length).length
}"""
#: Opens the fold around an open form, as a viewer has done who opened the form on a phone.
UNFOLD = """() => {
  for (const each of document.querySelectorAll(".page:has(.with-form) .side .fold")) each.open = true
}"""
PLANE: dict[str, Any] = {
    "delta": {"start": 0.403, "stop": 0.997, "num": 100}, "epsilon": {"start": 0.002, "stop": 0.298, "num": 75},
    "initial_conditions": {"count": 16},
    "quantities": ["region", "orbits", "attractors", "lyapunov", "families"],
}  # fmt: skip
FIGURE_7, STIFF, GAPS, MACHINE = "plane of Figure 7", "teeth that give way", "three gaps", "a pair of gears"
LOSSES = "impacts that lose energy"
#: Submitted in this order: the last one is the first in the list.
SURVEYS: dict[str, dict[str, Any]] = {
    MACHINE: {
        "machine": {
            "inertia": 0.003, "drag": 0.0005, "backlash": 100e-6, "radius": 0.05, "drive": "torque",
            "rpm": {"start": 1000.0, "stop": 3000.0, "num": 25},
            "eccentricity": {"start": 1e-6, "stop": 50e-6, "num": 20},
        },
        "initial_conditions": {"count": 16},
        "quantities": ["region", "attractors"],
    },
    STIFF: {
        **PLANE, "model": "stiff", "kappa": 2e4, "quantities": ["region", "attractors"],
        "delta": {"start": 0.41, "stop": 0.99, "num": 20}, "epsilon": {"start": 0.0075, "stop": 0.1425, "num": 10},
    },
    LOSSES: {
        **PLANE, "model": "inelastic", "restitution": 0.9, "quantities": ["attractors", "lyapunov", "families"],
        "delta": {"start": 0.412, "stop": 0.988, "num": 25}, "epsilon": {"start": 0.008, "stop": 0.292, "num": 19},
    },
    GAPS: {**PLANE, "beta": {"start": 0.4, "stop": 0.8, "num": 3}, "quantities": ["region"]},
    FIGURE_7: PLANE,
}  # fmt: skip


@dataclass(frozen=True)
class View:
    """Content of a picture: the address, with its survey by name; the actions; and the text to read at the end."""

    what: str
    query: Mapping[str, str] = field(default_factory=dict)
    act: Callable[[Page], None] = lambda _page: None
    until: Sequence[str] = ()


def press(*names: str) -> Callable[[Page], None]:
    """Press these buttons, one after the other."""

    def act(page: Page) -> None:
        for name in names:
            page.get_by_role("button", name=name, exact=True).click()

    return act


def by_keyboard(page: Page) -> None:
    """Walk over the map by its keys."""
    page.locator(".plot[data-keys=heard]").focus()
    for key in ("ArrowRight", "ArrowUp") * 6:
        page.keyboard.press(key)


def cross_section(page: Page) -> None:
    """Click another point with Shift, once the first is there."""
    page.get_by_text("from 1,024 starts").first.wait_for()
    page.keyboard.down("Shift")
    page.mouse.click(*page.evaluate(PLACE, [0.75, 0.2]))
    page.keyboard.up("Shift")


def tolerances(page: Page) -> None:
    """Ask for the ellipse and the yield of the open point."""
    page.get_by_label("σ of eccentricity, µm").fill("1.5")
    page.keyboard.press("Enter")
    page.get_by_role("button", name="Compute yield").click()


def subtract_losses(page: Page) -> None:
    """Show the first map less the same map of another survey."""
    page.get_by_role("button", name="Add a second map", exact=True).click()
    surveys = page.get_by_label("Survey of map 2")
    surveys.select_option(surveys.locator("option", has_text=LOSSES).first.text_content())
    page.get_by_role("checkbox", name="first map less this one").check()


BASINS, DIAGRAM = ("600 × 600 cells",), ("periodic motions",)
#: A view of the explorer is a line here.
VIEWS: dict[str, View] = {
    "start": View("Before any survey"),
    "map": View("A survey", {"survey": FIGURE_7}),
    "values": View(
        "Numbers over the plane", {"survey": FIGURE_7, "variable": "quiet_fraction", "overlays": "quiet_limit,SN1"}
    ),
    "form": View("The form of a new survey", {"survey": FIGURE_7}, press("New survey"), ("cells, about",)),
    "deep": View(
        "A window computed afresh",
        {
            "survey": FIGURE_7,
            "variable": "region",
            "delta": "0.7701471304,0.7701471314",
            "epsilon": "0.0978908122,0.0978908132",
        },
    ),
    "go-to": View("To go to a point", {"survey": FIGURE_7}, press("Go to a point"), ("Enter as",)),
    "point": View(
        "A clicked point",
        {"survey": FIGURE_7, "variable": "attractor_kind", "point": "0.6,0.1", "p.tab": "basins"},
        until=BASINS,
    ),
    "section": View(
        "A cross-section", {"survey": FIGURE_7, "point": "0.6,0.06", "p.tab": "diagram"}, cross_section, DIAGRAM
    ),
    "machine": View(
        "A machine with its design limit, and the tolerances of a point",
        {"survey": MACHINE, "variable": "attractor_kind", "overlays": "design_limit", "point": "0.0042,0.00015"},
        tolerances,
        ("of the gears pass",),
    ),
    "keys": View("The map by the keyboard", {"survey": FIGURE_7}, by_keyboard, ("region here",)),
    "families": View(
        "The largest families, and one of them",
        {"survey": FIGURE_7, "variable": "largest_family", "family": "2"},
        until=("of the plane",),
    ),
    "beside": View(
        "Two maps, and points that are compared",
        {"survey": FIGURE_7, "variable": "attractor_kind", "pins": "0.6,0.1,0.6;0.8,0.2,0.6"},
        press("Add a second map"),
    ),
    "slices": View("A slice of a survey with a third axis", {"survey": GAPS, "slice": "2"}),
    "stiff": View("Teeth that give way", {"survey": STIFF, "variable": "attractor_kind"}),
    "inelastic": View(
        "Impacts that lose energy",
        {"survey": LOSSES, "variable": "largest_family", "point": "0.6,0.25", "p.tab": "motion"},
        until=("Order spectrum of the force",),
    ),
    "difference": View(
        "The difference of two surveys",
        {"survey": FIGURE_7, "variable": "quiet_fraction"},
        subtract_losses,
        (f"{FIGURE_7} less {LOSSES}",),
    ),
    "help": View("Help", {"survey": FIGURE_7}, press("Help"), ("What is good",)),
}


def submitted(url: str) -> dict[str, str]:
    """The ids of the surveys by name, which are done."""
    with httpx.Client(base_url=url, timeout=60) as client:
        there = {each["name"]: str(each["id"]) for each in client.get("/v1/surveys").json()["surveys"]}
        for name in (each for each in SURVEYS if each not in there):
            answer = client.post("/v1/surveys", json=SURVEYS[name] | {"name": name}).raise_for_status()
            there[name] = str(answer.json()["id"])
        for survey_id in there.values():
            while (state := client.get(f"/v1/surveys/{survey_id}").json()["state"]) in ("accepted", "running"):
                time.sleep(POLL_SECONDS)
            if state != "successful":
                raise RuntimeError(f"a survey is {state}: start again with other --data")
        return there


def _note(asked: list[str], sent: Request) -> None:
    asked.append(sent.url)


def taken(browser: Browser, url: str, view: View, surveys: Mapping[str, str]) -> dict[tuple[str, int], Image.Image]:
    """Take the pictures of a view; return {(theme, width of the screen): picture}."""
    found = {}
    for theme in THEMES:
        context = browser.new_context(viewport={"width": LAPTOP[0], "height": LAPTOP[1]})
        context.set_default_timeout(PATIENCE_MS)
        page = context.new_page()
        asked: list[str] = []
        page.on("request", partial(_note, asked))
        survey = {"survey": surveys[view.query["survey"]]} if "survey" in view.query else {}
        page.goto(f"{url}/?{httpx.QueryParams({**view.query, **survey, 'theme': theme})}")
        page.wait_for_function(DRAWN, polling=POLL_MS)
        view.act(page)
        for text in view.until:
            page.get_by_text(text).first.wait_for()
        wait_for_lines(page)
        for size in (LAPTOP, WIDE, TABLET, PHONE):
            found[theme, size[0]] = picture_of(page, size)
        context.close()
        if others := [each for each in asked if not each.startswith((f"{url}/", "blob:", "data:"))]:
            raise RuntimeError(f"the page has asked somebody else: {', '.join(others)}")
    return found


def picture_of(page: Page, size: tuple[int, int]) -> Image.Image:
    """Return the page on a screen of this size; of a tablet and a phone all screens of the page, one below the other.

    If a point is open on a tablet or a phone, the picture has two screens: the sheet of the point as it opens, and the
    enlarged sheet.
    """
    page.set_viewport_size({"width": size[0], "height": size[1]})
    settle(page)
    page.evaluate(UNFOLD)
    more = page.get_by_role("button", name="More", exact=True)
    if more.is_visible():
        first = steady_screenshot(page)
        more.click()
        screens = [first, steady_screenshot(page)]
        page.get_by_role("button", name="Less", exact=True).click()
    else:
        is_whole = size in (TABLET, PHONE) and not page.get_by_role("dialog").count()
        screens = [steady_screenshot(page, is_whole)]
    pictures = [Image.open(io.BytesIO(each)).convert("RGB") for each in screens]
    found = Image.new("RGB", (size[0], sum(each.height for each in pictures)))
    for number, picture in enumerate(pictures):
        found.paste(picture, (0, number * size[1]))
    return found


def wait_for_lines(page: Page) -> None:
    """Wait until some lines are drawn, and no more come."""
    page.wait_for_function(f"({LINES})() > 0", polling=POLL_MS)  # a view without any is a mistake, and said to be one
    lines = 0
    while lines != page.evaluate(LINES):
        lines = page.evaluate(LINES)
        page.wait_for_timeout(LINES_MS)


def settle(page: Page) -> None:
    """Wait until nothing is being computed or laid out."""
    page.wait_for_timeout(STEADY_MS)
    computing = page.get_by_role("status").filter(has_text="omputing").or_(page.get_by_text("is being computed"))
    while computing.count():
        page.wait_for_timeout(STEADY_MS)
    page.wait_for_function(IDLE, polling=POLL_MS)


def steady_screenshot(page: Page, is_whole: bool = False) -> bytes:
    """Return a picture of the screen, or of the whole page, once two in turn are equal: nothing moves any more."""
    newest = page.screenshot(full_page=is_whole)
    while True:
        page.wait_for_timeout(STEADY_MS)
        before, newest = newest, page.screenshot(full_page=is_whole)
        if newest == before:
            return newest


def sheet_of(screens: Mapping[tuple[str, int], Image.Image]) -> Image.Image:
    """Return all screens of a view in ROWS, light on the left and dark on the right, half as large."""
    width, heights = WIDE[0], [max(size[1] for size, _ in row) for row in ROWS]
    sheet = Image.new("RGB", (2 * width + GAP, sum(heights) + GAP * (len(ROWS) - 1)), "#808080")
    for theme, begin in zip(THEMES, (0, width + GAP), strict=True):
        top = 0
        for row, height in zip(ROWS, heights, strict=True):
            left = begin
            for size, most in row:
                for screen in screens_of(screens[theme, size[0]], size, most):
                    sheet.paste(screen, (left, top))
                    left += size[0] + GAP
            top += height + GAP
    return sheet.resize((sheet.width // 2, sheet.height // 2), Image.Resampling.LANCZOS)


def screens_of(picture: Image.Image, size: tuple[int, int], most: int) -> Iterator[Image.Image]:
    """Yield the screens of a page that may be higher than one, from its top."""
    for number in range(min(most, -(-picture.height // size[1]))):
        yield picture.crop((0, number * size[1], size[0], min((number + 1) * size[1], picture.height)))


def write(name: str, screens: Mapping[tuple[str, int], Image.Image]) -> None:
    """Write the two pictures of a view."""
    single, sheet = IMAGES / f"explorer-{name}.png", IMAGES / f"explorer-{name}-screens.webp"
    if shown := single.name in PAGE.read_text():
        screens["light", LAPTOP[0]].quantize(256, dither=Image.Dither.NONE).save(single, optimize=True)
    for quality in (85, 75, 65, 55, 45):
        sheet_of(screens).save(sheet, quality=quality, method=6)
        if sheet.stat().st_size <= LARGEST:
            break
    for path in (single, sheet) if shown else (sheet,):
        print(f"{path.name} {path.stat().st_size / 1e3:.0f} kB")
        if path.stat().st_size > LARGEST:
            raise RuntimeError(f"{path.name} is larger than {LARGEST} bytes: let the view show less")


def listed() -> str:
    """The part of docs/explorer.md that has all views of which there is a picture."""
    parts = [HEADING, LEAD]
    for name, view in VIEWS.items():
        if (IMAGES / f"explorer-{name}-screens.webp").exists():
            parts.append(f"**{view.what}**\n\n![{view.what}](images/explorer-{name}-screens.webp)\n")
    return "\n".join(parts)


def main() -> None:
    """Take the pictures, all or some."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("views", nargs="*", choices=[*VIEWS, []], help="all of them if none is named")
    parser.add_argument("--kept", type=Path, help="each screen as it was, here")
    parser.add_argument("--data", type=Path, help="keep the service's data here, and use what is there")
    parser.add_argument("--chromium", default=CHROMIUM)
    given = parser.parse_args()
    names = given.views or list(VIEWS)
    with tempfile.TemporaryDirectory() as temporary, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=given.chromium, args=FLAGS)
        empty, full = Path(temporary) / "empty", given.data or Path(temporary) / "full"
        before = [name for name in names if "survey" not in VIEWS[name].query]
        for data, chosen in ((empty, before), (full, [name for name in names if name not in before])):
            if not chosen:
                continue
            with server(data, "--workers", "2") as (url, _):
                surveys = submitted(url) if data == full else {}
                for name in chosen:
                    screens = taken(browser, url, VIEWS[name], surveys)
                    if given.kept:
                        given.kept.mkdir(parents=True, exist_ok=True)
                        for (theme, width), picture in screens.items():
                            picture.save(given.kept / f"{name}-{width}-{theme}.png")
                    write(name, screens)
        browser.close()
    before, _, _ = PAGE.read_text().partition(HEADING)
    PAGE.write_text(before + listed())


if __name__ == "__main__":
    main()
