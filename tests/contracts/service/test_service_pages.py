"""A page of the explorer and its websocket: who opens it, and what is left when it is closed."""

import asyncio
import logging
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from re import findall
from typing import Any

import httpx
import pytest
from fastapi.testclient import TestClient
from service_support import front_end
from starlette.websockets import WebSocket, WebSocketDisconnect
from waiting import HANG, wait_until

from gear_rattle.service.explorer.map.figure import Map
from gear_rattle.service.explorer.map.shared import Shared
from gear_rattle.service.explorer.page import mount
from gear_rattle.service.explorer.point import work

SWEEP_SECONDS = mount.SWEEP_SECONDS
HOST = "127.0.0.1:8000"
SOCKET = f"ws://{HOST}/ws"
OWN = {"Origin": f"http://{HOST}", "Sec-Fetch-Site": "same-origin"}


@pytest.fixture(autouse=True)
def _no_page_is_put_away_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mount, "SWEEP_SECONDS", HANG)


def test_a_page_is_let_go_of_when_its_browser_leaves(tmp_path: Path) -> None:
    with front_end(tmp_path) as client:
        (token,) = set(findall(r'"token":\s*"([^"]+)"', client.get("/page").text))
        with client.websocket_connect(SOCKET, headers={**OWN}, subprotocols=["bokeh", token]) as socket:
            assert "ACK" in socket.receive_text()
            (page,) = open_pages(client)
            assert page.connection_count == 1
        assert page.connection_count == 0  # and so it is swept


def test_processes_for_the_first_click_are_started_once_a_page_has_its_map(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = list[str]()
    cells = Map.cells

    async def prepare(_: Any) -> None:
        seen.append("processes")

    def drawn(*args: Any) -> None:
        cells(*args)
        seen.append("map")

    monkeypatch.setattr(work, "prepare", prepare)
    monkeypatch.setattr(Map, "cells", drawn)
    with front_end(tmp_path, preload=True) as client:
        for pages in (1, 2):
            client.get("/page")
            wait_until(lambda pages=pages: seen.count("map") == pages and "processes" in seen)
    assert seen == ["map", "processes", "map"]


@pytest.mark.parametrize("preload", [True, False])
def test_the_first_map_is_found_after_the_start_where_that_is_wanted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, preload: bool
) -> None:
    found = list[Shared]()

    async def prepare(shared: Shared) -> None:
        found.append(shared)

    monkeypatch.setattr(Shared, "prepare", prepare)
    with front_end(tmp_path, preload=preload) as client:
        client.portal.call(client.app.state.explorer.prepare)
    assert len(found) == preload


def test_a_page_cannot_be_opened_with_a_token_of_somebody_else_s_making(tmp_path: Path) -> None:
    with front_end(tmp_path) as client:
        (token,) = set(findall(r'"token":\s*"([^"]+)"', client.get("/page").text))
        body, signature = token.split(".")
        forged = f"{body}.{signature[::-1]}"
        with (
            pytest.raises(WebSocketDisconnect),
            client.websocket_connect(SOCKET, headers={**OWN}, subprotocols=["bokeh", forged]) as socket,
        ):
            socket.receive_text()
        assert [page.connection_count for page in open_pages(client)] == [0]


