"""The stiff gear over the (δ, ε) plane: against its impacting limit, its own return map, and attractors of samples."""

import numpy as np
import pytest
from depth import deep, either

import rattle
from rattle.errors import ParameterError
from rattle.numerics.complex_step import value_and_jacobian
from rattle.stiff import StiffGear, attractors_of, period_one, regions, saddle_node_1
from rattle.stiff.map.return_map import StiffPoint, step_with_tangent
from rattle.stiff.orbits.closure import ContactCycle, departure_after_first_contact, write_residuals
from rattle.stiff.orbits.equations import StiffItinerary
from rattle.stiff.orbits.families import families_of_a_to_d, find_family_members


def test_the_compiled_closure_is_that_of_the_equations() -> None:
    """Values and all derivatives, by complex steps, of motions of several walls and periods."""
    rng, checked = np.random.default_rng(0), 0
    for walls in ((1,), (1, -1), (1, -1, 1), (1, 1, -1)) * 20:
        c, m = len(walls), int(rng.integers(1, 3))
        delta, epsilon, beta = 10 ** rng.uniform(-1, 0.5), rng.random(), rng.uniform(0.1, 1)
        kappa = 10 ** rng.uniform(1, 9)
        times, durations, p = np.sort(rng.random(c)) * m, rng.uniform(0.01, 4, c), 1 / np.sqrt(2 * kappa)
        if np.min(np.diff(np.append(times, times[0] + m)) - p * durations) < 1e-3:
            continue
        x = np.concatenate([times, durations, [delta, epsilon]])
        exact, by_all = value_and_jacobian(StiffItinerary(walls, m, beta, p).residual, x)
        value, jacobian = np.empty(2 * c), np.empty((2 * c, 2 * c + 1))
        assert write_residuals(
            np.delete(x, 2 * c), ContactCycle(np.array(walls), m, delta, beta, kappa), value, jacobian
        )
        np.testing.assert_allclose(value, exact, atol=1e-13 * (1 + np.abs(exact).max()))
        np.testing.assert_allclose(jacobian, np.delete(by_all, 2 * c, 1), atol=1e-11 * np.abs(by_all).max())
        checked += 1
    assert checked > 40


def test_the_plane_converges_to_that_of_the_impacting_model() -> None:
    """At κ = 1e10 places are 1e-4 off; only a point next to a curve may be in another region."""
    rng = np.random.default_rng(1)
    delta, epsilon = rng.uniform(0.4, 1.0, 150), rng.uniform(0.005, 0.3, 150)
    found, limit = period_one(delta, epsilon, 0.6, 1e10), rattle.period_one(delta, epsilon, 0.6)
    same = (found.exists == limit.exists).all(axis=0) & (
        regions(delta, epsilon, 0.6, 1e10) == rattle.regions(delta, epsilon)
    )
    assert same.sum() >= 149
    assert set(rattle.regions(delta, epsilon)) == {1, 2, 3, 4, 5}
    off = np.abs((found.tau - limit.tau + 0.5) % 1 - 0.5)[:, same]
    assert np.nanmax(off) < 1e-3
    np.testing.assert_allclose(found.v[:, same], limit.v[:, same], atol=2e-3)
    np.testing.assert_array_equal(np.isnan(found.multipliers[:, 0]), ~found.exists)


def test_every_motion_is_a_fixed_point_of_the_return_map() -> None:
    rng, checked = np.random.default_rng(2), 0
    for _ in range(60):
        delta, epsilon, beta = rng.uniform(0.1, 1.5), rng.uniform(0.05, 0.5), rng.choice([0.3, 0.6, 1.2])
        point = StiffPoint(delta, epsilon, beta, 10 ** rng.uniform(2, 8))
        found = period_one(*point)
        for i in np.flatnonzero(found.exists):
            multipliers = found.multipliers[i]
            status, tau, v, time, _below, j00, _b, _c, j11, _ln = step_with_tangent(found.tau[i], found.v[i], point)
            error = 1e-10 * (1 + abs(multipliers[0])) * (1 + 1 / found.v[i])
            assert status == 0
            assert time == pytest.approx(1.0, abs=error)
            assert abs((tau - found.tau[i] + 0.5) % 1 - 0.5) < error
            assert v == pytest.approx(found.v[i], abs=error)
            assert sum(multipliers).real == pytest.approx(j00 + j11, rel=1e-6, abs=1e-6)
            assert np.prod(multipliers) == pytest.approx(np.exp(-delta), rel=1e-10)
            assert found.stable[i] == (abs(multipliers[0]) < 1)
            checked += 1
    assert checked > 80


