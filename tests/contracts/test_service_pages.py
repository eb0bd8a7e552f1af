"""A page of the explorer and its websocket: who opens it, and what is left when it is closed."""

from pathlib import Path
from re import findall
from typing import Any

import pytest
from fastapi.testclient import TestClient
from service_support import front_end
from starlette.websockets import WebSocketDisconnect
from waiting import HANG

from service.explorer import mount

HOST = "127.0.0.1:8000"
SOCKET = f"ws://{HOST}/ws"
OWN = {"Origin": f"http://{HOST}", "Sec-Fetch-Site": "same-origin"}


@pytest.fixture(autouse=True)
def _no_page_is_put_away_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mount, "SWEEP_SECONDS", HANG)


def test_a_page_is_let_go_of_when_its_browser_leaves(tmp_path: Path) -> None:
    with front_end(tmp_path) as client:
        (token,) = set(findall(r'"token":\s*"([^"]+)"', client.get("/").text))
        with client.websocket_connect(SOCKET, headers={**OWN}, subprotocols=["bokeh", token]) as socket:
            assert "ACK" in socket.receive_text()
            (page,) = open_pages(client)
            assert page.connection_count == 1
        assert page.connection_count == 0  # and so it is swept


def test_a_page_cannot_be_opened_with_a_token_of_somebody_else_s_making(tmp_path: Path) -> None:
    with front_end(tmp_path) as client:
        (token,) = set(findall(r'"token":\s*"([^"]+)"', client.get("/").text))
        body, signature = token.split(".")
        forged = f"{body}.{signature[::-1]}"
        with (
            pytest.raises(WebSocketDisconnect),
            client.websocket_connect(SOCKET, headers={**OWN}, subprotocols=["bokeh", forged]) as socket,
        ):
            socket.receive_text()
        assert [page.connection_count for page in open_pages(client)] == [0]


def open_pages(client: TestClient) -> list[Any]:
    return list(client.app.state.explorer._loading.result().context.sessions)


def test_a_page_that_is_swept_has_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    failures: list[str] = []
    monkeypatch.setattr("panel.io.application.logger.warning", failures.append)  # of what is done at the end
    with front_end(tmp_path) as client:
        (token,) = set(findall(r'"token":\s*"([^"]+)"', client.get("/").text))
        with client.websocket_connect(SOCKET, headers={**OWN}, subprotocols=["bokeh", token]) as socket:
            assert "ACK" in socket.receive_text()
        explorer = client.app.state.explorer
        assert len(explorer._news._listeners) == 1
        client.portal.call(explorer._loading.result().context._cleanup_sessions, 0)
        assert open_pages(client) == []
        assert explorer._news._listeners == set()
    assert failures == []
