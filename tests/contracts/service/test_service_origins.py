"""Requests without a key: from loopback, by names of the service; and pages of other sites, which are refused."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from pydantic import ValidationError
from service_support import BODY, HERE, NOBODY, assert_problem, front_end, front_of, key, peer, submit
from starlette.websockets import WebSocketDisconnect

from gear_rattle.service.access import keys
from gear_rattle.service.access.middleware import requires_keys
from gear_rattle.service.access.origins import is_loopback
from gear_rattle.service.database.tables import Scope, State
from gear_rattle.service.settings import Settings


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("data"), require_keys=True, max_jobs=1000) as client:
        yield client


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("data"), allowed_hosts=("gear.example",)) as client:
        yield client


# Loopback, names and proxies


@pytest.mark.parametrize(
    ("host", "expected"),
    [
        ("127.0.0.1", True),
        ("127.8.9.1", True),
        ("::1", True),
        ("::ffff:127.0.0.1", True),
        ("localhost", True),
        ("0.0.0.0", False),
        ("::", False),
        ("192.168.0.1", False),
        ("::ffff:192.168.0.1", False),
        ("no.such.name.invalid", False),
        ("", False),
    ],
)
def test_loopback_is_recognised(host: str, expected: bool) -> None:
    assert is_loopback(host) is expected


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({}, False),
        ({"require_keys": True}, True),
        ({"host": "0.0.0.0"}, True),
        ({"host": "::"}, True),
        ({"host": "0.0.0.0", "insecure": True}, False),
    ],
)
def test_keys_are_asked_beyond_loopback(settings: dict[str, Any], expected: bool) -> None:
    assert requires_keys(Settings(**settings)) is expected


def test_on_loopback_no_key_is_asked_but_of_those_who_are_not_there(local: TestClient) -> None:
    assert local.get("/v1/surveys").status_code == 200
    for address in (NOBODY, ("10.0.0.1", 1), ("nonsense", 1)):
        with peer(local, address) as stranger:
            assert_problem(stranger.get("/v1/surveys"), 401)
    with peer(local, ("::1", 1)) as here:
        assert here.get("/v1/surveys").status_code == 200


@pytest.mark.parametrize(
    "header", ["X-Forwarded-For", "X-Forwarded-Proto", "Forwarded", "Via", "X-Real-IP", "CF-Connecting-IP"]
)
def test_a_proxy_on_loopback_does_not_open_the_door(local: TestClient, header: str) -> None:
    assert_problem(local.get("/v1/surveys", headers={header: "127.0.0.1"}), 401)


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("127.0.0.1:8000", 200),
        ("127.0.0.1:9", 200),
        ("localhost", 200),
        ("LocalHost.:8000", 200),
        ("[::1]:8000", 200),
        ("gear.localhost", 200),
        ("gear.example:80", 200),
        ("evil.example", 403),
        ("evil.example:8000", 403),
        ("127.0.0.1.evil.example", 403),
        ("localhost.evil.example", 403),
        ("evillocalhost", 403),
        ("127.0.0.1@evil.example", 403),
        ("192.168.0.9", 403),
        ("[::1", 403),
        ("", 403),
    ],
)
def test_a_name_that_was_pointed_here_is_refused(local: TestClient, host: str, status: int) -> None:
    for path in ("/v1/surveys", "/v1/health", "/docs"):
        assert local.get(path, headers={"Host": host}).status_code == status, path


def test_where_every_address_is_ours_any_address_will_do_but_no_name(tmp_path: Path) -> None:
    with front_end(tmp_path, host="0.0.0.0", insecure=True) as client, peer(client, NOBODY) as stranger:
        for host, status in (("192.168.0.9:8000", 200), ("evil.example", 403), ("localhost", 200)):
            assert stranger.get("/v1/surveys", headers={"Host": host}).status_code == status, host


def test_with_a_key_any_name_will_do(client: TestClient) -> None:
    assert client.get("/v1/surveys", headers=key(client) | {"Host": "gear.example"}).status_code == 200


def test_without_a_key_the_survey_of_a_revoked_one_is_verified(local: TestClient) -> None:
    database = front_of(local).database
    row, token = keys.add_key(database, "gone", Scope.SUBMIT)
    with peer(local, NOBODY) as remote:
        survey_id = submit(remote, {"Authorization": f"Bearer {token}"})
    database.set_state(survey_id, State.FAILED, "no permission")
    database.revoke_key(row.id)
    assert local.post(f"/v1/surveys/{survey_id}/verify").status_code == 202


# Pages of other sites

OTHER_SITES = [
    {"Origin": "http://evil.example"},
    {"Origin": "null"},
    {"Origin": "http://127.0.0.1:8001"},
    {"Origin": "http://[::1"},
    {"Sec-Fetch-Site": "cross-site"},
    {"Sec-Fetch-Site": "same-site"},
    {"Sec-Fetch-Site": "nonsense", "Origin": HERE},
    {"Sec-Fetch-Site": "cross-site", "Origin": HERE},
]
OURSELVES = [{}, {"Origin": HERE}, {"Sec-Fetch-Site": "same-origin"}, {"Sec-Fetch-Site": "none"}]


@pytest.mark.parametrize("headers", OTHER_SITES)
def test_a_page_of_another_site_cannot_write(local: TestClient, client: TestClient, headers: dict[str, str]) -> None:
    before = local.get("/v1/surveys").json()["count"]
    survey_id = submit(client, key(client))
    for each, more in ((local, {}), (client, key(client))):
        for method, path in (("POST", "/v1/surveys"), ("DELETE", f"/v1/surveys/{survey_id}"), ("PUT", "/v1/surveys")):
            assert_problem(each.request(method, path, json=BODY, headers=headers | more), 403, code="forbidden")
    assert local.get("/v1/surveys").json()["count"] == before


@pytest.mark.parametrize("headers", OURSELVES)
def test_our_own_pages_and_programs_write(local: TestClient, headers: dict[str, str]) -> None:
    survey_id = submit(local, headers)
    assert local.delete(f"/v1/surveys/{survey_id}", headers=headers).status_code == 200


def test_no_page_of_another_site_is_allowed_to_read(local: TestClient) -> None:
    asked = {"Origin": "http://evil.example", "Access-Control-Request-Method": "POST"}
    preflight, read = local.options("/v1/surveys", headers=asked), local.get("/v1/surveys", headers=asked)
    assert_problem(preflight, 405)
    for response in (preflight, read, local.get("/v1/nowhere"), local.get("/v1/health", headers={"Host": "x"})):
        assert not [name for name in response.headers if name.startswith("access-control-")]
        assert response.headers["x-content-type-options"] == "nosniff"
        assert response.headers["cross-origin-resource-policy"] == "same-origin"
        policy = response.headers["content-security-policy"].split("; ")
        assert {"default-src 'self'", "frame-ancestors 'self'"} < set(policy)
        assert not [each for each in policy if "http" in each or "*" in each or "eval" in each]


def test_a_page_of_an_origin_in_the_settings_reads_and_does_not_write(tmp_path: Path) -> None:
    friend = "https://maps.example"
    with front_end(tmp_path, cors_origins=(friend,)) as client:
        for origin, allowed in ((friend, friend), ("https://evil.example", None)):
            asked = {"Origin": origin, "Sec-Fetch-Site": "cross-site"}
            read = client.get("/v1/surveys", headers=asked)
            assert read.headers.get("access-control-allow-origin") == allowed
            assert "access-control-allow-credentials" not in read.headers
            assert_problem(client.post("/v1/surveys", json=BODY, headers=asked), 403, code="forbidden")
            wish = asked | {"Access-Control-Request-Method": "GET", "Access-Control-Request-Headers": "authorization"}
            assert client.options("/v1/surveys", headers=wish).status_code == (200 if allowed else 400)
            wish["Access-Control-Request-Method"] = "POST"
            assert client.options("/v1/surveys", headers=wish).status_code == 400


@pytest.mark.parametrize("origin", ["*", "maps.example", "https://maps.example/path"])
def test_an_origin_is_named_in_full(origin: str) -> None:
    with pytest.raises(ValidationError, match="is not an origin"):
        Settings(cors_origins=(origin,))


@pytest.mark.parametrize(
    ("address", "headers", "said"),
    [
        ("testclient/rattle/", {}, "with --root-path /rattle (RATTLE_ROOT_PATH=/rattle)"),
        (
            "testclient/rattle",
            {"Sec-Fetch-Site": "same-origin"},
            "X-Forwarded-Prefix: /rattle, which counts with RATTLE_BEHIND_PROXY=true",
        ),
        ("gears.example/", {}, "proxy_set_header Host $http_host"),
        ("127.0.0.1:8443/", {}, "proxy_set_header Host $http_host"),
        # Chromium says of a page that it is of the same site, and of its websocket nothing: that would be refused.
        ("gears.example/", {"Sec-Fetch-Site": "same-origin"}, "proxy_set_header Host $http_host"),
    ],
)
def test_a_page_behind_a_proxy_that_is_set_up_wrong_says_what_to_set(
    local: TestClient, caplog: pytest.LogCaptureFixture, address: str, headers: dict[str, str], said: str
) -> None:
    refused = local.get("/page", headers={"Rattle-Address": address, **headers})
    assert_problem(refused, 403, said)
    assert said in caplog.text


def test_a_page_behind_a_proxy_that_is_set_up_well_is_opened(local: TestClient) -> None:
    for headers in ({}, {"Rattle-Address": HERE.removeprefix("http://") + "/"}):
        assert local.get("/page", headers=headers).status_code == 200


def test_a_write_that_a_proxy_has_changed_is_told_of_the_proxy(local: TestClient) -> None:
    sent = local.post("/v1/surveys", json=BODY, headers={"Origin": "http://gears.example"})
    assert_problem(sent, 403, "proxy_set_header Host $http_host")


def test_websockets_are_refused_like_writes(
    local: TestClient, client: TestClient, caplog: pytest.LogCaptureFixture
) -> None:
    for each, headers in ((local, {"Origin": "http://evil.example"}), (client, {})):
        with pytest.raises(WebSocketDisconnect) as refused, each.websocket_connect("/explorer", headers=headers):
            pass
        assert refused.value.code == 1008
    assert "a websocket was refused: A page of another site may not change this service" in caplog.text
    assert "http://evil.example" in caplog.text
