"""A drawing of two unlike gears with an error once a tooth: the same numbers by library, REST, commands, surveys."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient
from service_support import IN_A_THREAD, assert_problem, front_end
from typer.testing import CliRunner

import rattle
from gear_rattle.service.cli import app
from gear_rattle.service.harmonics import harmonic_texts
from gear_rattle.workers import SurveyRequest

PAIR: dict[str, Any] = {
    "inertia": 0.003, "drag": 5e-4, "radius": 0.05, "teeth": 20, "backlash": 100e-6, "drive": "speed",
    "driven_inertia": 0.02, "driven_drag": 4e-3, "driven_teeth": 35,
}  # fmt: skip
AT: dict[str, Any] = {"eccentricity": 15e-6, "rpm": 1500, "restitution": 0.9, "mesh_error": 0.06e-6}
SAMPLE = 32


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("two"), points=IN_A_THREAD) as client:
        yield client


def options(numbers: dict[str, Any]) -> list[str]:
    return [word for name, value in numbers.items() for word in (f"--{name.replace('_', '-')}", f"{value}")]


def said(*words: str) -> str:
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    return done.output


def test_rest_has_the_point_of_the_library(client: TestClient) -> None:
    machine = rattle.Machine(**PAIR, **AT)
    answer = client.get("/v1/machine", params=PAIR | AT)
    assert answer.status_code == 200, answer.text
    found = answer.json()
    assert (found["delta"], found["epsilon"], found["beta"]) == (machine.delta, machine.epsilon, machine.beta)
    assert found["restitution"] == 0.9
    assert [tuple(each) for each in found["harmonics"]] == list(machine.harmonics)
    assert found["units"] == machine.units._asdict()
    assert (found["revolutions"], found["rate_error"]) == (1.0, 0.0)


def test_attractors_are_the_same_everywhere(client: TestClient) -> None:
    machine = rattle.Machine(**PAIR, **AT)
    known = {(each.m, each.n_plus, each.n_minus): each.fraction for each in machine.attractors(SAMPLE)}
    answer = client.get("/v1/attractors", params=PAIR | AT | {"count": SAMPLE, "v_max": "natural"})
    assert answer.status_code == 200, answer.text
    found = {(each["m"], each["n_plus"], each["n_minus"]): each["fraction"] for each in answer.json()["attractors"]}
    assert found == known
    line = said("attractors", *options(PAIR | AT), "--count", f"{SAMPLE}", "--verdict")
    known_verdict = machine.verdict(SAMPLE)
    assert line.strip() == str(known_verdict)
    answer = client.get("/v1/verdict", params=PAIR | AT | {"count": SAMPLE})
    assert answer.status_code == 200, answer.text
    verdict = answer.json()
    assert {name: verdict[name] for name in known_verdict._fields} == known_verdict._asdict()
    assert (verdict["text"], verdict["measured"]) == (line.strip(), None)
    assert verdict["machine"] == client.get("/v1/machine", params=PAIR | AT).json()


def test_a_knock_that_does_not_exist_is_null(client: TestClient) -> None:
    verdict = client.get("/v1/verdict", params=PAIR | AT | {"restitution": 0.7, "count": SAMPLE}).json()
    assert (verdict["kind"], verdict["share"], verdict["knock"]) == ("quiet", 0.0, None)
    assert verdict["hardest"] > 0
    assert verdict["text"].startswith("quiet: no knock up to")


def test_a_measured_curve_gives_the_same_numbers_everywhere(client: TestClient, tmp_path: Path) -> None:
    turn = np.arange(240) / 240
    error = 15 * np.cos(2 * np.pi * turn) + 0.06 * np.cos(2 * np.pi * 20 * turn)
    curve = tmp_path / "curve.csv"
    rows = zip((360 * turn).tolist(), error.tolist(), strict=True)
    curve.write_text("angle_deg,error_um\n" + "".join(f"{angle!r},{e!r}\n" for angle, e in rows))
    numbers = {name: value for name, value in (PAIR | AT).items() if name not in ("eccentricity", "mesh_error")}
    words = ("attractors", *options(numbers), "--transmission-error", str(curve), "--orders", "20", "--verdict")
    printed = said(*words).splitlines()
    assert "µm rms left out" in printed[0]
    known = rattle.read_transmission_error(curve, orders=20)
    machine = rattle.Machine(**numbers, eccentricity=0, errors=known.harmonics)
    assert printed[-1] == str(machine.verdict(64))
    parts = {order: size for order, size, _ in known.harmonics}
    assert (parts[1], parts[20]) == (pytest.approx(15e-6, rel=1e-12), pytest.approx(0.06e-6, rel=1e-9))
    query = numbers | {"orders": 20, "count": 64}
    answer = client.post(
        "/v1/verdict", params=query, content=curve.read_text(), headers={"Content-Type": "text/csv; charset=utf-8"}
    )
    assert answer.status_code == 200, answer.text
    verdict = answer.json()
    assert verdict["text"] == printed[-1]
    assert [tuple(each) for each in verdict["measured"]["harmonics"]] == list(known.harmonics)
    assert (verdict["measured"]["left_out"], verdict["measured"]["points"]) == (known.left_out, 240)
    point = {name: verdict["machine"][name] for name in ("delta", "epsilon", "beta", "restitution")}
    harmonics = harmonic_texts(map(tuple, verdict["machine"]["harmonics"]))
    further = client.get("/v1/attractors", params=point | {"harmonic": harmonics, "count": 8, "v_max": "natural"})
    assert further.status_code == 200, further.text
    rattling = [(each["kind"], each["fraction"]) for each in further.json()["attractors"]]
    assert rattling == [(each.kind, each.fraction) for each in machine.attractors(8)]
    done = CliRunner().invoke(app, [*words, "--eccentricity", "1e-6"])
    assert done.exit_code != 0
    assert "leave out" in " ".join(done.output.replace("│", " ").split())  # the message is wrapped in a box


@pytest.mark.parametrize(
    ("table", "query", "words"),
    [
        ("", {}, "body"),
        ("angle,error\n0,1\n", {}, "the column angle of the body does not say its unit"),
        ("speed,error_um\n0,1\n", {}, "the body must have exactly one of the columns angle_deg"),
        ("angle_deg,error_um\n0,one\n", {}, "line 2 of the body"),
        ("angle_deg,error_um\n0,1\n180,2\n", {}, "points are too few"),
        ("angle_deg,error_um\n0,1\n", {"backlash": 50}, "metres"),
        ("angle_deg,error_um\n0,1\n", {"eccentricity": 1e-6}, "query.eccentricity: there is no such parameter"),
        ("angle_deg,error_um\n0,1\n", {"orders": 0}, "query.orders"),
        ("angle_deg,error_um\n0,1\n" * 10_000, {}, "too large"),
    ],
)
def test_a_curve_that_is_none_is_refused(client: TestClient, table: str, query: dict[str, Any], words: str) -> None:
    given = PAIR | {"rpm": 1500, "restitution": 0.9} | query
    answer = client.post("/v1/verdict", params=given, content=table, headers={"Content-Type": "text/csv"})
    assert_problem(answer, 413 if words == "too large" else 422, words)


def test_a_survey_of_it_has_the_same_points() -> None:
    ratio = AT["mesh_error"] / AT["eccentricity"]
    axes = {"rpm": {"start": 1000, "stop": 2000, "num": 3}, "eccentricity": {"start": 5e-6, "stop": 15e-6, "num": 3}}
    request = SurveyRequest.model_validate(
        {
            "model": "inelastic",
            "restitution": 0.9,
            "harmonics": [[20, ratio, 0.0]],
            "machine": PAIR | axes,
            "quantities": ["attractors"],
        }
    )
    assert request.machine is not None
    assert request.machine.model_dump() == PAIR
    assert SurveyRequest.model_validate(request.model_dump(mode="json")) == request
    for delta in request.delta.values():
        for epsilon in request.epsilon.values():
            eccentricity = float(request.machine.eccentricity_in_metres(epsilon))
            machine = rattle.Machine(
                **PAIR,
                eccentricity=eccentricity,
                mesh_error=ratio * eccentricity,
                rpm=float(request.machine.speed_at_damping(delta)),
                restitution=request.restitution,  # type: ignore[attr-defined]
            )
            assert (machine.delta, machine.epsilon) == pytest.approx((delta, epsilon), rel=1e-12)
            assert machine.beta == request.beta
            assert machine.harmonics == ((20, pytest.approx(ratio), 0.0),)
