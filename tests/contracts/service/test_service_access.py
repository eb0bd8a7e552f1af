"""Who is let in: keys, their scopes and quotas, names of the service, pages of other sites."""

import re
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from service_support import BODY, HERE, assert_problem, front_end, front_of
from starlette.websockets import WebSocketDisconnect

from service.access import keys
from service.access.middleware import asks_keys
from service.access.origins import is_loopback
from service.database.tables import Scope, State
from service.settings import Settings

CELLS = 24  # of BODY
NOBODY = ("203.0.113.7", 40000)


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("data"), require_keys=True, max_jobs=1000) as client:
        yield client


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("data"), allowed_hosts=("gear.example",)) as client:
        yield client


def key(client: TestClient, scope: Scope = Scope.SUBMIT, **quotas: int) -> dict[str, str]:
    """Headers with a new key."""
    _, token = keys.add_key(front_of(client).database, "somebody", scope, **quotas)
    return {"Authorization": f"Bearer {token}"}


def submit(client: TestClient, headers: dict[str, str], **changes: Any) -> str:
    response = client.post("/v1/surveys?force=true", json=BODY | changes, headers=headers)
    assert response.status_code == 202, response.text
    return str(response.json()["id"])


@contextmanager
def peer(client: TestClient, address: tuple[str, int]) -> Iterator[TestClient]:
    """The same application, asked from another address."""
    yield TestClient(client.app, HERE, raise_server_exceptions=False, client=address)


# Keys


def test_a_secret_is_nowhere_in_the_data_directory(client: TestClient) -> None:
    token = key(client)["Authorization"].split()[1]
    assert keys.TOKEN.fullmatch(token)
    secret = keys.TOKEN.fullmatch(token)[2].encode()
    files = [path for path in front_of(client).directory.path.rglob("*") if path.is_file()]
    kept = b"".join(path.read_bytes() for path in files)
    assert keys.hash_of(secret.decode()).encode() in kept
    assert secret not in kept


def test_each_key_is_another_one_of_256_bits(client: TestClient) -> None:
    tokens = {key(client)["Authorization"] for _ in range(20)}
    assert len(tokens) == 20
    assert len({token.rpartition("_")[2] for token in tokens}) == 20


@pytest.mark.parametrize(
    "value",
    [
        None,
        "",
        "Bearer",
        "Bearer ",
        "Bearer nonsense",
        "Basic {token}",
        "{token}",
        "Bearer {token}x",
        "Bearer {other_id}",
        "Bearer {upper}",
        "Bearer rattle_{zeros}_{secret}",
        "Bearer ' OR 1=1 --",
        "Bearer \xff",
    ],
)
def test_without_a_live_key_nothing_is_answered(client: TestClient, value: str | None) -> None:
    good, other = (key(client)["Authorization"].split()[1] for _ in range(2))
    _, good_id, secret = good.split("_", 2)
    values = {
        "token": good,
        "other_id": f"rattle_{other.split('_')[1]}_{secret}",
        "upper": good.upper(),
        "zeros": "0" * len(good_id),
        "secret": secret,
    }
    headers = {} if value is None else {"Authorization": value.format(**values).encode("latin-1")}
    for method, path in (
        ("GET", "/v1/surveys"),
        ("POST", "/v1/surveys"),
        ("GET", "/v1/nowhere"),
        ("GET", "/v1/surveys/x/store/zarr.json"),
        ("HEAD", "/v1/surveys/x/store/zarr.json"),
        ("GET", "/v1/orbits?delta=0.6&epsilon=0.1"),
        ("GET", "/v1/health/"),
        ("GET", "/v1/../v1/surveys"),
        ("POST", "/v1/health"),
        ("GET", "/docs/x"),
    ):
        response = client.request(method, path, headers=headers)
        assert response.status_code == 401, (method, path)
        assert response.headers["www-authenticate"].startswith("Bearer")
        if method != "HEAD":
            assert_problem(response, 401, "key")
    assert client.get("/v1/surveys", headers={"Authorization": f"bearer {good}"}).status_code == 200


def test_a_body_without_a_key_is_not_even_read(client: TestClient) -> None:
    response = client.post("/v1/surveys", content=b"{", headers={"Content-Type": "application/json"})
    assert_problem(response, 401)
    assert_problem(client.post("/v1/surveys", content=b"{", headers=key(client) | {"Content-Type": "text/x"}), 415)


