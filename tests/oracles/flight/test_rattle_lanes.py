"""Many flights in lanes: against the scalar map, independent of each other, and their tangent vectors."""

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import random_flights as flights
from compiled import compiled
from depth import either

import rattle
from rattle.flight.forcing import DRIFT
from rattle.flight.lanes.block import (
    FIELDS,
    LANES,
    TABLES,
    allocate_lane_block,
    clear_block,
    move_trajectory,
    put_trajectory_on_lane,
)
from rattle.impacting.map import impact_map
from rattle.impacting.map.iterate import count_flights

# ---- blocks ---------------------------------------------------------------------------------------------------------


def test_a_block_is_whole_cache_lines_and_tables_lie_over_the_fields_that_they_name():
    memory = allocate_lane_block()
    for k, name in enumerate(FIELDS):
        assert memory[name].ctypes.data % 64 == 0, name
        memory[name] = k
    for table, names in TABLES.items():
        assert memory[table].shape == (1, len(names), LANES)
        assert memory[table][0, :, 0].tolist() == [list(FIELDS).index(name) for name in names], table


@compiled
def _loaded(memory):
    """Another trajectory on every lane."""
    b = memory[0]
    clear_block(b)
    for i in range(LANES):
        put_trajectory_on_lane(b, i, 0.01 * i, 1.0 + i, 0.3 + 0.01 * i, 0.05 * i, 0.6, 7.0)
        b.who[i], b.unit[i], b.time[i] = i, 2.0 + i, 3.0 + i


@compiled
def _moved(memory, i, j):
    move_trajectory(memory[0], i, j)


def test_what_is_moved_to_another_lane_is_all_that_it_carries():
    memory = allocate_lane_block()
    _loaded(memory)
    np.testing.assert_array_equal(memory["parameters_"], memory["parameters"].astype(np.float32))
    before = memory.copy()
    _moved(memory, 3, 90)
    for name in ("carried", "carried_"):
        assert (before[name][0, :, 3] != before[name][0, :, 90]).any()
        np.testing.assert_array_equal(memory[name][0, :, 3], before[name][0, :, 90])
    assert memory["who"][0, [3, 90]].tolist() == [90, -1]
    assert memory["limit"][0, 90] == -1.0


# ---- lanes ----------------------------------------------------------------------------------------------------------


@compiled
def _mapped(states):
    """Π of each column by the scalar kernel: τ, v, impacts on Σ⁻, how much the last digits of the start matter."""
    n = states.shape[1]
    out = np.zeros((4, n))
    for k in range(n):
        tau, v, delta, epsilon, beta = states[0, k], states[1, k], states[2, k], states[3, k], states[4, k]
        found = impact_map.apply_impact_map_with_tangent(tau, v, delta, epsilon, beta, DRIFT, False)
        out[0, k], out[1, k], out[2, k] = found[1], found[2], found[4]
        steep = max(max(abs(found[5]), abs(found[6])), max(abs(found[7]), abs(found[8])))
        out[3, k] = (1.0 + v + epsilon) * (1.0 + found[3]) * (1.0 + steep) * (1.0 + 1.0 / found[2])
        if found[0] != 0:
            out[2, k] = -1.0
    return out


@pytest.mark.parametrize(
    ("regime", "count", "near"),
    [
        (flights.PLANE, either(20_000, 700_000), 0.25),
        (flights.WIDE, either(30_000, 300_000), 0.25),
        (flights.ARCS, either(30_000, 300_000), 0.5),
    ],
    ids=["plane", "wide", "arcs"],
)
def test_lanes_against_the_scalar_map(regime, count, near):
    """The maps differ by rounding, which a graze enlarges; the tangent matrix gives the factor.

    Above the quiet limit flights turn twice: lanes prove those, the scalar map searches them.
    """
    tau, v, delta, epsilon, beta = states = flights.random_states(count, 11, regime, near)
    lanes = rattle.iterate(delta, epsilon, tau, v, 1, beta)
    scalar_tau, scalar_v, scalar_minus, condition = _mapped(states)
    moved = scalar_minus >= 0
    assert np.array_equal(lanes.n_plus == 1, moved)
    assert moved.mean() > 0.999
    differ = np.flatnonzero(moved & (lanes.n_minus != scalar_minus))
    d_tau = np.abs((lanes.tau - scalar_tau + 0.5) % 1 - 0.5)[moved]
    d_v = np.abs(lanes.v - scalar_v)[moved]
    well = condition[moved] < 1e3
    relative = np.maximum(d_tau, d_v) / condition[moved]
    print(
        f"well-conditioned {well.mean():.3f}: τ within {d_tau[well].max():.1e}, v within {d_v[well].max():.1e}; "
        f"all against their condition within {relative.max():.1e}; n_minus differs {differ.size}"
    )
    assert differ.size == 0, states[:, differ[:5]].T.tolist()
    assert max(d_tau[well].max(), d_v[well].max()) < 1e-12
    assert relative.max() < 3e-15


