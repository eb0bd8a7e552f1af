"""Iteration of the stiff gear over arrays against scipy's integrator, finite differences, and the impacting limit."""

import numpy as np
import pytest
from stiff_high_precision import integrated

import rattle
from rattle.errors import ParameterError
from rattle.stiff import StiffGear, iterate, iterate_tangent
from rattle.stiff.map.quiet import quiet_depth

RNG = np.random.default_rng(5)
DELTA, EPSILON = RNG.uniform(0.4, 1.0, 40), RNG.uniform(0.15, 0.3, 40)
TAU, V, KAPPA = RNG.random(40), RNG.uniform(0.5, 6.0, 40), 10 ** RNG.uniform(2, 6, 40)


def test_three_returns_agree_with_solve_ivp() -> None:
    for i in range(2):
        delta, epsilon, kappa = DELTA[i], EPSILON[i], 10.0 ** (2 + i)
        found = iterate_tangent(delta, epsilon, TAU[i], V[i], 3, kappa=kappa)
        begun, ended = 1e-4, 1e-4  # in the gap, not on the wall
        position, velocity, *_ = StiffGear(delta, epsilon, 0.6, kappa).flight(0.6, -V[i], TAU[i], begun)
        duration = float(found.time) - begun + ended
        end = integrated(TAU[i] + begun, position, velocity, duration, delta, epsilon, 0.6, kappa)
        after = StiffGear(delta, epsilon, 0.6, kappa).flight(0.6, -float(found.v), float(found.tau), ended)
        np.testing.assert_allclose(end[:2], after[:2], atol=1e-6)
        assert end[2:] == (found.n_plus, found.n_minus)


def test_elements_do_not_depend_on_one_another() -> None:
    n = np.arange(40) % 7
    whole = iterate(DELTA, EPSILON, TAU, V, n, 0.6, KAPPA)
    for i in range(0, 40, 5):
        tau, v, below = TAU[i], V[i], 0
        for _ in range(n[i]):
            step = StiffGear(DELTA[i], EPSILON[i], 0.6, KAPPA[i]).impact(tau, v)
            tau, v, below = step.tau, step.v, below + step.n_minus
        assert (whole.tau[i], whole.v[i], whole.n_plus[i], whole.n_minus[i]) == (tau, v, n[i], below)
    table = StiffGear(0.6, 0.2, 0.6, 1e3).iterate(TAU[:3, None], V[:4], 2)
    assert table.tau.shape == (3, 4)
    assert table.v[2, 1] == iterate(0.6, 0.2, TAU[2], V[1], 2, 0.6, 1e3).v


def test_exponents_are_those_of_finite_differences_and_sum_to_the_damping() -> None:
    found, h = iterate_tangent(DELTA, EPSILON, TAU, V, 2, 0.6, KAPPA), 1e-7
    there, here = (iterate(DELTA, EPSILON, TAU + side * h, V, 2, 0.6, KAPPA) for side in (1, -1))
    stretch = np.hypot((there.tau - here.tau + 0.5) % 1 - 0.5, 0.5 * (there.v**2 - here.v**2)) / (2 * h)
    same = (there.n_minus == here.n_minus) & (stretch < 1e3)  # where a contact is light slopes change within h
    assert same.sum() > 25
    np.testing.assert_allclose(found.lyapunov[0][same], (np.log(stretch) / found.time)[same], atol=2e-4)
    long = iterate_tangent(DELTA, EPSILON, TAU, V, 500, 0.6, KAPPA)
    np.testing.assert_allclose(long.lyapunov.sum(axis=0), -DELTA, atol=1e-9)


def test_the_limit_is_the_impacting_map() -> None:
    """The difference falls as κ^(−1/2) if no contact with Σ⁻ is light."""
    limit = rattle.iterate_tangent(DELTA, EPSILON, TAU, V, 2)
    off = []
    for kappa in (1e6, 1e8, 1e10):
        found = iterate_tangent(DELTA, EPSILON, TAU, V, 2, 0.6, kappa)
        off.append(np.abs(np.stack([found.tau - limit.tau, found.v - limit.v, *(found.lyapunov - limit.lyapunov)])))
    regular = (off[0] < 0.1).all(axis=0)
    assert regular.sum() >= 25
    for more, less in ((off[0], off[1]), (off[1], off[2])):
        large = (more > 1e-6) & regular
        assert np.median(more[large] / less[large]) == pytest.approx(10.0, rel=0.05)


def test_a_motion_that_becomes_quiet_keeps_its_last_departure() -> None:
    gear = StiffGear(0.6, 0.1, 0.6, 1e3)
    end = gear.iterate(0.2, 1.0, 10_000)
    assert 5 < end.n_plus < 10_000
    with pytest.raises(rattle.RattleError, match="quiet"):
        gear.impact(float(end.tau), float(end.v))
    assert end == gear.iterate(end.tau, end.v, 0)._replace(n_plus=end.n_plus, n_minus=end.n_minus)
    again = gear.flight(0.6, -float(end.v), float(end.tau), 60.0)
    depth, velocity = quiet_depth(0.6, 0.1, 1e3, float(end.tau) + 60.0)
    assert (again.position - 0.6, again.velocity) == pytest.approx((float(depth), float(velocity)), abs=1e-9)


def test_hostile_input_is_refused() -> None:
    for bad in ({"kappa": 0.0}, {"kappa": np.nan}, {"v": 0.0}, {"n": 1.5}, {"kappa": [1.0, 2.0, 3.0]}):
        with pytest.raises(ParameterError, match="must"):
            iterate(**({"delta": 0.6, "epsilon": 0.1, "tau": [0.1, 0.2], "v": 3.0, "n": 1} | bad))