@pytest.mark.parametrize("kappa", [pytest.param(1e2, marks=deep), 1e3, pytest.param(1e5, marks=deep)])
def test_what_samples_find_is_among_the_motions(kappa: float) -> None:
    """Every attracting P(1,1,0) and P(1,1,1) of random cells is one of the letters (or a slow P), and stable."""
    rng, n = np.random.default_rng(3), either(30, 60)
    drawn = rng.uniform(0.1, 1.2, 60), rng.uniform(0.02, 0.4, 60), rng.choice([0.3, 0.6, 1.2], 60)
    delta, epsilon, beta = (each[:n] for each in drawn)
    table = attractors_of(delta, epsilon, beta, kappa, 32)
    one = (table.kind == 2) & (table.m == 1) & (table.n_plus == 1) & (table.n_minus < 2)
    assert one.sum() > n / 3
    for row in np.flatnonzero(one):
        i = table.cell[row]
        known = StiffGear(delta[i], epsilon[i], beta[i], kappa).orbits()
        near = [x for x in known if abs(x.v - table.v[row]) + abs(x.tau - table.tau[row]) < 1e-6]
        assert len(near) == 1
        assert near[0].stable
        assert near[0].n_minus == table.n_minus[row]


@pytest.mark.parametrize(
    ("delta", "epsilon", "beta", "kappa", "names"),
    [(0.557, 0.4, 0.396, 21.5, "BCD"), (1.42, 0.6, 0.079, 68.7, "D")],
)
def test_a_family_that_only_a_graze_leads_to_is_found(delta, epsilon, beta, kappa, names) -> None:
    """Near resonance the limit leads to no P(1,1,1), but a P(1,1,0) touches Σ⁻, and the return map has both."""
    found = find_family_members(delta, epsilon, beta, kappa)
    assert "".join(member.name for member in found) == names
    for member in found:
        tau, v = departure_after_first_contact(member.y, member.cycle)
        again = step_with_tangent(tau, v, StiffPoint(delta, epsilon, beta, kappa))
        assert again[:3] == pytest.approx((0, tau, v), abs=1e-9)
        assert again[4] == member.cycle.walls.size - 1


def test_a_soft_gear_has_a_slow_motion_beside_its_letters() -> None:
    """Near resonance the family of A and C folds once more: what follows is no counterpart, and not in the plane."""
    point = (0.8024625, 0.18397943, 1.264796, 63.882357)
    assert [orbit.name for orbit in StiffGear(*point).orbits()] == ["A", "C", "P"]
    np.testing.assert_array_equal(period_one(*point).exists, [True, False, True, False])
    assert regions(*point) == 2


def test_sn1_is_the_fold_of_the_shortest_contact() -> None:
    """At κ = 1e5 and large damping folds of contacts that swing two or three times have speeds nearer to 2πδ."""
    delta = np.linspace(0.9, 1.2, 4)
    np.testing.assert_array_equal(regions(delta, 0.25, 1.2, 1e5), rattle.regions(delta, 0.25, 1.2))
    off = [[saddle_node_1(x, kappa, 1.2).epsilon - float(rattle.sn1(x, 1.2)) for x in delta] for kappa in (1e5, 1e7)]
    np.testing.assert_allclose(np.divide(*off), 10.0, rtol=0.05)