@pytest.mark.parametrize("coding", ["br", "gzip", "GZIP", "identity, br", "nonsense", "deflate"])
def test_a_compressed_body_is_refused_in_words(client: TestClient, coding: str) -> None:
    headers = key(client) | {"Content-Encoding": coding}
    for method, path in (("POST", "/v1/surveys"), ("POST", "/v1/surveys/x/verify"), ("POST", "/login")):
        refused = client.request(method, path, json=BODY, headers=headers)
        assert_problem(refused, 415, "Content-Encoding")
        assert refused.headers["accept-encoding"] == "identity"
    assert client.get("/v1/surveys", headers=headers).status_code == 200
    plain = client.post("/v1/surveys", json=BODY, headers=headers | {"Content-Encoding": "Identity"})
    assert plain.status_code == 202


def test_a_revoked_key_is_refused_at_once(client: TestClient) -> None:
    headers = key(client)
    submit(client, headers)
    front_of(client).database.revoke_key(headers["Authorization"].split("_")[1])
    assert_problem(client.get("/v1/surveys", headers=headers), 401, "revoked")
    assert client.get("/v1/surveys", headers=key(client, Scope.READ)).status_code == 200


def test_reading_does_not_allow_writing(client: TestClient) -> None:
    writer, reader = key(client), key(client, Scope.READ)
    survey_id = submit(client, writer)
    for path in ("/v1/surveys", f"/v1/surveys/{survey_id}", "/v1/orbits?delta=0.6&epsilon=0.1"):
        assert client.get(path, headers=reader).status_code == 200
    before = client.get("/v1/surveys", headers=reader).json()
    assert_problem(client.post("/v1/surveys", json=BODY, headers=reader), 403, "submit")
    assert_problem(client.delete(f"/v1/surveys/{survey_id}", headers=reader), 403, "submit")
    assert client.get("/v1/surveys", headers=reader).json() == before


def test_only_the_key_that_submitted_a_survey_removes_it(client: TestClient) -> None:
    mine, yours = key(client), key(client)
    survey_id = submit(client, mine)
    path = f"/v1/surveys/{survey_id}"
    assert client.get(path, headers=yours).json()["state"] == "accepted"
    assert_problem(client.delete(path, headers=yours), 403, survey_id)
    assert client.get(path, headers=yours).json()["state"] == "accepted"
    assert client.delete(path, headers=mine).json()["state"] == "dismissed"
    assert_problem(client.delete(path, headers=yours), 403, survey_id)
    assert client.delete(path, headers=mine).status_code == 204
    assert_problem(client.delete(path, headers=mine), 404)


def test_a_survey_without_an_owner_is_removed_on_loopback_only(tmp_path: Path) -> None:
    with front_end(tmp_path) as client:
        survey_id = submit(client, {})
    with front_end(tmp_path, require_keys=True) as client:
        assert_problem(client.delete(f"/v1/surveys/{survey_id}", headers=key(client)), 403, survey_id)
    with front_end(tmp_path) as client:
        assert client.delete(f"/v1/surveys/{survey_id}").status_code == 200


def test_two_keys_do_not_meet_in_an_idempotency_key(client: TestClient) -> None:
    once = {"Idempotency-Key": "once"}
    mine, yours = key(client) | once, key(client) | once
    first = submit(client, mine)
    assert submit(client, mine) == first
    assert submit(client, yours) != first
    assert submit(client, key(client) | once, seed=5) not in (first, None)


# Quotas


def test_cells_count_until_the_survey_is_deleted(client: TestClient) -> None:
    headers, other = key(client, max_cells=2 * CELLS + 5), key(client)
    first, second = submit(client, headers), submit(client, headers, seed=1)
    refused = client.post("/v1/surveys", json=BODY | {"seed": 2}, headers=headers)
    assert_problem(refused, 403, f"{CELLS} cells", f"the {2 * CELLS} of", f"{2 * CELLS + 5} cells")
    submit(client, other)  # another key has its own
    client.delete(f"/v1/surveys/{first}", headers=headers)  # dismissed: its store is still there
    assert_problem(client.post("/v1/surveys", json=BODY | {"seed": 2}, headers=headers), 403)
    client.delete(f"/v1/surveys/{first}", headers=headers)
    third = submit(client, headers, seed=2)
    assert {second, third} == {
        survey["id"]
        for survey in client.get("/v1/surveys", headers=headers).json()["surveys"]
        if front_of(client).database.job(survey["id"]).owner == headers["Authorization"].split("_")[1]
    }


def test_running_surveys_count_until_they_end(client: TestClient) -> None:
    headers = key(client, max_running=1)
    first = submit(client, headers | {"Idempotency-Key": "first"})
    refused = client.post("/v1/surveys", json=BODY | {"seed": 1}, headers=headers)
    assert_problem(refused, 429, "1 surveys", "quota")
    assert int(refused.headers["retry-after"]) > 0
    assert submit(client, headers | {"Idempotency-Key": "first"}) == first  # nothing new is asked
    front_of(client).database.set_state(first, State.RUNNING)
    assert_problem(client.post("/v1/surveys", json=BODY | {"seed": 1}, headers=headers), 429)
    front_of(client).database.set_state(first, State.SUCCESSFUL)
    submit(client, headers, seed=1)


