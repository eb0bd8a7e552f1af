"""The explorer behind a real nginx and a real Caddy, with TLS, at the root of a host and below a path."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import pytest
from explorer_support import EXPLORER, click_cell, visiting, wait_for_map
from faults import IN_PROCESS, NO_DEADLINE, Faults
from playwright.sync_api import Browser, expect
from proxies import BEGIN, PROGRAMS, Proxied
from service_processes import FIELDS, client_of, finish, free_port, server
from waiting import HANG

SETTINGS = EXPLORER | {"RATTLE_BEHIND_PROXY": "true", "RATTLE_REQUIRE_KEYS": "true"}


class Front:
    """A service with a survey, which can be started again."""

    def __init__(self, directory: Path) -> None:
        self.port, self.log = free_port(), directory / "log"
        self._data, faults = directory / "data", Faults(directory)
        faults.inject(IN_PROCESS, NO_DEADLINE)
        self._settings = faults.environment | SETTINGS
        self.key = finish("key", "add", "me", "--scope", "submit", "--data", str(self._data)).stdout.strip()
        self._stack = ExitStack()

    def start(self) -> None:
        log = self._stack.enter_context(self.log.open("a"))
        self._stack.enter_context(
            server(self._data, self.port, "--workers", "1", settings=self._settings, stdout=log, stderr=log)
        )

    def stop(self) -> None:
        self._stack.pop_all().close()


class Behind(NamedTuple):
    """A service and the proxy before it."""

    front: Front
    proxied: Proxied


@pytest.fixture(scope="module")
def front(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Front]:
    found = Front(tmp_path_factory.mktemp("front"))
    found.start()
    with client_of(found.port, found.key) as client:
        client.submit(FIELDS).wait()
    try:
        yield found
    finally:
        found.stop()


@pytest.fixture(params=BEGIN)
def behind(request: pytest.FixtureRequest, front: Front, tmp_path: Path) -> Iterator[Behind]:
    if PROGRAMS[request.param] is None:
        pytest.skip(f"{request.param} is not installed (apt-get install {request.param})")
    with BEGIN[request.param](front.port, tmp_path) as proxied:
        yield Behind(front, proxied)


@pytest.mark.parametrize("place", ["root", "below"])
def test_the_page_works_and_comes_back_after_a_restart(browser: Browser, behind: Behind, place: str) -> None:
    front, url = behind.front, getattr(behind.proxied, place)
    allowed = ("Failed to load resource", "WebSocket", "open websocket", "net::ERR_")  # while the service is away
    with visiting(browser, url, allowed, ignore_https_errors=True, accept_downloads=True) as context:
        page = context.new_page()
        page.goto(f"{url}/")
        page.get_by_label("API key").fill(front.key)
        page.get_by_role("button", name="Sign in").click()
        wait_for_map(
            page, "renderers.some((each) => each.name?.startsWith('cells') && each.data_source.data.image.length)"
        )
        click_cell(page, 0.45, 0.02)
        expect(page.locator(".beside")).to_contain_text("Damping δ = 0.45")
        link = page.get_by_role("link", name="A notebook")
        assert page.evaluate("(each) => each.href", link.element_handle()).startswith(f"{url}/v1/notebook?")
        with page.expect_download() as download:
            page.get_by_role("link", name="NetCDF").click()
        assert download.value.path().read_bytes().startswith(b"\x89HDF")
        expect(page.locator("pre").first).to_contain_text(f'"{url}/v1/surveys/')
        for name, part in {"All documents": "/help/", "REST API": "/docs"}.items():
            assert page.locator("a", has_text=name).evaluate("(each) => each.href") == url + part
        assert page.url.startswith(f"{url}/?")
        front.stop()
        expect(page.get_by_role("alert").filter(has_text="connection to the service is lost")).to_be_visible()
        front.start()
        expect(page.locator("#lost")).to_have_count(0)
        wait_for_map(
            page, "renderers.some((each) => each.name?.startsWith('cells') && each.data_source.data.image.length)"
        )
        assert page.url.startswith(f"{url}/?")
        page.get_by_role("button", name="Sign out").click()
        expect(page.get_by_label("API key")).to_be_visible()
        assert page.url == f"{url}/login"


WITHOUT_HOST = {
    "nginx": {r"^ *proxy_set_header Host .*\n": "    proxy_set_header Host $proxy_host;\n"},
    "caddy": {r"flush_interval -1": "flush_interval -1\n\t\theader_up Host {upstream_hostport}"},
}


@pytest.mark.parametrize("program", BEGIN)
def test_without_the_host_page_and_log_say_what_to_set(
    browser: Browser, front: Front, tmp_path: Path, program: str
) -> None:
    if PROGRAMS[program] is None:
        pytest.skip(f"{program} is not installed (apt-get install {program})")
    said = "set the proxy before it to pass on the Host header (nginx: proxy_set_header Host $http_host"
    with BEGIN[program](front.port, tmp_path, WITHOUT_HOST[program]) as proxied:
        url = proxied.below
        with visiting(browser, url, ("Failed to load resource",), ignore_https_errors=True) as context:
            page = context.new_page()
            page.goto(f"{url}/")
            page.get_by_label("API key").fill(front.key)
            page.get_by_role("button", name="Sign in").click()
            expect(page.get_by_role("alert").filter(has_text=said)).to_be_visible(timeout=1000 * HANG)
    assert said in front.log.read_text()
