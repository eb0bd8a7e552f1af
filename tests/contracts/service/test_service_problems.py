"""Every refusal is a problem document that says what to do, whatever is thrown at the service."""

import json
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from service_support import BODY, assert_problem, front_end, front_of
from sqlalchemy.exc import OperationalError

LIMITS = {
    "max_cells": 600,
    "max_tiles": 50,
    "max_count": 32,
    "max_samples": 4000,
    "max_tile_samples": 2000,
    "max_jobs": 3,
}


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("data"), max_body_bytes=2000, max_point_count=16, **LIMITS) as client:
        yield client


def body(**changes: Any) -> dict[str, Any]:
    """The small survey, with dotted fields changed."""
    changed = deepcopy(BODY)
    for path, value in changes.items():
        *parents, last = path.split("__")
        target = changed
        for parent in parents:
            target = target.setdefault(parent, {})
        target[last] = value
    return changed


REFUSED = [
    (body(delta__start=float("nan")), "body.delta.start", "finite"),
    (body(delta__stop=float("inf")), "body.delta.stop", "finite"),
    (body(epsilon__start=float("-inf")), "body.epsilon.start", "finite"),
    (body(delta__num=float("nan")), "body.delta.num", ""),
    (body(delta={"start": 1.0, "stop": 0.4, "num": 5}), "body.delta", "below"),
    (body(delta={"start": 0.4, "stop": 0.4, "num": 5}), "body.delta", "below"),
    (body(delta__num=1), "body.delta.num", "2"),
    (body(delta__num=0), "body.delta.num", ""),
    (body(delta__num=-7), "body.delta.num", ""),
    (body(delta__num=2.5), "body.delta.num", ""),
    (body(delta__num="6"), "body.delta.num", ""),
    (body(delta__num=True), "body.delta.num", ""),
    (body(delta__start="0.5"), "body.delta.start", ""),
    (body(delta__start=None), "body.delta.start", ""),
    (body(delta__start=-0.1), "body.delta", "positive"),
    (body(epsilon__start=-0.1), "body.epsilon", "negative"),
    (body(delta__num=10**30), "body.delta.num", ""),
    (body(delta=[0.4, 1.0, 6]), "body.delta", ""),
    (body(beta=0), "body.beta", ""),
    (body(beta=float("nan")), "body.beta", "finite"),
    (body(quantities=["region", "weather"]), "body.quantities", "region"),
    (body(quantities=[]), "body.quantities", ""),
    (body(quantities="region"), "body.quantities", ""),
    (body(tile__delta=7), "body", "exceeds"),
    (body(tile__delta=0), "body.tile.delta", ""),
    (body(seed=-1), "body.seed", ""),
    (body(seed=1.5), "body.seed", ""),
    (body(initial_conditions__count=0), "body.initial_conditions.count", ""),
    (body(initial_conditions__v_max=-1.0), "body.initial_conditions.v_max", ""),
    (body(name=3), "body.name", ""),
    (body(name="a\x00b"), "body.name", ""),
    (body(surprise=1), "body.surprise", ""),
    ({}, "body.delta", ""),
    ([], "body", ""),
    ("text", "body", ""),
    (None, "body", ""),
]


@pytest.mark.parametrize(("wrong", "field", "word"), REFUSED)
def test_a_bad_survey_is_refused_field_by_field(client: TestClient, wrong: Any, field: str, word: str) -> None:
    content = json.dumps(wrong)  # writes NaN and Infinity, which are no JSON
    response = client.post("/v1/surveys", content=content, headers={"Content-Type": "application/json"})
    problem = assert_problem(response, 422, word)
    assert any(item["field"].startswith(field) for item in problem["errors"]), problem