def test_a_browser_that_leaves_while_its_message_is_handled_leaves_no_traceback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "gear_rattle.service.explorer.page.socket")
    records: list[logging.LogRecord] = []
    handler = logging.Handler()
    handler.emit = records.append  # type: ignore[method-assign]
    loggers = [
        logging.getLogger(name)
        for name in ("bokeh", "bokeh_fastapi", "gear_rattle.service.explorer.page.socket", "panel")
    ]
    for logger in loggers:
        logger.addHandler(handler)
    gone, failed = threading.Event(), threading.Semaphore(0)
    send_text = WebSocket.send_text

    async def send(socket: WebSocket, text: str) -> None:
        if gone.is_set():
            failed.release()
            raise WebSocketDisconnect(1006)
        await send_text(socket, text)

    monkeypatch.setattr(WebSocket, "send_text", send)
    with front_end(tmp_path) as client:
        (token,) = set(findall(r'"token":\s*"([^"]+)"', client.get("/page").text))
        with client.websocket_connect(SOCKET, headers={**OWN}, subprotocols=["bokeh", token]) as socket:
            assert "ACK" in socket.receive_text()
            gone.set()
            for number in range(3):
                for part in ({"msgid": str(number), "msgtype": "PULL-DOC-REQ"}, {}, {}):
                    socket.send_json(part)
                if number == 0:
                    assert failed.acquire(timeout=HANG)
            socket.close(1006)
        assert [page.connection_count for page in open_pages(client)] == [0]
    for logger in loggers:
        logger.removeHandler(handler)
    said = [record.getMessage() for record in records if record.levelno >= logging.INFO]
    assert not any(record.exc_info for record in records), said
    assert sum("has left" in text for text in said) == 1


def open_pages(client: TestClient) -> list[Any]:
    return list(client.app.state.explorer._loading.result().context.sessions)


@pytest.mark.parametrize(("code", "comes_back"), [(1000, False), (1001, False), (1006, True)])
def test_a_page_ends_with_its_browser_or_when_it_is_swept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int, comes_back: bool
) -> None:
    """A page that was closed or reloaded ends at once, and with it what it had computed; a lost connection may not."""
    failures: list[str] = []
    monkeypatch.setattr("panel.io.application.logger.warning", failures.append)  # of what is done at the end
    with front_end(tmp_path) as client:
        (token,) = set(findall(r'"token":\s*"([^"]+)"', client.get("/page").text))
        with client.websocket_connect(SOCKET, headers={**OWN}, subprotocols=["bokeh", token]) as socket:
            assert "ACK" in socket.receive_text()
            (page,) = open_pages(client)
            socket.close(code)
            wait_until(lambda: page.connection_count == 0)
        explorer = client.app.state.explorer
        assert len(explorer._news._listeners) == comes_back == len(open_pages(client))
        client.portal.call(explorer._loading.result().context._cleanup_sessions, 0)
        assert open_pages(client) == []
        assert explorer._news._listeners == set()
    assert failures == []


