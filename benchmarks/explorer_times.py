"""Measure how long a user of the explorer waits, and how much memory its pages take, in Chromium with a real server.

    python benchmarks/explorer_times.py [--side 600] [--trials 7] [--pages 20] [--chromium PATH]

The program prints the time until the first map and until each part of a clicked point is on the screen: median and
range in milliseconds by the page's own clock. It also prints how long the server's process and the page's main thread
worked for each of these steps, which depends less on other programs. At the end it prints the memory of the server's
process without a page, with one page and with twenty, and the memory of one page's scripts.
"""

from __future__ import annotations

import argparse
import os
import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import psutil
from playwright.sync_api import Browser, CDPSession, Page, sync_playwright
from server import server

#: The browser with which the published times were measured, or else the headless one that the tests use.
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-headless-shell")
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update"]
POINTS = ((0.6, 0.1), (0.55, 0.08), (0.7, 0.12))  # clicked one after the other
PARTS = ("answer", "own answer", "margin")
#: A page is idle if it works for less than IDLE milliseconds in a second. The longest wait for it is PATIENCE seconds.
IDLE, PATIENCE = 200.0, 30

#: Script for a page. At every frame it records the time at which each awaited part has appeared on the screen.
WATCH = r"""
window.seen = {}
const text = (node) => node.nodeType === 3 ? node.data : node.tagName === "STYLE" || node.tagName === "SCRIPT" ? "" :
  [...(node.shadowRoot?.childNodes ?? []), ...node.childNodes].map(text).join("")
const of_cell = "survey's grid cell"
const steps = {  // of the view of a point, one after the other
  "answer": (all) => Math.abs(Number(/Damping δ = ([\d.]+)/.exec(all)?.[1]) - clicked.delta) < 0.005 &&
    /random start|every start|From a/.test(all),
  "own answer": (all) => !all.includes(of_cell) && /from 1,024 starts|1,024 random starts|every start/.test(all),
  "margin": (all) => /margin of quiet|No impact slower|margin is 0|cannot be computed which/.test(all),
}
function look() {
  const map = window.Bokeh?.documents?.map((each) => each.get_model_by_name("map")).find((each) => each)
  const drawn = map && Bokeh.index?.find_one(map) &&
    map.renderers.some((each) => each.name?.startsWith("cells") && each.data_source.data.image.length)
  if (drawn && !seen.drawn) seen.drawn = true  // the next frame has it on the screen
  else if (drawn && !seen.map) seen.map = performance.now()
  if (window.clicked?.at && !("margin" in clicked)) {  // to look costs a third of the page's time
    const all = [...document.querySelectorAll(".beside")].map(text).join("")
    const now = performance.now() - clicked.at
    for (const [name, holds] of Object.entries(steps)) {
      if (!(name in clicked) && !holds(all)) break
      clicked[name] ??= now
    }
  }
  requestAnimationFrame(look)
}
requestAnimationFrame(look)
addEventListener("pointerup", () => { if (window.clicked) clicked.at = performance.now() }, true)
"""
PLACE = """([delta, epsilon]) => {
  const map = Bokeh.documents.map((each) => each.get_model_by_name("map")).find((each) => each)
  const view = Bokeh.index.find_one(map), box = view.canvas_view.el.getBoundingClientRect()
  return [box.x + view.frame.x_scale.compute(delta), box.y + view.frame.y_scale.compute(epsilon)]
}"""


class Work:
    """Measures for how many milliseconds the server's process and the main thread of a page have worked."""

    def __init__(self, server: psutil.Process, cdp: CDPSession) -> None:
        self._server, self._cdp = server, cdp
        cdp.send("Performance.enable")

    def now(self) -> tuple[float, float]:
        """Return the milliseconds of work of the server and of the page since each of them began."""
        times = self._server.cpu_times()
        metrics = {each["name"]: each["value"] for each in self._cdp.send("Performance.getMetrics")["metrics"]}
        return 1e3 * (times.user + times.system), 1e3 * metrics["TaskDuration"]


class Table(dict[str, list[float]]):
    """Measured milliseconds or megabytes, as a list for each name."""

    def add(self, name: str, value: float) -> None:
        self.setdefault(name, []).append(value)

    def __str__(self) -> str:
        rows = ["| ms | median | least | most |", "|---|---|---|---|"]
        for name, values in self.items():
            rows.append(f"| {name} | {statistics.median(values):.0f} | {min(values):.0f} | {max(values):.0f} |")
        return "\n".join(rows)


def wait_until(condition: Callable[[], Any], seconds: float = 300.0) -> Any:
    """Call `condition` ten times a second until its result is true, and return this result."""
    deadline = time.monotonic() + seconds
    while not (value := condition()):
        assert time.monotonic() < deadline, "it took too long"
        time.sleep(0.1)
    return value


