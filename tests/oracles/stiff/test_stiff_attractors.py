"""Attractors and basins of the stiff gear: sum rule, labels that solve the equations, shares of the impacting limit."""

import numpy as np
import pytest
from depth import either

import rattle
from rattle.stiff import StiffGear
from rattle.stiff.map.return_map import StiffPoint, step


def names(attractors):
    return [(x.kind, x.m, x.n_plus, x.n_minus) for x in attractors]


@pytest.mark.parametrize(("epsilon", "kappa"), [(0.0615, 1e5), (0.089, 1e4), (0.1, 1e4), (0.2, 300.0), (0.12, 3e3)])
def test_exponents_sum_to_the_damping(epsilon: float, kappa: float) -> None:
    for attractor in StiffGear(0.6, epsilon, 0.6, kappa).attractors(64):
        if attractor.kind in ("periodic", "chaotic"):
            assert sum(attractor.lyapunov) == pytest.approx(-0.6, abs=1e-11)


def test_chaos_is_seen() -> None:
    chaotic = [x for x in StiffGear(0.6, 0.12, 0.6, 3e3).attractors(64) if x.kind == "chaotic"]
    assert len(chaotic) == 1
    assert chaotic[0].lyapunov[0] > 20 * chaotic[0].lyapunov_error > 0


@pytest.mark.parametrize(("delta", "epsilon", "beta", "kappa"), [(0.6, 0.089, 0.6, 1e4), (0.3, 0.1, 0.3, 200.0)])
def test_periodic_attractors_are_stable_solutions(delta: float, epsilon: float, beta: float, kappa: float) -> None:
    gear = StiffGear(delta, epsilon, beta, kappa)
    found = [x for x in gear.attractors(128) if x.kind == "periodic"]
    assert found
    for x in found:
        orbit = gear.orbit(x.tau, x.v, x.n_plus)
        assert orbit.stable
        assert orbit.label == (x.m, x.n_plus, x.n_minus)
        assert np.log(abs(orbit.multipliers[0])) / x.m == pytest.approx(x.lyapunov[0], abs=1e-7)
        assert orbit.v == pytest.approx(x.v, abs=1e-8)


def test_shares_converge_to_those_of_the_impacting_model() -> None:
    """The same initial conditions (τ, v): Figure 4 at ε = 0.0615, where basins are plain."""
    limit = rattle.Gear(0.6, 0.0615).attractors(256)
    off = []
    for kappa in (1e2, 1e4, 1e6):
        found = StiffGear(0.6, 0.0615, 0.6, kappa).attractors(256)
        assert names(found) == names(limit)
        off.append(abs(found[0].fraction - limit[0].fraction))
    assert off[0] > off[1] > off[2]
    assert off[2] < 0.012


def test_rest_attracts_below_its_limit_only() -> None:
    for delta, kappa, rests in ((0.6, 1e2, True), (0.6, 19.0, False), (2.0, 1.0, False), (0.2, 1e4, True)):
        limit = StiffGear(delta, 0.1, 0.6, kappa).quiet_limit
        below = StiffGear(delta, 0.5 * limit, 0.6, kappa).attractors(32)
        above = StiffGear(delta, 1.03 * limit, 0.6, kappa).attractors(32)
        if rests:  # elsewhere its basin may be too small for the sample
            assert "quiet" in [x.kind for x in below]
        assert "quiet" not in [x.kind for x in above]
        assert sum(x.fraction for x in above) == pytest.approx(1.0)


def test_basins_are_those_of_single_trajectories() -> None:
    gear = StiffGear(0.6, 0.089, 0.6, 1e3)
    cells, direct = gear.basins(60, method="cells"), gear.basins(60, method="direct")
    refined = gear.basins(60, method="refined")
    assert rattle.disagreement(cells, direct) < 0.05
    assert rattle.disagreement(refined, direct) < 0.005
    rng = np.random.default_rng(0)
    point = StiffPoint(0.6, 0.089, 0.6, 1e3)
    for i, j in rng.integers(0, 60, (either(12, 40), 2)):
        attractor = direct.attractors[direct.labels[i, j]]
        tau, v, status = direct.tau[j], direct.v[i], 0
        for _ in range(3000):
            status, tau, v, *_ = step(tau, v, point)
            if status:
                break
        assert (attractor.kind == "quiet") == (status != 0)
        if attractor.kind == "periodic":
            orbit = gear.orbit(tau, v, attractor.n_plus)
            assert orbit.label == (attractor.m, attractor.n_plus, attractor.n_minus)


def test_results_depend_on_nothing_but_the_arguments() -> None:
    gear = StiffGear(0.6, 0.1, 0.6, 1e3)
    assert repr(gear.attractors(64)) == repr(gear.attractors(64))
    first, again = gear.uncertainty(256), gear.uncertainty(256)
    np.testing.assert_array_equal(first.fractions, again.fractions)
    assert np.all(first.pairs == 256)


@pytest.mark.parametrize("kappa", [1.0, 2 * np.pi**2, 1e10])
def test_hostile_parameters_are_told_something(kappa: float) -> None:
    for delta, epsilon, beta in ((0.05, 0.0, 0.1), (5.0, 1.0, 2.0), (5.0, 0.0, 0.6)):
        found = StiffGear(delta, epsilon, beta, kappa).attractors(16, budget=10_000)
        assert sum(x.fraction for x in found) == pytest.approx(1.0)
