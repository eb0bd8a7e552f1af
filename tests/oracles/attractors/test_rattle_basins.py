"""Basins: two independent methods against each other, against Figure 4, and against answers known exactly."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from depth import deep, either
from figure4 import KNOWN, label

import rattle
from rattle.attractors.basins import Basins, GrowingClassification, classify_plane_states, flag_boundary_cells
from rattle.attractors.cell_map import periodic_groups_of_cell_map
from rattle.attractors.measures import fit_power_law


@cache
def basins(point, n, **how):
    return rattle.Gear(*point).basins(n, **how)


def fractions(attractors):
    return {label(a): a.fraction for a in attractors}


def agree(found, known, tolerance):
    for name in set(found) | set(known):
        assert found.get(name, 0.0) == pytest.approx(known.get(name, 0.0), abs=tolerance), name


@pytest.mark.parametrize("method", ["cells", "direct", "refined"])
@pytest.mark.parametrize("epsilon", KNOWN)
def test_fractions_of_figure_4(epsilon, method):
    n = either(300 if method == "cells" else 100, 300)  # mapped cells err more, and cost less
    found = basins((0.6, epsilon), n, method=method)
    agree(fractions(found.attractors), KNOWN[epsilon], 0.01)
    counted = np.bincount(found.labels.ravel(), minlength=len(found.attractors)) / found.labels.size
    assert [a.fraction for a in found.attractors] == pytest.approx(counted)
    assert (np.diff(counted) <= 0).all()
    converged = np.array([a.kind in ("quiet", "periodic") for a in found.attractors])[found.labels]
    assert ((found.steps >= 0) == converged).all()


@pytest.mark.parametrize("beta", [0.3, 0.6, 1.0])
@pytest.mark.parametrize("epsilon", [0.078, 0.12])
def test_both_methods_find_the_attractors_of_the_sample(epsilon, beta):
    gear = rattle.Gear(0.6, epsilon, beta)
    sample = gear.attractors(count=1024)
    for method in ("cells", "direct"):
        found = gear.basins(either(100, 200), method=method)
        agree(fractions(found.attractors), fractions(sample), 0.02)
        for a in found.attractors:
            if a.kind == "periodic" and a.fraction > 0.01:
                twin = next(b for b in sample if label(b) == label(a))
                assert (a.tau, a.v) == pytest.approx((twin.tau, twin.v), abs=1e-6)


@pytest.mark.parametrize("impacts", [pytest.param(1, marks=deep), 16])
@pytest.mark.parametrize("epsilon", [pytest.param(0.0615, marks=deep), pytest.param(0.078, marks=deep), 0.1])
def test_the_methods_differ_in_few_cells_and_at_boundaries(epsilon, impacts):
    point, side = (0.6, epsilon), either(160, 400)
    mapped, direct = basins(point, side, impacts=impacts), basins(point, side, method="direct")
    differing = rattle.differing_cells(mapped, direct)
    assert rattle.disagreement(mapped, direct) == differing.mean() < (0.03 if impacts == 1 else 0.001)
    near = flag_boundary_cells(direct.labels) | flag_boundary_cells(mapped.labels)
    assert (differing & ~near).sum() <= 0.1 * differing.sum()
    assert rattle.disagreement(basins(point, side, method="refined", impacts=impacts), direct) <= 0.5 * differing.mean()


def test_the_interleaved_basins_of_four_orbits():
    point = 0.6, 0.089
    direct = basins(point, 400, method="direct")
    by_impacts = [rattle.disagreement(basins(point, 400, impacts=k), direct) for k in (1, 4, 16)]
    assert by_impacts[0] < 0.15
    assert by_impacts[2] < 0.05  # 0.033; 0.008 on 1000 × 1000 cells
    assert by_impacts == sorted(by_impacts, reverse=True)


@pytest.mark.parametrize(
    ("point", "share"),
    [
        ((0.6, 0.089), 1e-4),
        *(
            pytest.param(*case, marks=deep)
            for case in (((0.1, 0.02), 5e-4), ((0.4, 0.1), 4e-3), ((0.762, 0.0972), 1e-5))
        ),
    ],
)
def test_refinement_goes_on_until_nothing_changes(point, share):
    """Many cells that one round of refinement left wrong touch cells that this round had just followed."""
    refined, direct = (basins(point, 400, method=method) for method in ("refined", "direct"))
    assert rattle.disagreement(refined, direct) < share
    assert {label(a) for a in refined.attractors} == {label(a) for a in direct.attractors}
    wrong = rattle.differing_cells(refined, direct)  # alone among cells of one label: all others were followed
    assert not (wrong & flag_boundary_cells(refined.labels)).any()


def test_a_lattice_finds_a_basin_that_cell_mapping_misses():
    """P(4,5,1) wins 0.33 % of the plane in pieces that are no larger than a cell."""
    n = either(200, 400)
    found = {method: fractions(basins((0.6, 0.18), n, method=method).attractors) for method in ("cells", "refined")}
    assert (4, 5, 1) not in found["cells"]
    assert found["refined"][4, 5, 1] > 0


@pytest.mark.parametrize("point", [(0.6, 0.089), (0.6, 0.1), (0.1, 0.02)])
def test_states_followed_in_several_calls_keep_their_attractors(point):
    gear = rattle.Gear(*point)
    tau, v = np.random.default_rng(3).random((2, 1200))
    v = 7 * v + 1e-3
    parts, at_once = (
        GrowingClassification(rattle.Gear(*point).states),
        GrowingClassification(rattle.Gear(*point).states),
    )
    rows = np.concatenate(
        [parts.classify_more_states(t, w)[0] for t, w in zip(np.split(tau, 6), np.split(v, 6), strict=True)]
    )
    whole, _impacts = at_once.classify_more_states(tau, v)
    pairs = np.unique(np.stack([rows, whole]), axis=1)
    assert len(pairs.T) == rows.max() + 1 == whole.max() + 1 == parts.table.kind.size > 2, gear


@deep
def test_finer_cells_are_better_cells():
    point, errors = (0.6, 0.1), []
    for n in either((25, 100, 400), (50, 200, 800)):
        errors.append(rattle.disagreement(basins(point, n, impacts=1), basins(point, n, method="direct")))
    assert errors[0] > 2 * errors[1] > 4 * errors[2]


@deep
def test_finer_cells_have_the_same_fractions():
    coarse, fine = (fractions(basins((0.6, 0.1), n).attractors) for n in (200, 1000))
    agree(coarse, fine, 0.003)


def test_a_cell_does_not_depend_on_the_others():
    gear = rattle.Gear(0.6, 0.1)
    found = gear.basins(60, method="direct")
    tau, v = (x.ravel() for x in np.meshgrid(found.tau, found.v))
    order = np.random.default_rng(5).permutation(tau.size)
    table, rows, _impacts = classify_plane_states(rattle.Gear(0.6, 0.1).states, tau[order], v[order])
    kinds = np.array([rattle.KINDS.index(a.kind) for a in found.attractors])
    assert (table.kind[rows] == kinds[found.labels.ravel()[order]]).all()


@pytest.mark.parametrize("method", ["cells", "direct"])
def test_nothing_is_quiet_above_the_quiet_limit(method):
    gear = rattle.Gear(0.6, 0.2)
    assert gear.epsilon > gear.quiet_limit
    assert "quiet" not in fractions(gear.basins(100, method=method).attractors)


def test_states_above_the_grid_are_followed_on():
    gear = rattle.Gear(0.6, 0.1)
    low, direct = gear.basins(150, v_max=3.5), gear.basins(150, v_max=3.5, method="direct")
    assert max(a.v for a in low.attractors) > 3.5
    assert rattle.disagreement(low, direct) < 0.005


def test_groups_of_a_small_map():
    group, steps, first = periodic_groups_of_cell_map(np.array([1, 2, 1, 0, 4, 4, 9, 8, 7, 9]))
    assert group.tolist() == [0, 0, 0, 0, 1, 1, 3, 2, 2, 3]
    assert steps.tolist() == [1, 0, 0, 2, 0, 1, 1, 0, 0, 0]
    assert first.tolist() == [1, 4, 7, 9]


@pytest.mark.parametrize("seed", range(5))
def test_groups_of_random_maps(seed):
    random = np.random.default_rng(seed)
    n = 300
    image = random.integers(0, n, n)
    group, steps, first = periodic_groups_of_cell_map(image)
    for cell in range(n):
        orbit = [cell]
        while image[orbit[-1]] not in orbit:
            orbit.append(image[orbit[-1]])
        entry = orbit.index(image[orbit[-1]])
        assert steps[cell] == entry
        assert first[group[cell]] == min(orbit[entry:])
    order = random.permutation(n)  # cell i is now called order[i]
    renamed = np.empty(n, np.int64)
    renamed[order] = order[image]
    again, steps_again, _first = periodic_groups_of_cell_map(renamed)
    assert (steps_again[order] == steps).all()
    assert len(np.unique(np.stack([group, again[order]]), axis=1).T) == group.max() + 1 == again.max() + 1


def painted(labels):
    one = rattle.Gear(0.6, 0.056).attractors(count=8)[0]
    n = len(labels)
    centres = (np.arange(n) + 0.5) / n
    return Basins(centres, 7 * centres, labels, (one,) * (labels.max() + 1), np.zeros_like(labels), "direct", 7.0)


def test_entropy_of_painted_basins():
    labels = np.zeros((20, 20), np.int64)
    assert rattle.basin_entropy(painted(labels))[:1] == (0.0,)
    assert np.isnan(rattle.basin_entropy(painted(labels)).boundary_entropy)
    labels[:, 8:] = 1  # cuts the second column of boxes into 3 : 2
    p = np.array([0.6, 0.4])
    each = -(p * np.log(p)).sum()
    assert rattle.basin_entropy(painted(labels)) == pytest.approx((each / 4, each, 16, 4))
    chess = np.indices((16, 16)).sum(axis=0) % 2
    assert rattle.basin_entropy(painted(chess), box=4) == pytest.approx((np.log(2), np.log(2), 16, 16))


def test_no_entropy_where_a_cell_is_undecided():
    labels = np.zeros((20, 20), np.int64)
    labels[:, 8:] = 1
    known = painted(labels)
    quiet, other = known.attractors
    unsure = replace(known, attractors=(quiet, replace(other, kind="undecided")))
    assert np.isnan(rattle.basin_entropy(unsure)[:2]).all()
    assert rattle.basin_entropy(unsure)[2:] == rattle.basin_entropy(known)[2:] == (16, 4)


def test_the_fit_recovers_a_power_law_and_its_error():
    sizes, pairs = 2.0 ** -np.arange(5.0, 13.0), np.full(8, 8192)
    random = np.random.default_rng(2)
    fits = np.array([fit_power_law(sizes, random.binomial(pairs, 2 * sizes**0.7), pairs) for _ in range(400)])
    assert fits[:, 0].mean() == pytest.approx(0.7, abs=0.01)
    assert (np.abs(fits[:, 0] - 0.7) < fits[:, 1]).mean() > 0.9
    assert np.isnan(fit_power_law(sizes, np.zeros(8, np.int64), pairs)).all()


def test_a_smooth_boundary_has_exponent_one_and_a_mixed_one_less():
    smooth = rattle.Gear(0.6, 0.0615).uncertainty(pairs=either(2048, 8192))
    assert abs(smooth.exponent - 1) < 1.5 * smooth.error
    pairs = either(1024, 2048)
    mixed = rattle.Gear(0.6, 0.089).uncertainty(pairs=pairs)
    assert mixed.exponent + 3 * mixed.error < 0.8
    assert mixed.exponent == rattle.Gear(0.6, 0.089).uncertainty(pairs=pairs).exponent
    other = rattle.Gear(0.6, 0.089).uncertainty(pairs=pairs, seed=1)
    assert abs(mixed.exponent - other.exponent) < 2 * np.hypot(mixed.error, other.error)


def test_what_is_refused():
    gear = rattle.Gear(0.6, 0.1)
    for wrong in ({"resolution": 0}, {"resolution": 2.5}, {"v_max": 0}, {"method": "guess"}, {"impacts": 0}):
        with pytest.raises(rattle.ParameterError):
            gear.basins(**({"resolution": 10} | wrong))
    with pytest.raises(rattle.ParameterError):
        rattle.disagreement(gear.basins(10), gear.basins(20))
    with pytest.raises(rattle.ParameterError):
        rattle.basin_entropy(gear.basins(4))
    with pytest.raises(rattle.ParameterError):
        gear.uncertainty(pairs=0)
    with pytest.raises(rattle.ParameterError):
        gear.gamma(spacing=0)