@pytest.mark.parametrize(("quota", "allowed"), [({"max_running": 3}, 3), ({"max_cells": 3 * CELLS}, 3)])
def test_many_requests_at_once_do_not_pass_a_quota(client: TestClient, quota: dict[str, int], allowed: int) -> None:
    headers = key(client, **quota)

    def post(seed: int) -> int:
        return client.post("/v1/surveys", json=BODY | {"seed": seed}, headers=headers).status_code

    with ThreadPoolExecutor(8) as pool:
        statuses = list(pool.map(post, range(16)))
    assert statuses.count(202) == allowed
    assert set(statuses) == {202, 429 if "max_running" in quota else 403}


# What is open


def test_health_lives_without_a_key_and_says_more_with_one(client: TestClient) -> None:
    headers = key(client, Scope.READ)
    stranger, known = client.get("/v1/health"), client.get("/v1/health", headers=headers)
    assert stranger.status_code == known.status_code == 200
    assert {name for name, value in stranger.json().items() if value is not None} == {"status", "version"}
    assert known.json()["accepted"] == front_of(client).database.count(State.ACCEPTED)
    assert known.json()["running"] == front_of(client).database.count(State.RUNNING)
    assert "cluster" in known.json()
    assert client.get("/v1/health", headers={"Authorization": "Bearer wrong"}).json() == stranger.json()


#: Answered without a key; there is no cluster here.
OPEN = {"/v1/health": 200, "/v1/ready": 503}


def test_every_route_but_these_declares_the_key(client: TestClient) -> None:
    document = client.get("/openapi.json").json()
    assert document["components"]["securitySchemes"]["key"]["scheme"] == "bearer"
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            asked = path not in OPEN
            assert ("security" in operation) == asked, (method, path)
            assert ("401" in operation["responses"]) == asked, (method, path)
            assert "403" in operation["responses"], (method, path)
    assert client.get("/docs").status_code == 200


def test_every_route_of_the_application_asks_for_a_key(client: TestClient) -> None:
    paths = client.get("/openapi.json").json()["paths"]
    assert len(paths) > 7
    for path, operations in paths.items():
        for method in operations:
            answer = client.request(method, re.sub(r"{[^}]*}", "x", path))
            assert answer.status_code == OPEN.get(path, 401), (method, path)


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
    assert asks_keys(Settings(**settings)) is expected


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
            assert_problem(each.request(method, path, json=BODY, headers=headers | more), 403, "another site")
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
        assert response.headers["content-security-policy"] == "frame-ancestors 'self'"


def test_websockets_are_refused_like_writes(local: TestClient, client: TestClient) -> None:
    for each, headers in ((local, {"Origin": "http://evil.example"}), (client, {})):
        with pytest.raises(WebSocketDisconnect) as refused, each.websocket_connect("/explorer", headers=headers):
            pass
        assert refused.value.code == 1008


# What a route does not know


@pytest.mark.parametrize(
    ("path", "known"),
    [
        ("/v1/surveys?limt=5", "limit"),
        ("/v1/surveys?limit=5&x", "limit"),
        ("/v1/orbits?delta=0.6&epsilon=0.1&Beta=0.5", "beta"),
        ("/v1/surveys/x/map.png?quantity=region", "variable"),
        ("/v1/surveys/x/store/zarr.json?v=1", "none"),
        ("/v1/health?verbose=1", "none"),
    ],
)
def test_an_unknown_parameter_is_named_with_those_that_there_are(local: TestClient, path: str, known: str) -> None:
    problem = assert_problem(local.get(path), 422, known)
    assert problem["errors"][0]["field"].startswith("query.")


def test_only_the_owner_lets_a_survey_run_again(client: TestClient) -> None:
    owner, other = key(client, max_running=1), key(client)
    survey_id = submit(client, owner)
    front_of(client).database.set_state(survey_id, State.FAILED, "no permission")
    path = f"/v1/surveys/{survey_id}/verify"
    assert_problem(client.post(path, headers=other), 403, "was not submitted with this API key")
    assert client.get(f"/v1/surveys/{survey_id}", headers=owner).json()["state"] == "failed"
    assert client.post(path, headers=owner).status_code == 202


def test_without_a_key_the_survey_of_a_revoked_one_is_verified(local: TestClient) -> None:
    database = front_of(local).database
    row, token = keys.add_key(database, "gone", Scope.SUBMIT)
    with peer(local, NOBODY) as remote:
        survey_id = submit(remote, {"Authorization": f"Bearer {token}"})
    database.set_state(survey_id, State.FAILED, "no permission")
    database.revoke_key(row.id)
    assert local.post(f"/v1/surveys/{survey_id}/verify").status_code == 202
