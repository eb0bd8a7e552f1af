"""A drawing of two unlike gears with an error once a tooth: the same numbers by library, REST, commands, surveys."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient
from service_support import IN_A_THREAD, front_end
from typer.testing import CliRunner

import rattle
from gear_rattle.service.cli import app
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
    assert line.strip() == str(machine.verdict(SAMPLE))


def test_a_measured_curve_is_read_by_commands(tmp_path: Path) -> None:
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
    done = CliRunner().invoke(app, [*words, "--eccentricity", "1e-6"])
    assert done.exit_code != 0
    assert "leave out" in done.output


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
            eccentricity = float(request.machine.eccentricity(epsilon))
            machine = rattle.Machine(
                **PAIR,
                eccentricity=eccentricity,
                mesh_error=ratio * eccentricity,
                rpm=float(request.machine.rpm(delta)),
                restitution=request.restitution,  # type: ignore[attr-defined]
            )
            assert (machine.delta, machine.epsilon) == pytest.approx((delta, epsilon), rel=1e-12)
            assert machine.beta == request.beta
            assert machine.harmonics == ((20, pytest.approx(ratio), 0.0),)
