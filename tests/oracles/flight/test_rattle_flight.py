"""First impacts against 40-digit values, and by proof against panels."""

import json
from pathlib import Path

import flights_high_precision as exact
import numpy as np
import panel_march
import pytest
from depth import either

import rattle
from rattle.flight import first_impact, forcing, law

FLIGHTS = json.loads((Path(__file__).parents[2] / "reference" / "flights.json").read_text())


@pytest.mark.parametrize("case", FLIGHTS, ids=lambda c: f"{c['delta']:.3f}-{c['epsilon']:.3f}-{c['velocity']:.2g}")
def test_reference_flights_to_twelve_digits(case):
    gear = rattle.Gear(case["delta"], case["epsilon"], case["beta"])
    found = gear.first_impact(case["wall"], case["phase"], case["velocity"])
    assert found.next_wall == case["next_wall"]
    assert found.flight_time == pytest.approx(float(case["flight_time"]), rel=1e-12, abs=0)
    assert found.impact_velocity == pytest.approx(float(case["impact_velocity"]), rel=1e-12, abs=0)
    assert tuple(found) == (found.flight_time, found.next_wall, found.impact_velocity)


@pytest.mark.parametrize("seed", range(40))
def test_other_flights_to_twelve_digits(seed):
    rng = np.random.default_rng([seed, 2009])
    delta, epsilon, beta = rng.uniform(0.15, 1.6), rng.uniform(0, 0.45), rng.uniform(0.15, 1.3)
    wall, phase, speed = int(rng.choice([1, -1])), rng.random(), 10 ** rng.uniform(-4, 1.1)
    time, next_wall, velocity = exact.first_impact(wall, phase, -wall * speed, delta, epsilon, beta)
    found = rattle.Gear(delta, epsilon, beta).first_impact(wall, phase, -wall * speed)
    assert found.next_wall == next_wall
    assert found.flight_time == pytest.approx(float(time), rel=1e-12, abs=0)
    assert found.impact_velocity == pytest.approx(float(velocity), rel=1e-12, abs=0)


def test_the_proof_and_the_panels_agree():
    """Two algorithms, one answer: single precision with a proof, and panels that cannot skip a crossing."""
    rng, count = np.random.default_rng(5), either(4_000, 20_000)
    proved = 0
    for _ in range(count):
        delta, epsilon, beta = rng.uniform(0.2, 1.5), rng.uniform(0, 0.4), rng.uniform(0.2, 1.2)
        wall, tau, w = int(rng.choice([1, -1])), rng.random(), 10 ** rng.uniform(-6, 1.17)
        w *= -wall
        flight = law.flight_from_phase(tau, w, delta, epsilon, forcing.DRIFT)
        ok, target, s, w1, *_ = first_impact.guess_first_impact(wall, tau, flight, beta)
        if ok:
            proved += 1
            march_status, march_target, march_s = panel_march.march(wall, tau, w, delta, epsilon, beta, forcing.DRIFT)
            assert (march_status, march_target) == (panel_march.FOUND, target)
            assert abs(march_s - s) <= 1e-13 * s + 1e-14 / abs(w1)
    assert 0.4 * count < proved < 0.975 * count  # both outcomes of the proof were really exercised


def test_a_flight_with_a_maximum_inside_is_not_skipped():
    """Φ'' < 0 on part of this flight from the reference set: the paper's one-minimum picture fails."""

    def bends_down(case):
        w, d, e = case["velocity"], case["delta"], case["epsilon"]
        theta = 2 * np.pi * case["phase"]
        a = 4 * np.pi - 2 * np.pi * e * np.sin(theta) - w
        s = np.linspace(0, float(case["flight_time"]), 400)
        return (d * a * np.exp(-d * s) - 4 * np.pi**2 * e * np.cos(theta + 2 * np.pi * s)).min() < 0

    assert sum(bends_down(case) for case in FLIGHTS) > 20


@pytest.mark.parametrize(
    ("wall", "phase", "velocity"),
    [(0, 0.1, -1.0), (2, 0.1, -1.0), (1, float("nan"), -1.0), (1, 0.1, 1.0), (-1, 0.1, -1.0), (1, 0.1, 0.0),
     (1, 0.1, float("inf")), (1, "x", -1.0)],
)  # fmt: skip
def test_bad_departures_are_refused(wall, phase, velocity):
    with pytest.raises(rattle.ParameterError):
        rattle.Gear(0.6, 0.1).first_impact(wall, phase, velocity)
