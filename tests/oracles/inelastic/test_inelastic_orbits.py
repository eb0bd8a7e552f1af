"""Period-one motions with restitution in closed form, any periodic motion, exponents and multipliers."""

import math

import numpy as np
import pytest
from depth import either

import rattle
from rattle import inelastic
from rattle.inelastic import InelasticGear

DRIFT = 4 * math.pi


@pytest.mark.parametrize(
    ("r", "born", "flip"),
    [
        (1.0, 0.0596430582, 0.2055258549),
        (0.9, 0.0912220056, 0.2227891783),
        (0.8, 0.1263097249, 0.2466397644),
    ],
)
def test_limits(r: float, born: float, flip: float) -> None:
    assert inelastic.epsilon_of_saddle_node(0.6, r, DRIFT) == pytest.approx(born, abs=1e-9)
    assert inelastic.epsilon_of_flip_of_c(0.6, r, DRIFT) == pytest.approx(flip, abs=1e-9)


def test_limits_of_elastic_impacts_are_those_of_the_elastic_gear() -> None:
    for delta in (0.45, 0.6, 0.8):
        assert inelastic.epsilon_of_saddle_node(delta, 1.0, DRIFT) == pytest.approx(
            float(rattle.sn1(delta, virtual=True)), rel=1e-13
        )
    assert inelastic.epsilon_of_flip_of_c(0.5, 1.0, DRIFT) == pytest.approx(
        float(rattle.flip(0.5, virtual=True)), rel=1e-13
    )
    assert inelastic.quiet_limit(0.6, DRIFT) == pytest.approx(float(rattle.quiet_limit(0.6)), rel=1e-14)


@pytest.mark.parametrize(
    ("delta", "epsilon", "r"), [(0.6, 0.1, 0.9), (0.6, 0.2, 0.7), (0.45, 0.12, 0.8), (0.6, 0.1, 1.0)]
)
def test_a_and_c_close_and_have_their_multipliers(delta: float, epsilon: float, r: float) -> None:
    gear = InelasticGear(delta, epsilon, 0.6, r)
    found = {each.name: each for each in gear.orbits()}
    assert "A" in found
    for each in found.values():
        step = gear.impact(each.tau, each.v)
        assert abs(step.tau - each.tau) < 1e-11
        assert abs(step.v - each.v) < 1e-11
        trace, determinant = sum(each.multipliers), math.prod(each.multipliers)
        assert np.trace(step.tangent) == pytest.approx(trace.real, abs=1e-8)
        assert np.linalg.det(step.tangent) == pytest.approx(determinant.real, abs=1e-9)
        assert determinant.real == pytest.approx(r ** (2 * (1 + each.n_minus)) * math.exp(-delta), rel=1e-9)


@pytest.mark.parametrize("load", [0.0, 0.7])
def test_the_tangent_is_the_derivative(load: float) -> None:
    """Central differences of the map, with harmonics and both walls."""
    rng = np.random.default_rng(5)
    gear = InelasticGear(0.5, 0.15, 0.4, 0.8, load, [(3, 0.05, 0.3), (7, 0.01, 0.6)])
    done = 0
    while done < 40:
        tau, v = float(rng.random()), float(rng.uniform(1.0, 6.0))
        step, h = gear.impact(tau, v), 1e-6
        moved = [gear.impact(tau + a * h, v + b * h) for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1))]
        if len({each.n_minus for each in (step, *moved)}) > 1 or abs(step.tangent).max() > 50:
            continue
        done += 1
        columns = []
        for plus, minus in (moved[:2], moved[2:]):
            apart = (plus.tau - minus.tau + 0.5) % 1.0 - 0.5
            columns.append([apart / (2 * h), (plus.v - minus.v) / (2 * h)])
        assert pytest.approx(step.tangent, abs=3e-6 * (1 + abs(step.tangent).max() ** 2)) == np.array(columns).T


def test_elastic_period_one_motions_are_those_of_the_elastic_gear() -> None:
    for delta, epsilon in ((0.6, 0.072), (0.6, 0.2), (0.5, 0.25), (0.76, 0.2)):
        ours = InelasticGear(delta, epsilon, 0.6).orbits()
        theirs = rattle.Gear(delta, epsilon, 0.6).orbits()
        assert [each.name for each in ours] == [each.name for each in theirs]
        for one, other in zip(ours, theirs, strict=True):
            assert one.tau == pytest.approx(other.tau, abs=1e-8)
            assert one.v == pytest.approx(other.v, abs=1e-8)
            assert one.multipliers == pytest.approx(other.multipliers, abs=1e-6)


@pytest.mark.parametrize("harmonics", [(), [(2, 0.1, 0.2), (5, 0.02, 0.9)]])
def test_multipliers_of_any_motion(harmonics: list) -> None:
    """Their product is e^(−δm) r^(2n), and it is the determinant of the product of the tangents."""
    rng, seen = np.random.default_rng(1), 0
    for _ in range(either(12, 60)):
        delta, r = float(rng.uniform(0.3, 0.8)), float(rng.uniform(0.6, 0.98))
        gear = InelasticGear(delta, float(rng.uniform(0.1, 0.3)), 0.6, r, 0.0, harmonics)
        for x in gear.attractors(32):
            if x.kind != "periodic" or x.contacts:
                continue
            orbit = gear.orbit(x.tau, x.v, x.n_plus)
            assert (orbit.m, orbit.n_plus, orbit.n_minus, orbit.contacts) == (x.m, x.n_plus, x.n_minus, 0)
            impacts = x.n_plus + x.n_minus
            product = math.prod(orbit.multipliers)
            assert product.real == pytest.approx(math.exp(-delta * x.m) * r ** (2 * impacts), rel=1e-9)
            tangent, tau, v = np.eye(2), orbit.tau, orbit.v
            for _ in range(orbit.n_plus):
                tau, v, _below, each, _time = gear.impact(tau, v)
                tangent = each @ tangent
            assert np.linalg.det(tangent) == pytest.approx(product.real, rel=1e-6)
            assert np.trace(tangent) == pytest.approx(sum(orbit.multipliers).real, rel=1e-6, abs=1e-6)
            assert sum(x.lyapunov) == pytest.approx(-delta + 2 * math.log(r) * impacts / x.m, abs=1e-9)
            seen += 1
    assert seen > 5


def test_sum_of_exponents() -> None:
    """λ₁ + λ₂ = −δ + 2 ln r times the impacts per period, in chaos too."""
    n = 4000
    found = inelastic.iterate_tangent(0.45, 0.3, 0.2, 3.0, n, 0.6, restitution=0.8)
    rate = float((found.n_plus + found.n_minus) / found.time)
    assert float(found.lyapunov.sum()) == pytest.approx(-0.45 + 2 * math.log(0.8) * rate, abs=1e-10)
    assert float(found.lyapunov[0]) > 0.05


def test_impulses_balance_the_drift() -> None:
    """(1 + r)(Σv₊ − Σv₋) of arrivals is δq a period, of motions without contact."""
    for r, load, harmonics in ((0.9, 0.0, ()), (0.8, 0.5, [(3, 0.05, 0.1)])):
        gear = InelasticGear(0.6, 0.25, 0.6, r, load, harmonics)
        for x in gear.attractors(32):
            if x.kind != "periodic" or x.contacts:
                continue
            motion = gear.trajectory(x.tau, x.v, x.m + 1e-9, 10)
            impulse = (1 + r) * float((motion.impact_wall * motion.impact_speed).sum())
            assert impulse / x.m == pytest.approx(0.6 * DRIFT * (1 + load), rel=1e-8)
