"""Period-one orbits and regions against the committed references, published values and the map itself."""

import json
from pathlib import Path

import numpy as np
import pytest
from depth import either
from mpmath import mp, mpf

import rattle

SIDE = either(300, 1000)  # of the plane
ORBITS = json.loads((Path(__file__).parents[2] / "reference" / "orbits.json").read_text())


@pytest.mark.parametrize("case", ORBITS, ids=lambda c: f"{c['delta']:.3f}-{c['epsilon']:.3f}-{c['beta']:.2f}")
def test_reference_orbits(case):
    gear = rattle.Gear(case["delta"], case["epsilon"], case["beta"])
    found = {orbit.name: orbit for orbit in gear.orbits()}
    assert gear.region() == (case["region"] or rattle.REGIONS.index("".join(sorted(case["orbits"]))))
    assert set(found) == set(case["orbits"])
    for name, orbit in found.items():
        expected = case["orbits"][name]
        assert orbit.tau == pytest.approx(expected["phase"], abs=1e-10)
        assert orbit.v == pytest.approx(expected["velocity"], abs=1e-10)
        assert max(abs(x) for x in orbit.multipliers) == pytest.approx(expected["spectral_radius"], rel=1e-9)
        assert orbit.stable == (expected["spectral_radius"] < 1)


def random_points(count, seed):
    rng = np.random.default_rng(seed)
    return rng.uniform(0.2, 1.5, count), rng.uniform(0, 0.4, count), rng.uniform(0.2, 1.2, count)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("delta", [1e-140, 1e-155])
def test_multipliers_are_numbers_as_far_as_double_precision_goes(delta):
    """The larger one of A is −4πε/δ to within δ/ε."""
    for orbit in rattle.Gear(delta, 0.1).orbits():
        large, small = orbit.multipliers
        assert abs(large) == pytest.approx(4 * np.pi * 0.1 / delta, rel=1e-14)
        assert large * small == pytest.approx(1.0, rel=1e-14)


def test_every_orbit_is_a_fixed_point_of_the_map_with_its_multipliers():
    """The closed form and the compiled map are independent derivations of the same motion."""
    delta, epsilon, beta = (x[: either(1000, 2000)] for x in random_points(2000, 8))
    found = rattle.period_one(delta, epsilon, beta)
    seen = np.zeros(4, int)
    for k, i in zip(*np.nonzero(found.exists), strict=True):
        step = rattle.Gear(delta[i], epsilon[i], beta[i]).impact(found.tau[k, i], found.v[k, i])
        size = np.abs(step.tangent).max()
        moved = (step.tau - found.tau[k, i] + 0.5) % 1 - 0.5
        assert max(abs(moved), abs(step.v - found.v[k, i])) < 1e-12 * size
        assert step.n_minus == k % 2
        multipliers = found.multipliers[k, :, i]
        assert abs(np.trace(step.tangent) - multipliers.sum()) < 1e-5 * size
        assert multipliers.prod() == pytest.approx(np.exp(-delta[i]), rel=1e-12)
        assert found.stable[k, i] == (abs(multipliers).max() < 1)
        seen[k] += 1
    assert seen.min() > 0.05 * delta.size


def test_five_regions_cover_the_plane_of_figure_seven():
    delta, epsilon = np.meshgrid(np.linspace(0.4, 1, SIDE), np.linspace(0.005, 0.3, SIDE))
    region = rattle.regions(delta, epsilon)
    assert region.dtype == np.int8
    assert set(np.unique(region)) == {1, 2, 3, 4, 5}


def test_regions_broadcast_and_follow_beta():
    region = rattle.regions(np.array([0.6, 0.8]), np.array([[0.03], [0.2]]), 0.6)
    assert region.shape == (2, 2)
    assert region.tolist() == [[1, 1], [5, 5]]
    delta, epsilon, beta = random_points(50, 3)
    assert [rattle.Gear(*p).region() for p in zip(delta, epsilon, beta, strict=True)] == rattle.regions(
        delta, epsilon, beta
    ).tolist()


def test_a_cell_does_not_depend_on_its_neighbours():
    delta, epsilon, beta = random_points(400, 4)
    whole = rattle.period_one(delta, epsilon, beta)
    shuffled = np.random.default_rng(1).permutation(400)
    again = rattle.period_one(delta[shuffled], epsilon[shuffled], beta[shuffled])
    for a, b in zip(whole, again, strict=True):
        np.testing.assert_array_equal(a[..., shuffled], b)


def test_analytic_limits_in_high_precision():
    rng = np.random.default_rng(0)
    for delta in [1e-3, 0.049, 0.051, 0.6, *rng.uniform(0.05, 3, 20)]:
        d = mpf(float(delta))
        coth = 1 / mp.tanh(d / 2)
        gear = rattle.Gear(delta, 0.0)
        sn1, flip = (float(limit(delta, virtual=True)) for limit in (rattle.sn1, rattle.flip))
        assert sn1 == pytest.approx(float(abs(2 - d * coth)), rel=1e-13)
        assert flip == pytest.approx(float(mp.hypot(2 - d * coth, d**2 * coth / (2 * mp.pi))), rel=1e-13)
        assert gear.quiet_limit == pytest.approx(float(2 * d / mp.sqrt(4 * mp.pi**2 + d**2)), rel=1e-14)


def test_published_and_known_values():
    assert rattle.Gear(0.6, 0).sn1 == pytest.approx(0.0596430582, abs=5e-11)
    assert rattle.Gear(0.762, 0).sn1 == pytest.approx(0.0958502413, abs=5e-11)
    assert rattle.Gear(0.5, 0).flip == pytest.approx(0.16767, abs=5e-6)
    for name, epsilon in (("B", 0.06874679), ("D", 0.06874679)):  # SN2 at δ = 0.6
        assert name not in [o.name for o in rattle.Gear(0.6, epsilon - 1e-8).orbits()]
        assert name in [o.name for o in rattle.Gear(0.6, epsilon + 1e-8).orbits()]
    stable = [{o.name: o.stable for o in rattle.Gear(0.6, 0.07615571 + h).orbits()}["D"] for h in (-1e-8, 1e-8)]
    assert stable == [True, False]  # PD1 at δ = 0.6
    regained = [{o.name: o.stable for o in rattle.Gear(0.4, e).orbits()}["D"] for e in (0.2394, 0.2396)]
    assert regained == [False, True]  # D regains stability at high ε, which the paper does not say


@pytest.mark.parametrize(
    "bad", [(0, 0.1, 0.6), (-0.1, 0.1, 0.6), (0.6, -1e-9, 0.6), (0.6, 0.1, 0), (float("nan"), 0, 1)]
)
def test_bad_parameters_are_refused_with_a_reason(bad):
    for call in (lambda: rattle.Gear(*bad), lambda: rattle.regions(*bad), lambda: rattle.period_one(*bad)):
        with pytest.raises(rattle.ParameterError, match=r"delta|epsilon|beta"):
            call()
