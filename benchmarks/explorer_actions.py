"""Measure many actions in the explorer: the memory of the service, and how long the service and the page are blocked.

    python benchmarks/explorer_actions.py [--actions 1000] [--every 200] [--chromium PATH] [--data PATH]

A visitor in Chromium does random actions, the same in every run: choose maps, surveys and slices, show lines, zoom,
press keys, click points, draw cross-sections, open the form, reload and close pages. The program prints the memory of
the service's processes (PSS). For each kind of action, it prints the longest task of the page's main thread and the
longest step of the service's event loop, in wall-clock time and in processor time of the thread, which depends less on
other programs.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import httpx
import psutil
from explorer_times import CHROMIUM, FLAGS, PLACE, wait_until
from playwright.sync_api import Browser, BrowserContext, Locator, Page, TimeoutError, sync_playwright
from server import server

VISIT = 25  # actions on a page, after which a page is opened in a new browser context, without cache and cookies
PAUSE_MS, PATIENCE_MS = 100, 30_000
GONE_MS = 3000  # wait for an element that may have disappeared
PLANE = {"delta": {"start": 0.4, "stop": 1.0}, "epsilon": {"start": 0.005, "stop": 0.3}}
SURVEYS: tuple[dict[str, Any], ...] = (
    {"name": "all", "num": 40, "quantities": ["region", "orbits", "attractors", "lyapunov", "intensity"]},
    {"name": "large", "num": 600, "quantities": ["region", "orbits"]},
    {"name": "slices", "num": 24, "quantities": ["region"], "beta": {"start": 0.4, "stop": 0.8, "num": 3}},
    {"name": "stiff", "num": 16, "quantities": ["region", "attractors"], "model": "stiff", "kappa": 2e4},
)
TASKS = ["disabled-by-default-devtools.timeline"]  # category of traces with each task of a page's main thread
MAIN_THREAD = "CrRendererMain"
DRAWN = """() => {
  const map = window.Bokeh?.documents?.map((each) => each.get_model_by_name("map")).find((each) => each)
  return map && Bokeh.index.find_one(map) &&
    map.renderers.some((each) => each.name?.startsWith("cells") && each.data_source.data.image.length)
}"""
WHOLE = """({delta, epsilon}) => {
  const map = Bokeh.documents.map((each) => each.get_model_by_name("map")).find((each) => each)
  const holds = (range, axis) => range.start <= axis.start && range.end >= axis.stop
  return holds(map.x_range, delta) && holds(map.y_range, epsilon)
}"""
IDLE = "() => Bokeh.documents.every((each) => each.is_idle)"
LISTED = 12  # longest steps of the event loop that are printed
POLL_MS = 50  # Playwright polls at every frame by default, and a browser under load may paint none


def submitted(url: str) -> list[str]:
    """Submit the surveys, wait until they are done, and return their ids."""
    links = []
    for survey in SURVEYS:
        axes = {axis: span | {"num": survey["num"]} for axis, span in PLANE.items()}
        rest = {name: value for name, value in survey.items() if name != "num"}
        body = axes | rest | {"initial_conditions": {"count": 4}}
        answer = httpx.post(f"{url}/v1/surveys", json=body, timeout=60).raise_for_status().json()
        links.append((str(answer["id"]), url + answer["links"]["self"]))
    for _, link in links:
        wait_until(partial(_is_done, link))
    return [survey_id for survey_id, _ in links]


def _is_done(link: str) -> bool:
    return bool(httpx.get(link, timeout=60).json()["state"] == "successful")


class Visitor:
    """A user of the explorer; actions are chosen at random, with the same seed in every run."""

    def __init__(self, browser: Browser, url: str, surveys: Sequence[str]) -> None:
        self._browser, self._url, self._surveys = browser, url, surveys
        self._chance = random.Random(0)
        self._context: BrowserContext | None = None
        self._page: Page
        self._left = 0
        often = (self.variable, self.survey, self.point, self.zoom, self.keys, self.line)
        seldom = (self.whole, self.cross_section, self.close_point, self.reload, self.limits, self.slice, self.form)
        self._kinds = often + often + seldom

    def act(self) -> tuple[str, float, float]:
        """Do one action.

        Returns
        -------
        :
            Name of the action, and the longest task of the page's main thread: milliseconds of wall-clock time, and of
            processor time of the thread.
        """
        if not self._left:
            kind: Callable[[], None] = self.arrive
            self._left = VISIT
        else:
            kind = self._chance.choice(self._kinds)
        self._left -= 1
        self._browser.start_tracing(categories=TASKS)
        try:
            kind()
        except TimeoutError as error:
            buttons = self._page.locator("button").all_inner_texts()
            raise RuntimeError(f"{kind.__name__} at {self._page.url}, where the buttons are {buttons}") from error
        self._page.wait_for_function(IDLE, polling=POLL_MS)
        self._page.wait_for_timeout(PAUSE_MS)
        return kind.__name__.replace("_", " "), *longest_task(self._browser.stop_tracing())

    def leave(self) -> None:
        """Close the browser context."""
        if self._context is not None:
            self._context.close()

    def arrive(self) -> None:
        self.leave()
        self._context = self._browser.new_context(viewport={"width": 1280, "height": 800})
        self._context.set_default_timeout(PATIENCE_MS)
        self._page = self._context.new_page()
        self._page.goto(f"{self._url}/?survey={self._chance.choice(self._surveys)}")
        self._page.wait_for_function(DRAWN, polling=POLL_MS)

    def reload(self) -> None:
        self._page.reload()
        self._page.wait_for_function(DRAWN, polling=POLL_MS)

    def variable(self) -> None:
        choice = self._page.get_by_label("Map", exact=True)
        options = choice.locator("option").evaluate_all("(all) => all.map((each) => each.value)")
        self._select(choice, value=self._chance.choice(options))

    def limits(self) -> None:
        choice, index = self._page.get_by_label("Colour range"), self._chance.randrange(3)
        if choice.is_visible() and choice.is_enabled():
            self._select(choice, index=index)

    def _select(self, choice: Locator, **what: Any) -> None:
        with suppress(TimeoutError):  # the element has just disappeared with another map
            choice.select_option(**what, timeout=GONE_MS)

    def survey(self) -> None:
        chosen = self._chance.choice(self._surveys)
        self._page.locator(f"button.survey[data-survey='{chosen}']").click()
        self._page.wait_for_function(DRAWN, polling=POLL_MS)

    def slice(self) -> None:
        self._page.locator(f"button.survey[data-survey='{self._surveys[2]}']").click()
        slider = self._page.get_by_role("slider")
        if slider.count():
            slider.first.focus()
            self._page.keyboard.press(self._chance.choice(("ArrowLeft", "ArrowRight")))

    def zoom(self) -> None:
        self._page.mouse.move(*self._place())
        for _ in range(self._chance.randrange(1, 5)):
            self._page.mouse.wheel(0, self._chance.choice((-200, 200)))

    def whole(self) -> None:
        self._on_map("0")

    def keys(self) -> None:
        self._on_map(*self._chance.choices(("ArrowUp", "ArrowRight", "ArrowDown", "ArrowLeft", "+", "-"), k=6))

    def line(self) -> None:
        self._page.get_by_role("checkbox", name=self._chance.choice(("SN1", "G1", "PD1", "quiet limit"))).first.click()

    def point(self) -> None:
        self._page.mouse.click(*self._place())
        try:
            self._page.locator(".beside", has_text="Damping δ = ").wait_for(timeout=GONE_MS)
        except TimeoutError:  # the click was outside of the map
            return
        self._page.wait_for_timeout(10 * PAUSE_MS)

    def cross_section(self) -> None:
        self._page.keyboard.down("Shift")
        self._page.mouse.click(*self._place())
        self._page.keyboard.up("Shift")

    def close_point(self) -> None:
        self._on_map("Escape")

    def form(self) -> None:
        self._page.locator("button", has_text="New survey").click()
        self._page.wait_for_timeout(PAUSE_MS)
        self._page.locator("button", has_text="Close the form").click()

    def _place(self) -> tuple[float, float]:
        """Show the whole survey, and return the screen coordinates of a random point on its map."""
        self._on_map("0")  # the service sets the window; coordinates that were computed before no longer hold
        self._page.wait_for_function(WHOLE, arg=PLANE, polling=POLL_MS)
        at = self._chance.uniform(0.45, 0.95), self._chance.uniform(0.03, 0.27)
        x, y = self._page.evaluate(PLACE, at)
        return float(x), float(y)

    def _on_map(self, *keys: str) -> None:
        self._page.get_by_role("application", name="map over damping").focus()
        for key in keys:
            self._page.keyboard.press(key)


def longest_task(trace: bytes) -> tuple[float, float]:
    """Return the wall-clock and the thread time of the longest task in a trace of the pages' main threads, in ms."""
    events = json.loads(trace)["traceEvents"]
    named = (each for each in events if each["name"] == "thread_name" and each["args"]["name"] == MAIN_THREAD)
    pages = {(each["pid"], each["tid"]) for each in named}
    tasks = [each for each in events if each["name"] == "RunTask" and (each["pid"], each["tid"]) in pages]
    clock, thread = (max((each.get(name, 0) / 1e3 for each in tasks), default=0.0) for name in ("dur", "tdur"))
    return clock, thread


