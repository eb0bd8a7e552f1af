"""A machine over REST: its parameter point and back, its attractors, and how hard they rattle."""

import math
from collections.abc import Iterator
from typing import Any

import pytest
from fastapi.testclient import TestClient
from service_support import IN_A_THREAD, assert_problem, front_end

import rattle

SI = {"inertia": 0.003, "drag": 0.05, "backlash": 100e-6, "eccentricity": 150e-6, "radius": 0.05, "rpm": 3000.0}
PLAIN = {"delta": 0.6, "epsilon": 0.1}


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("machine"), points=IN_A_THREAD) as client:
        yield client


def found(client: TestClient, route: str, **query: Any) -> Any:
    answer = client.get(f"/v1/{route}", params=query)
    assert answer.status_code == 200, answer.text
    return answer.json()


def test_the_description_says_when_the_gears_are_equal(client: TestClient) -> None:
    paths = client.get("/openapi.json").json()["paths"]
    assert "two gears" in paths["/v1/machine"]["get"]["summary"]
    for route in ("machine", "attractors", "intensity"):
        (inertia,) = (each for each in paths[f"/v1/{route}"]["get"]["parameters"] if each["name"] == "inertia")
        assert "of each of two equal gears" in inertia["description"]


@pytest.mark.parametrize("changed", [{}, {"drive": "speed"}, {"stiffness": 1e8}])
def test_a_machine_is_the_point_that_it_is(client: TestClient, changed: dict[str, Any]) -> None:
    machine = rattle.Machine(**SI, **changed)
    at = found(client, "machine", **SI, **changed)
    assert {name: at[name] for name in ("delta", "epsilon", "beta", "kappa")} == {
        "delta": machine.delta,
        "epsilon": machine.epsilon,
        "beta": machine.beta,
        "kappa": machine.kappa,
    }
    assert at["units"] == machine.units._asdict()
    assert at["quiet_limit"] == machine.gear.quiet_limit * machine.units.length


def test_at_the_ends_of_double_precision_there_are_numbers_or_none(client: TestClient) -> None:
    soft = found(client, "machine", **SI | {"rpm": 1.0}, stiffness=5e-324)
    assert soft["kappa"] > 0
    assert soft["quiet_limit"] is None
    slow = found(client, "machine", **SI | {"drag": 1e-300, "rpm": 1e-300})
    assert (slow["units"]["frequency"], slow["units"]["power"]) == (pytest.approx(1e-300 / 60), 0.0)


def test_attractors_of_a_machine_are_those_of_its_point(client: TestClient) -> None:
    machine = rattle.Machine(**SI)
    point = {"delta": machine.delta, "epsilon": machine.epsilon, "beta": machine.beta}
    assert found(client, "attractors", **SI, count=8) == found(client, "attractors", **point, count=8)


@pytest.mark.parametrize("kappa", [None, 1e4])
def test_intensities_are_those_of_the_library(client: TestClient, kappa: float | None) -> None:
    stiff = {} if kappa is None else {"kappa": kappa}
    gear = rattle.models.model_of(0.6, kappa=kappa).gear(**PLAIN)
    answer = found(client, "intensity", **PLAIN, **stiff, count=8)
    known = gear.attractors(8)
    assert answer["kappa"] == kappa
    for one, each in zip(answer["attractors"], known, strict=True):
        intensity = gear.intensity(each)
        assert (one["kind"], one["fraction"], one["si"]) == (each.kind, each.fraction, None)
        for name in ("impacts_plus", "impacts_minus", "mean_speed", "largest_speed", "energy", "contact", "impulse"):
            assert one[name] == getattr(intensity, name)
        assert one["errors"] == intensity.errors._asdict()
        level = intensity.level(2 * math.pi**2 * 0.36)
        assert one["level"] == (pytest.approx(level, abs=1e-9) if math.isfinite(level) else None)
        assert one["impulse"] == pytest.approx(2 * math.pi * 0.6, rel=1e-10 if each.kind != "chaotic" else 1e-3)


def test_of_a_machine_intensities_are_in_si_units_too(client: TestClient) -> None:
    machine = rattle.Machine(**SI)
    attractors = machine.gear.attractors(8)
    answer = found(client, "intensity", **SI, count=8)["attractors"]
    assert len(answer) == len(attractors)
    for one, each in zip(answer, attractors, strict=True):
        expected = machine.intensity(each)._asdict()
        expected["level"] = expected["level"] if math.isfinite(expected["level"]) else None
        assert one["si"] == expected


