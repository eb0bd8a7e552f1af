"""The start of a service: it ends or removes unfinished work of its own, and leaves and names all else."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zarr
from fastapi.testclient import TestClient
from service_support import BODY, front_end, idle_cluster, local_client
from waiting import wait_until

from gear_rattle.service.app import create_app
from gear_rattle.service.database import Database, DoneTile, NewJob
from gear_rattle.service.database.tables import State
from gear_rattle.service.jobs.directory import DataDirectory
from gear_rattle.service.settings import Settings
from gear_rattle.workers import SurveyRequest, create_store

HEX = "0123456789abcdef" * 2


@pytest.fixture
def stores(tmp_path: Path) -> Path:
    (tmp_path / "data" / "surveys").mkdir(parents=True)
    return tmp_path / "data" / "surveys"


@pytest.fixture
def database(stores: Path) -> Iterator[Database]:
    """Return the database of an earlier service; close it before the next one starts."""
    database = Database(f"sqlite:///{stores.parent / 'jobs.sqlite'}")
    yield database
    database.close()


def accept(database: Database, request: dict[str, Any] = BODY, state: State = State.RUNNING) -> str:
    survey_id = database.add_or_find_job(NewJob("", request, "c", "b", 24, 4), 100).id
    database.set_state(survey_id, state)
    return survey_id


def fill(path: Path) -> Path:
    (path / "region" / "c").mkdir(parents=True)
    (path / "region" / "c" / "0").write_text("chunk")
    (path / "region" / "c" / "0.abc.partial").write_text("chu")
    return path


def files(path: Path) -> list[str]:
    return sorted(str(found.relative_to(path)) for found in path.rglob("*") if found.is_file())


def test_only_what_the_database_owns_is_swept(
    stores: Path, database: Database, caplog: pytest.LogCaptureFixture
) -> None:
    running, ended = accept(database), accept(database, state=State.SUCCESSFUL)
    deleted, unknown = accept(database, state=State.FAILED), "f" * 16
    for name in (
        *(f"{running}.zarr", f".{running}.zarr.{HEX}", f"{ended}.zarr", f".trash-{deleted}"),
        *(f"{unknown}.zarr", f".{unknown}.zarr.{HEX}", f".trash-{unknown}"),
        *("mine", f"{running}.zarr.backup", f".{running}.zarr.old"),
        *(f"{running}.certificates.zarr", f"{unknown}.certificates.zarr"),
    ):
        fill(stores / name)
    zarr.create_group(stores / f"{running}.zarr", attributes={"content_hash": "c"})
    database.close()
    before = {path.name: files(path) for path in stores.iterdir()}
    with front_end(stores.parent) as client:
        assert {item["id"] for item in client.get("/v1/surveys").json()["surveys"]} == {running, ended}
    after = {path.name: files(path) for path in stores.iterdir()}
    gone = {f".{running}.zarr.{HEX}", f".trash-{deleted}"}
    assert after == {name: found for name, found in before.items() if name not in gone} | {
        f"{running}.zarr": ["region/c/0", "zarr.json"]
    }
    named = "\n".join(record.getMessage() for record in caplog.records if "left alone" in record.getMessage())
    for name in before.keys() - gone - {f"{running}.zarr", f"{ended}.zarr", f"{running}.certificates.zarr"}:
        assert f"/{name} belongs to no survey" in named, name
    for name in (f"{ended}.zarr", f"{running}.certificates.zarr"):
        assert f"/{name} belongs" not in named


def test_a_deletion_that_was_begun_is_ended(stores: Path, database: Database) -> None:
    """Killed with the store half gone, or gone: such a survey would answer identical requests with nothing."""
    begun, before = accept(database, state=State.SUCCESSFUL), accept(database, state=State.SUCCESSFUL)
    database.begin_deletion(begun)
    for survey_id in (begun, before):
        fill(stores / f"{survey_id}.zarr")
    fill(stores / f"{begun}.certificates.zarr")
    database.close()
    with front_end(stores.parent) as client:
        assert [item["id"] for item in client.get("/v1/surveys").json()["surveys"]] == [before]
    assert [path.name for path in stores.iterdir()] == [f"{before}.zarr"]


def test_a_deletion_is_noted_before_it_begins(stores: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def crash(*_: object) -> None:
        raise SystemError

    with front_end(stores.parent) as client:
        job = client.post("/v1/surveys", json=BODY).json()
        assert client.delete(job["links"]["self"]).json()["state"] == "dismissed"
        monkeypatch.setattr(DataDirectory, "remove_store", crash)
        assert client.delete(job["links"]["self"]).status_code == 500
        assert client.get(job["links"]["self"]).json()["message"] == "being deleted"
        monkeypatch.undo()
        assert client.delete(job["links"]["self"]).status_code == 204
        assert client.get("/v1/surveys").json()["count"] == 0


def end_of(client: TestClient, survey_id: str) -> dict[str, Any]:
    def ended() -> dict[str, Any] | None:
        document: dict[str, Any] = client.get(f"/v1/surveys/{survey_id}").json()
        return document if State(document["state"]).is_final else None

    found: dict[str, Any] = wait_until(ended)
    return found


def test_a_survey_that_cannot_go_on_is_ended_and_says_why(stores: Path, database: Database) -> None:
    invalid = accept(database, BODY | {"delta": {"start": 1.0, "stop": 0.4, "num": 5}})
    foreign, older, other = (accept(database) for _ in range(3))
    fill(stores / f"{foreign}.zarr")
    database.add_tile(older, DoneTile(0, 6, 0.1, 0, []))
    zarr.create_group(stores / f"{older}.zarr", attributes={"content_hash": "x", "code_version": "0.0+old"})
    create_store(SurveyRequest(**BODY | {"seed": 1}), stores / f"{other}.zarr")
    database.close()
    before = {path.name: files(path) for path in stores.iterdir()}
    with local_client(create_app(Settings(data=stores.parent), idle_cluster)) as client:
        messages = {survey_id: end_of(client, survey_id) for survey_id in (invalid, foreign, older, other)}
    assert {document["state"] for document in messages.values()} == {"failed"}
    assert "no longer valid in this version (delta: " in messages[invalid]["message"]
    assert "\n" not in messages[invalid]["message"]
    assert "not a survey" in messages[foreign]["message"]
    assert "0.0+old" in messages[older]["message"]
    assert messages[older]["tiles_done"] == 1
    assert "another survey" in messages[other]["message"]
    assert {path.name: files(path) for path in stores.iterdir()} == before
