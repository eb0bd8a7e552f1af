"""A survey that is there already is not computed again, unless it is wanted anew."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from service_support import BODY, assert_problem, front_end, front_of

import gear_rattle.workers.survey.request
from gear_rattle.service.access.keys import add_key
from gear_rattle.service.database import Database, NewJob
from gear_rattle.service.database.tables import Scope, State


@pytest.fixture
def client(tmp_path: Path, database_url: str) -> Iterator[TestClient]:
    with front_end(tmp_path / "data", database_url=database_url, max_jobs=3) as client:
        yield client


def post(client: TestClient, status: int, query: str = "", headers: Any = None, **changes: Any) -> str:
    """Submit; the id of the survey that is answered with."""
    response = client.post(f"/v1/surveys{query}", json=BODY | changes, headers=headers)
    assert response.status_code == status, response.text
    assert response.headers["location"] == f"/v1/surveys/{response.json()['id']}"
    assert ("retry-after" in response.headers) == (status == 202)
    return str(response.json()["id"])


def finish(client: TestClient, survey_id: str, state: State = State.SUCCESSFUL) -> None:
    front = front_of(client)
    front.directory.store(survey_id).mkdir(parents=True, exist_ok=True)
    assert front.database.set_state(survey_id, state)


def test_a_successful_one_is_answered_at_once_even_if_the_queue_is_full(client: TestClient) -> None:
    first = post(client, 202)
    finish(client, first)
    for seed in range(1, 4):
        post(client, 202, seed=seed)
    assert_problem(client.post("/v1/surveys", json=BODY | {"seed": 9}), 429)
    assert post(client, 200, name="another name") == first
    assert client.get(f"/v1/surveys/{first}").json()["name"] == BODY["name"]
    # What the tile would be by default anyway is no difference, another one is.
    assert_problem(client.post("/v1/surveys", json=BODY | {"tile": {"delta": 2, "epsilon": 2}}), 429)


def test_one_that_waits_is_joined(client: TestClient) -> None:
    assert len({post(client, 202) for _ in range(3)}) == 1
    assert client.get("/v1/surveys").json()["count"] == 1


def test_force_computes_anew_and_the_finished_one_is_preferred_to_the_running(client: TestClient) -> None:
    first = post(client, 202)
    finish(client, first)
    forced = post(client, 202, "?force=true")
    assert forced != first
    assert post(client, 200) == first
    finish(client, forced)
    assert post(client, 200) == forced
    assert_problem(client.post("/v1/surveys?force=perhaps", json=BODY), 422, "force")


@pytest.mark.parametrize("state", [State.FAILED, State.DISMISSED])
def test_failed_and_dismissed_ones_are_computed_again(client: TestClient, state: State) -> None:
    first = post(client, 202)
    finish(client, first, state)
    assert post(client, 202) != first


def test_a_deleted_one_and_one_without_its_store_are_computed_again(client: TestClient) -> None:
    first = post(client, 202)
    finish(client, first)
    assert client.delete(f"/v1/surveys/{first}").status_code == 204
    second = post(client, 202)
    finish(client, second)
    assert post(client, 200) == second
    front_of(client).directory.store(second).rmdir()
    third = post(client, 202)
    assert len({first, second, third}) == 3


def test_other_code_computes_another_survey(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    first = post(client, 202)
    finish(client, first)
    monkeypatch.setattr(gear_rattle.workers.survey.request, "code_version", lambda: "of tomorrow")
    assert post(client, 202) != first


def test_a_key_stands_for_the_survey_that_it_was_answered_with(client: TestClient) -> None:
    first = post(client, 202)
    finish(client, first)
    key = {"Idempotency-Key": "once"}
    assert post(client, 200, headers=key) == first
    forced = post(client, 202, "?force=true")
    finish(client, forced)
    assert post(client, 200) == forced
    assert post(client, 200, headers=key) == first
    assert post(client, 200, "?force=true", headers=key) == first
    assert_problem(client.post("/v1/surveys", json=BODY | {"seed": 1}, headers=key), 409, first, code="conflict")
    assert_problem(client.post("/v1/surveys", json=BODY | {"name": "other"}, headers=key), 409, code="conflict")
    client.delete(f"/v1/surveys/{first}")
    assert post(client, 200, headers=key) == forced  # the key went with the survey


def test_a_forced_survey_keeps_its_key(client: TestClient) -> None:
    key = {"Idempotency-Key": "anew"}
    finish(client, post(client, 202))
    forced = post(client, 202, "?force=true", headers=key)
    assert post(client, 202, "?force=true", headers=key) == forced
    assert post(client, 202, headers=key) == forced


def test_owners_share_what_is_finished_only(tmp_path: Path, database_url: str) -> None:
    with front_end(tmp_path / "data", database_url=database_url, require_keys=True) as client:
        database = front_of(client).database
        tokens = [add_key(database, name, Scope.SUBMIT, max_cells=30)[1] for name in ("mine", "yours")]
        mine, yours = ({"Authorization": f"Bearer {token}"} for token in tokens)
        first = post(client, 202, headers=mine)
        second = post(client, 202, headers=yours)
        assert first != second  # I could dismiss mine
        assert post(client, 202, headers=mine) == first
        finish(client, first)
        assert post(client, 200, headers=yours) == first
        assert_problem(client.post("/v1/surveys?force=1", json=BODY, headers=yours), 403, code="quota_exceeded")
        assert_problem(client.delete(f"/v1/surveys/{first}", headers=yours), 403)


def test_many_at_once_are_one_survey(database_url: str) -> None:
    database = Database(database_url)

    def accept(number: int) -> str:
        key = f"key {number % 4}" if number % 2 else None
        return database.add_or_find_job(NewJob("", {}, "c", "b", 24, 4, key), 100, lambda _: True).id

    with ThreadPoolExecutor(12) as pool:
        assert len(set(pool.map(accept, range(48)))) == 1
    assert database.jobs(10)[1] == 1
    database.close()
