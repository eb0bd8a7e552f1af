"""Populations of the service: jobs as surveys are, apart from them, and what they answer."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from service_support import BODY, IN_A_THREAD, assert_problem, front_end, front_of, key
from typer.testing import CliRunner
from written import write_tile

from gear_rattle.service.cli import app
from gear_rattle.service.client import Client, Job
from gear_rattle.service.database import DoneTile
from gear_rattle.service.database.tables import State
from gear_rattle.service.errors import ResponseError, ServiceError
from gear_rattle.workers import (
    PopulationRequest,
    SurveyError,
    SurveyRequest,
    create_store,
    finish_store,
    open_survey,
    tiles_of,
)
from gear_rattle.workers.answers import read_finished_population, read_population_in_dataset
from gear_rattle.workers.kinds import compute_tile

pytestmark = pytest.mark.usefixtures("templates_once")

POPULATION: dict[str, Any] = {
    "name": "small",
    "gear": {
        "delta": 0.6,
        "epsilon": {"distribution": "uniform", "low": 0.03, "high": 0.21},
        "beta": {"distribution": "uniform", "low": 0.5, "high": 0.7},
    },
    "gears": 40,
    "count": 4,
    "share": 0.6,
    "judged": 4,
    "pairs": 40,
    "tile": 80,
}

#: Some of its gears would gain energy at an impact.
LOSES = {"distribution": "normal", "mean": 0.9, "deviation": 0.05, "low": 0.1}


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("data"), points=IN_A_THREAD, max_count=64) as client:
        yield client


def finished(client: TestClient, **changes: Any) -> str:
    """A population that was computed here."""
    body = POPULATION | changes
    found = client.post("/v1/populations?force=true", json=body).json()
    front, request = front_of(client), PopulationRequest.model_validate(body)
    store = front.directory.store(found["id"])
    create_store(request, store)
    for tile in tiles_of(request):
        arrays, record = compute_tile(request, tile)
        write_tile(request, str(store), tile, arrays)
        front.database.add_tile(found["id"], DoneTile(tile.index, tile.n_cells, record.seconds, 0, []))
    finish_store(store)
    front.database.set_state(found["id"], State.SUCCESSFUL)
    return str(found["id"])


def test_a_population_is_accepted_and_listed_apart_from_surveys(client: TestClient) -> None:
    survey = client.post("/v1/surveys?force=true", json=BODY).json()
    answer = client.post("/v1/populations?force=true", json=POPULATION)
    assert answer.status_code == 202
    found = answer.json()
    here = f"/v1/populations/{found['id']}"
    assert answer.headers["location"] == found["links"]["self"] == here
    assert (found["state"], found["cells"], found["tiles"]) == ("accepted", 40 + 5 * 40, 3)
    assert client.get(here).json()["request"]["gear"]["epsilon"]["high"] == 0.21
    listed = client.get("/v1/populations").json()
    assert found["id"] in [each["id"] for each in listed["populations"]]
    surveys = client.get("/v1/surveys").json()
    assert survey["id"] in [each["id"] for each in surveys["surveys"]]
    assert found["id"] not in [each["id"] for each in surveys["surveys"]]
    assert (surveys["count"], listed["count"]) == (len(surveys["surveys"]), len(listed["populations"]))
    for path in ("", "/events", "/store/zarr.json", "/map.png", "/download.csv", "/download.nc"):
        assert_problem(client.get(f"/v1/surveys/{found['id']}{path}"), 404, code="unknown_survey")
    for path in ("", "/events", "/store/zarr.json", "/answers"):
        assert_problem(client.get(f"/v1/populations/{survey['id']}{path}"), 404)


def test_the_same_population_is_computed_once(client: TestClient) -> None:
    first = client.post("/v1/populations", json=POPULATION | {"seed": 5})
    again = client.post("/v1/populations", json=POPULATION | {"seed": 5, "name": "another"})
    forced = client.post("/v1/populations?force=true", json=POPULATION | {"seed": 5})
    assert first.json()["id"] == again.json()["id"] != forced.json()["id"]
    keyed = {"Idempotency-Key": "once"}
    client.post("/v1/populations", json=POPULATION | {"seed": 6}, headers=keyed)
    assert_problem(client.post("/v1/populations", json=POPULATION | {"seed": 7}, headers=keyed), 409, code="conflict")


def test_the_answers_are_those_of_the_store(client: TestClient) -> None:
    survey_id = finished(client)
    answer = client.get(f"/v1/populations/{survey_id}/answers")
    assert answer.status_code == 200
    found = answer.json()
    exact = read_finished_population(front_of(client).directory.store(survey_id))
    assert found["quiet"] == dict(exact.quiet._asdict())
    assert exact.passing is not None
    assert found["passing"] == dict(exact.passing._asdict())
    assert found["quiet_indices"]["epsilon"]["first"]["value"] == exact.indices()["epsilon"].first.value
    assert found["intensity"]["0.5"]["value"] == exact.intensity((0.5,))[0.5].value
    assert found["worst"][0]["row"] == exact.worst(1)[0].row
    again = client.get(f"/v1/populations/{survey_id}/answers", headers={"If-None-Match": answer.headers["etag"]})
    assert again.status_code == 304


def test_a_population_is_followed_read_and_deleted_as_a_survey(client: TestClient) -> None:
    survey_id = finished(client, seed=2)
    here = f"/v1/populations/{survey_id}"
    events = client.get(f"{here}/events").text
    assert events.count("event: tile") == 3
    assert client.get(f"{here}/store/zarr.json").json()["attributes"]["kind"] == "population"
    assert client.get(f"{here}/store/energy/c/0/0").status_code == 200
    assert_problem(client.delete(f"/v1/surveys/{survey_id}"), 404)
    assert client.delete(here).status_code == 204
    assert_problem(client.get(here), 404)
    assert not front_of(client).directory.store(survey_id).exists()


def test_a_chunk_that_was_computed_and_is_lost_is_no_fill_value(client: TestClient) -> None:
    survey_id = finished(client, seed=3)
    chunk = front_of(client).directory.store(survey_id) / "energy" / "c" / "1" / "0"  # type: ignore[operator]
    chunk.unlink()
    here = f"/v1/populations/{survey_id}"
    assert_problem(client.get(f"{here}/store/energy/c/1/0"), 503, f"POST {here}/verify")
    assert client.get(f"{here}/store/energy/c/9/0").status_code == 404
    assert client.post(f"{here}/verify").json()["state"] == "accepted"


def test_what_is_not_finished_has_no_answers(client: TestClient) -> None:
    survey_id = client.post("/v1/populations", json=POPULATION | {"seed": 4}).json()["id"]
    assert_problem(client.get(f"/v1/populations/{survey_id}/answers"), 404, "is accepted")
    dismissed = client.delete(f"/v1/populations/{survey_id}").json()
    assert dismissed["state"] == "dismissed"


def test_what_a_population_costs_is_measured(client: TestClient) -> None:
    found = client.post("/v1/estimate", json=POPULATION | {"gears": 4000}).json()
    assert found["seconds"] > 0
    assert "9 gears" in found["basis"]


@pytest.mark.parametrize(
    ("changes", "field", "words"),
    [
        ({"gear": POPULATION["gear"] | {"epsilon": 0.1, "beta": 0.6}}, "body", "nothing varies"),
        ({"gear": POPULATION["gear"] | {"radius": 0.05}}, "body", "both define the gear"),
        ({"gear": POPULATION["gear"] | {"beta": {"distribution": "normal", "mean": 0.6}}}, "body.gear.beta", ""),
        ({"gear": POPULATION["gear"] | {"restitution": LOSES}}, "body", "such as a normal one with high = 1"),
        ({"correlation": [[1.0, 0.5], [0.4, 1.0]]}, "body", "must be symmetric"),
        ({"count": 100}, "body.count", "limit of this service, 64."),
        ({"gears": 2_000_000}, "body.gears", "limit of this service, 1,000,000."),
        ({"tiles": 3}, "body.tiles", ""),
    ],
)
def test_what_cannot_be_computed_is_refused(
    client: TestClient, changes: dict[str, Any], field: str, words: str
) -> None:
    problem = assert_problem(client.post("/v1/populations", json=POPULATION | changes), 422, words)
    assert field in problem["errors"][0]["field"] if problem["errors"] else not field


def test_only_who_submitted_a_population_removes_it(tmp_path: Path) -> None:
    with front_end(tmp_path, require_keys=True) as client:
        mine, other = key(client), key(client)
        found = client.post("/v1/populations", json=POPULATION, headers=mine).json()
        here = f"/v1/populations/{found['id']}"
        assert_problem(client.get(here), 401)
        assert_problem(client.delete(here, headers=other), 403)
        assert client.delete(here, headers=mine).json()["state"] == "dismissed"


def test_the_client_submits_waits_and_asks(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Client, "close", lambda _: None)  # the tests below go on with it
    survey_id = finished(client, seed=8)
    with Client(http=client) as python:
        job = python.submit_population(POPULATION | {"seed": 8})
        assert job.id == survey_id
        assert job.wait().answers()["gears"] == 40
        assert python.population(survey_id).state == "successful"
        request = PopulationRequest.model_validate(POPULATION | {"seed": 9})
        waits = python.submit_population(request, force=True)
        with pytest.raises(ResponseError, match="is accepted"):
            waits.answers()
        waits.delete()
        with pytest.raises(ServiceError, match=r"Population .* is dismissed"):
            waits.wait()
        by_fields = python.submit_population(**POPULATION | {"seed": 8})
        assert by_fields.id == survey_id
        listed = list(python.populations())
        assert survey_id in [each.id for each in listed]
        assert {each.kind for each in listed} == {"population"}
        assert repr(job) == f"<population {survey_id}: successful, 100 %>"


def test_commands_submit_list_and_follow_a_population(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = [text for name, value in {"delta": "0.6", "epsilon": "uniform:0.03:0.21", "beta": "uniform:0.5:0.7"}.items()
             for text in (f"--{name}", value)]  # fmt: skip
    asked += ["--name", "small", "--gears", "40", "--count", "4", "--share", "0.6", "--judged", "4", "--pairs", "40"]
    asked += ["--tile", "80", "--seed", "10"]
    survey_id = finished(client, seed=10)
    store = front_of(client).directory.store(survey_id)
    monkeypatch.setattr(Client, "close", lambda _: None)
    monkeypatch.setattr("gear_rattle.service.client.Client", lambda _url: Client(http=client))
    monkeypatch.setattr(Job, "open", lambda _: open_survey(store))

    def said(*arguments: str, code: int = 0) -> str:
        result = CliRunner().invoke(app, arguments)
        assert result.exit_code == code, result.output
        return " ".join(result.output.split())

    words = said("tolerance", "--submit", "--watch", *asked)
    exact = read_finished_population(store)
    assert words.startswith(survey_id)
    assert f"runs quietly with a probability of {exact.quiet.value:.4g} [{exact.quiet.low:.4g}" in words
    followed = said("watch", survey_id)
    assert followed in words
    assert survey_id in said("list", "--populations")
    assert survey_id not in said("list")
    assert "--out PATH" in said("tolerance", *asked, code=2).replace("│ ", "")
    assert "no survey and no population" in said("watch", "0" * 16, code=2).replace("│ ", "")


def test_a_population_is_answered_from_an_opened_store(client: TestClient) -> None:
    store = front_of(client).directory.store(finished(client, seed=11))
    found, exact = read_population_in_dataset(open_survey(store), "it"), read_finished_population(store)
    assert (found.quiet, found.passing, found.worst(3)) == (exact.quiet, exact.passing, exact.worst(3))
    with pytest.raises(SurveyError, match="it holds no population"):
        read_population_in_dataset(
            open_survey(store).assign_attrs(request=SurveyRequest(**BODY).model_dump_json()), "it"
        )
    lacking = open_survey(store).load()
    lacking["status"][3] = 0
    with pytest.raises(SurveyError, match="it lacks 1 gears"):
        read_population_in_dataset(lacking, "it")
