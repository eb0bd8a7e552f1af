"""All stable orbits of period one: against the closed form, the map, and what samples and continuation found."""

import json
import math

import motions_high_precision as exact
import numpy as np
import pytest
import stable_planes
from mpmath import mp

import rattle
from rattle.flight.first_impact import OK, first_impact
from rattle.flight.forcing import DRIFT
from rattle.flight.law import fold_phase, wrap_phase_difference
from rattle.impacting.map.impact_map import apply_impact_map_with_tangent
from rattle.impacting.orbits.limits import quiet_limit
from rattle.impacting.orbits.stable import find_stable_orbits

ROOM = 160


def stable(delta, epsilon, beta):
    """The stable orbits of flat arrays, and which entries (n, ROOM) hold one."""
    delta, epsilon, beta = (np.ascontiguousarray(x, dtype=float) for x in (delta, epsilon, beta))
    found = find_stable_orbits(delta, epsilon, beta, ROOM)
    assert found.n.max() <= ROOM
    return found, np.arange(ROOM) < found.n[:, None]


def small_damping(count, seed):
    """Cells where real gears are: δ in 1e-3…0.3, β/δ in 0.3…3, ε in 0.1…1.6 of the quiet limit."""
    rng = np.random.default_rng(seed)
    delta = 10 ** rng.uniform(-3, math.log10(0.3), count)
    beta = delta * 10 ** rng.uniform(math.log10(0.3), math.log10(3), count)
    return delta, rng.uniform(0.1, 1.6, count) * quiet_limit(delta), beta


def around(n_plus, tau, v, delta, epsilon, beta):
    """Flights from (τ, v) until Σ⁺ was met n_plus times more: wall, time and speed after each impact (n, 3)."""
    impacts = [(1, tau, v)]
    while n_plus > 0:
        wall, time, speed = impacts[-1]
        status, s, wall, w1, *_ = first_impact(
            wall, float(fold_phase(time)), -wall * speed, delta, epsilon, beta, DRIFT
        )
        assert status == OK
        impacts.append((int(wall), time + s, abs(w1)))
        n_plus -= wall > 0
    return np.array(impacts)


def trace_and_determinant(n_plus, tau, v, delta, epsilon, beta):
    """Return trace and determinant of the product of the map's tangents."""
    product = np.eye(2)
    for _ in range(n_plus):
        _status, tau, v, _time, _below, j00, j01, j10, j11, _ln = apply_impact_map_with_tangent(
            tau, v, delta, epsilon, beta, DRIFT, False
        )
        product = np.array([[j00, j01], [j10, j11]]) @ product
    return np.trace(product), np.linalg.det(product)


def test_every_orbit_closes_under_the_map_and_keeps_its_balances():
    """The map's search for first impacts knows nothing of the equations for the times."""
    rng = np.random.default_rng(1)
    plane = rng.uniform(0.4, 1.0, 200), rng.uniform(0.005, 0.3, 200), np.full(200, 0.6)
    delta, epsilon, beta = (np.concatenate(x) for x in zip(plane, small_damping(100, 2), strict=True))
    found, filled = stable(delta, epsilon, beta)
    labels = set()
    for i, j in zip(*np.nonzero(filled), strict=True):
        orbit = int(found.n_plus[i, j]), found.tau[i, j], found.v[i, j], delta[i], epsilon[i], beta[i]
        wall, time, speed = around(*orbit).T
        assert max(abs(time[-1] - time[0] - 1), abs(speed[-1] / speed[0] - 1)) < 1e-12
        assert np.all(np.abs(speed[1:-1] / speed[0] - 1) + np.abs(time[1:-1] - time[0]) > 1e-6)
        assert speed[wall > 0].max() < speed[0] * (1 + 1e-12)
        assert np.sum(wall < 0) == found.n_minus[i, j]
        assert abs((wall * speed)[1:].sum() / (2 * math.pi * delta[i]) - 1) < 1e-10
        trace, determinant = trace_and_determinant(*orbit)
        assert trace == pytest.approx(found.trace[i, j], abs=1e-8)
        assert determinant == pytest.approx(math.exp(-delta[i]), abs=1e-8)
        assert abs(trace) < 1 + math.exp(-delta[i])
        labels.add((orbit[0], int(found.n_minus[i, j])))
    assert {(n, 0) for n in range(1, 30)} | {(1, 1), (2, 1), (2, 2), (3, 3)} <= labels


