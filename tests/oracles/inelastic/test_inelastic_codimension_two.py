"""COD20 to COD23 as curves in (δ, ε, r)."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

import rattle
from rattle import inelastic
from rattle.inelastic import InelasticGear, follow_codimension_two
from rattle.models import Inelastic

POINTS = ("COD20", "COD21", "COD23", "COD22")
Q = 4 * math.pi


def trace_at_graze(curve: rattle.curves.Curve) -> np.ndarray:
    return curve.multipliers.sum(axis=0).real


@pytest.mark.parametrize("name", POINTS)
def test_it_begins_at_the_point_of_the_elastic_gear(name: str) -> None:
    (known,) = (each for each in rattle.curves.codimension_two() if each.name == name)
    curve = follow_codimension_two(name)
    assert (curve.delta[0], curve.epsilon[0]) == pytest.approx((known.delta, known.epsilon), abs=1e-11)
    assert curve.residual.max() < 1e-9
    if name == "COD22":  # there the force presses on Σ⁺ at the departure, and a slow motion comes back at once
        assert curve.end == "the flight after impact 0 on Σ⁺ touches Σ⁺ on its way"
        assert 0.03 < curve.restitution[-1] < 0.033
        for r, returns in ((0.032, 1.0), (0.0305, 0.0)):
            delta = curve.delta[-1] + (r - curve.restitution[-1]) * np.gradient(curve.delta, curve.restitution)[-1]
            found = InelasticGear(delta, inelastic.epsilon_of_saddle_node(delta, r, Q), 0.601, r).first_impact(
                1, 0.75, -r * delta * Q / (1 + r)
            )
            assert found.next_wall == 1
            assert round(found.flight_time) == returns, (r, found)
    else:
        assert curve.end == "restitution = 0.001"
    assert curve.at(1.0) == pytest.approx((known.delta, known.epsilon), abs=1e-11)


@pytest.mark.parametrize("name", POINTS)
def test_the_motion_grazes_and_meets_its_condition(name: str) -> None:
    """By the return map: the motion just misses the wall a little below, and touches it a little above."""
    curve = follow_codimension_two(name)
    for r in (0.95, 0.8, 0.5, 0.2):
        delta, epsilon = curve.at(r)
        i = int(np.argmin(np.abs(curve.restitution - r)))
        assert (curve.delta[i], curve.epsilon[i]) == pytest.approx((delta, epsilon), abs=0.02)
        speed = r * delta * Q / (1 + r)
        decay = math.exp(-delta)
        offset = (speed + Q - Q * delta / (1 - decay)) / (2 * math.pi)
        cosine = math.sqrt(max(epsilon**2 - offset**2, 0.0))
        trace = 1 + r * r * decay - (1 + r) ** 2 * math.pi * (1 - decay) * cosine / delta**2
        wanted = {"COD20": -1 - r * r * decay, "COD21": 2 * r * math.exp(-delta / 2), "COD22": 1 + r * r * decay}
        if name in wanted:
            assert trace == pytest.approx(wanted[name], abs=1e-6)  # at COD22 the root of ε² − offset²
        wider, narrower = (InelasticGear(delta, epsilon * (1 + 1e-9), 0.6 * x, r) for x in (1.001, 0.999))
        tau = math.atan2(offset, cosine) / (2 * math.pi) % 1.0
        assert wider.impact(tau, speed).n_minus == 0
        assert narrower.impact(tau, speed).n_minus > 0


@pytest.mark.parametrize("r", [0.98, 0.9, 0.8, 0.6])
def test_curves_of_the_plane_meet_there(r: float) -> None:
    """A second computation: the traced curves of one restitution, crossed by themselves."""
    window = {"delta": (0.3, 1.0), "epsilon": (0.0, 0.8)}
    graze = inelastic.trace("G1", 0.6, r, **window)
    order = np.argsort(graze.delta)

    def above(delta: float, other: float) -> float:
        return graze.at(delta=delta)[0] - other

    delta20, epsilon20 = follow_codimension_two("COD20").at(r)
    crossed = brentq(
        lambda d: above(d, inelastic.epsilon_of_flip_of_c(d, r, Q)), delta20 - 0.05, delta20 + 0.05, xtol=1e-13
    )
    assert crossed == pytest.approx(delta20, abs=1e-9)
    assert inelastic.epsilon_of_flip_of_c(crossed, r, Q) == pytest.approx(epsilon20, abs=1e-9)

    # SN1 touches the graze: its motion has τ = 3/4, to which the phase along G1 rises as a smooth function of ε
    delta22, epsilon22 = follow_codimension_two("COD22").at(r)
    last = order[-1]
    assert (graze.delta[last], graze.epsilon[last]) == pytest.approx((delta22, epsilon22), abs=1e-8)
    assert inelastic.epsilon_of_saddle_node(delta22, r, Q) == pytest.approx(epsilon22, abs=1e-12)

    delta21, epsilon21 = follow_codimension_two("COD21").at(r)
    apart = trace_at_graze(graze) - 2 * r * np.exp(-graze.delta / 2)
    near = order[np.abs(graze.delta[order] - delta21) < 0.08]
    fit = np.polynomial.Polynomial.fit(apart[near], graze.delta[near], min(6, near.size - 1))
    assert fit(0.0) == pytest.approx(delta21, abs=1e-5)
    assert graze.at(delta=delta21)[0] == pytest.approx(epsilon21, abs=1e-10)

    delta23, epsilon23 = follow_codimension_two("COD23").at(r)
    for name in ("SN2", "PD1"):
        curve = inelastic.trace(name, 0.6, r, **window)
        last = int(np.argmax(curve.delta))
        assert (curve.delta[last], curve.epsilon[last]) == pytest.approx((delta23, epsilon23), abs=1e-6)


def test_points_of_a_plane() -> None:
    found = {each.name: each for each in Inelastic(0.9, 0.8, 0.5).codimension_two()}
    assert set(found) == set(POINTS)
    for name, each in found.items():
        delta, epsilon = follow_codimension_two(name).at(0.8)  # β = 0.6, without load
        assert (each.delta, each.epsilon) == pytest.approx((delta, 1.5 * epsilon), abs=1e-12)


def test_what_is_refused() -> None:
    with pytest.raises(rattle.ParameterError, match="name must be"):
        follow_codimension_two("COD7")
    with pytest.raises(rattle.RattleError, match=r"COD20 is known for a restitution from 0.001 to 1, got 0.0001"):
        follow_codimension_two("COD20").at(0.0001)
    with pytest.raises(rattle.RattleError, match="no COD22 of the elastic gear was found"):
        follow_codimension_two("COD22", 1e-8)
    table = follow_codimension_two("COD22").to_dataframe()
    assert list(table) == ["delta", "epsilon", "restitution", "tau", "speed"]
