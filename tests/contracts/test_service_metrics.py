"""Metrics and logs, parsed by those who read them."""

import json
import logging
import logging.config
from collections.abc import Callable, Iterator
from io import StringIO
from itertools import count
from pathlib import Path
from types import SimpleNamespace

import pytest
from fastapi.testclient import TestClient
from prometheus_client.parser import text_string_to_metric_families
from service_support import BODY, front_end, front_of

from service.logs import about, log_config
from service.tables import State
from workers import SurveyRequest, compute_tile, tiles_of

REQUEST = SurveyRequest(**BODY)
Labels = tuple[tuple[str, str], ...]


@pytest.fixture
def client(tmp_path: Path) -> Iterator[TestClient]:
    with front_end(tmp_path) as client:
        yield client


def scrape(client: TestClient) -> dict[str, dict[Labels, float]]:
    response = client.get("/v1/metrics")
    assert response.headers["content-type"].startswith("text/plain; version=")
    found: dict[str, dict[Labels, float]] = {}
    for family in text_string_to_metric_families(response.text):
        for sample in family.samples:
            found.setdefault(sample.name, {})[tuple(sorted(sample.labels.items()))] = sample.value
    return found


def test_surveys_and_tiles(client: TestClient) -> None:
    before = scrape(client)
    assert set(before["rattle_surveys"]) == {(("state", state),) for state in State}
    assert set(before["rattle_surveys"].values()) == {0}
    survey_id = client.post("/v1/surveys", json=BODY).json()["id"]
    client.post("/v1/surveys", json=BODY | {"seed": 1})
    front, tile = front_of(client), tiles_of(REQUEST)[1]
    front.database.set_state(survey_id, State.RUNNING)
    record = compute_tile(REQUEST, tile)[1]
    front.manager._record(survey_id, record)
    after = scrape(client)
    assert after["rattle_surveys"][(("state", "running"),)] == 1
    assert after["rattle_queue_length"][()] == after["rattle_surveys"][(("state", "accepted"),)] == 1
    assert after["rattle_survey_tiles"] == {(("state", "done"),): 1, (("state", "waiting"),): 2 * REQUEST.n_tiles - 1}
    assert after["rattle_tiles_total"][()] == 1
    assert after["rattle_cells_total"][()] == tile.n_cells
    assert after["rattle_impacts_total"][()] == record.impacts > 0
    assert after["rattle_workers"][()] == 0


def test_impacts_do_not_depend_on_tiles() -> None:
    whole = REQUEST.model_copy(update={"tile": REQUEST.tile.model_copy(update={"delta": 6, "epsilon": 4})})
    in_one, in_many = (
        sum(compute_tile(request, tile)[1].impacts for tile in tiles_of(request)) for request in (whole, REQUEST)
    )
    assert in_one == in_many > 0


def test_latency_has_a_bounded_number_of_series(client: TestClient) -> None:
    for number in range(20):
        client.get(f"/v1/surveys/{number:016x}")
        client.get(f"/nowhere/{number}")
        client.request(f"BREW{number}", "/v1/surveys")
    client.head(f"/v1/surveys/{0:016x}/store/zarr.json")
    counts = scrape(client)["rattle_http_request_seconds_count"]
    survey = tuple(sorted({"method": "GET", "route": "/v1/surveys/{survey_id}", "status": "404"}.items()))
    assert counts[survey] == 20
    assert {route for labels in counts for name, route in labels if name == "route"} == {
        "/v1/surveys/{survey_id}",
        "/v1/surveys/{survey_id}/store/{key:path}",
        "none",
    } | ({"/v1/surveys"} if any(("route", "/v1/surveys") in labels for labels in counts) else set())
    assert {method for labels in counts for name, method in labels if name == "method"} == {"GET", "HEAD", "other"}


def test_applications_count_apart(client: TestClient, tmp_path: Path) -> None:
    client.get("/v1/health")
    with front_end(tmp_path / "other") as other:
        assert "rattle_http_request_seconds_count" not in scrape(other)


def test_keys_are_asked_for_figures(tmp_path: Path) -> None:
    with front_end(tmp_path, require_keys=True) as client:
        assert client.get("/v1/metrics").status_code == 401
        assert client.get("/v1/health").status_code == 200


@pytest.fixture
def lines(request: pytest.FixtureRequest) -> Iterator[Callable[[], list[str]]]:
    root, written = logging.getLogger(), StringIO()
    handlers, level = root.handlers[:], root.level
    logging.config.dictConfig(log_config(request.param))
    handler = next(each for each in root.handlers if type(each) is logging.StreamHandler)
    handler.setStream(written)
    yield lambda: written.getvalue().splitlines()
    root.handlers[:], root.level = handlers, level


@pytest.mark.parametrize("lines", ["json"], indirect=True)
def test_json_lines(client: TestClient, lines: Callable[[], list[str]], monkeypatch: pytest.MonkeyPatch) -> None:
    clock = count(0, 2.5)
    monkeypatch.setattr("service.logs.time", SimpleNamespace(perf_counter=lambda: next(clock)))
    survey_id = "0123456789abcdef"
    response = client.get(f"/v1/surveys/{survey_id}", headers={"X-Request-ID": "mine-1"})
    assert response.headers["x-request-id"] == "mine-1"
    with about(survey_id):
        logging.getLogger("service.jobs").warning("two\nlines %s", "here")
    records = [json.loads(line) for line in lines()]
    request = next(record for record in records if record["logger"] == "service.logs")
    assert request["survey"] == survey_id
    assert (request["request"], request["method"], request["status"]) == ("mine-1", "GET", 404)
    assert request["route"] == "/v1/surveys/{survey_id}"
    assert request["seconds"] == 2.5
    job = next(record for record in records if record["logger"] == "service.jobs")
    assert (job["survey"], job["level"], job["message"]) == (survey_id, "WARNING", "two\nlines here")


@pytest.mark.parametrize("lines", ["text"], indirect=True)
def test_text_lines(client: TestClient, lines: Callable[[], list[str]]) -> None:
    response = client.get("/v1/health", headers={"X-Request-ID": "not an id"})
    chosen = response.headers["x-request-id"]
    assert len(chosen) == 32
    line = next(line for line in lines() if "GET /v1/health 200" in line)
    assert f"request={chosen}" in line