@pytest.mark.parametrize(
    ("route", "query", "message"),
    [
        ("machine", SI | {"radius": 50}, "for 50 mm give 0.05"),
        ("machine", SI | {"rpm": 1e9}, "no gear turns at"),
        ("machine", SI | {"drive": "belt"}, "drive"),
        ("machine", SI | {"inertia": 5e-324, "rpm": 1e-5}, "delta"),
        ("machine", SI | {"rpm": 5e-324}, "speed"),
        ("machine", {name: SI[name] for name in SI if name != "drag"}, "query.drag"),
        ("attractors", SI | {"backlash": 0.1}, "for 0.1 mm give 0.0001"),
        ("attractors", {name: SI[name] for name in SI if name != "rpm"}, "query.rpm"),
        ("attractors", {"epsilon": 0.1}, "query.delta"),
        ("intensity", PLAIN | SI, "exclude each other: give"),
        ("intensity", PLAIN | {"count": 10**9}, "count may be at most"),
        ("intensity", {}, "query.delta"),
    ],
)
def test_what_cannot_be_meant_is_refused(client: TestClient, route: str, query: dict[str, Any], message: str) -> None:
    assert_problem(client.get(f"/v1/{route}", params=query), 422, message)


def test_orbits_of_a_machine_are_those_of_its_point_and_in_its_units(client: TestClient) -> None:
    given = SI | {"drag": 5e-4, "backlash": 300e-6}  # C ends in grazing G1 there
    machine = rattle.Machine(**given)
    of_machine = found(client, "orbits", **given)
    of_point = found(client, "orbits", delta=machine.delta, epsilon=machine.epsilon, beta=machine.beta)
    si = of_machine.pop("si")
    assert of_point.pop("si") is None
    assert of_machine == of_point
    assert si["velocities"] == [orbit.v * machine.units.velocity for orbit in machine.gear.orbits()]
    assert si["quiet_limit"] == machine.gear.quiet_limit * machine.units.length
    assert machine.gear.sn1 is not None
    assert si["sn1"] == machine.gear.sn1 * machine.units.length
    assert (of_point["flip"], si["flip"]) == (None, None)
    (missing,) = of_point["missing"]
    end = float(rattle.grazing("G1", machine.delta, machine.beta).epsilon)
    assert missing == {"limit": "flip", "reason": "none at this damping: C ends in grazing G1", "epsilon": end}
    assert si["missing"] == [end * machine.units.length]
    stiff = found(client, "orbits", **SI, stiffness=1e6)
    assert stiff["si"]["flip"] is None
    assert [each["limit"] for each in stiff["missing"]] == ["sn1", "flip"]
    assert stiff["si"]["missing"] == [None, None]


def test_basins_of_a_machine_are_those_of_its_point(client: TestClient) -> None:
    machine = rattle.Machine(**SI)
    point = {"delta": machine.delta, "epsilon": machine.epsilon, "beta": machine.beta}
    pictures = [client.get("/v1/basins.png", params=query | {"resolution": 8}) for query in (SI, point)]
    assert [each.status_code for each in pictures] == [200, 200]
    assert pictures[0].content == pictures[1].content
    assert_problem(client.get("/v1/basins.png", params=SI | PLAIN), 422, "exclude each other")
    assert_problem(client.get("/v1/orbits", params={"delta": 0.6}), 422, "query.epsilon")


def test_a_limit_is_that_of_the_library_and_in_metres(client: TestClient) -> None:
    given = SI | {"drag": 1.5e-3, "backlash": 300e-6}
    asked = {"share": 0.8, "count": 64}
    at = found(client, "limits", **given, **asked, of="eccentricity")
    exact = rattle.design_limit(given, "eccentricity", 0.8, count=64)
    assert at["limits"] == [{"at": None, "value": exact.value, "low": exact.low, "high": exact.high}]
    curve = found(client, "limits", **asked, of="epsilon", over="delta", values=[0.5, 0.6])
    assert [each["at"] for each in curve["limits"]] == [0.5, 0.6]
    assert curve["limits"][0]["value"] < curve["limits"][1]["value"]
    none = found(client, "limits", **asked, of="epsilon", delta=0.6, low=0.01, high=0.02)
    assert none["limits"] == [{"at": None, "value": None, "low": None, "high": None}]


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ({"of": "epsilon"}, "delta must be given too"),
        ({"of": "epsilon", "delta": 0.6, "rpm": 3000}, "both define the gear"),
        ({"of": "epsilon", "delta": 0.6, "count": 16}, "16 samples are too few for a share of 0.99"),
        ({"of": "epsilon", "delta": 0.6, "over": "beta"}, "over and values belong together"),
        ({"of": "epsilon", "delta": 0.6, "low": 0.1}, "low and high belong together"),
        ({"of": "epsilon", "delta": 0.6, "count": 10**6}, "count may be at most"),
        ({"of": "radius", "delta": 0.6}, "query.of"),
    ],
)
def test_a_limit_that_cannot_be_is_refused(client: TestClient, query: dict[str, Any], words: str) -> None:
    assert_problem(client.get("/v1/limits", params=query), 422, words)
