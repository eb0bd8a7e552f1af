"""A browser where keys are asked: the form, its cookie, and what the cookie opens."""

from base64 import urlsafe_b64decode
from collections.abc import Iterator
from pathlib import Path
from re import findall

import pytest
from fastapi.testclient import TestClient
from service_support import BODY, assert_problem, front_end, front_of
from starlette.websockets import WebSocketDisconnect
from waiting import HANG

from gear_rattle.service.access import keys
from gear_rattle.service.access.keys import COOKIE, OLD_COOKIE
from gear_rattle.service.database.keys import MOST_SESSIONS
from gear_rattle.service.database.tables import Scope

HOST = "127.0.0.1:8000"
SOCKET = f"ws://{HOST}/ws"
OWN = {"Origin": f"http://{HOST}", "Sec-Fetch-Site": "same-origin"}
OTHER = ({"Origin": "http://evil.example"}, {"Sec-Fetch-Site": "cross-site"}, {"Sec-Fetch-Site": "same-site"})
ATTRIBUTES = {"httponly", "samesite=strict", "path=/"}


@pytest.fixture(scope="module")
def asking(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("data"), require_keys=True, max_jobs=1000) as client:
        client.follow_redirects = False
        yield client


@pytest.fixture
def client(asking: TestClient) -> TestClient:
    asking.cookies.clear()
    return asking


def token_of(client: TestClient, scope: Scope = Scope.SUBMIT) -> str:
    return keys.add_key(front_of(client).database, "somebody", scope)[1]


def sign_in(client: TestClient, token: str, path: str = "/login", **headers: str) -> list[str]:
    """Sign in by the form; the attributes of the cookie, which the client keeps."""
    answer = client.post(path, data={"key": token}, headers=OWN | headers)
    assert answer.status_code == 303, answer.text
    return [part.strip().lower() for part in answer.headers["set-cookie"].split(";")]


def test_the_page_asks_for_a_key_and_comes_back_to_the_view_that_was_asked_for(client: TestClient) -> None:
    sent = client.get("/?survey=abc&delta=0.5,0.6")
    assert (sent.status_code, sent.headers["location"]) == (303, "/login?next=%2F%3Fsurvey%3Dabc%26delta%3D0.5%2C0.6")
    form = client.get(sent.headers["location"])
    assert form.status_code == 200
    assert 'type="password"' in form.text
    back = client.post(sent.headers["location"], data={"key": token_of(client)}, headers=OWN)
    assert (back.status_code, back.headers["location"]) == (303, "/?survey=abc&delta=0.5,0.6")
    assert client.get("/v1/surveys").status_code == 200


@pytest.mark.parametrize(
    "wanted", ["https://evil.example/", "//evil.example", "/\\evil.example", "/v1/surveys", "/?\r\nx"]
)
def test_the_form_leads_to_no_other_page(client: TestClient, wanted: str) -> None:
    answer = client.post("/login", params={"next": wanted}, data={"key": token_of(client)}, headers=OWN)
    assert (answer.status_code, answer.headers["location"]) == (303, "/")


def test_the_cookie_can_neither_be_read_by_scripts_nor_sent_by_other_sites(client: TestClient) -> None:
    assert set(sign_in(client, token_of(client))) >= ATTRIBUTES
    assert "secure" not in sign_in(client, token_of(client))
    assert "secure" in sign_in(client, token_of(client), **{"X-Forwarded-Proto": "https"})


@pytest.mark.parametrize("wrong", ["", "something else", "rattle_0123456789abcdef_" + "A" * 43, "<script>", "\x00"])
def test_a_wrong_key_is_said_to_be_wrong_and_is_not_shown(client: TestClient, wrong: str) -> None:
    answer = client.post("/login", data={"key": wrong}, headers=OWN)
    assert answer.status_code == 401
    assert "unknown or was revoked" in answer.text
    assert "set-cookie" not in answer.headers
    assert not wrong or wrong not in answer.text


