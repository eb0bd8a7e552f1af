"""The data directory is known by its identity: in what stands in its place nothing is written, and nothing is lost."""

import shutil
import sqlite3
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from service_support import BODY, assert_problem, front_end, front_of, idle_cluster, local_client
from waiting import wait_until

from gear_rattle.service.app import create_app
from gear_rattle.service.errors import DataDirectoryError
from gear_rattle.service.jobs import manager
from gear_rattle.service.jobs.opening import open_service_data
from gear_rattle.service.settings import Settings

SMALLER = BODY | {"seed": 3}


@pytest.fixture(params=["inside", "elsewhere"])
def data(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A data directory, with the job database in it or not."""
    if request.param == "elsewhere":
        monkeypatch.setenv("RATTLE_DATABASE_URL", f"sqlite:///{tmp_path}/elsewhere.sqlite")
    return tmp_path / "data"


def take_away(data: Path) -> Path:
    """Replace the directory by an empty one, as an unmounted disk leaves it."""
    away = data.with_name("away")
    data.rename(away)
    data.mkdir()
    return away


def bring_back(away: Path, data: Path) -> None:
    data.rmdir()  # nothing was written there
    away.rename(data)


def health(client: TestClient) -> dict[str, object]:
    answer = client.get("/v1/health")
    assert answer.status_code == 200
    found: dict[str, object] = answer.json()
    return found


def test_while_it_is_away_nothing_is_accepted_and_nothing_written(data: Path) -> None:
    with local_client(create_app(Settings(data=data), idle_cluster)) as client:
        wait_until(lambda: health(client)["status"] == "ok")
        front_of(client).manager._run_next_survey = lambda _: False  # type: ignore[method-assign]  # it stays accepted
        path = client.post("/v1/surveys", json=BODY).headers["location"]
        away = take_away(data)
        for body in (BODY, SMALLER):
            refused = client.post("/v1/surveys", json=body)
            assert_problem(refused, 503, code="data_directory_away")
            assert int(refused.headers["retry-after"]) > 0
        front_of(client).database._reader.dispose()  # who opens it now would make another
        assert client.get("/v1/surveys").status_code == (503 if (away / "jobs.sqlite").exists() else 200)
        assert health(client)["status"] == "degraded"
        assert "data directory" in str(health(client)["storage"])
        assert_problem(client.get("/v1/ready"), 503)
        for link in ("store/zarr.json", "map.png", "download.nc", "download.csv"):  # 404: a chunk of fill values
            assert_problem(client.get(f"{path}/{link}"), 503, code="data_directory_away")
        bring_back(away, data)
        assert health(client)["status"] == "ok"
        assert client.get(path).json()["state"] == "accepted"
        assert client.post("/v1/surveys", json=SMALLER).status_code == 202
        assert client.get("/v1/surveys").json()["count"] == 2


def test_an_ended_survey_is_not_deleted_where_it_is_not(data: Path) -> None:
    with front_end(data) as client:
        path = client.post("/v1/surveys", json=BODY).headers["location"]
        client.delete(path)
        away = take_away(data)
        assert_problem(client.delete(path), 503, code="data_directory_away")
        bring_back(away, data)
        assert client.get(path).json()["message"] == "dismissed by request"
        assert client.delete(path).status_code == 204


def test_a_survey_waits_for_its_directory(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever fails meanwhile fails for that reason; it goes on when the directory is back."""
    tried = 0

    def store_is_gone(*_: object) -> None:
        nonlocal tried, away
        tried += 1
        away = take_away(data)
        raise RuntimeError("the store is gone")

    away = data
    monkeypatch.setattr(manager, "create_store", lambda *_: None)
    monkeypatch.setattr(manager, "tiles_done", lambda *_: set())
    monkeypatch.setattr(manager, "run_tiles", store_is_gone)
    monkeypatch.setattr(manager, "finish_store", lambda *_: None)
    with local_client(create_app(Settings(data=data), idle_cluster)) as client:
        path = client.post("/v1/surveys", json=BODY).headers["location"]
        wait_until(lambda: "data directory" in front_of(client).manager.storage_state)
        assert tried == 1
        monkeypatch.setattr(manager, "run_tiles", lambda *_: None)
        bring_back(away, data)
        wait_until(lambda: client.get(path).json()["state"] == "successful")
        wait_until(lambda: health(client)["status"] == "ok")  # which is said just afterwards


def test_what_comes_back_as_another_device_is_opened_anew(tmp_path: Path) -> None:
    """The file that is open is not the one that is there: what it is told would be lost."""
    data = tmp_path / "data"
    with front_end(data) as client:
        first = client.post("/v1/surveys", json=BODY).json()["id"]
        away = take_away(data)
        data.rmdir()
        shutil.copytree(away, data)
        second = client.post("/v1/surveys", json=SMALLER).json()["id"]
    with sqlite3.connect(data / "jobs.sqlite") as database:
        assert [found for (found,) in database.execute("SELECT id FROM jobs ORDER BY number")] == [first, second]


def identity_of(data: Path) -> str:
    return (data / "identity").read_text()


@pytest.mark.parametrize("older", ["nothing", "database", "stores"])
def test_a_directory_without_identity_gets_one_and_keeps_it(tmp_path: Path, older: str) -> None:
    data = tmp_path / "data"
    if older != "nothing":
        with front_end(data) as client:
            client.post("/v1/surveys", json=BODY)
        (data / "identity").unlink()
    if older == "stores":
        (data / "jobs.sqlite").unlink()
        (data / "surveys" / f"{'0' * 16}.zarr").mkdir()
    with front_end(data) as client:
        found = identity_of(data)
        assert client.get("/v1/surveys").json()["count"] == (older == "database")
    assert len(found.strip()) == 32
    with front_end(data):
        assert identity_of(data) == found


def test_a_database_elsewhere_knows_the_directory(tmp_path: Path, database_url: str) -> None:
    """A service that starts before its disk is mounted would compute everything again, in the hole."""
    data, hole, other = (tmp_path / name for name in ("data", "hole", "other"))
    with open_service_data(Settings(data=data, database_url=database_url)):
        known = identity_of(data)
    with open_service_data(Settings(data=other)):  # another service's
        pass
    for wrong in (hole, other):
        with (
            pytest.raises(DataDirectoryError, match="not the data directory that the job database has recorded"),
            open_service_data(Settings(data=wrong, database_url=database_url)),
        ):
            pass
    assert not (hole / "identity").exists()
    (data / "identity").unlink()  # copied without it
    (data / "surveys" / f"{'0' * 16}.zarr").mkdir()
    with open_service_data(Settings(data=data, database_url=database_url)):
        assert identity_of(data) == known
    (hole / "identity").write_text(known)  # as the message says
    with open_service_data(Settings(data=hole, database_url=database_url)):
        assert identity_of(hole) == known
