"""The life of a survey, seen by its clients and by its database, without a cluster."""

import sqlite3
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from httpx_sse import EventSource
from service_support import BODY, assert_problem, front_end, front_of
from waiting import HANG

from gear_rattle.service.database import DoneTile
from gear_rattle.service.database.engine import UNPOOLED, open_engine
from gear_rattle.service.database.tables import State
from gear_rattle.service.errors import DataDirectoryError


@pytest.fixture
def client(tmp_path: Path, database_url: str) -> Iterator[TestClient]:
    with front_end(tmp_path / "data", database_url=database_url) as client:
        yield client


def submit(client: TestClient, **changes: Any) -> str:
    """Id of a new survey."""
    response = client.post("/v1/surveys?force=true", json=BODY | changes)
    assert response.status_code == 202, response.text
    return str(response.json()["id"])


def events(client: TestClient, survey_id: str, after: int = 0) -> list[tuple[int, str, dict[str, Any]]]:
    """Every event of a survey that has ended: id, kind, data."""
    response = client.get(f"/v1/surveys/{survey_id}/events", headers={"Last-Event-ID": str(after)})
    assert response.status_code == 200
    return [(int(event.id), event.event, event.json()) for event in EventSource(response).iter_sse()]


def finish(client: TestClient, survey_id: str, tiles: int = 4) -> None:
    """Let the database hear that a survey ran and ended."""
    database = front_of(client).database
    database.set_state(survey_id, State.RUNNING)
    for index in range(tiles):
        failures = [{"epsilon": 1, "delta": 2, "message": "no convergence"}] if index == 1 else []
        database.add_tile(survey_id, DoneTile(index, 6, 0.5, len(failures), failures))
    database.set_state(survey_id, State.SUCCESSFUL)


def test_an_accepted_survey_has_a_location_and_links(client: TestClient) -> None:
    response = client.post("/v1/surveys", json=BODY)
    assert response.status_code == 202
    assert int(response.headers["retry-after"]) > 0
    shown = client.get(response.headers["location"])
    assert shown.json() == response.json()
    document = shown.json()
    assert document["state"] == "accepted"
    assert (document["cells"], document["tiles"], document["progress"]) == (24, 4, 0)
    assert document["links"]["self"] == response.headers["location"]
    assert document["request"]["delta"] == BODY["delta"]


def test_a_repeated_key_answers_with_the_first_survey(client: TestClient) -> None:
    key = {"Idempotency-Key": "once"}
    reordered = dict(reversed(BODY.items()))
    first = client.post("/v1/surveys", json=BODY, headers=key)
    second = client.post("/v1/surveys", json=reordered, headers=key)
    assert first.headers["location"] == second.headers["location"]
    assert client.get("/v1/surveys").json()["count"] == 1
    assert_problem(client.post("/v1/surveys", json=BODY | {"seed": 1}, headers=key), 409, code="conflict")


def test_one_key_sent_by_many_at_once_is_one_survey(client: TestClient) -> None:
    def post(_: int) -> str:
        return client.post("/v1/surveys", json=BODY, headers={"Idempotency-Key": "same"}).headers["location"]

    with ThreadPoolExecutor(8) as pool:
        assert len(set(pool.map(post, range(16)))) == 1
    assert client.get("/v1/surveys").json()["count"] == 1


def test_pages_hold_every_survey_once_newest_first(client: TestClient) -> None:
    submitted = [submit(client, seed=seed) for seed in range(7)]
    found: list[str] = []
    page: dict[str, Any] = {"next": None}
    while not found or page["next"]:
        query = {"limit": 3} | ({"cursor": page["next"]} if page["next"] else {})
        page = client.get("/v1/surveys", params=query).json()
        assert page["count"] == 7
        found += [survey["id"] for survey in page["surveys"]]
    assert found == submitted[::-1]


def test_events_are_numbered_and_resume_after_any_of_them(client: TestClient) -> None:
    survey_id = submit(client)
    finish(client, survey_id)
    every = events(client, survey_id)
    assert [number for number, _, _ in every] == list(range(1, 8))
    assert [kind for _, kind, _ in every] == ["state", "state", "tile", "tile", "tile", "tile", "state"]
    assert [data["progress"] for _, _, data in every] == [0, 0, 25, 50, 75, 99, 100]
    assert [data["state"] for _, kind, data in every if kind == "state"] == ["accepted", "running", "successful"]
    for seen in range(7):
        assert events(client, survey_id, seen) == every[seen:]


