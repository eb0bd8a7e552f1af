"""The impact law: what its parts say of one impact, and what motions show of their product."""

import math

import numpy as np
import pytest

import rattle
from rattle.flight import impact_law
from rattle.flight.forcing import DRIFT
from rattle.flight.impact_law import ELASTIC
from rattle.impacting.map.impact_map import apply_impact_map_with_tangent


def test_an_elastic_impact_turns_the_velocity_and_keeps_the_energy():
    for w in (-7.0, -1e-3, 0.25, 3.0):
        after = impact_law.reflected_velocity(w)
        assert abs(after) == abs(w)
        assert after * w < 0
        assert impact_law.velocity_before_reflection(after) == w
        assert impact_law.impact_mismatch(w, after) == 0.0
        assert impact_law.impulse_of(abs(w)) == abs(after - w)
        assert ELASTIC.energy_loss(w) == w**2 / 2 - after**2 / 2
        step = 1e-6
        change = (impact_law.reflected_velocity(w + step) - impact_law.reflected_velocity(w - step)) / (2 * step)
        assert impact_law.velocity_change_after_elastic_impact(1.0) == pytest.approx(change, rel=1e-9)
        energy = (impact_law.reflected_velocity(w + step) ** 2 - impact_law.reflected_velocity(w - step) ** 2) / (
            4 * step
        )
        assert ELASTIC.energy_change(w, 1.0) == pytest.approx(energy, rel=1e-8)
    assert not ELASTIC.chatter_completes


def test_determinants_of_motions_are_what_the_law_says():
    rng = np.random.default_rng(58)
    for _ in range(100):
        delta, epsilon, beta = rng.uniform(0.1, 1.5), rng.uniform(0, 0.4), rng.uniform(0.2, 1.2)
        status, _t, _v, time, n_minus, *_j, log_det = apply_impact_map_with_tangent(
            rng.random(), rng.uniform(0.3, 12.0), delta, epsilon, beta, DRIFT, True
        )
        if status == 0:
            assert log_det == pytest.approx(impact_law.log_determinant(delta, time, 1 + n_minus), abs=1e-9)
            exact = math.exp(-delta * time)
            assert impact_law.determinant(delta, time, 1 + n_minus) == pytest.approx(exact, rel=1e-15)
            assert ELASTIC.determinant(delta, time, 1 + n_minus) == pytest.approx(exact, rel=1e-15)


def test_multipliers_and_exponents_have_the_product_and_the_sum_of_the_law():
    gear = rattle.Gear(0.6, 0.1)
    for orbit in gear.orbits():
        expected = ELASTIC.determinant(0.6, orbit.m, orbit.n_plus + orbit.n_minus)
        assert np.prod(orbit.multipliers) == pytest.approx(expected, rel=1e-12)
    for each in gear.attractors(count=64):
        if each.kind in ("periodic", "chaotic"):
            assert sum(each.lyapunov) == pytest.approx(ELASTIC.lyapunov_exponent_sum(0.6, math.nan), abs=1e-9)