def _mixed(n, seed):
    """Arguments of iterate over a wide range, n per element from 0."""
    rng = np.random.default_rng(seed)
    return [
        rng.uniform(0.1, 2.5, n),
        rng.uniform(0, 1.0, n),
        rng.random(n),
        10 ** rng.uniform(-3, 1.1, n),
        rng.integers(0, 120, n),
        rng.uniform(0.05, 2, n),
    ]


def _same(a, b):
    return all(np.array_equal(x, y, equal_nan=True) for x, y in zip(a, b, strict=True))


@pytest.mark.parametrize("function", [rattle.iterate, rattle.iterate_tangent])
def test_an_element_does_not_depend_on_the_others(function):
    arguments = _mixed(3000, 1)
    whole = function(*arguments)
    order = np.random.default_rng(2).permutation(3000)
    assert _same(function(*(x[order] for x in arguments)), (x[..., order] for x in whole))
    for piece in (slice(0, 1), slice(7, 110), slice(2900, 3000), slice(5, 3000, 7)):
        assert _same(function(*(x[piece] for x in arguments)), (x[..., piece] for x in whole))
    for k in range(60):
        assert _same(function(*(x[k] for x in arguments)), (x[..., k] for x in whole))
    damping, eccentricity = arguments[:2]
    rough = eccentricity / rattle.quiet_limit(damping)  # kinds that take different stages, each kind on its own
    for piece in (rough < 0.3, rough < 0.6, rough < 1, rough > 1):
        assert piece.sum() > 100
        assert _same(function(*(x[piece] for x in arguments)), (x[..., piece] for x in whole))


def test_threads_at_once_compute_the_same_bits():
    arguments = _mixed(2000, 4)
    pieces = [slice(i, i + 500) for i in range(0, 2000, 500)] * 3
    alone = [rattle.iterate_tangent(*(x[p] for x in arguments)) for p in pieces]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda p: rattle.iterate_tangent(*(x[p] for x in arguments)), pieces))
    assert all(_same(a, b) for a, b in zip(alone, together, strict=True))


def test_n_impacts_are_n_times_one():
    delta, epsilon, tau, v, n, beta = _mixed(400, 5)
    delta, epsilon = delta + 0.3, epsilon * 0.1  # tame: rounding does not grow
    state, minus = (tau, v), 0
    for _ in range(5):
        once = rattle.iterate(delta, epsilon, *state, 1, beta)
        state, minus = (once.tau, once.v), minus + once.n_minus
    five = rattle.iterate(delta, epsilon, tau, v, 5, beta)
    assert np.array_equal(five.n_minus, minus)
    assert np.abs((five.tau - state[0] + 0.5) % 1 - 0.5).max() < 1e-9
    np.testing.assert_allclose(five.v, state[1], atol=1e-9)
    assert (rattle.iterate(delta, epsilon, tau, v, n, beta).n_plus <= n).all()


def test_shapes_and_nothing_to_do():
    still = rattle.iterate(0.6, 0.1, [0.25, 1.75, -0.25], [1.0, 2.0, 3.0], 0)
    assert still.tau.tolist() == [0.25, 0.75, 0.75]
    assert still.v.tolist() == [1.0, 2.0, 3.0]
    assert still.n_plus.tolist() == still.n_minus.tolist() == [0, 0, 0]
    assert np.isnan(rattle.iterate_tangent(0.6, 0.1, 0.25, 1.0, 0).lyapunov).all()
    nothing = rattle.iterate(0.6, np.zeros((0, 3)), 0.5, 1.0, 4)
    assert all(x.shape == (0, 3) for x in nothing)
    assert rattle.iterate_tangent(0.6, [], 0.5, 1.0, 4).lyapunov.shape == (2, 0)
    wide = rattle.iterate(np.full((3, 1), 0.6), np.full(4, 0.1), 0.5, 5.0, [[1], [0], [7]])
    assert all(x.shape == (3, 4) for x in wide)
    assert wide.n_plus.tolist() == [[1] * 4, [0] * 4, [7] * 4]
    assert rattle.iterate(0.6, 0.1, -1e-300, 5.0, 1).n_plus == 1


