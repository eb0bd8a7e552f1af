"""Invariants of the impact map that no formula in the library was fitted to."""

import numpy as np
import pytest
from depth import either
from hypothesis import given, settings
from hypothesis import strategies as st

import rattle
from rattle.flight.forcing import DRIFT
from rattle.impacting.map import impact_map

points = st.builds(
    rattle.Gear,
    delta=st.floats(0.1, 2.0),
    epsilon=st.floats(0.0, 0.5),
    beta=st.floats(0.1, 2.0),
)
phases = st.floats(0.0, 1.0, exclude_max=True)
speeds = st.floats(1e-4, 12.0)


@settings(max_examples=either(100, 300))
@given(points, phases, speeds)
def test_determinant_in_energy_coordinates_is_the_damping_over_the_flight(gear, tau, v):
    found = impact_map.apply_impact_map_with_tangent(tau, v, gear.delta, gear.epsilon, gear.beta, DRIFT, True)
    status, _, v1, time, *_, j00, j01, j10, j11, log_det = found
    assert status == 0
    assert log_det == pytest.approx(-gear.delta * time, abs=1e-9 / min(v, v1, 1.0))
    product = j00 * j11 - j01 * j10
    size = max(abs(j00 * j11), abs(j01 * j10))
    assert product == pytest.approx(np.exp(-gear.delta * time), abs=1e-10 * size + 1e-9)


@settings(max_examples=either(100, 300))
@given(points, phases, speeds)
def test_inverse_undoes_the_map(gear, tau, v):
    forward = gear.impact(tau, v)
    back = gear.inverse_impact(forward.tau, forward.v)
    condition = np.abs(np.linalg.inv(forward.tangent)).max() + 1
    if back.n_minus == forward.n_minus:  # at a graze the two may disagree by rounding
        assert abs((back.tau - tau + 0.5) % 1 - 0.5) < 1e-12 * condition
        assert abs(back.v - v) < 1e-12 * condition * max(v, 1)
        assert back.time == pytest.approx(forward.time, abs=1e-12 * condition)
    else:
        assert condition > 1e5


@settings(max_examples=either(60, 150))
@given(points, phases, st.floats(0.05, 10.0))
def test_tangent_is_the_derivative(gear, tau, v):
    step = gear.impact(tau, v)
    h = 1e-6
    for column, (dt, dv) in enumerate([(h, 0.0), (0.0, h)]):
        ahead, behind = gear.impact(tau + dt, v + dv), gear.impact(tau - dt, v - dv)
        if {ahead.n_minus, behind.n_minus} != {step.n_minus}:
            return  # the difference straddles Γ, where Π has no derivative
        change = [(ahead.tau - behind.tau + 0.5) % 1 - 0.5, ahead.v - behind.v]
        scale = np.abs(step.tangent).max()
        np.testing.assert_allclose(np.array(change) / (2 * h), step.tangent[:, column], atol=1e-4 * scale**3 + 1e-4)


def test_differences_do_straddle_rarely():
    """Guards the test above against returning early every time."""
    rng = np.random.default_rng(0)
    gear = rattle.Gear(0.6, 0.1)
    same = [
        gear.impact(t + 1e-6, v).n_minus == gear.impact(t - 1e-6, v).n_minus
        for t, v in zip(rng.random(300), rng.uniform(0.05, 10, 300), strict=True)
    ]
    assert np.mean(same) > 0.98


@settings(max_examples=either(25, 60))
@given(points, phases, speeds, st.integers(0, 12))
def test_iterate_repeats_the_map(gear, tau, v, n):
    """Step by step: another order of rounding, which the next steps may amplify, is the only difference."""
    t, speed = tau, v
    for _ in range(n):
        found, step = gear.iterate(t, speed, 1), gear.impact(t, speed)
        assert (int(found.n_plus), int(found.n_minus)) == (1, step.n_minus)
        tolerance = 1e-13 * (1 + np.abs(step.tangent).max())
        assert abs((found.tau - step.tau + 0.5) % 1 - 0.5) < tolerance
        assert abs(found.v - step.v) < tolerance
        t, speed = step.tau, step.v


def test_iterate_broadcasts_and_keeps_elements_apart():
    gear = rattle.Gear(0.6, 0.1)
    tau, v = np.linspace(0, 0.9, 5)[:, None], np.linspace(1, 6, 4)
    whole = gear.iterate(tau, v, 20)
    assert whole.tau.shape == (5, 4)
    assert whole.n_minus.dtype == np.int64
    one = gear.iterate(tau[3, 0], v[2], 20)
    assert (whole.tau[3, 2], whole.v[3, 2]) == (one.tau, one.v)


@pytest.mark.parametrize(
    ("tau", "v", "n"),
    [
        (0.1, 0.0, 3),
        (0.1, -1.0, 3),
        (np.nan, 1.0, 3),
        (0.1, np.inf, 3),
        (0.1, 1.0, -1),
        (0.1, 1.0, 1.5),
        ([1, 2], [1, 2, 3], 1),
    ],
)
def test_iterate_refuses_bad_states(tau, v, n):
    with pytest.raises(rattle.ParameterError):
        rattle.Gear(0.6, 0.1).iterate(tau, v, n)
