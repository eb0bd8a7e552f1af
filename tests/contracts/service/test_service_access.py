"""The permissions of a key: its scope, its surveys, its quotas; and the paths that need no key."""

import re
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from service_support import BODY, assert_problem, front_end, front_of, key, submit

from gear_rattle.service.access import keys
from gear_rattle.service.database.tables import Scope, State

CELLS = 24  # of BODY


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("data"), require_keys=True, max_jobs=1000) as client:
        yield client


# Keys


def test_a_secret_is_nowhere_in_the_data_directory(client: TestClient) -> None:
    token = key(client)["Authorization"].split()[1]
    assert keys.TOKEN.fullmatch(token)
    secret = keys.TOKEN.fullmatch(token)[2].encode()
    files = [path for path in front_of(client).directory.path.rglob("*") if path.is_file()]
    kept = b"".join(path.read_bytes() for path in files)
    assert keys.hash_secret(secret.decode()).encode() in kept
    assert secret not in kept


def test_each_key_is_another_one_of_256_bits(client: TestClient) -> None:
    tokens = {key(client)["Authorization"] for _ in range(20)}
    assert len(tokens) == 20
    assert len({token[-43:] for token in tokens}) == 20


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
            assert_problem(response, 401, code="unauthorized")
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
        assert_problem(refused, 415, code="unsupported_media_type")
        assert refused.headers["accept-encoding"] == "identity"
    assert client.get("/v1/surveys", headers=headers).status_code == 200
    plain = client.post("/v1/surveys", json=BODY, headers=headers | {"Content-Encoding": "Identity"})
    assert plain.status_code == 202


def test_a_revoked_key_is_refused_at_once(client: TestClient) -> None:
    headers = key(client)
    submit(client, headers)
    front_of(client).database.revoke_key(headers["Authorization"].split("_")[1])
    assert_problem(client.get("/v1/surveys", headers=headers), 401, code="unauthorized")
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


def test_only_the_owner_lets_a_survey_run_again(client: TestClient) -> None:
    owner, other = key(client, max_running=1), key(client)
    survey_id = submit(client, owner)
    front_of(client).database.set_state(survey_id, State.FAILED, "no permission")
    path = f"/v1/surveys/{survey_id}/verify"
    assert_problem(client.post(path, headers=other), 403, code="forbidden")
    assert client.get(f"/v1/surveys/{survey_id}", headers=owner).json()["state"] == "failed"
    assert client.post(path, headers=owner).status_code == 202


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
    assert_problem(refused, 403, f"would have {3 * CELLS} cells", f"quota of your key, {2 * CELLS + 5} cells")
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
    assert_problem(refused, 429, "quota", code="queue_full")
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
    assert known.json()["accepted"] == front_of(client).database.count_jobs(State.ACCEPTED)
    assert known.json()["running"] == front_of(client).database.count_jobs(State.RUNNING)
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