#: δ, ε, β and the labels of the stable orbits with at most six impacts
EXACT = (
    (0.369, 0.0555, 0.958, [(1, 0), (2, 0)]),
    (0.0312, 0.00339, 0.0121, [(2, 0), (3, 0), (2, 2), (4, 0)]),
    (0.00258, 0.00151, 0.00204, [(1, 1), (1, 1), (2, 1), (2, 2), (3, 3)]),
    (0.101, 0.0445, 0.0254, [(2, 1), (3, 1)]),
    (0.465, 0.426, 0.439, [(2, 1), (1, 2)]),
    (0.112, 0.0916, 0.124, [(1, 1), (1, 1)]),
    (0.00539, 0.00354, 0.000915, [(4, 1), (4, 1)]),
    (0.00897, 0.00681, 0.00528, [(2, 1), (1, 3), (3, 3)]),
)


@pytest.mark.parametrize(("delta", "epsilon", "beta", "labels"), EXACT)
def test_orbits_in_forty_digits(delta, epsilon, beta, labels):
    (_n, n_plus, n_minus, tau, v, trace), filled = stable([delta], [epsilon], [beta])
    few = np.flatnonzero((filled & (n_plus + n_minus <= 6))[0])
    assert [(n_plus[0, j], n_minus[0, j]) for j in few] == labels
    for j in few:
        wall, time, _ = around(int(n_plus[0, j]), tau[0, j], v[0, j], delta, epsilon, beta)[:-1].T
        walls = wall.astype(int).tolist()
        times, velocities, multipliers = exact.motion_values(
            [round(float(t), 7) for t in time], walls, 1, delta, epsilon, beta
        )
        speeds = -wall * np.array([float(x) for x in velocities])
        assert np.argmax(np.where(wall > 0, speeds, 0)) == 0
        assert tau[0, j] == pytest.approx(float(times[0]), abs=1e-13)
        assert v[0, j] == pytest.approx(speeds[0], rel=1e-13)
        assert trace[0, j] == pytest.approx(float(mp.re(mp.fsum(multipliers))), abs=1e-11)


def test_those_of_the_closed_form_are_among_them():
    rng = np.random.default_rng(3)
    delta, epsilon, beta = rng.uniform(0.2, 1.5, 1000), rng.uniform(0, 0.4, 1000), rng.uniform(0.2, 1.2, 1000)
    closed = rattle.period_one(delta, epsilon, beta)
    found, filled = stable(delta, epsilon, beta)
    assert not closed.stable[0].any()
    for k in (1, 2, 3):
        match = filled & (found.n_plus == 1) & (found.n_minus == k % 2)
        near = match & (np.abs(found.tau - closed.tau[k, :, None]) < 1e-11)
        assert np.array_equal(near.any(axis=1), closed.stable[k])
        i, j = np.nonzero(near)
        assert found.v[i, j] == pytest.approx(closed.v[k, i], rel=1e-11)
        assert found.trace[i, j] == pytest.approx(closed.multipliers[k, :, i].sum(axis=1).real, abs=1e-8)
        assert closed.stable[k].sum() > (0, 2, 30, 30)[k]


def test_a_cell_does_not_depend_on_its_neighbours_or_on_the_room():
    delta, epsilon, beta = small_damping(60, 4)
    found, _ = stable(delta, epsilon, beta)
    assert found.n.max() > 8
    for i in range(delta.size):
        alone = find_stable_orbits(*(x[i : i + 1] for x in (delta, epsilon, beta)), 8)
        assert alone.n[0] == found.n[i]
        for one, all_ in zip(alone[1:], found[1:], strict=True):
            assert np.array_equal(one[0], all_[i, :8], equal_nan=True)


@pytest.mark.parametrize("name", stable_planes.PLANES)
def test_none_is_missing_that_starts_and_continuation_prove_to_exist(name):
    cells = json.loads(stable_planes.FILE.read_text())[name]["cells"]
    numbers = np.array([int(cell) for cell in cells])
    found, _ = stable(*(x[numbers] for x in stable_planes.cells_of(name)))
    existing = [(i, *row) for i, rows in enumerate(cells.values()) for row in rows]
    assert len(existing) > 150
    for i, n_plus, n_minus, tau, v in existing:
        same = (found.n_plus[i] == n_plus) & (found.n_minus[i] == n_minus)
        assert np.any(
            same & (np.abs(wrap_phase_difference(found.tau[i] - tau)) < 1e-6) & (np.abs(found.v[i] / v - 1) < 1e-6)
        )


def test_a_cell_lists_them_whatever_its_sample_finds():
    delta, epsilon, beta = small_damping(40, 5)
    found, filled = stable(delta, epsilon, beta)
    table = rattle.attractors_of(delta, epsilon, beta, count=2, budget=64)
    rows = (table.kind == rattle.KINDS.index("periodic")) & (table.m == 1)
    listed = sorted(zip(table.cell[rows], table.n_plus[rows], table.n_minus[rows], table.v[rows], strict=True))
    known = sorted((i, found.n_plus[i, j], found.n_minus[i, j], found.v[i, j]) for i, j in np.argwhere(filled))
    assert np.array_equal(listed, known)
    assert np.sum(table.samples[rows] == 0) > 50