def test_a_form_of_many_fields_is_refused_in_words(client: TestClient) -> None:
    fields = "&".join(f"key={number}" for number in range(9))
    form = {"Content-Type": "application/x-www-form-urlencoded"}
    assert_problem(client.post("/login", content=fields, headers=OWN | form), 422, "only the field named key")


def test_who_may_read_looks_and_who_may_submit_submits(client: TestClient) -> None:
    sign_in(client, token_of(client, Scope.READ))
    assert client.get("/v1/surveys").status_code == 200
    assert_problem(client.post("/v1/surveys", json=BODY, headers=OWN), 403, code="forbidden")
    sign_in(client, token_of(client))
    submitted = client.post("/v1/surveys", json=BODY, headers=OWN)
    assert submitted.status_code == 202
    sign_in(client, token_of(client))
    assert_problem(client.delete(submitted.json()["links"]["self"], headers=OWN), 403, code="forbidden")


@pytest.mark.parametrize("headers", OTHER)
def test_another_site_gains_nothing_by_the_cookie(client: TestClient, headers: dict[str, str]) -> None:
    sign_in(client, token_of(client))
    assert_problem(client.post("/v1/surveys", json=BODY, headers=headers), 403, code="forbidden")
    assert_problem(client.post("/login", data={"key": "x"}, headers=headers), 403, code="forbidden")
    assert_problem(client.post("/logout", headers=headers), 403, code="forbidden")
    with pytest.raises(WebSocketDisconnect) as refused, client.websocket_connect(SOCKET, headers=headers):
        pass
    assert refused.value.code == 1008


def test_a_revoked_key_and_a_forgotten_one_open_nothing(client: TestClient) -> None:
    database = front_of(client).database
    key, token = keys.add_key(database, "leaving", Scope.SUBMIT)
    sign_in(client, token)
    assert client.get("/v1/surveys").status_code == 200
    database.revoke_key(key.id)
    assert_problem(client.get("/v1/surveys"), 401)
    assert client.get("/").headers["location"] == "/login"
    sign_in(client, token_of(client))
    assert client.post("/logout", headers=OWN).headers["location"] == "/login"
    assert COOKIE not in client.cookies
    assert_problem(client.get("/v1/surveys"), 401)


def test_the_cookie_is_a_session_of_its_own_and_not_the_key(client: TestClient) -> None:
    database = front_of(client).database
    key, token = keys.add_key(database, "two browsers", Scope.SUBMIT)
    held = []
    for _ in range(2):
        client.cookies.clear()
        sign_in(client, token)
        held.append(client.cookies[COOKIE])
    assert len(set(held)) == 2
    secret = token[-43:]  # it may hold a "_" itself
    assert not any(secret in cookie or key.id in cookie for cookie in held)
    files = [path for path in front_of(client).directory.path.rglob("*") if path.is_file()]
    kept = b"".join(path.read_bytes() for path in files)
    assert keys.hash_secret(held[1]).encode() in kept
    assert held[1].encode() not in kept
    assert_problem(client.get("/v1/surveys", headers={"Authorization": f"Bearer {held[1]}"}), 401)
    client.cookies.set(COOKIE, held[0])
    client.post("/logout", headers=OWN)
    statuses = [client.get("/v1/surveys", headers={"Cookie": f"{COOKIE}={cookie}"}).status_code for cookie in held]
    assert statuses == [401, 200]  # somebody who has copied the first one too
    assert client.get("/v1/surveys", headers={"Authorization": f"Bearer {token}"}).status_code == 200


def test_a_session_ends_with_its_time_and_with_its_key(tmp_path: Path, database_url: str) -> None:
    with front_end(tmp_path, require_keys=True, database_url=database_url, session_seconds=1e6) as client:
        client.follow_redirects = False
        database = front_of(client).database
        key, token = keys.add_key(database, "short", Scope.READ)
        old = keys.begin_session(database, key, -1)
        assert keys.find_caller_of_session(database, old) is None
        sessions = [keys.begin_session(database, key, 1e6) for _ in range(MOST_SESSIONS + 1)]
        live = [keys.find_caller_of_session(database, each) is not None for each in sessions]
        assert live == [False] + [True] * MOST_SESSIONS
        other = keys.begin_session(database, keys.add_key(database, "other", Scope.READ)[0], 1e6)
        sign_in(client, token)
        assert client.get("/v1/surveys").status_code == 200
        database.revoke_key(key.id)
        assert_problem(client.get("/v1/surveys"), 401, code="unauthorized")
        assert not any(keys.find_caller_of_session(database, each) for each in sessions)
        assert keys.find_caller_of_session(database, other) is not None


