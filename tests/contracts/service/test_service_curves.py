"""The curves of a half-backlash by REST and on the command line: the library's, in JSON that has no NaN."""

import csv
import json
from collections.abc import Iterator
from pathlib import Path
from threading import Event
from typing import Any

import pytest
from depth import deep
from fastapi.testclient import TestClient
from service_support import IN_A_THREAD, assert_problem, front_end, front_of
from typer.testing import CliRunner
from waiting import HANG

from gear_rattle.service.cli import app
from gear_rattle.service.routes import model as routes
from rattle import curves
from rattle.models import DEFAULT_MODEL

WINDOW = "delta_min=0.45&delta_max=0.85&epsilon_min=0.05&epsilon_max=0.25"


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("data"), points=IN_A_THREAD) as client:
        yield client


def get(client: TestClient, query: str) -> dict[str, Any]:
    response = client.get(f"/v1/curves?{query}")
    assert response.status_code == 200, response.text

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    document: dict[str, Any] = json.loads(response.text, parse_constant=refuse)
    return document


@pytest.mark.parametrize("beta", [0.6, pytest.param(0.5, marks=deep)])
def test_the_answer_is_what_the_library_traces(client: TestClient, beta: float) -> None:
    document = get(client, f"beta={beta}&{WINDOW}")
    assert document["beta"] == beta
    assert document["window"] == {"delta": [0.45, 0.85], "epsilon": [0.05, 0.25]}
    assert [curve["name"] for curve in document["curves"]] == list(curves.NAMES)
    for found in document["curves"]:
        curve = curves.trace(found["name"], beta, (0.45, 0.85), (0.05, 0.25))
        assert found["meaning"] == curves.describe(curve.name)
        for column in ("delta", "epsilon", "tau", "v", "arclength", "piece"):
            assert found[column] == getattr(curve, column).tolist(), column
        assert found["folds"] == list(curve.folds)
        assert [(end["index"], end["reason"]) for end in found["ends"]] == [(e.index, e.reason) for e in curve.ends]
        assert found["missing"] is None
        pairs = [[(z["re"], z["im"]) for z in pair] for pair in found["multipliers"]]
        if curve.name == "quiet_limit":
            assert {value for pair in pairs for z in pair for value in z} == {None}
        else:
            assert pairs == [[(z.real, z.imag) for z in pair] for pair in curve.multipliers.T]
    for found, point in zip(document["points"], curves.codimension_two(beta), strict=True):
        assert (found["name"], found["delta"], found["epsilon"]) == (point.name, point.delta, point.epsilon)
        assert found["curves"] == list(point.curves)
        assert {tuple(pair["curves"]): pair["order"] for pair in found["tangency"]} == point.tangency


def test_the_defaults_are_the_papers(client: TestClient) -> None:
    document = get(client, "")
    assert document["beta"] == 0.6
    assert document["window"] == {"delta": [0.3, 1.2], "epsilon": [0.0, 1.0]}
    assert all(curve["delta"] for curve in document["curves"])


@pytest.mark.parametrize(
    "query",
    [
        "beta=1e-3",
        pytest.param("beta=1e3", marks=deep),
        "beta=1e300",
        pytest.param("delta_min=1e-300&delta_max=1", marks=deep),  # smaller ones are in test_service_extremes.py
        "delta_max=1e6&epsilon_max=1e6",
    ],
)
def test_extreme_parameters_are_answered(client: TestClient, query: str) -> None:
    for curve in get(client, query)["curves"]:
        lengths = {
            len(curve[column]) for column in ("delta", "epsilon", "tau", "v", "multipliers", "arclength", "piece")
        }
        assert len(lengths) == 1
        assert lengths == {0} or curve["missing"] is None


REFUSED = [
    ("beta=0", "query.beta"),
    ("beta=nan", "query.beta"),
    ("beta=x", "query.beta"),
    ("delta_min=0", "query.delta_min"),
    ("delta_min=1.3", "query.delta_max"),
    ("delta_max=inf", "query.delta_max"),
    ("delta_max=1e300", "query.delta_max"),
    ("delta_min=1e-9&delta_max=2e-9", "delta must reach above"),
    ("epsilon_min=-1", "query.epsilon_min"),
    ("epsilon_min=0.5&epsilon_max=0.5", "query.epsilon_max"),
]


@pytest.mark.parametrize(("query", "words"), REFUSED)
def test_a_bad_window_is_refused(client: TestClient, query: str, words: str) -> None:
    assert_problem(client.get(f"/v1/curves?{query}"), 422, words)


def never(*_: object) -> None:
    """Compute for ever in a process."""
    Event().wait()


def test_an_answer_that_takes_too_long_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(routes.plane_curves, "curves_document", never)
    with front_end(tmp_path, max_point_seconds=0.5) as client:
        client.portal.call(front_of(client).kernels.wait_until_compiled, DEFAULT_MODEL, HANG)  # not what is timed
        assert_problem(client.get("/v1/curves"), 503, "within 0.5 s", "smaller window")


def test_the_route_is_declared(client: TestClient) -> None:
    operation = client.get("/openapi.json").json()["paths"]["/v1/curves"]["get"]
    assert {parameter["name"] for parameter in operation["parameters"]} == {
        "beta",
        "kappa",
        "restitution",
        "load",
        "harmonic",
        "delta_min",
        "delta_max",
        "epsilon_min",
        "epsilon_max",
    }
    assert {"200", "422", "503"} <= set(operation["responses"])


def test_the_command_prints_points_and_ends_and_writes_a_table(tmp_path: Path) -> None:
    table = tmp_path / "curves.csv"
    options = ["curves", "--delta", "0.45:0.85", "--epsilon", "0.05:0.25", "--csv", str(table)]
    result = CliRunner().invoke(app, options)
    assert result.exit_code == 0, result.output
    assert "COD22  0.770147130934" in result.output
    assert "window: delta = 0.45" in result.output
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    g1 = [float(row["epsilon"]) for row in rows if row["curve"] == "G1"]
    assert g1 == curves.trace("G1", 0.6, (0.45, 0.85), (0.05, 0.25)).epsilon.tolist()


def test_the_command_says_how_a_range_is_written() -> None:
    result = CliRunner().invoke(app, ["curves", "--delta", "0.3"])
    assert result.exit_code == 2
    assert "LOW:HIGH" in result.output
