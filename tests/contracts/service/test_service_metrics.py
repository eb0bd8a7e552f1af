"""Metrics and logs, parsed by those who read them."""

import json
import logging
import logging.config
import re
from collections.abc import Callable, Iterator
from io import StringIO
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import quote

import pytest
from fastapi.testclient import TestClient
from prometheus_client.parser import text_string_to_metric_families
from service_support import BODY, front_end, front_of
from sqlalchemy.exc import OperationalError

from gear_rattle.service.access.middleware import AccessMiddleware
from gear_rattle.service.database import Database
from gear_rattle.service.database.tables import State
from gear_rattle.service.observability.logs import add_survey_id_to_logs, format_logs_of_libraries, log_config
from gear_rattle.service.observability.logs_json import TRACEBACKS
from gear_rattle.workers import SurveyRequest, compute_tile, tiles_of

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
    front.manager._record_tile(survey_id, REQUEST, record)
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


@pytest.mark.parametrize("lines", ["text"], indirect=True)
def test_errors_of_the_service_count_as_such(
    client: TestClient, monkeypatch: pytest.MonkeyPatch, lines: Callable[[], list[str]]
) -> None:
    """An earlier version counted them as 499, as if clients had gone, so no alert on 5xx ever fired."""

    def fail(*_: object) -> None:
        raise RuntimeError("a bug")

    monkeypatch.setattr(front_of(client).database, "job", fail)
    answer = client.get("/v1/surveys/x", headers={"X-Request-ID": "mine"})
    assert answer.status_code == 500
    assert answer.headers["x-request-id"] == "mine"
    assert answer.headers["x-content-type-options"] == "nosniff"
    counts = scrape(client)["rattle_http_request_seconds_count"]
    assert counts[tuple(sorted({"method": "GET", "route": "/v1/surveys/{survey_id}", "status": "500"}.items()))] == 1
    assert not [labels for labels in counts if ("status", "499") in labels]
    assert any("GET /v1/surveys/x 500" in line for line in lines())