def submitted(url: str, side: int) -> str:
    """Submit a survey of side × side cells, wait until it is complete, and return its id."""
    body = {
        "delta": {"start": 0.4, "stop": 1.0, "num": side},
        "epsilon": {"start": 0.005, "stop": 0.3, "num": side},
        "quantities": ["region", "orbits"],
        "tile": {"delta": min(side, 100), "epsilon": min(side, 100)},
    }
    answer = httpx.post(f"{url}/v1/surveys", json=body).json()
    wait_until(lambda: httpx.get(url + answer["links"]["self"]).json()["state"] == "successful")
    return str(answer["id"])


def settled(page: Page, work: Work) -> None:
    """Wait until the server and the page each work for less than IDLE milliseconds in a second."""
    before = work.now()
    for _ in range(PATIENCE):
        page.wait_for_timeout(1000)
        after = work.now()
        if all(later - earlier < IDLE for earlier, later in zip(before, after, strict=True)):
            return
        before = after


def visit(browser: Browser, url: str, process: psutil.Process, waited: Table, worked: Table) -> None:
    """Measure one user whose browser has an empty cache: the first map, the same map again, and some clicks."""
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    context.set_default_timeout(120_000)
    try:
        page = context.new_page()
        page.add_init_script(WATCH)
        work = Work(process, context.new_cdp_session(page))

        def took(name: str, before: tuple[float, float]) -> None:
            settled(page, work)
            for whose, later, earlier in zip(("server", "page"), work.now(), before, strict=True):
                worked.add(f"{name}: {whose}", later - earlier)

        for name in ("first map", "map again"):
            before = work.now()[0], 0.0  # the page is new, so its work starts at 0
            page.goto(url)
            page.wait_for_function("() => seen.map")
            waited.add(name, page.evaluate("seen.map"))
            took(name, before)
        for number, (delta, epsilon) in enumerate(POINTS, start=1):
            name = f"click {number}"
            x, y = page.evaluate(PLACE, [delta, epsilon])
            page.evaluate("(delta) => { window.clicked = {delta} }", delta)
            before = work.now()
            page.mouse.click(x, y)
            page.wait_for_function("() => clicked.margin")
            for part in PARTS:
                waited.add(f"{name}: {part}", page.evaluate(f"clicked['{part}']"))
            took(name, before)
    finally:
        context.close()


def memory(browser: Browser, url: str, process: psutil.Process, pages: int) -> Table:
    """Return MB of memory: of the server with no page, with one and with `pages`, and of the scripts of a page."""
    found = Table()
    contexts = []
    try:
        found.add("server without a page", process.memory_full_info().uss / 1e6)
        for number in range(1, pages + 1):
            context = browser.new_context(viewport={"width": 1280, "height": 800})
            contexts.append(context)
            context.set_default_timeout(300_000)
            page = context.new_page()
            page.add_init_script(WATCH)
            page.goto(url)
            page.wait_for_function("() => seen.map")
            if number == 1:
                cdp = context.new_cdp_session(page)
                settled(page, Work(process, cdp))
                heap = cdp.send("Runtime.getHeapUsage")["usedSize"] / 1e6
                found.add("scripts of a page", heap)
            if number in (1, pages):
                page.wait_for_timeout(3000)
                found.add(
                    f"server with {number} page{'' if number == 1 else 's'}", process.memory_full_info().uss / 1e6
                )
    finally:
        for context in contexts:
            context.close()
    return found


def main() -> None:
    """Run the measurements and print them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--side", type=int, default=0, help="cells along each axis of a survey; 0: the example")
    parser.add_argument("--trials", type=int, default=7)
    parser.add_argument("--pages", type=int, default=20)
    parser.add_argument("--chromium", default=CHROMIUM)
    parser.add_argument("--data", type=Path, help="keep the service's data here, and use what is there")
    given = parser.parse_args()
    waited, worked = Table(), Table()
    with (
        tempfile.TemporaryDirectory() as temporary,
        server(given.data or Path(temporary), "--workers", "1") as (url, process),
        sync_playwright() as playwright,
    ):
        page = f"{url}/?survey={submitted(url, given.side)}" if given.side else url
        browser = playwright.chromium.launch(executable_path=given.chromium, args=FLAGS)
        visit(browser, page, process, Table(), Table())  # loads kernels, so it does not count
        held = memory(browser, page, process, given.pages)
        for _ in range(given.trials):
            visit(browser, page, process, waited, worked)
            print(".", end="", file=sys.stderr, flush=True)
        browser.close()
    cells = f"{given.side} × {given.side} cells" if given.side else "the example"
    print(f"{cells}, {given.trials} visits; load average {os.getloadavg()[0]:.1f}\n")
    print(f"Waited\n\n{waited}\n\nAt work\n\n{worked}\n\nMemory, MB\n")
    for name, (megabytes,) in held.items():
        print(f"- {name}: {megabytes:.0f}")


if __name__ == "__main__":
    main()
