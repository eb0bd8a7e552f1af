"""The capture criterion against long simulation: what it calls quiet never comes back, and it is not timid."""

import numpy as np
import pytest
from depth import either

import rattle
from rattle.flight import forcing
from rattle.flight.forcing import DRIFT
from rattle.impacting.map import impact_map
from rattle.impacting.map.quiet import capture_invariant_limit


def contact_force(tau, delta, epsilon):
    theta = 2 * np.pi * tau
    return forcing.contact_force(np.sin(theta), np.cos(theta), delta, epsilon, DRIFT)


def history(delta, epsilon, beta, tau, v, periods, most=200_000):
    """I e^(δt) relative to its start at every impact, the final speed, and whether Σ⁻ was ever touched."""
    start, t, ratios, touched = v**3 / contact_force(tau, delta, epsilon), 0.0, [], False
    for _ in range(most):
        status, tau, v, s, below = impact_map.apply_impact_map(tau, v, delta, epsilon, beta, DRIFT)
        assert status == 0
        t += s
        touched |= below > 0
        ratios.append(v**3 / contact_force(tau, delta, epsilon) * np.exp(delta * t) / start)
        if t > periods:
            break
    return np.array(ratios), v, touched


def adiabatic(ratios):
    return ratios.min() > 0.75 and ratios.max() < 1.35


@pytest.mark.parametrize("seed", range(either(20, 60)))
def test_captured_motion_follows_the_adiabatic_law(seed):
    rng = np.random.default_rng([seed, 33])
    delta, beta, tau = 10 ** rng.uniform(-1.3, 0.3), rng.uniform(0.1, 1.5), rng.random()
    epsilon = rng.uniform(0.0, 0.97) * rattle.Gear(delta, 0).quiet_limit
    v = (capture_invariant_limit(delta, epsilon, beta) * contact_force(tau, delta, epsilon)) ** (1 / 3)
    periods = min(3 / delta, 12)
    ratios, final, touched = history(delta, epsilon, beta, tau, v, periods)
    assert final < v
    assert not touched
    assert adiabatic(ratios)
    assert abs(np.log(ratios[-1])) < 0.5 * delta * periods  # decay dominates the kicks


def test_the_speed_falls_by_a_third_of_the_damping_per_period():
    """model.md: δ = 0.6 gives a factor 0.8187 per period."""
    delta, epsilon, tau = 0.6, 0.05, 0.2
    speeds = []
    v, t = 0.05, 0.0
    while t < 9.5:
        _, tau, v, s, _ = impact_map.apply_impact_map(tau, v, delta, epsilon, 0.6, DRIFT)
        if int(t + s) > int(t):
            speeds.append(v / contact_force(tau, delta, epsilon) ** (1 / 3))
        t += s
    rates = np.array(speeds[1:]) / speeds[:-1]
    assert np.exp(np.log(rates).mean()) == pytest.approx(np.exp(-delta / 3), abs=2e-3)


def test_the_law_fails_well_above_the_criterion():
    """The check above can fail: at 125 times the invariant (5 times the speed) the motion is not adiabatic."""
    broken = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        delta, tau = rng.uniform(0.2, 1.0), rng.random()
        epsilon = 0.7 * rattle.Gear(delta, 0).quiet_limit
        v = 5 * (capture_invariant_limit(delta, epsilon, 5.0) * contact_force(tau, delta, epsilon)) ** (1 / 3)
        ratios, _, _ = history(delta, epsilon, 5.0, tau, v, 6)
        broken.append(not adiabatic(ratios))
    assert sum(broken) > 10


def test_no_capture_at_or_above_the_quiet_limit():
    for delta in np.linspace(0.05, 2, 40):
        limit = float(rattle.quiet_limit(delta))
        assert rattle.Gear(delta, limit).capture_speed < 1e-9
        assert rattle.Gear(delta, limit * 1.0001).capture_speed == 0.0
        assert rattle.Gear(delta, limit * 0.9).capture_speed > 1e-3 * delta


def test_the_criterion_adapts_to_all_three_parameters():
    base = rattle.Gear(0.6, 0.1).capture_speed
    assert rattle.Gear(0.6, 0.15).capture_speed < base
    assert rattle.Gear(1.2, 0.1).capture_speed > base
    assert rattle.Gear(0.6, 0.1, 0.001).capture_speed < base