def test_a_browser_that_comes_too_late_is_refused_instead_of_being_given_another_page(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Of whose parts it knows nothing: it would stay empty."""
    with front_end(tmp_path) as client:
        (token,) = set(findall(r'"token":\s*"([^"]+)"', client.get("/page").text))
        client.portal.call(client.app.state.explorer._loading.result().context._cleanup_sessions, 0)
        with (
            pytest.raises(WebSocketDisconnect) as refused,
            client.websocket_connect(SOCKET, headers={**OWN}, subprotocols=["bokeh", token]),
        ):
            pass
        assert refused.value.reason == mount.GONE
        assert open_pages(client) == []
    assert not [record for record in caplog.records if record.exc_info]


def test_who_runs_no_script_gets_no_page(tmp_path: Path) -> None:
    """A monitor or a crawler, which never opens a websocket: nothing of what it asks for is kept."""
    with front_end(tmp_path, max_pages=1) as client:
        answers = [client.request(method, "/?theme=dark") for method in ("GET", "HEAD") for _ in range(20)]
        assert {each.status_code for each in answers} == {200}
        assert {each.text for each in answers} == {answers[0].text, ""}
        assert open_pages(client) == []
        assert client.app.state.explorer._news._listeners == set()
        assert "needs JavaScript" in answers[0].text
        assert client.get("/page").status_code == 200


@pytest.mark.parametrize("visited", [False, True])
def test_a_page_that_nobody_comes_to_is_swept_within_seconds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, visited: bool
) -> None:
    assert mount.UNUSED_MILLISECONDS + 1000 * SWEEP_SECONDS <= 30_000
    with front_end(tmp_path, max_pages=1) as client:
        (token,) = set(findall(r'"token":\s*"([^"]+)"', client.get("/page").text))
        if visited:
            with client.websocket_connect(SOCKET, headers={**OWN}, subprotocols=["bokeh", token]) as socket:
                assert "ACK" in socket.receive_text()
                (left,) = open_pages(client)
                socket.close(1006)
                wait_until(lambda: left.connection_count == 0)
        sweep = mount.forget_unused, client.app.state.explorer._loading.result()
        (page,) = open_pages(client)
        client.portal.call(*sweep)
        assert open_pages(client) == [page]
        assert client.get("/page").status_code == 503
        monkeypatch.setattr(mount, "UNUSED_MILLISECONDS", -1)  # its time is up
        assert client.get("/page").status_code == 200  # nobody waits for the next sweep
        assert page not in open_pages(client)
        client.portal.call(*sweep)
        assert open_pages(client) == []


def test_others_have_their_turn_between_the_parts_of_a_page_and_its_document(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Made at once, a page keeps everybody waiting who asks the service for something."""
    turns, seen = 0, list[int]()

    async def count() -> None:
        nonlocal turns
        while True:
            turns += 1
            await asyncio.sleep(0)

    def noted(owner: Any, name: str) -> None:
        work: Callable[..., Any] = getattr(owner, name)

        def note(*arguments: Any, **named: Any) -> Any:
            seen.append(turns)
            return work(*arguments, **named)

        monkeypatch.setattr(owner, name, note)

    with front_end(tmp_path) as client:
        client.get("/page")  # what it imports is there
        from gear_rattle.service.explorer.page import page

        noted(page, "Page")
        noted(page._Template, "_init_doc")
        if find_spec("bokeh.server.asgi") is None:
            from gear_rattle.service.explorer.page.transport_fastapi import DocHandler

            noted(DocHandler, "render_session")
        counting = client.portal.start_task_soon(count)
        seen.clear()
        assert client.get("/page").status_code == 200
        counting.cancel()
    assert len(seen) > 1
    assert seen == sorted(set(seen))


def test_a_page_whose_browser_leaves_while_it_is_made_is_finished_and_swept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def visit(client: TestClient, page: Any) -> None:
        transport = httpx.ASGITransport(client.app, client=("127.0.0.1", 50000))
        async with httpx.AsyncClient(transport=transport, base_url=f"http://{HOST}") as http:
            visiting = asyncio.ensure_future(http.get("/page"))
            make = page.Page

            def left(*arguments: Any) -> Any:
                visiting.cancel()
                return make(*arguments)

            monkeypatch.setattr(page, "Page", left)
            with pytest.raises(asyncio.CancelledError):
                await visiting
        for _ in range(100):
            await asyncio.sleep(0)
        await client.app.state.explorer._loading.result().context._cleanup_sessions(0)

    with front_end(tmp_path) as client:
        client.get("/page")
        from gear_rattle.service.explorer.page import page

        client.portal.call(visit, client, page)
        assert open_pages(client) == []
        assert client.app.state.explorer._news._listeners == set()


def test_what_a_page_imports_is_imported_in_one_thread_only(tmp_path: Path) -> None:
    """Panel's modules import each other in a circle: two threads that import them at once get half of one."""
    asked = """
import sys
from pathlib import Path
from service_support import front_end
from gear_rattle.service.errors import UnavailableError
from gear_rattle.service.explorer.page.mount import Explorer
def load(self):
    raise UnavailableError("it is being loaded")
Explorer.load = load
with front_end(Path(sys.argv[1])) as client:
    print(client.get("/").status_code, client.get("/static/js/bokeh.min.js").status_code)
print(*sorted({name.partition(".")[0] for name in sys.modules} & {"panel", "bokeh"}))
"""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    said = subprocess.run(
        [sys.executable, "-c", asked, str(tmp_path)], capture_output=True, text=True, timeout=HANG, env=environment
    )
    assert said.stdout.split("\n") == ["503 503", "", ""], said.stderr