def test_errors_before_any_route_count_as_such(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("a bug")

    monkeypatch.setattr(AccessMiddleware, "_check_target_and_headers", fail)
    assert client.get("/v1/health").status_code == 500
    monkeypatch.undo()
    counts = scrape(client)["rattle_http_request_seconds_count"]
    assert counts[tuple(sorted({"method": "GET", "route": "none", "status": "500"}.items()))] == 1


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
    yield lambda: written.getvalue().removesuffix("\n").split("\n")
    root.handlers[:], root.level = handlers, level


@pytest.mark.parametrize("lines", ["json"], indirect=True)
def test_json_lines(client: TestClient, lines: Callable[[], list[str]], monkeypatch: pytest.MonkeyPatch) -> None:
    clock = count(0, 2.5)
    monkeypatch.setattr(
        "gear_rattle.service.observability.request_log.time", SimpleNamespace(perf_counter=lambda: next(clock))
    )
    survey_id = "0123456789abcdef"
    response = client.get(f"/v1/surveys/{survey_id}", headers={"X-Request-ID": "mine-1"})
    assert response.headers["x-request-id"] == "mine-1"
    with add_survey_id_to_logs(survey_id):
        logging.getLogger("gear_rattle.service.jobs.manager").warning("two\nlines %s", "here")
    records = [json.loads(line) for line in lines()]
    request = next(record for record in records if record["logger"] == "gear_rattle.service.observability.logs")
    assert request["survey"] == survey_id
    assert (request["request"], request["method"], request["status"]) == ("mine-1", "GET", 404)
    assert request["route"] == "/v1/surveys/{survey_id}"
    assert request["seconds"] == 2.5
    job = next(record for record in records if record["logger"] == "gear_rattle.service.jobs.manager")
    assert (job["survey"], job["level"], job["message"]) == (survey_id, "WARNING", r"two\nlines here")


@pytest.mark.parametrize("lines", ["text"], indirect=True)
def test_text_lines(client: TestClient, lines: Callable[[], list[str]]) -> None:
    response = client.get("/v1/health", headers={"X-Request-ID": "not an id"})
    chosen = response.headers["x-request-id"]
    assert len(chosen) == 32
    line = next(line for line in lines() if "GET /v1/health 200" in line)
    assert f"request={chosen}" in line


#: Ends of lines, escape sequences of terminals in one and two bytes, and what turns a line round.
FORGED = "2026-01-01 00:00:00,000 ERROR root FAKE"
HOSTILE = f"a\r\n{FORGED}\x1b[2J\x9b31m\u2028{FORGED}\u202e\x00\n{FORGED}"


def attack(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    """Put that into whatever a request, a survey and a library have."""
    raw = HOSTILE.encode()
    client.get(f"/v1/{quote(HOSTILE)}")
    client.get(f"/v1/surveys/{quote(HOSTILE, safe='')}/events")
    client.get("/v1/surveys", params={HOSTILE: HOSTILE})
    client.get("/v1/surveys", headers=[(b"X-Request-ID", raw), (b"Last-Event-ID", raw), (b"x-\x1b", raw)])
    client.post("/v1/surveys", json=BODY, headers=[(b"Idempotency-Key", raw)])

    client.post("/v1/surveys", json=BODY | {"name": HOSTILE})

    def fail(*_: object) -> None:
        try:
            raise ValueError(HOSTILE)
        except ValueError as error:
            error.add_note(HOSTILE)
            raise OperationalError(HOSTILE, {"name": HOSTILE}, error) from error

    monkeypatch.setattr(Database, "add_or_find_job", fail)
    assert client.post("/v1/surveys", json=BODY).status_code == 503
    with add_survey_id_to_logs(HOSTILE):
        logging.getLogger("uvicorn.error").info("%s said", HOSTILE, stack_info=True)
    try:
        raise ExceptionGroup(HOSTILE, [ValueError(HOSTILE)])
    except ExceptionGroup:
        logging.getLogger("uvicorn.error").exception("Exception in ASGI application\n")


@pytest.mark.parametrize("lines", ["text"], indirect=True)
def test_nobody_forges_a_line_of_text(
    client: TestClient, lines: Callable[[], list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    attack(client, monkeypatch)
    found = lines()
    assert [line for line in found if not line.isprintable() or line.startswith(FORGED[:10])] == []
    assert sum(rf"a\r\n{FORGED}\x1b[2J\x9b31m\u2028" in line for line in found) >= 5
    others = (
        " httpx ",
        " gear_rattle.service.jobs.manager ",
    )  # the latter tries again to start a cluster, as often as it has time to
    dated = [line for line in found if not line.startswith("  ") and not any(name in line for name in others)]
    assert all(re.match(r"\d{4}-", line) for line in dated)
    assert len(dated) == 10
    assert any(line.endswith("Exception in ASGI application") for line in dated)


@pytest.mark.parametrize("lines", ["json"], indirect=True)
def test_nobody_forges_a_line_of_json(
    client: TestClient, lines: Callable[[], list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    attack(client, monkeypatch)
    found = lines()
    assert all(line.isascii() and line.isprintable() for line in found)
    others = "httpx", "gear_rattle.service.jobs.manager"
    records = [record for record in map(json.loads, found) if record["logger"] not in others]
    assert len(records) == 10
    values = [(name, value) for record in records for name, value in record.items() if isinstance(value, str)]
    said = [part for name, value in values for part in (value.split("\n") if name in TRACEBACKS else [value])]
    assert [part for part in said if not part.isprintable() or part.startswith(FORGED[:10])] == []
    assert {"exc_info", "stack_info", "survey"} <= {name for name, _ in values}


@pytest.mark.parametrize("lines", ["text"], indirect=True)
def test_libraries_with_handlers_of_their_own_write_like_everybody(lines: Callable[[], list[str]]) -> None:
    library = logging.getLogger("tests.library")
    library.propagate = False
    handler = logging.StreamHandler(written := StringIO())
    library.addHandler(handler)
    format_logs_of_libraries()
    with add_survey_id_to_logs("0123456789abcdef"):
        library.warning("%s", HOSTILE)
    library.removeHandler(handler)
    assert written.getvalue().count("\n") == 1
    assert written.getvalue()[:-1].isprintable()
    assert written.getvalue().endswith("survey=0123456789abcdef\n")
    assert lines() == [""]
