"""Open connections end once another process revokes their key on the same database, or their browser signs out."""

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from pathlib import Path
from re import findall
from typing import Any

import pytest
from fastapi.testclient import TestClient
from service_support import BODY, front_end, front_of
from waiting import HANG, wait_until

from gear_rattle.service.access import keys
from gear_rattle.service.database import Database
from gear_rattle.service.database.keys import AccessKeys
from gear_rattle.service.database.tables import KeyRow, Scope

HOST = "127.0.0.1:8000"
OWN = {"Origin": f"http://{HOST}", "Sec-Fetch-Site": "same-origin"}


@pytest.fixture
def client(tmp_path: Path, database_url: str) -> Iterator[TestClient]:
    limits = {"heartbeat_seconds": HANG}
    with front_end(tmp_path, require_keys=True, database_url=database_url, **limits) as client:
        client.follow_redirects = False
        yield client


def new_key(client: TestClient) -> tuple[KeyRow, dict[str, str]]:
    key, token = keys.add_key(front_of(client).database, "somebody", Scope.SUBMIT)
    return key, {"Authorization": f"Bearer {token}"}


def revoke(database_url: str, key: KeyRow) -> None:
    """Revoke a key as `rattle key revoke` does, beside the service."""
    with closing(Database(database_url, exclusive=False)) as database:
        database.revoke_key(key.id)


def open_things(client: TestClient) -> int:
    return len(front_of(client).revocations._open)


def sign_in(client: TestClient, headers: dict[str, str]) -> str:
    client.cookies.clear()
    form = {"key": headers["Authorization"].split()[1]}
    assert client.post("/login", data=form, headers=OWN).status_code == 303
    return str(client.cookies[keys.COOKIE])


@contextmanager
def streams(client: TestClient, headers: list[dict[str, str]]) -> Iterator[list[Any]]:
    """Event streams that are open, one for each of these."""
    before = open_things(client)
    path = client.post("/v1/surveys?force=true", json=BODY, headers=headers[0] | OWN).headers["location"]
    client.cookies.clear()
    with ThreadPoolExecutor(len(headers)) as pool:
        found = [pool.submit(client.get, f"{path}/events", headers=each) for each in headers]
        try:
            wait_until(lambda: open_things(client) == before + len(headers))
            yield found
        finally:
            front_of(client).manager.dismiss_or_delete(
                path.rpartition("/")[2]
            )  # the last event ends those that are left


def test_streams_end_when_their_key_is_revoked_and_others_go_on(client: TestClient, database_url: str) -> None:
    (key, headers), (_, others) = new_key(client), new_key(client)
    session = {"Cookie": f"{keys.COOKIE}={sign_in(client, headers)}"}
    with streams(client, [headers, session, others]) as (first, second, third):
        revoke(database_url, key)
        for ended in (first.result(HANG), second.result(HANG)):
            assert ended.status_code == 200
            assert "event: state" in ended.text
        wait_until(lambda: open_things(client) == 1)
        assert not third.done()


def test_signing_out_ends_the_streams_of_this_browser_alone(client: TestClient) -> None:
    _, headers = new_key(client)
    mine, yours = ({"Cookie": f"{keys.COOKIE}={sign_in(client, headers)}"} for _ in range(2))
    with streams(client, [mine, yours, headers]) as (first, second, third):
        assert client.post("/logout", headers=OWN | mine).status_code == 303
        assert first.result(HANG).status_code == 200
        wait_until(lambda: open_things(client) == 2)
        assert not second.done()
        assert not third.done()


def test_one_question_is_for_all_of_them_and_none_for_none(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    asked, twice = [], threading.Event()
    live_identities = AccessKeys.live_identities

    def count(database: AccessKeys, identities: Any) -> Any:
        asked.append(len(identities))
        if len(asked) > 1:
            twice.set()
        return live_identities(database, identities)

    monkeypatch.setattr(AccessKeys, "live_identities", count)
    every = [new_key(client)[1] for _ in range(4)]
    with streams(client, [*every, *every]):
        del asked[:]
        assert twice.wait(HANG)
        assert set(asked) == {4}
    wait_until(lambda: not front_of(client).revocations._has_open.is_set())
    del asked[:]
    assert client.get("/v1/health").status_code == 200
    assert asked == []


@pytest.mark.parametrize("way", ["revoke", "sign out"])
def test_the_websocket_of_a_page_ends_too(client: TestClient, database_url: str, way: str) -> None:
    key, headers = new_key(client)
    sign_in(client, headers)
    (token,) = set(findall(r'"token":\s*"([^"]+)"', client.get("/page").text))
    with client.websocket_connect(f"ws://{HOST}/ws", headers={**OWN}, subprotocols=["bokeh", token]) as socket:
        assert "ACK" in socket.receive_text()
        assert open_things(client) == 1
        end: Callable[[], object] = lambda: (  # noqa: E731 - one of two
            revoke(database_url, key) if way == "revoke" else client.post("/logout", headers=OWN)
        )
        end()
        assert next(said for said in iter(socket.receive, None) if said["type"] == "websocket.close")["code"] == 1008
    assert open_things(client) == 0
