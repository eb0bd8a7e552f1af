"""Damage is reported, and nothing else suffers: rows of the job database, chunks, circular links."""

from collections.abc import Callable, Iterator
from pathlib import Path

import obstore
import pytest
from depth import either
from fastapi.testclient import TestClient
from s3_server import BUCKET, S3
from service_support import BODY, assert_problem, compute, front_end, front_of, idle_cluster, local_client
from sqlalchemy import text
from waiting import wait_until
from written import write_tile

from gear_rattle.service.app import create_app
from gear_rattle.service.database import Database, DoneTile
from gear_rattle.service.database.tables import State
from gear_rattle.service.explorer.common.address import View
from gear_rattle.service.explorer.common.news import JobStatus
from gear_rattle.service.explorer.map.shared import default_survey
from gear_rattle.service.explorer.page.rows import survey_row
from gear_rattle.service.settings import Settings
from gear_rattle.workers import StoreInBucket, SurveyRequest, complete, compute_tile, create_store, tiles_of
from gear_rattle.workers.survey.levels import grid

pytestmark = pytest.mark.usefixtures("templates_once")

REQUEST = SurveyRequest(**BODY)
TILE = tiles_of(REQUEST)[1]  # the first row, the second column


Take = Callable[[str, str], None]  # a key away from the store of a survey


# Stores


@pytest.fixture
def on_disk(tmp_path: Path) -> Iterator[tuple[TestClient, Take]]:
    with front_end(tmp_path) as client:

        def take(survey_id: str, key: str) -> None:
            (front_of(client).directory.store(survey_id) / key).unlink()

        yield client, take


@pytest.fixture
def in_a_bucket(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, storage: S3) -> Iterator[tuple[TestClient, Take]]:
    for name, value in storage.settings.items():
        monkeypatch.setenv(name, value)
    with front_end(tmp_path, store=f"s3://{BUCKET}/damaged") as client:

        def take(survey_id: str, key: str) -> None:
            store = front_of(client).directory.store(survey_id)
            assert isinstance(store, StoreInBucket)
            obstore.delete(store.objects, key)

        yield client, take


def with_one_tile(client: TestClient) -> str:
    """The id of a survey at work, one of whose four tiles is done."""
    survey_id = str(client.post("/v1/surveys", json=BODY).json()["id"])
    front = front_of(client)
    place = front.directory.store(survey_id)
    create_store(REQUEST, place)
    front.database.set_state(survey_id, State.RUNNING)
    write_tile(REQUEST, str(place), TILE, compute_tile(REQUEST, TILE)[0])
    front.database.add_tile(survey_id, DoneTile(TILE.index, TILE.n_cells, 0.1, 0, []))
    return survey_id


@pytest.mark.parametrize("where", ["on_disk", "in_a_bucket"])
def test_a_chunk_that_was_computed_and_is_lost_is_no_fill_value(where: str, request: pytest.FixtureRequest) -> None:
    client, take = request.getfixturevalue(where)
    survey_id = with_one_tile(client)
    store = f"/v1/surveys/{survey_id}/store"
    done = ("region/c/0/1", "status/c/0/1", "attractor_lyapunov/c/0/0/0/1", "delta/c/0", "region/zarr.json")
    nothing = (
        "region/c/0/0",
        "region/c/1/1",
        "region/c/0/2",
        "region/c/0/1/0",
        "region/c/9",
        "region/c",
        "x/c/0/1",
    )
    assert [client.get(f"{store}/{key}").status_code for key in done] == [200] * len(done)
    for key in done:
        take(survey_id, key)
    for key in done:
        lost = client.get(f"{store}/{key}")
        assert_problem(lost, 503, key, code="store_damaged")
        assert int(lost.headers["retry-after"]) > 0
        assert client.head(f"{store}/{key}").status_code == 503
    for key in nothing:
        assert_problem(client.get(f"{store}/{key}"), 404)


