"""A page where keys are asked, and a page that is open when the service ends and when it comes back."""

import signal
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from subprocess import Popen
from typing import NamedTuple

import pytest
from depth import deep
from explorer_support import EXPLORER, assert_accessible, place_of, visiting, wait_for, wait_for_map
from faults import IN_PROCESS, NO_DEADLINE, Faults
from playwright.sync_api import Browser, expect
from proxy import proxy
from service_processes import free_port, server
from typer.testing import CliRunner
from waiting import HANG

from gear_rattle.service.cli import app


class Asking(NamedTuple):
    """A service that asks for keys: keys by scope, its process, and how another one begins in its place."""

    url: str
    tokens: dict[str, str]
    process: Popen[str]
    again: Callable[[], AbstractContextManager[Popen[str]]]


@pytest.fixture
def asking(tmp_path: Path) -> Iterator[Asking]:
    tokens, data, faults = {}, str(tmp_path / "data"), Faults(tmp_path)
    faults.inject(IN_PROCESS, NO_DEADLINE)
    for scope in ("read", "submit"):
        made = CliRunner().invoke(app, ["key", "add", scope, "--scope", scope, "--data", data])
        tokens[scope] = next(word for word in made.stdout.split() if word.startswith("rattle_"))
    port = free_port()
    settings = faults.environment | EXPLORER | {"RATTLE_REQUIRE_KEYS": "true"}
    begin = partial(server, Path(data), port, "--workers", "1", settings=settings)
    with begin() as process:
        yield Asking(f"http://127.0.0.1:{port}", tokens, process, begin)


def test_a_page_that_asks_somebody_else_is_found_out(browser: Browser) -> None:
    """What the fixture of every page of these tests looks for."""

    def visit() -> None:
        with visiting(browser, "http://here.invalid") as context:
            page = context.new_page()
            page.route("**", lambda route: route.fulfill(body="", content_type="text/html"))
            page.goto("http://here.invalid/")
            page.set_content("<link rel=preload as=image href=b.png><iframe src=http://elsewhere.invalid/a></iframe>")

    with pytest.raises(AssertionError, match=r"\['asked http://elsewhere\.invalid/a'\]"):
        visit()


#: What a browser says of a service that ended, and of the page that it had.
REFUSED = ("WebSocket connection", "Could not open websocket")


def test_a_key_opens_the_page_and_the_service_ends_while_it_is_open(browser: Browser, asking: Asking) -> None:
    url, tokens, process, again = asking
    with visiting(browser, url, allowed=("net::ERR_", *REFUSED)) as context:
        page = context.new_page()
        page.goto(f"{url}/?theme=dark")
        assert_accessible(page)
        page.get_by_label("API key").fill(tokens["read"])
        page.get_by_role("button", name="Sign in").click()
        expect(page.get_by_text("No surveys yet")).to_be_visible()
        expect(page.get_by_text("the gear runs quietly from most starts")).to_be_visible()
        page.get_by_role("button", name="Regions").click()
        wait_for_map(page, "renderers.find((each) => each.name === 'names').data_source.data.name.includes('III')")
        wait_for_map(page, "renderers.find((each) => each.name === 'SN1').data_source.data.xs.length > 0")
        page.mouse.click(*place_of(page, 0.6, 0.1))
        expect(page.locator(".beside")).to_contain_text("Damping δ = 0.6")
        page.get_by_role("button", name="Close the point").click()
        assert page.url.startswith(f"{url}/?")
        assert "theme=dark" in page.url
        (cookie,) = context.cookies()
        assert cookie["httpOnly"]
        assert cookie["sameSite"] == "Strict"
        page.get_by_role("button", name="New survey", exact=True).click()
        expect(page.get_by_text("cells, about")).to_be_visible()
        expect(page.get_by_role("button", name="Submit")).to_be_disabled()
        assert_accessible(page)
        page.get_by_role("button", name="Sign out").click()
        expect(page.get_by_label("API key")).to_be_visible()
        assert context.cookies() == []
        page.get_by_label("API key").fill(tokens["submit"])
        page.get_by_role("button", name="Sign in").click()
        page.get_by_role("button", name="New survey", exact=True).click()
        expect(page.get_by_text("cells, about")).to_be_visible()
        expect(page.get_by_role("button", name="Submit")).to_be_enabled()
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=HANG) == 0  # by itself: nobody cuts it short
        expect(page.get_by_role("alert").filter(has_text="connection to the service is lost")).to_be_visible()
        assert page.evaluate("[...document.querySelectorAll('.page nav, .page section')].every((each) => each.inert)")
        assert_accessible(page)
        view = page.url
        with again():
            expect(page.locator("#lost")).to_have_count(0)
            expect(page.get_by_text("No surveys yet")).to_be_visible()
            assert page.url == view
            page.get_by_role("button", name="New survey", exact=True).click()
            expect(page.get_by_text("cells, about")).to_be_visible()
            page.close()


#: The first websockets of a tab, so many, ask for a page that is not there.
LATE = """
const Socket = WebSocket
window.WebSocket = class extends Socket {
  constructor(url, protocols) {
    const before = Number(sessionStorage.getItem("sockets"))
    sessionStorage.setItem("sockets", before + 1)
    super(url, before < %d ? ["bokeh", "nothing"] : protocols)
  }
}
"""


@pytest.mark.parametrize(("refused", "opened"), [pytest.param(2, True, marks=deep), (100, False)])
def test_a_page_whose_connection_ends_before_it_is_here_is_opened_anew_but_not_for_ever(
    browser: Browser, service: str, refused: int, opened: bool
) -> None:
    with visiting(browser, service, allowed=REFUSED) as context:
        page = context.new_page()
        page.add_init_script(LATE % refused)
        page.goto(f"{service}/?theme=dark")
        if opened:
            wait_for_map(page, "renderers.find((each) => each.name === 'names')")
            assert page.locator("#lost").count() == 0
            wait_for(page, "() => sessionStorage.getItem('rattle_tried') === null")  # the next loss is a first one
            assert "theme=dark" in page.url
        else:
            expect(page.get_by_role("alert").filter(has_text="cannot be opened")).to_be_visible()
            assert_accessible(page)
        assert page.evaluate("Number(sessionStorage.getItem('sockets'))") == (refused + 1 if opened else 4)


@pytest.mark.parametrize(
    ("path", "replaced", "said"),
    [
        ("/rattle/", {b" /rattle/": b" /"}, "the service with --root-path /rattle (RATTLE_ROOT_PATH=/rattle)"),
        ("/rattle", {b" /rattle/": b" /", b" /rattle ": b" / "}, "X-Forwarded-Prefix: /rattle, which counts with"),
        ("/", {b"\r\nHost: ": b"\r\nHost: localhost\r\nX-Host: "}, "proxy_set_header Host $http_host"),
        ("/", {b"Upgrade: websocket\r\n": b""}, "must pass on websockets"),
    ],
)
def test_behind_a_proxy_that_is_set_up_wrong_the_page_says_what_to_set(
    browser: Browser, service: str, path: str, replaced: dict[bytes, bytes], said: str
) -> None:
    complaints = ("Failed to load resource", "WebSocket connection", "Could not open websocket", "404", "MIME type")
    with proxy(int(service.rpartition(":")[2]), replaced) as port:
        there = f"http://127.0.0.1:{port}"
        with visiting(browser, there, allowed=complaints) as context:
            page = context.new_page()
            page.goto(there + path)
            expect(page.get_by_role("alert").filter(has_text=said)).to_be_visible()