def test_a_client_that_saw_the_end_is_told_not_to_come_back(client: TestClient) -> None:
    survey_id = submit(client)
    finish(client, survey_id)
    assert client.get(f"/v1/surveys/{survey_id}/events", headers={"Last-Event-ID": "7"}).status_code == 204
    bad = client.get(f"/v1/surveys/{survey_id}/events", headers={"Last-Event-ID": "seven"})
    assert_problem(bad, 422, "last-event-id")


def test_an_open_stream_ends_with_the_survey(client: TestClient) -> None:
    survey_id = submit(client)
    with ThreadPoolExecutor(1) as pool:
        stream = pool.submit(events, client, survey_id)
        finish(client, survey_id)
        assert stream.result(timeout=HANG)[-1][2]["state"] == "successful"


def test_failed_cells_are_counted_and_explained(client: TestClient) -> None:
    survey_id = submit(client)
    finish(client, survey_id)
    document = client.get(f"/v1/surveys/{survey_id}").json()
    assert document["cells_failed"] == 1
    assert document["failures"] == [{"epsilon": 1, "delta": 2, "message": "no convergence"}]


def test_delete_dismisses_first_and_deletes_then(client: TestClient) -> None:
    survey_id = submit(client)
    path = f"/v1/surveys/{survey_id}"
    dismissed = client.delete(path)
    assert dismissed.status_code == 200
    assert dismissed.json()["state"] == "dismissed"
    assert events(client, survey_id)[-1][2]["state"] == "dismissed"
    assert client.delete(path).status_code == 204
    assert_problem(client.get(path), 404)
    assert_problem(client.delete(path), 404)


def test_deleting_a_survey_removes_its_store_and_rows_and_nothing_else(client: TestClient, database_url: str) -> None:
    front = front_of(client)
    kept, gone = submit(client), submit(client)
    for survey_id in (kept, gone):
        finish(client, survey_id)
        (front.directory.store(survey_id) / "region").mkdir(parents=True)
    assert client.delete(f"/v1/surveys/{gone}").status_code == 204
    assert list(front.directory.store(kept).parent.iterdir()) == [front.directory.store(kept)]
    with open_engine(database_url, UNPOOLED).connect() as database:
        for table, rows in (("jobs", 1), ("tiles", 4), ("events", 7)):
            assert database.exec_driver_sql(f"SELECT count(*) FROM {table}").scalar_one() == rows
    assert client.get("/v1/surveys").json()["count"] == 1


def test_nothing_happens_to_a_survey_after_its_end(client: TestClient) -> None:
    survey_id = submit(client)
    database = front_of(client).database
    client.delete(f"/v1/surveys/{survey_id}")
    before = events(client, survey_id)
    database.add_tile(survey_id, DoneTile(0, 6, 0.5, 0, []))
    assert not database.set_state(survey_id, State.SUCCESSFUL)
    assert events(client, survey_id) == before
    assert database.recorded_tile_indices(survey_id) == set()


def test_tiles_whose_chunks_are_lost_are_forgotten(client: TestClient) -> None:
    survey_id = submit(client)
    database = front_of(client).database
    for index in range(4):
        database.add_tile(survey_id, DoneTile(index, 6, 0.5, index, []))
    told = len(database.events(survey_id, 0))
    assert database.keep_only_tiles(survey_id, {0, 2}) == 2
    (repair,) = database.events(survey_id, 0)[told:]  # or whoever watches would see progress fall without a word
    assert "2 tiles are lost or damaged" in repair.data["message"]
    assert repair.data["tiles_done"] == 2
    assert database.keep_only_tiles(survey_id, {0, 2}) == 0
    assert len(database.events(survey_id, 0)) == told + 1
    document = client.get(f"/v1/surveys/{survey_id}").json()
    assert database.recorded_tile_indices(survey_id) == {0, 2}
    assert (document["tiles_done"], document["cells_done"], document["cells_failed"]) == (2, 12, 2)


def test_surveys_are_found_again_after_a_restart(tmp_path: Path, database_url: str) -> None:
    with front_end(tmp_path, database_url=database_url) as client:
        survey_id = submit(client)
        before = client.get(f"/v1/surveys/{survey_id}").json()
    with front_end(tmp_path, database_url=database_url) as client:
        assert client.get(f"/v1/surveys/{survey_id}").json() == before
        assert front_of(client).database.active_surveys()


