"""The thread that runs surveys: when it waits, what it says meanwhile, and that it ends."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from service_support import BODY, assert_problem, front_of, idle_cluster, local_client
from waiting import HANG, wait_until

from gear_rattle.service.app import create_app
from gear_rattle.service.database.tables import State
from gear_rattle.service.jobs import manager
from gear_rattle.service.settings import Settings
from gear_rattle.workers import StorageError, TileRecord


@contextmanager
def service(data: Path) -> Iterator[TestClient]:
    with local_client(create_app(Settings(data=data), idle_cluster)) as client:
        yield client


def full_disk(*_: Any) -> None:
    raise StorageError("the disk is full")


def test_a_storage_that_nobody_waits_for_is_not_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(manager, "create_store", full_disk)
    with service(tmp_path) as client:
        survey_id = client.post("/v1/surveys", json=BODY).json()["id"]
        wait_until(lambda: "full" in client.get("/v1/health").json()["storage"])
        assert client.delete(f"/v1/surveys/{survey_id}").json()["state"] == "dismissed"
        wait_until(lambda: client.get("/v1/health").json()["status"] == "ok")


def test_a_survey_that_goes_on_after_a_restart_no_longer_says_that_it_waits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(manager, "create_store", full_disk)
    with service(tmp_path) as client:
        path = client.post("/v1/surveys", json=BODY).headers["location"]
        wait_until(lambda: "waits for its store" in client.get(path).json()["message"])
    seen = []

    def run_one_tile(*arguments: Any) -> None:
        arguments[4](TileRecord(0, 6, (), 0, 0.5))
        seen.append(client.get(path).json())
        raise RuntimeError("enough")

    monkeypatch.setattr(manager, "create_store", lambda *_: None)
    monkeypatch.setattr(manager, "tiles_done", lambda *_: set())
    monkeypatch.setattr(manager, "run_tiles", run_one_tile)
    with service(tmp_path) as client:
        wait_until(lambda: bool(seen))
    assert (seen[0]["state"], seen[0]["message"]) == (State.RUNNING, "")


def test_a_deletion_waits_for_the_last_tiles_of_a_survey_that_has_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Or one that follows the end at once would be refused by chance."""
    tiles_end = threading.Event()
    monkeypatch.setattr(manager, "create_store", lambda *_: None)
    monkeypatch.setattr(manager, "tiles_done", lambda *_: set())
    monkeypatch.setattr(manager, "run_tiles", lambda *_: tiles_end.wait(HANG))
    monkeypatch.setattr(manager, "LAST_TILES_SECONDS", 0.1)
    with service(tmp_path) as client:
        path = client.post("/v1/surveys", json=BODY).headers["location"]
        wait_until(lambda: client.get(path).json()["state"] == "running")
        assert client.delete(path).json()["state"] == "dismissed"
        assert_problem(client.delete(path), 409, code="conflict")
        ended = front_of(client).manager._lock
        wait_for = ended.wait_for

        def end_while_waited_for(is_over: Callable[[], bool], seconds: float) -> bool:
            assert not is_over()
            tiles_end.set()
            return wait_for(is_over, seconds)

        monkeypatch.setattr(manager, "LAST_TILES_SECONDS", HANG)
        monkeypatch.setattr(ended, "wait_for", end_while_waited_for)
        assert client.delete(path).status_code == 204
        assert_problem(client.get(path), 404)


def test_a_stop_is_never_overlooked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The stop may come as the thread turns to the next survey."""
    with service(tmp_path) as client:
        manager = front_of(client).manager
        wait_until(lambda: manager.cluster_state == "ready")
        clear, wait = manager._wake.clear, manager._wake.wait
        overlooked = threading.Event()

        def stop_and_clear() -> None:
            manager.ask_to_stop()
            clear()

        def wait_although_stopped(*_: Any) -> None:
            if manager._stopping.is_set():
                overlooked.set()
            else:
                wait()

        monkeypatch.setattr(manager._wake, "clear", stop_and_clear)
        monkeypatch.setattr(manager._wake, "wait", wait_although_stopped)
        manager.wake()
        wait_until(lambda: not manager._thread.is_alive() or overlooked.is_set())
    assert not overlooked.is_set()


def test_a_survey_with_families_is_joined_after_its_tiles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done = []

    def note(name: str) -> Callable[..., None]:
        return lambda *_: done.append(name)

    monkeypatch.setattr(manager, "create_store", lambda *_: None)
    monkeypatch.setattr(manager, "tiles_done", lambda *_: set())
    monkeypatch.setattr(manager, "is_incomplete", lambda request, _: "families" in request.quantities)
    for name in ("run_tiles", "complete_on_cluster", "finish_store"):
        monkeypatch.setattr(manager, name, note(name))
    with service(tmp_path) as client:
        asked = BODY | {"quantities": ["attractors", "lyapunov", "families"]}
        for body in (asked, BODY):
            path = client.post("/v1/surveys", json=body).headers["location"]
            wait_until(lambda path=path: client.get(path).json()["state"] == "successful")
    assert done == ["run_tiles", "complete_on_cluster", "finish_store", "run_tiles", "finish_store"]