OVER_THE_LIMIT = [
    ({"delta__num": 101, "epsilon__num": 6, "tile": {}}, "600", "body.delta.num"),
    ({"delta__num": 20, "epsilon__num": 20, "tile": {"delta": 1, "epsilon": 1}}, "50", "body.tile"),
    ({"initial_conditions__count": 33}, "32", "body.initial_conditions.count"),
    ({"delta__num": 24, "epsilon__num": 24, "initial_conditions__count": 8, "tile": {}}, "4,000", "count"),
    (
        {"delta__num": 12, "epsilon__num": 12, "initial_conditions__count": 16, "tile": {"delta": 12, "epsilon": 12}},
        "2,000",
        "tile",
    ),
    # A cell with basins follows 4096 states, whatever the sample.
    ({"delta__num": 2, "epsilon__num": 2, "tile": {}, "quantities": ["region", "basins"]}, "4,000", "body.quantities"),
]


@pytest.mark.parametrize(("changes", "limit", "field"), OVER_THE_LIMIT)
def test_a_survey_over_a_limit_is_told_the_limit(
    client: TestClient, changes: dict[str, Any], limit: str, field: str
) -> None:
    assert_problem(client.post("/v1/surveys", json=body(**changes)), 422, limit, field)


UNREADABLE = [
    (b'{"delta": ', 422),
    (b'"\xff"', 400),
    (b"[" * 1990, 400),
    (b'{"seed": ' + b"1" * 1900 + b"}", 422),
    (b'{"\\ud800": 1}', 422),
    (b'{"name": "\\ud800"}', 422),
    (b"", 422),
]


@pytest.mark.parametrize(("content", "status"), UNREADABLE)
def test_an_unreadable_body_is_refused(client: TestClient, content: bytes, status: int) -> None:
    response = client.post("/v1/surveys", content=content, headers={"Content-Type": "application/json"})
    assert_problem(response, status)


@pytest.mark.parametrize("media_type", ["text/plain", "application/x-www-form-urlencoded", "application/xml", ""])
def test_other_media_types_are_refused(client: TestClient, media_type: str) -> None:
    response = client.post("/v1/surveys", content=json.dumps(BODY), headers={"Content-Type": media_type})
    assert_problem(response, 415, code="unsupported_media_type")


@pytest.mark.parametrize("path", ["/v1/surveys", "/nowhere"])
@pytest.mark.parametrize("chunked", [True, False])
def test_a_large_body_is_refused(client: TestClient, path: str, chunked: bool) -> None:
    content: Any = iter([b" " * 900] * 3) if chunked else b" " * 2700
    response = client.post(path, content=content, headers={"Content-Type": "application/json"})
    assert_problem(response, 404 if chunked and path == "/nowhere" else 413)


def test_a_lying_content_length_does_not_help(client: TestClient) -> None:
    headers = {"Content-Type": "application/json", "Content-Length": "5"}
    assert_problem(client.post("/v1/surveys", content=iter([b" " * 2700]), headers=headers), 413)


@pytest.mark.parametrize(
    ("method", "path", "allowed"),
    [
        ("DELETE", "/v1/surveys", {"GET", "HEAD", "POST"}),
        ("PUT", "/v1/surveys/x", {"GET", "HEAD", "PATCH", "DELETE"}),
        ("POST", "/v1/surveys/x/store/zarr.json", {"GET", "HEAD"}),
        ("POST", "/v1/health", {"GET", "HEAD"}),
    ],
)
def test_other_methods_are_refused(client: TestClient, method: str, path: str, allowed: set[str]) -> None:
    response = client.request(method, path)
    assert_problem(response, 405)
    assert set(response.headers["allow"].split(", ")) == allowed


@pytest.mark.parametrize(
    "path",
    ["/v1", "/v1/surveys/", "/v1/surveys/x", "/v1/surveys/x/events", "/v1/surveys/x/map.png", "/v1/surveys/%00"],
)
def test_unknown_paths_and_surveys_are_not_found(client: TestClient, path: str) -> None:
    assert_problem(client.get(path), 404)


@pytest.mark.parametrize("query", ["limit=0", "limit=501", "limit=x", "cursor=0", "cursor=x", f"cursor={10**20}"])
def test_bad_pages_are_refused(client: TestClient, query: str) -> None:
    assert_problem(client.get(f"/v1/surveys?{query}"), 422, query.split("=")[0])