def test_a_chunk_of_a_level_that_is_lost_is_no_fill_value_either(
    on_disk: tuple[TestClient, Take], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same holds if it was requested before there were levels."""
    monkeypatch.setattr(grid, "LARGEST_WITHOUT_LEVELS", 3)
    monkeypatch.setattr(grid, "LARGEST_NOT_HALVED", 2)
    client, take = on_disk
    survey_id = str(client.post("/v1/surveys", json=BODY).json()["id"])
    front, key = front_of(client), "levels/1/region_occurs/c/0/0"
    here = f"/v1/surveys/{survey_id}/store/{key}"
    compute(front, survey_id, REQUEST)
    assert client.get(here).status_code == 404
    complete(REQUEST, front.directory.store(survey_id))
    front.database.set_state(survey_id, State.SUCCESSFUL)
    assert client.get(here).status_code == 200
    take(survey_id, key)
    assert_problem(client.get(here), 503, code="store_damaged")


def test_links_in_a_circle_are_a_problem_of_the_survey(tmp_path: Path) -> None:
    with front_end(tmp_path) as client:
        survey_id = with_one_tile(client)
        here, store = f"/v1/surveys/{survey_id}", front_of(client).directory.store(survey_id)
        assert isinstance(store, Path)
        for key in ("region/c/0/1", "stray"):
            (store / key).unlink(missing_ok=True)
            (store / key).symlink_to(store / key)
        assert_problem(client.get(f"{here}/store/region/c/0/1"), 503, "region/c/0/1")
        assert_problem(client.get(f"{here}/store/stray"), 404)
        for route in ("map.png", "download.nc", "download.csv"):
            assert_problem(client.get(f"{here}/{route}"), 503, "region", code="store_damaged")
        assert client.get(f"{here}/map.png?variable=status").status_code == 200
        (store / "zarr.json").unlink()
        (store / "zarr.json").symlink_to(store / "zarr.json")
        assert_problem(client.get(f"{here}/store/zarr.json"), 503, code="store_damaged")
        for route in ("map.png", "download.nc", "download.csv"):
            assert_problem(client.get(f"{here}/{route}"), 422, "zarr.json")


def test_a_damaged_chunk_is_no_error_of_the_service(tmp_path: Path) -> None:
    with front_end(tmp_path) as client:
        survey_id = with_one_tile(client)
        store = front_of(client).directory.store(survey_id)
        assert isinstance(store, Path)
        chunk = store / "region" / "c" / "0" / "1"
        chunk.write_bytes(chunk.read_bytes()[::-1])
        for route in ("map.png", "download.nc", "download.csv"):
            assert_problem(client.get(f"/v1/surveys/{survey_id}/{route}"), 503, "region", code="store_damaged")


@pytest.mark.parametrize("axis", ["delta", "epsilon"])
def test_axes_to_the_end_of_double_precision_are_drawn_or_refused(tmp_path: Path, axis: str) -> None:
    with front_end(tmp_path) as client:
        for stop, status in either(((1e299, 200), (1e308, 422)), ((1e299, 200), (1e308, 422), (1.7e308, 422))):
            fields = BODY | {"quantities": ["region"], axis: {"start": 0.5, "stop": stop, "num": BODY[axis]["num"]}}
            survey_id = client.post("/v1/surveys", json=fields).json()["id"]
            create_store(SurveyRequest(**fields), front_of(client).directory.store(survey_id))
            answer = client.get(f"/v1/surveys/{survey_id}/map.png")
            assert answer.status_code == status, answer.text
            if status == 422:
                assert_problem(answer, 422, "cannot be drawn")


# Rows

DAMAGED = {
    "sqlite": ["'{'", "''", "CAST(x'fe' AS TEXT)", "x'fe00'", "3", "'null'", "'[1, 2]'"],
    "postgresql": ["'null'", "'3'", "'[1, 2]'", "'\"{\"'"],
}


def damage(database: Database, survey_id: str, by: str) -> None:
    with database._writer.begin() as connection:
        connection.execute(text(f"UPDATE jobs SET request = {by} WHERE id = :id"), {"id": survey_id})


def damages(url: str) -> list[str]:
    return DAMAGED[url.partition(":")[0].partition("+")[0]]


def test_a_damaged_request_is_shown_as_failed_and_can_be_deleted(tmp_path: Path, database_url: str) -> None:
    states = (State.ACCEPTED, State.RUNNING, State.SUCCESSFUL)
    with front_end(tmp_path, database_url=database_url, max_jobs=100) as client:
        database = front_of(client).database
        whole = client.post("/v1/surveys", json=BODY).json()["id"]
        for number, by in enumerate(damages(database_url)):
            for state in either(states[number % 3 :][:1], states):
                survey_id = client.post("/v1/surveys?force=true", json=BODY).json()["id"]
                database.set_state(survey_id, state)
                damage(database, survey_id, by)
                here = f"/v1/surveys/{survey_id}"
                listed = {each["id"]: each for each in client.get("/v1/surveys").json()["surveys"]}
                assert listed.keys() == {whole, survey_id}
                assert listed[whole]["state"] == "accepted"
                for shown in (listed[survey_id], client.get(here).json()):
                    assert shown["state"] == "failed", by
                    assert "cannot be read" in shown["message"]
                assert client.get(here).json()["request"] == {}
                assert client.get("/v1/health").status_code == 200
                assert_problem(client.post(f"{here}/verify"), 409, code="conflict")
                assert_problem(client.get(f"{here}/certificates"), 409, "damaged", code="conflict")
                again = client.post("/v1/surveys", json=BODY)
                assert again.json()["id"] == whole
                assert client.delete(here).status_code == 204
                assert_problem(client.get(here), 404)


def test_the_explorer_lists_a_damaged_one_and_shows_another(tmp_path: Path) -> None:
    with front_end(tmp_path) as client:
        ids = [client.post("/v1/surveys?force=true", json=BODY).json()["id"] for _ in range(2)]
        database = front_of(client).database
        damage(database, ids[1], "'{'")
        standings = [JobStatus(job, None, None) for job in database.jobs(2)[0]]
        rows = [survey_row(each, View(survey=ids[1]), is_owned=True) for each in standings]
        assert [(row["id"], row["state"], row["variable"]) for row in rows] == [
            (ids[1], "failed", ""),
            (ids[0], "accepted", ""),
        ]
        assert "cannot be read" in rows[0]["message"]
        first, second = (each.job for each in standings)
        assert second.id == ids[0]
        assert default_survey([first, second]) is second
        assert default_survey([first]) is None


def test_the_surveys_behind_a_damaged_one_run(
    tmp_path: Path, database_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    computed: list[str] = []
    monkeypatch.setattr("gear_rattle.service.jobs.manager.create_store", lambda *_: None)
    monkeypatch.setattr("gear_rattle.service.jobs.manager.finish_store", lambda *_: None)
    monkeypatch.setattr("gear_rattle.service.jobs.manager.tiles_done", lambda *_: set())
    monkeypatch.setattr("gear_rattle.service.jobs.manager.run_tiles", lambda _, path, *__: computed.append(path.stem))
    with front_end(tmp_path, database_url=database_url) as client:
        ids = [client.post("/v1/surveys?force=true", json=BODY).json()["id"] for _ in range(2)]
        damage(front_of(client).database, ids[0], damages(database_url)[0])
    with local_client(create_app(Settings(data=tmp_path, database_url=database_url), idle_cluster)) as client:
        wait_until(lambda: computed)
        assert computed == [ids[1]]
        kept = front_of(client).database.job(ids[0])
        assert (kept.state, "cannot be read" in kept.message) == (State.FAILED, True)
        assert client.get("/v1/health").json()["cluster"] == "ready"
        assert client.get("/v1/surveys").json()["count"] == 2