@pytest.mark.parametrize(
    "bad",
    [{"delta": 0.0}, {"delta": -0.6}, {"delta": math.nan}, {"epsilon": -0.1}, {"epsilon": math.inf}, {"tau": math.nan},
     {"tau": math.inf}, {"v": 0.0}, {"v": -1.0}, {"v": math.nan}, {"v": math.inf}, {"n": -1}, {"n": 1.5},
     {"n": 1 << 60}, {"n": "x"}, {"beta": 0.0}, {"beta": math.nan}, {"tau": [0.1, 0.2], "v": [1.0, 1.0, 1.0]},
     {"v": "fast"}, {"v": True}, {"v": 1j}, {"v": [[1.0], [1.0, 2.0]]}],
    ids=repr,
)  # fmt: skip
@pytest.mark.parametrize("function", [rattle.iterate, rattle.iterate_tangent, count_flights])
def test_bad_input_is_refused(function, bad):
    good = {"delta": 0.6, "epsilon": 0.1, "tau": 0.5, "v": 1.0, "n": 3, "beta": 0.6}
    with pytest.raises(rattle.ParameterError):
        function(**(good | bad))


def test_shares_of_the_paths():
    """Workloads A (one parameter point) and C (the plane of Figure 7): how often the quick proof does not suffice."""
    rng = np.random.default_rng(7)
    tau, v = rng.random(4096), rng.uniform(0.5, 7.0, 4096)
    delta, epsilon = (x.ravel() for x in np.meshgrid(np.linspace(0.4, 1, 64), np.linspace(0.02, 0.3, 64)))
    for name, d, e, most_scanned, most_searched in (("A", 0.6, 0.1, 0.01, 0.002), ("C", delta, epsilon, 0.25, 0.08)):
        flown, scanned, searched = count_flights(d, e, tau, v, 100)
        print(f"{name}: {flown} flights, scanned {scanned / flown:.4%}, searched {searched / flown:.4%}")
        assert flown >= 409_600
        assert scanned < most_scanned * flown
        assert searched < most_searched * flown


# ---- tangent vectors ------------------------------------------------------------------------------------------------


def test_exponents_sum_to_minus_the_damping_and_states_are_those_of_iterate():
    arguments = _mixed(2000, 6)
    arguments[4] += 1
    plain, stretched = rattle.iterate(*arguments), rattle.iterate_tangent(*arguments)
    assert _same(plain, stretched[:4])
    done = stretched.n_plus == arguments[4]
    assert done.mean() > 0.9
    # the mean over a short time is worth less, and a slow departure costs a flight's determinant digits, 1e-16/v
    off = (stretched.time * np.abs(stretched.lyapunov.sum(axis=0) + arguments[0]))[done]
    print(f"sum of exponents + δ, times the time: {off.max():.1e} at most, {np.median(off):.1e} in the median")
    assert np.median(off) < 1e-13
    assert off.max() < 1e-10
    rng = np.random.default_rng(7)
    long = rattle.iterate_tangent(0.6, 0.1, rng.random(512), rng.uniform(0.5, 7.0, 512), 300)
    off = np.abs(long.lyapunov.sum(axis=0) + 0.6)[long.time > 10]
    print(f"workload A: sum of exponents + δ within {off.max():.1e} on {off.size} trajectories")
    assert off.size > 50
    assert off.max() < 1e-12


def test_exponents_of_a_stable_orbit_are_those_of_its_multipliers():
    gear = rattle.Gear(0.6, 0.0615)
    orbit = next(o for o in gear.orbits() if o.stable)
    found = rattle.iterate_tangent(gear.delta, gear.epsilon, orbit.tau, orbit.v, 200_000)
    assert found.time == pytest.approx(200_000 * 1.0, abs=1e-3)
    expected = np.sort(np.log(np.abs(orbit.multipliers)))[::-1]
    assert found.lyapunov == pytest.approx(expected, abs=2e-5)  # a transient over 200 000 periods
