"""A page of the explorer and its websocket: who opens it, and what is left when it is closed."""

import asyncio
import logging
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from re import findall
from typing import Any

import httpx
import pytest
from bokeh.server.session import ServerSession
from fastapi.testclient import TestClient
from service_support import front_end
from starlette.types import Message, Receive, Scope, Send
from starlette.websockets import WebSocketDisconnect
from waiting import HANG, wait_until

from gear_rattle.service.explorer.map.figure import MapFigure
from gear_rattle.service.explorer.map.shared import SharedState
from gear_rattle.service.explorer.page import mount, pages
from gear_rattle.service.explorer.point import work

LOOK_MS = 20
HOST = "127.0.0.1:8000"
SOCKET = f"ws://{HOST}/ws"
OWN = {"Origin": f"http://{HOST}", "Sec-Fetch-Site": "same-origin"}


@pytest.fixture(autouse=True)
def passed(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """Return an event that, once set, makes the time pass for which pages without a browser are kept."""
    passed = threading.Event()
    waited = property(lambda _session: 1e9 if passed.is_set() else 0.0)
    monkeypatch.setattr(ServerSession, "milliseconds_since_last_unsubscribe", waited)
    monkeypatch.setitem(pages.SETTINGS, "check_unused_sessions_milliseconds", LOOK_MS)
    return passed


def test_a_page_is_let_go_of_when_its_browser_leaves(tmp_path: Path) -> None:
    with front_end(tmp_path) as client:
        (token,) = set(findall(r'"token":\s*"([^"]+)"', client.get("/page").text))
        with client.websocket_connect(SOCKET, headers={**OWN}, subprotocols=["bokeh", token]) as socket:
            assert "ACK" in socket.receive_text()
            (page,) = open_pages(client)
            assert page.connection_count == 1
        wait_until(lambda: page.connection_count == 0)
        wait_until(lambda: page.destroyed)


def test_processes_for_the_first_click_are_started_once_a_page_has_its_map(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = list[str]()
    cells = MapFigure.draw_cells

    async def prepare(_: Any) -> None:
        seen.append("processes")

    def drawn(*args: Any) -> None:
        cells(*args)
        seen.append("map")

    monkeypatch.setattr(work, "prepare_processes", prepare)
    monkeypatch.setattr(MapFigure, "draw_cells", drawn)
    with front_end(tmp_path, preload=True) as client:
        for pages in (1, 2):
            client.get("/page")
            wait_until(lambda pages=pages: seen.count("map") == pages and "processes" in seen)
    assert seen == ["map", "processes", "map"]


@pytest.mark.parametrize("preload", [True, False])
def test_the_first_map_is_found_after_the_start_where_that_is_wanted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, preload: bool
) -> None:
    found = list[SharedState]()

    async def prepare(shared: SharedState) -> None:
        found.append(shared)

    monkeypatch.setattr(SharedState, "compute_default_map", prepare)
    with front_end(tmp_path, preload=preload) as client:
        client.portal.call(client.app.state.explorer.preload_page)
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


def test_a_page_is_nobody_else_s_whatever_it_is_asked_by(tmp_path: Path) -> None:
    with front_end(tmp_path) as client:
        (token,) = set(findall(r'"token":\s*"([^"]+)"', client.get("/page").text))
        (page,) = open_pages(client)
        asked: list[tuple[dict[str, str], dict[str, str]]] = [
            ({"bokeh_session_id": page.id}, {}), ({"bokeh-session-id": page.id}, {}), ({"bokeh-token": token}, {}),
            ({}, {"Bokeh-Session-Id": page.id}),
        ]  # fmt: skip
        for number, (params, headers) in enumerate(asked, start=2):
            assert client.get("/page", params=params, headers=headers).status_code == 200
            assert len(open_pages(client)) == number


def test_a_browser_that_leaves_while_its_message_is_handled_leaves_no_traceback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    records: list[logging.LogRecord] = []
    handler = logging.Handler()
    handler.emit = records.append  # type: ignore[method-assign]
    loggers = [logging.getLogger(name) for name in ("bokeh", "bokeh_fastapi", "gear_rattle.service.explorer", "panel")]
    for logger in loggers:
        logger.addHandler(handler)
    gone, failed = threading.Event(), threading.Semaphore(0)
    serve = mount._PageWebsocketRoute.__call__

    async def leaving(route: mount._PageWebsocketRoute, scope: Scope, receive: Receive, send: Send) -> None:
        async def sent(message: Message) -> None:
            if gone.is_set() and message["type"] == "websocket.send":
                failed.release()
                raise OSError("the browser has left")
            await send(message)

        await serve(route, scope, receive, sent)

    monkeypatch.setattr(mount._PageWebsocketRoute, "__call__", leaving)
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
        wait_until(lambda: [page.connection_count for page in open_pages(client)] == [0])
    for logger in loggers:
        logger.removeHandler(handler)
    said = [record.getMessage() for record in records if record.exc_info or record.levelno > logging.INFO]
    assert said == []


def open_pages(client: TestClient) -> list[Any]:
    return list(client.app.state.explorer._loading.result().sessions())


@pytest.mark.parametrize(("code", "comes_back"), [(1000, False), (1001, False), (1006, True)])
def test_a_page_ends_with_its_browser_or_when_it_is_swept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, passed: threading.Event, code: int, comes_back: bool
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
        news = client.app.state.explorer.news
        if comes_back:
            client.portal.call(asyncio.sleep, 5e-3 * LOOK_MS)
            assert open_pages(client) == [page]
            assert len(news._listeners) == 1
            passed.set()
        wait_until(lambda: open_pages(client) == [])
        wait_until(lambda: news._listeners == set())
    assert failures == []


def test_a_browser_that_comes_too_late_is_refused_instead_of_being_given_another_page(
    tmp_path: Path, passed: threading.Event, caplog: pytest.LogCaptureFixture
) -> None:
    """The browser would not know the parts of another page, which would stay empty."""
    with front_end(tmp_path) as client:
        (token,) = set(findall(r'"token":\s*"([^"]+)"', client.get("/page").text))
        passed.set()
        wait_until(lambda: open_pages(client) == [])
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
        assert client.app.state.explorer.news._listeners == set()
        assert "needs JavaScript" in answers[0].text
        assert client.get("/page").status_code == 200


@pytest.mark.parametrize("visited", [False, True])
def test_a_page_that_nobody_comes_to_is_swept_within_seconds(
    tmp_path: Path, passed: threading.Event, visited: bool
) -> None:
    assert pages.UNUSED_SECONDS + pages.CHECK_SECONDS <= 30
    with front_end(tmp_path, max_pages=1) as client:
        (token,) = set(findall(r'"token":\s*"([^"]+)"', client.get("/page").text))
        if visited:
            with client.websocket_connect(SOCKET, headers={**OWN}, subprotocols=["bokeh", token]) as socket:
                assert "ACK" in socket.receive_text()
                (left,) = open_pages(client)
                socket.close(1006)
                wait_until(lambda: left.connection_count == 0)
        (page,) = open_pages(client)
        assert client.get("/page").status_code == 503
        assert open_pages(client) == [page]
        passed.set()
        wait_until(lambda: open_pages(client) == [])
        passed.clear()
        assert client.get("/page").status_code == 200


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
        noted(page._Template, "server_doc")
        counting = client.portal.start_task_soon(count)
        seen.clear()
        assert client.get("/page").status_code == 200
        counting.cancel()
    assert len(seen) == 2
    assert seen == sorted(set(seen))


def test_a_page_whose_browser_leaves_while_it_is_made_is_finished_and_swept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, passed: threading.Event
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

    with front_end(tmp_path) as client:
        client.get("/page")
        from gear_rattle.service.explorer.page import page

        client.portal.call(visit, client, page)
        wait_until(lambda: len(open_pages(client)) == 2)
        passed.set()
        wait_until(lambda: open_pages(client) == [])
        wait_until(lambda: client.app.state.explorer.news._listeners == set())


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
