"""A survey that is submitted with `certify`: its certificates over HTTP, how far they are, and that they go with it."""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from queue import Queue
from typing import Any

import pytest
import xarray as xr
from fastapi.testclient import TestClient
from service_support import BODY, assert_problem, compute, front_end, front_of, idle_cluster, local_client
from waiting import HANG, wait_until

from gear_rattle.service.app import create_app
from gear_rattle.service.database.tables import State
from gear_rattle.service.jobs import manager
from gear_rattle.service.settings import Settings
from gear_rattle.workers import SurveyRequest, complete, finish_store
from rattle.proof.check import check

pytestmark = pytest.mark.usefixtures("templates_once")

ASKED = BODY | {"quantities": ["attractors"], "certify": True}


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("data")) as client:
        yield client


def completed(client: TestClient) -> str:
    """The path of a survey that is computed and proved."""
    answer = client.post("/v1/surveys", json=ASKED)
    assert answer.status_code == 202, answer.text
    survey_id, request, front = answer.json()["id"], SurveyRequest(**ASKED), front_of(client)
    compute(front, survey_id, request)
    complete(request, front.directory.store(survey_id))
    finish_store(front.directory.store(survey_id))
    front.database.set_state(survey_id, State.SUCCESSFUL)
    return str(answer.headers["location"])


def test_certificates_are_read_checked_and_deleted_with_the_survey(client: TestClient) -> None:
    here = completed(client)
    link = client.get(here).json()["links"]["certificates"]
    shown = client.get(link).json()
    lines = client.get(shown["links"]["certificates"]).text.splitlines()
    assert shown["state"] == "successful"
    assert (shown["proved"], shown["refused"]) == (len(lines), 0)
    assert len(lines) > 5
    check(lines[0])
    assert client.get(shown["links"]["refused"]).text == ""
    assert client.get(f"{shown['links']['store']}/zarr.json").json()["attributes"]["documents"] == "certificates.jsonl"
    store = front_of(client).directory.store(here.rpartition("/")[2])
    beside = store.with_name(f"{store.stem}.certificates.zarr")
    with xr.open_zarr(beside) as proved:
        assert int(proved.attractor_certificate.sum()) == len(lines)
    chunk = next(path for path in beside.glob("attractor_certificate/c/**/*") if path.is_file())
    answer = client.get(f"{shown['links']['store']}/{chunk.relative_to(beside)}")
    assert answer.content == chunk.read_bytes()
    assert "max-age=3600" in answer.headers["cache-control"]
    for key in ("nothing", "../lock", ".zgroup"):
        assert_problem(client.get(f"{shown['links']['store']}/{key}"), 404)
    assert client.delete(here).status_code == 204
    assert not beside.exists()
    assert_problem(client.get(link), 404)


def test_a_survey_without_them_has_no_link(client: TestClient) -> None:
    here = client.post("/v1/surveys", json=BODY).headers["location"]
    assert client.get(here).json()["links"]["certificates"] is None
    assert_problem(client.get(f"{here}/certificates"), 404, code="not_in_survey")
    assert client.post("/v1/surveys", json=BODY | {"certify": True}).json()["links"]["self"] != here


def test_what_cannot_be_proved_here_is_refused(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    third = ASKED | {"beta": {"start": 0.5, "stop": 0.6, "num": 2}}
    assert_problem(client.post("/v1/surveys", json=third), 422, "without a third axis")
    monkeypatch.delitem(sys.modules, "rattle.proof.balls", raising=False)
    monkeypatch.setitem(sys.modules, "flint", None)
    assert_problem(client.post("/v1/surveys", json=ASKED | {"seed": 9}), 422, "body.certify", "gear-rattle[proof]")


def test_its_document_says_how_far_the_proofs_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[dict[str, Any]] = []
    accepted: Queue[str] = Queue()
    for name in ("create_store", "run_tiles", "finish_store"):
        monkeypatch.setattr(manager, name, lambda *_: None)
    monkeypatch.setattr(manager, "tiles_done", lambda *_: set())
    monkeypatch.setattr(manager, "is_incomplete", lambda *_: True)
    with local_client(create_app(Settings(data=tmp_path, preload=False), idle_cluster)) as client:

        def prove(_: Any, __: Any, ___: Any, ____: Any, on_proved: Callable[[int, int], None], _____: Any) -> None:
            here = accepted.get(timeout=HANG)  # proofs may begin before the answer to who submitted is read
            for done in (0, 1, 500, 1000):
                on_proved(done, 1000)
                shown.append(client.get(here).json())

        monkeypatch.setattr(manager, "complete_on_cluster", prove)
        path = client.post("/v1/surveys", json=ASKED).headers["location"]
        accepted.put(path)
        wait_until(lambda: client.get(path).json()["state"] == "successful")
        assert client.get(path).json()["message"] == ""
    said = [each["message"] for each in shown]
    assert said[1] == said[0] == "proves its periodic attractors: 0 of 1000 have been tried"
    assert said[2] == "proves its periodic attractors: 500 of 1000 have been tried"
    assert {each["state"] for each in shown} == {"running"}