def test_letters_go_through_the_graze_to_the_fold() -> None:
    """C makes a slight contact with Σ⁻ before it meets B: at κ = 1e4 between 0.16315 (fold) and 0.1632 (graze)."""
    fold = next(
        family
        for family in families_of_a_to_d(0.6, 0.6, 1e4, 1.0)
        if "C" in family.letters and family.points.shape[1] == 5
    )
    top = fold.points[fold.folds].max(axis=0)[-1]
    assert top == pytest.approx(0.1631523594, abs=1e-9)
    for off, names in ((-1e-9, "ABCD"), (1e-9, "AD")):
        assert "".join(sorted(member.name for member in find_family_members(0.6, top + off, 0.6, 1e4))) == names
    walls = {member.name: len(member.cycle.walls) for member in find_family_members(0.6, top - 1e-9, 0.6, 1e4)}
    assert walls == {"A": 1, "B": 2, "C": 2, "D": 2}
    born = saddle_node_1(0.6, 1e4).epsilon
    np.testing.assert_array_equal(regions(0.6, [born - 1e-9, born + 1e-9], 0.6, 1e4), [1, 2])


def test_cells_do_not_depend_on_their_block() -> None:
    """To the bit, whatever other cells are in the call, in whatever order, and whatever was computed before."""
    rng = np.random.default_rng(4)
    delta, epsilon = rng.choice([0.45, 0.6, 0.765, 0.9], 24), rng.uniform(0.0, 0.9, 24)
    kappa = rng.choice([1e3, 1e6], 24)
    families_of_a_to_d.cache_clear()
    whole = period_one(delta, epsilon, 0.6, kappa)
    order = rng.permutation(24)
    for part in (order[:7], order[7:8], order[8:]):
        families_of_a_to_d.cache_clear()
        here = period_one(delta[part], epsilon[part], 0.6, kappa[part])
        for all_of, some in zip(whole, here, strict=True):
            np.testing.assert_array_equal(all_of[..., part], some)
    assert whole.exists.any(axis=1).all()


def test_attractors_of_a_block_are_those_of_single_cells() -> None:
    delta, epsilon = np.meshgrid([0.5, 0.6], [0.06, 0.1, 0.2])
    kappa = np.array([1e3, 3e4])
    table = attractors_of(delta, epsilon, 0.6, kappa, 24, 6.0, 3)
    for cell, (d, e, k) in enumerate(np.broadcast(delta, epsilon, kappa)):
        rows = np.flatnonzero(table.cell == cell)
        single = StiffGear(d, e, 0.6, k).attractors(24, 6.0, 3)
        assert [rattle.KINDS[kind] for kind in table.kind[rows]] == [x.kind for x in single]
        for name in ("m", "n_plus", "n_minus", "tau", "v"):
            np.testing.assert_array_equal(getattr(table, name)[rows], [getattr(x, name) for x in single])
        np.testing.assert_array_equal(table.first[rows], [x.lyapunov[0] for x in single])
        np.testing.assert_array_equal(table.samples[rows] / 24, [x.fraction for x in single])


def test_hostile_input_of_planes_is_refused() -> None:
    for bad in (0.0, -1.0, np.inf, np.nan, "1"):
        for function in (period_one, regions, attractors_of):
            with pytest.raises(ParameterError, match="kappa"):
                function(0.6, 0.1, 0.6, bad)
    with pytest.raises(ParameterError, match="broadcast"):
        regions([0.5, 0.6], [0.1, 0.2, 0.3], 0.6, 1e4)


@pytest.mark.parametrize("delta", [2e-3, 2e-4])
def test_regions_of_weakly_damped_steel_are_those_of_the_limit(delta):
    """Families are followed with ε relative to δ: with ε in units of 1 a step passed two folds, and lost points."""
    beta, epsilon = 0.5 * delta * np.array([1.0, 2.0, 3.0]), delta * np.array([0.06, 0.12, 0.25, 0.35])[:, None]
    found = regions(delta, epsilon, beta, 1e7)
    np.testing.assert_array_equal(found, rattle.regions(delta, epsilon, beta))
    assert len(set(found.ravel())) > 3
    assert regions(0.002, 0.0005, 0.001, 1e5) == rattle.regions(0.002, 0.0005, 0.001)
    assert saddle_node_1(delta, 1e7, 3 * delta).epsilon == pytest.approx(float(rattle.sn1(delta, 3 * delta)), rel=2e-3)