@pytest.mark.parametrize("key", ["", "with space", "x" * 256, "ü"])
def test_bad_idempotency_keys_are_refused(client: TestClient, key: str) -> None:
    response = client.post("/v1/surveys", json=BODY, headers={"Idempotency-Key": key.encode("latin-1")})
    assert_problem(response, 422, "idempotency-key")


@pytest.mark.parametrize("route", ["orbits", "attractors", "basins.png"])
@pytest.mark.parametrize(
    "query",
    [
        "",
        "delta=0.6",
        "delta=nan&epsilon=0.1",
        "delta=0.6&epsilon=inf",
        "delta=-1&epsilon=0.1",
        "delta=0&epsilon=0.1",
        "delta=0.6&epsilon=-0.1",
        "delta=x&epsilon=0.1",
        "delta=0.6&epsilon=0.1&beta=0",
        "delta=0.6&epsilon=0.1&beta=-inf",
    ],
)
def test_bad_points_are_refused(client: TestClient, route: str, query: str) -> None:
    samples = "&count=4" if route == "attractors" else ""
    assert_problem(client.get(f"/v1/{route}?{query}{samples}"), 422)


@pytest.mark.parametrize(
    "extra", ["count=0", "count=17", "count=x", "v_max=nan", "v_max=0", "seed=-1", "seed=4294967296"]
)
def test_bad_samples_are_refused(client: TestClient, extra: str) -> None:
    assert_problem(client.get(f"/v1/attractors?delta=0.6&epsilon=0.1&{extra}"), 422, extra.split("=")[0])


@pytest.mark.parametrize(
    ("path", "known"),
    [
        ("/v1/surveys?limt=5", "limit"),
        ("/v1/surveys?limit=5&x", "limit"),
        ("/v1/orbits?delta=0.6&epsilon=0.1&Beta=0.5", "beta"),
        ("/v1/surveys/x/map.png?quantity=region", "variable"),
        ("/v1/surveys/x/store/zarr.json?v=1", "none"),
        ("/v1/health?verbose=1", "none"),
    ],
)
def test_an_unknown_parameter_is_named_with_those_that_there_are(client: TestClient, path: str, known: str) -> None:
    problem = assert_problem(client.get(path), 422, known)
    assert problem["errors"][0]["field"].startswith("query.")


def test_a_full_queue_says_to_wait(tmp_path: Path) -> None:
    with front_end(tmp_path, max_jobs=1) as client:
        assert client.post("/v1/surveys", json=BODY).status_code == 202
        response = client.post("/v1/surveys", json=BODY | {"seed": 1})
        assert_problem(response, 429)
        assert int(response.headers["retry-after"]) > 0


def test_a_database_that_does_not_answer_is_503_and_a_bug_is_500(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(error: Exception) -> None:
        def raise_it(survey_id: str, *_: object) -> None:
            raise error from ValueError(survey_id)

        monkeypatch.setattr(front_of(client).database, "job", raise_it)

    with front_end(tmp_path) as client:
        fail(OperationalError("SELECT secret", {}, Exception("database is locked")))
        response = client.get("/v1/surveys/x")
        assert "secret" not in response.text
        assert_problem(response, 503)
        assert int(response.headers["retry-after"]) > 0
        fail(RuntimeError("secret"))
        response = client.get("/v1/surveys/x")
        assert "secret" not in response.text
        assert_problem(response, 500)


def test_every_route_declares_its_problems(client: TestClient) -> None:
    document = client.get("/openapi.json").json()
    assert {"Problem", "FieldError"} <= set(document["components"]["schemas"])
    assert "HTTPValidationError" not in document["components"]["schemas"]
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            errors = {status: answer for status, answer in operation["responses"].items() if status >= "400"}
            assert "500" in errors, (method, path)
            for answer in errors.values():
                assert list(answer["content"]) == ["application/problem+json"], (method, path)
    assert client.get("/docs").status_code == 200
