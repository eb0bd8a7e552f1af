"""A browser, and a real server for it. A page that logs an error, or asks anybody but the server, fails its test."""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from faults import Faults
from playwright.sync_api import Browser, BrowserContext, Page, expect, sync_playwright
from service_processes import free_port, get, server
from waiting import HANG, wait_until

#: So that it runs as root, without a screen, and asks nothing of the network by itself.
FLAGS = [
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-dev-shm-usage"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
]
EXPLORER = {"RATTLE_EXPLORER": "true"}
PATIENCE_MS = 1000 * HANG
expect.set_options(timeout=PATIENCE_MS)
SURVEY: dict[str, Any] = {
    "name": "small",
    "delta": {"start": 0.42, "stop": 0.98, "num": 29},
    "epsilon": {"start": 0.01, "stop": 0.29, "num": 29},
    "quantities": ["region", "orbits", "attractors", "lyapunov"],
    "initial_conditions": {"count": 4},
}


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Chromium, without a window. Not for the session: while Playwright is there, no other test can use asyncio.run."""
    path = shutil.which("chromium")
    if path is None:
        pytest.skip("Chromium is not installed (apt-get install chromium)")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, headless=True, args=FLAGS, timeout=PATIENCE_MS)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def held(tmp_path_factory: pytest.TempPathFactory) -> Faults:
    """What holds the tiles of the service."""
    return Faults(tmp_path_factory.mktemp("faults"))


@pytest.fixture(scope="session")
def service(held: Faults) -> Iterator[str]:
    """URL of a service with one small survey that is done."""
    port, settings = free_port(), held.environment | EXPLORER
    with tempfile.TemporaryDirectory() as data, server(Path(data), port, "--workers", "1", settings=settings):
        url = f"http://127.0.0.1:{port}"
        here = httpx.post(f"{url}/v1/surveys", json=SURVEY, timeout=HANG).json()["links"]["self"]
        wait_until(lambda: get(url + here).json()["state"] == "successful")
        yield url


@pytest.fixture(scope="session")
def survey_id(service: str) -> str:
    """The id of the survey of the service."""
    return str(get(f"{service}/v1/surveys").json()["surveys"][-1]["id"])


@contextmanager
def visiting(browser: Browser, url: str, **options: Any) -> Iterator[BrowserContext]:
    """A browser with no memory, whose pages may complain of nothing and ask nothing of anybody else."""
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
    assert complaints == []


def _own(asked: str, url: str) -> bool:
    return asked.startswith((url, url.replace("http", "ws", 1), "blob:", "data:"))


@pytest.fixture
def page(browser: Browser, service: str) -> Iterator[Page]:
    """An empty page."""
    with visiting(browser, service) as context:
        yield context.new_page()