def test_a_cookie_that_holds_a_key_is_politely_refused(client: TestClient) -> None:
    token = token_of(client)
    client.cookies.set(OLD_COOKIE, token)
    assert_problem(client.get("/v1/surveys"), 401)
    sent = client.get("/")
    assert (sent.status_code, sent.headers["location"]) == (303, "/login")
    form = client.get("/login")
    assert form.status_code == 200
    assert "sign in again" in form.text
    assert f'{OLD_COOKIE}=""' in form.headers["set-cookie"]  # it holds a key, which nobody needs any more
    client.cookies.set(COOKIE, token)  # nor is it one in the place of a session
    assert_problem(client.get("/v1/surveys"), 401)


def test_a_header_wins_over_the_cookie(client: TestClient) -> None:
    sign_in(client, token_of(client))
    assert_problem(client.get("/v1/surveys", headers={"Authorization": "Bearer nonsense"}), 401)


def test_the_websocket_of_a_page_needs_a_key_and_a_page(client: TestClient) -> None:
    with pytest.raises(WebSocketDisconnect) as refused, client.websocket_connect(SOCKET, headers={**OWN}):
        pass
    assert refused.value.code == 1008
    sign_in(client, token_of(client, Scope.READ))
    forged = ["bokeh", "eyJzZXNzaW9uX2lkIjogIngiLCAic2Vzc2lvbl9leHBpcnkiOiA5OTk5OTk5OTk5fQ.c2ln"]
    with (
        pytest.raises(WebSocketDisconnect) as refused,
        client.websocket_connect(SOCKET, headers={**OWN}, subprotocols=forged) as socket,
    ):
        socket.receive_json()
    assert refused.value.code == 1008


def test_assets_are_closed_like_the_page(client: TestClient) -> None:
    for path in ("/static/js/bokeh.min.js", "/page"):
        assert_problem(client.get(path), 401)


def test_where_no_key_is_asked_the_page_is_open_to_its_own_names_only(tmp_path: Path) -> None:
    with front_end(tmp_path) as client:
        assert client.get("/page?theme=dark").status_code == 200
        page = client.get("/?theme=dark")
        assert page.status_code == 200
        assert "connect-src 'self'" in page.headers["content-security-policy"]
        assert page.headers["cache-control"] == "no-store"
        assert client.get("/static/js/bokeh.min.js").status_code == 200
        for path in ("/", "/page"):
            assert_problem(client.get(path, headers={"Host": "evil.example"}), 403)
        assert "https://" not in "".join(part for part in page.text.split("<script") if "src=" in part[:60])


def test_the_page_does_not_hold_the_key(client: TestClient) -> None:
    token = token_of(client)
    sign_in(client, token)
    assert token not in client.get("/").text
    page = client.get("/page")
    assert page.status_code == 200
    assert token not in page.text
    assert "Sign out" in page.text
    tokens = findall(r'"token":\s*"([^"]+)"', page.text)
    assert tokens
    for found in tokens:  # of Bokeh's session: signed, and without the headers of the request
        body = found.split(".")[0]
        assert b"rattle_" not in urlsafe_b64decode(body + "=" * (-len(body) % 4))


def test_pages_beyond_the_limit_wait(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from gear_rattle.service.explorer.page import pages

    monkeypatch.setitem(
        pages.SETTINGS, "unused_session_lifetime_milliseconds", 1000 * HANG
    )  # none is put away meanwhile
    with front_end(tmp_path, max_pages=2) as client:
        assert [client.get("/page").status_code for _ in range(3)] == [200, 200, 503]