def test_numbers_of_deleted_surveys_are_not_given_again(client: TestClient) -> None:
    database = front_of(client).database
    first = submit(client)
    number = database.job(first).number
    client.delete(f"/v1/surveys/{first}")
    client.delete(f"/v1/surveys/{first}")
    assert database.job(submit(client)).number > number


def test_a_data_directory_serves_one_server(tmp_path: Path) -> None:
    with front_end(tmp_path), pytest.raises(DataDirectoryError, match="Another service"), front_end(tmp_path):
        pass


def test_a_foreign_data_directory_is_refused_and_left_alone(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(DataDirectoryError, match="cannot be used"), front_end(tmp_path / "file"):
        pass
    foreign = b"this is not a database, but it is precious" * 100
    (tmp_path / "jobs.sqlite").write_bytes(foreign)
    with pytest.raises(DataDirectoryError, match="cannot be opened"), front_end(tmp_path):
        pass
    assert (tmp_path / "jobs.sqlite").read_bytes() == foreign


def test_a_database_of_another_program_is_refused_and_left_alone(tmp_path: Path) -> None:
    with sqlite3.connect(tmp_path / "jobs.sqlite") as database:
        database.execute("CREATE TABLE jobs (number INTEGER, salary REAL)")
    with pytest.raises(DataDirectoryError, match="another program"), front_end(tmp_path):
        pass
    with sqlite3.connect(tmp_path / "jobs.sqlite") as database:
        assert database.execute("SELECT name FROM sqlite_master").fetchall() == [("jobs",)]


def test_health_tells_that_the_cluster_is_missing(client: TestClient) -> None:
    submit(client)
    health = client.get("/v1/health").json()
    assert health["status"] == "degraded"
    assert health["accepted"] == 1


def test_a_survey_that_has_ended_is_verified_by_running_again(client: TestClient) -> None:
    survey_id = submit(client)
    path = f"/v1/surveys/{survey_id}"
    assert_problem(client.post(f"{path}/verify"), 409, "accepted")
    finish(client, survey_id)
    again = client.post(f"{path}/verify")
    assert again.status_code == 202
    assert again.headers["location"] == path
    document = again.json()
    assert (document["state"], document["finished"], document["cells_failed"]) == ("accepted", None, 1)
    assert document["failures"]
    assert front_of(client).database.recorded_tile_indices(survey_id) == set(
        range(4)
    )  # what is whole is not computed again
    assert front_of(client).database.active_surveys()[0].id == survey_id
    assert_problem(client.post(f"{path}/verify"), 409, "accepted")
    front_of(client).database.set_state(survey_id, State.FAILED, "no permission")
    assert client.post(f"{path}/verify").status_code == 202
    client.delete(path)
    assert client.post(f"{path}/verify").json()["state"] == "accepted"  # it goes on
    client.delete(path)
    front_of(client).database.begin_deletion(survey_id)
    assert_problem(client.post(f"{path}/verify"), 409, code="conflict")
    assert_problem(client.post("/v1/surveys/nobody/verify"), 404)


def test_verifying_is_work_that_must_have_room(tmp_path: Path) -> None:
    with front_end(tmp_path, max_jobs=1) as client:
        survey_id = submit(client)
        finish(client, survey_id)
        submit(client)
        assert_problem(client.post(f"/v1/surveys/{survey_id}/verify"), 429, "DELETE one")


def test_what_another_version_computed_stays_successful(client: TestClient) -> None:
    survey_id = submit(client)
    finish(client, survey_id)
    with open_engine(front_of(client).database._reader.url, UNPOOLED).begin() as database:
        database.exec_driver_sql("UPDATE jobs SET content_hash = 'of another version'")
    assert_problem(client.post(f"/v1/surveys/{survey_id}/verify"), 409, code="conflict")
    assert client.get(f"/v1/surveys/{survey_id}").json()["state"] == "successful"


def test_a_survey_that_is_let_run_again_keeps_its_store(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its deletion was requested at the same time, and came second."""
    front = front_of(client)
    survey_id = submit(client)
    finish(client, survey_id)
    store = front.directory.store(survey_id)
    store.mkdir(parents=True)
    set_state = front.database.set_state

    def set_state_then_verify(*arguments: Any) -> bool:
        changed = set_state(*arguments)
        front.manager.verify(survey_id, None, 32)
        return changed

    monkeypatch.setattr(front.database, "set_state", set_state_then_verify)
    assert_problem(client.delete(f"/v1/surveys/{survey_id}"), 409, "accepted")
    assert store.exists()