def memory(service: psutil.Process) -> tuple[float, float]:
    """Return the memory of the service's process, and of all its descendants together, in MiB."""
    found = []
    for process in (service, *service.children(recursive=True)):
        try:
            found.append(process.memory_full_info().pss / 2**20)
        except psutil.NoSuchProcess:  # it has ended meanwhile
            found.append(0.0)
    return found[0], sum(found[1:])


class Steps:
    """The long steps of the service's event loop, which benchmarks/held.py writes to a file in the service."""

    def __init__(self, path: Path) -> None:
        self._path, self._read = path, 0

    def new(self) -> list[tuple[float, float, str]]:
        """Return the steps since the last call: milliseconds of thread and of wall-clock time, and what ran."""
        lines = self._path.read_text().splitlines()[self._read :]
        self._read += len(lines)
        return [(1e3 * work, 1e3 * clock, whose) for work, clock, whose in map(json.loads, lines)]


def main() -> None:
    """Do the actions, and print the measured values."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--actions", type=int, default=1000)
    parser.add_argument("--every", type=int, default=200, help="actions between two readings of the memory")
    parser.add_argument("--chromium", default=CHROMIUM)
    parser.add_argument("--data", type=Path, help="keep the service's data here")
    given = parser.parse_args()
    longest: defaultdict[str, list[tuple[float, ...]]] = defaultdict(list)
    every_step: list[tuple[float, float, str]] = []
    with tempfile.TemporaryDirectory() as temporary:
        noted = Path(temporary) / "held"
        noted.touch()
        steps = Steps(noted)
        first = f"import pathlib, held; held.note(pathlib.Path({str(noted)!r})); "
        with (
            server(given.data or Path(temporary), "--workers", "1", first=first) as (url, process),
            sync_playwright() as playwright,
        ):
            surveys = submitted(url)
            browser = playwright.chromium.launch(executable_path=given.chromium, args=FLAGS)
            visitor = Visitor(browser, url, surveys)
            print("| actions | MiB of the service | of its processes | s |\n|---|---|---|---|")
            began = time.monotonic()
            for number in range(given.actions + 1):
                if number % given.every == 0:
                    service, others = memory(process)
                    print(f"| {number} | {service:.0f} | {others:.0f} | {time.monotonic() - began:.0f} |", flush=True)
                steps.new()
                kind, *page = visitor.act()
                every_step += (found := steps.new())
                loop = (max((each[place] for each in found), default=0.0) for place in (1, 0))
                longest[kind].append((*page, *loop))
            visitor.leave()
            browser.close()
    print(f"\nLoad average {os.getloadavg()[0]:.1f}\n")
    print("| action | times | page, ms | its thread, ms | event loop, ms | its thread, ms |\n|---|---|---|---|---|---|")
    for kind, times in sorted(longest.items()):
        row = (f"{max(each):.0f}" for each in zip(*times, strict=True))
        print(f"| {kind} | {len(times)} | {' | '.join(row)} |")
    for work, clock, whose in sorted(every_step, reverse=True)[:LISTED]:
        print(f"{work:.0f} ms of {clock:.0f}: {whose}", file=sys.stderr)


if __name__ == "__main__":
    main()
