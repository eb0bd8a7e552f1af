"""A page where keys are asked, and a page that is open when the service ends."""

import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import EXPLORER, PATIENCE_MS, visiting
from playwright.sync_api import Browser, expect
from service_processes import finish, free_port, server

expect.set_options(timeout=PATIENCE_MS)
SECONDS = 5.0  # from SIGTERM to the end


@pytest.fixture
def asking(tmp_path: Path) -> Iterator[tuple[str, dict[str, str], object]]:
    """URL of a service that asks for keys, keys by scope, and its process."""
    tokens = {}
    for scope in ("read", "submit"):
        made = finish("key", "add", scope, "--scope", scope, "--data", str(tmp_path))
        tokens[scope] = next(word for word in made.stdout.split() if word.startswith("rattle_"))
    port = free_port()
    with server(tmp_path, port, "--workers", "1", settings=EXPLORER | {"RATTLE_REQUIRE_KEYS": "true"}) as process:
        yield f"http://127.0.0.1:{port}", tokens, process


def test_a_key_opens_the_page_and_the_service_ends_while_it_is_open(
    browser: Browser, asking: tuple[str, dict[str, str], object]
) -> None:
    url, tokens, process = asking
    with visiting(browser, url) as context:
        page = context.new_page()
        page.goto(f"{url}/?theme=dark")
        page.get_by_label("API key").fill(tokens["read"])
        page.get_by_role("button", name="Sign in").click()
        expect(page.get_by_text("No surveys yet")).to_be_visible()
        assert page.url.startswith(f"{url}/?")
        assert "theme=dark" in page.url
        (cookie,) = context.cookies()
        assert cookie["httpOnly"]
        assert cookie["sameSite"] == "Strict"
        page.get_by_role("button", name="New survey").click()
        expect(page.get_by_text("cells, about")).to_be_visible()
        expect(page.get_by_role("button", name="Submit")).to_be_disabled()
        page.get_by_role("button", name="Sign out").click()
        expect(page.get_by_label("API key")).to_be_visible()
        assert context.cookies() == []
        page.get_by_label("API key").fill(tokens["submit"])
        page.get_by_role("button", name="Sign in").click()
        page.get_by_role("button", name="New survey").click()
        expect(page.get_by_text("cells, about")).to_be_visible()
        expect(page.get_by_role("button", name="Submit")).to_be_enabled()
        began = time.monotonic()
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=60) == 0
        assert time.monotonic() - began < SECONDS
        page.close()
