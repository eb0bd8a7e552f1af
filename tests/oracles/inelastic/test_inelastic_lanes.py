"""Inelastic samples in lanes: against the map one by one, their exponents, and how sure "chaotic" is."""

import numpy as np
import pytest
from depth import either
from numpy.typing import NDArray

from rattle.attractors.classify import allocate_probe_record, create_trajectories
from rattle.attractors.samples import Outcome, Trajectories
from rattle.inelastic import iterate, iterate_tangent
from rattle.inelastic.attractors.classifier import InelasticClassifier
from rattle.inelastic.map.cells import InelasticCells, make_inelastic_cells

BETA = 0.6


def random_cells(rng: np.random.Generator, n: int, r: float | NDArray[np.float64]) -> InelasticCells:
    """Cells of the paper's plane with this restitution, on either side of the quiet limit."""
    delta, epsilon = rng.uniform(0.4, 0.7, n), rng.uniform(0.0, 0.35, n)
    return make_inelastic_cells(delta, epsilon, np.full(n, BETA), np.broadcast_to(r, n).copy(), np.zeros(n))


def states(rng: np.random.Generator, shape: tuple[int, int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return rng.random(shape), rng.uniform(0.5, 9.0, shape)


def settled(cells: InelasticCells, tau: NDArray[np.float64], v: NDArray[np.float64]) -> InelasticClassifier:
    found = InelasticClassifier(cells, tau.copy(), v.copy())
    found.run_all_stages()
    return found


def labels(found: InelasticClassifier) -> NDArray[np.int64]:
    """What became of every sample (n_cells, count, 4): its outcome, and the label of its orbit."""
    cell, orbit = np.arange(len(found.status))[:, None], found.samples.orbit.reshape(found.status.shape)
    orbits, periodic = found.orbits, found.status == Outcome.PERIODIC
    label = [np.where(periodic, x[cell, orbit], 0) for x in (orbits.m, orbits.n_plus, orbits.n_minus)]
    return np.stack([found.status, *label], axis=-1)


def test_a_lane_makes_the_impacts_of_the_map() -> None:
    rng, n, impacts = np.random.default_rng(1), 400, 4
    cells = random_cells(rng, n, rng.uniform(0.5, 1.0, n))
    tau, v = states(rng, (n, 1))
    classifier = InelasticClassifier(cells, tau, v)
    samples: Trajectories = create_trajectories(np.arange(n), tau.ravel().copy(), v.ravel().copy(), impacts)
    classifier.advance(np.arange(n), samples, early=True)
    same = (samples.status == Outcome.UNRESOLVED) & (samples.impacts == impacts)
    assert same.sum() > n // 4  # the others came to contact, or to rest
    given = (x[same] for x in (cells.delta, cells.epsilon, tau.ravel(), v.ravel()))
    moved = iterate(*given, impacts, BETA, cells.restitution[same])
    near = np.abs(samples.v[same] - moved.v) < 1e-9 * (1.0 + moved.v)
    assert near.mean() > 0.99  # a graze takes any error to more
    np.testing.assert_allclose(samples.tau[same][near], moved.tau[near], atol=1e-9)


def test_lanes_find_what_is_found_one_by_one() -> None:
    rng, n, count = np.random.default_rng(2), 60, 32
    cells = random_cells(rng, n, rng.uniform(0.5, 0.8, n))
    tau, v = states(rng, (n, count))
    in_lanes, alone = settled(cells, tau, v), InelasticClassifier(cells, tau.copy(), v.copy())
    alone.fits_lanes[:] = False
    alone.run_all_stages()
    soon = (in_lanes.impacts < 40) & (alone.impacts < 40)  # before rounding parts two motions
    assert soon.mean() > 0.7
    same = (labels(in_lanes) == labels(alone)).all(axis=-1)
    assert same[soon].mean() > 0.998
    for kind in (Outcome.QUIET, Outcome.PERIODIC):
        share, other = ((x.status == kind).mean() for x in (in_lanes, alone))
        assert share == pytest.approx(other, abs=0.01)
    assert (in_lanes.orbits.contacts > 0).any()


def test_exponents_in_lanes_are_those_of_the_map() -> None:
    """λ₁ and λ₁ + λ₂ = −δ + 2 ln r × impacts per forcing period, of chaos at (0.45, 0.3) and r = 0.8."""
    delta, epsilon, r, n = 0.45, 0.3, 0.8, 12
    given = (np.array([x]) for x in (delta, epsilon, BETA, r, 0.0))
    found = InelasticClassifier(make_inelastic_cells(*given), *states(np.random.default_rng(4), (1, n)))
    seen = allocate_probe_record(n)
    found.samples.limit[:] = 100_000
    found.follow_with_tangent(np.arange(n), np.full(n, 3000.0), np.full(n, 300.0), seen)
    time, stretch, contraction = seen.sums.sum(axis=(0, 1))
    moved = iterate_tangent(delta, epsilon, *states(np.random.default_rng(5), (1, n)), 3000, BETA, r)
    free = np.isfinite(moved.lyapunov).all(axis=0)  # contact on the way to chaos makes them −∞
    assert free.sum() > n // 2
    first, second = moved.lyapunov[:, free].mean(axis=1)
    assert stretch / time == pytest.approx(first, rel=0.03)
    assert contraction / time == pytest.approx(first + second, rel=0.01)


@pytest.mark.parametrize("r", [0.98, 0.95, 0.9, 0.8])
def test_what_is_called_chaotic_hardly_settles_in_ten_times_the_observation(r: float) -> None:
    rng, n = np.random.default_rng(11), either(80, 300)
    found = settled(random_cells(rng, n, r), *states(rng, (n, 64)))
    chaotic = np.concatenate([chaos.samples for each in found.chaotic_sets.values() for chaos in each])
    undecided = (found.status == Outcome.UNRESOLVED).sum() - chaotic.size
    assert undecided <= 0.02 * found.status.size
    samples = found.samples
    longer = create_trajectories(
        samples.cell[chaotic], samples.tau[chaotic], samples.v[chaotic], 10 * samples.impacts[chaotic]
    )
    found.follow_to_attractor_or_limit(np.arange(chaotic.size), longer)
    assert chaotic.size > 100
    assert (longer.status != Outcome.UNRESOLVED).sum() <= 0.01 * chaotic.size
