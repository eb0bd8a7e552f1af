"""A browser, and a real server for it. A page that logs an error, or asks anybody but the server, fails its test."""

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from depth import either
from explorer_support import COARSE, EXPLORER, PATIENCE_MS, SURVEY, visiting
from faults import IN_PROCESS, Faults
from playwright.sync_api import Browser, Page, expect, sync_playwright
from service_processes import free_port, get, server
from waiting import HANG, wait_until

#: So that it runs as root, without a screen, and asks nothing of the network by itself.
FLAGS = [
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-dev-shm-usage"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
]
expect.set_options(timeout=PATIENCE_MS)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Chromium, without a window. Not for the session: while Playwright is there, no other test can use asyncio.run."""
    path = shutil.which("chromium-headless-shell") or shutil.which("chromium")  # the first draws no buttons of its own
    if path is None:
        pytest.skip("Chromium is not installed (apt-get install chromium-headless-shell)")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, headless=True, args=FLAGS, timeout=PATIENCE_MS)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def held(tmp_path_factory: pytest.TempPathFactory) -> Faults:
    """What holds the tiles of the service, whose cluster is in its process and whose points are coarse."""
    faults = Faults(tmp_path_factory.mktemp("faults"))
    faults.inject(IN_PROCESS, either(COARSE, ""))
    return faults


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


@pytest.fixture(autouse=True)
def _nothing_is_left(request: pytest.FixtureRequest, held: Faults) -> Iterator[None]:
    """What a test holds or submits, one that fails too, is there for no other one."""
    here = f"{request.getfixturevalue('service')}/v1/surveys" if "service" in request.fixturenames else ""
    before = _ids(here)
    yield
    held.release()
    for each in _ids(here) - before:  # one that runs is dismissed first
        wait_until(lambda one=f"{here}/{each}": httpx.delete(one, timeout=HANG).status_code in (204, 404))


def _ids(surveys: str) -> set[str]:
    return {each["id"] for each in get(surveys).json()["surveys"]} if surveys else set()


@pytest.fixture
def page(browser: Browser, service: str) -> Iterator[Page]:
    """An empty page."""
    with visiting(browser, service) as context:
        yield context.new_page()
