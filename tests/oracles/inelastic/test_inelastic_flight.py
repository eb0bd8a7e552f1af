"""Forcing of several harmonics, zeros of its contact force, and first impacts, against 40 digits."""

import numpy as np
import pytest
from depth import either
from inelastic_high_precision import Gear, bisected, first_impact, force, state
from mpmath import mp, mpf

import rattle
from rattle.inelastic.map.cells import make_inelastic_point
from rattle.inelastic.map.flight import evaluate_forced_flight, prepare_forced_flight
from rattle.inelastic.map.harmonics import contact_force_and_rate

FIRST = (1, 1.0, 0.0)


def random_harmonics(rng: np.random.Generator, count: int, highest: int) -> list[tuple[int, float, float]]:
    orders = rng.choice(np.arange(2, highest + 1), count, replace=False)
    return [(int(k), float(rng.random() / k**1.5), float(rng.random())) for k in orders]


def random_gear(rng: np.random.Generator, count: int, highest: int) -> tuple[rattle.Gear, Gear]:
    delta, beta = float(np.exp(rng.uniform(np.log(0.01), 0.0))), float(rng.uniform(0.2, 1.0))
    load = float(rng.uniform(0.0, 2.0))
    epsilon = float(rng.uniform(0.2, 2.0)) * delta / 3
    harmonics = random_harmonics(rng, count, highest)
    ours = rattle.Gear(delta, epsilon, beta, restitution=0.8, load=load, harmonics=harmonics)
    return ours, Gear(delta, epsilon, beta, 4 * np.pi * (1 + load), [FIRST, *ours.harmonics])


@pytest.mark.parametrize(("count", "highest"), [(0, 2), (4, 12), (30, 200)])
def test_contact_force(count: int, highest: int) -> None:
    rng = np.random.default_rng(count)
    for _ in range(20):
        ours, exact = random_gear(rng, count, highest)
        point, tau = ours._point, float(rng.random())
        value, rate = contact_force_and_rate(tau, ours.delta, point.drift, point.harmonics)
        size = sum((2 * np.pi * k) ** 2 * ours.epsilon * a for k, a, _ in exact.harmonics) + exact.delta * exact.drift
        assert abs(value - force(exact, mpf(tau))) < 1e-13 * size * highest
        slope = mp.diff(lambda t, exact=exact: force(exact, t), mpf(tau))
        assert abs(rate - slope) < 1e-12 * size * 2 * np.pi * highest


@pytest.mark.parametrize(("count", "highest"), [(0, 2), (4, 12), (30, 200)])
def test_zeros_of_the_contact_force(count: int, highest: int) -> None:
    """Zeros are as many as on 4000 phases in a period of the highest harmonic, and each is one in 40 digits."""
    rng = np.random.default_rng(7 + count)
    seen = 0
    for _ in range(either(10, 100)):
        ours, exact = random_gear(rng, count, highest)
        found = ours.contact_force_zeros
        grid = np.linspace(0, 1, 4000 * highest + 1)
        values = np.full(grid.size, exact.delta * exact.drift)
        for k, a, phase in exact.harmonics:
            angle, turn = 2 * np.pi * (k * grid + phase), 2 * np.pi * k
            values -= ours.epsilon * a * turn * (turn * np.cos(angle) + exact.delta * np.sin(angle))
        changes = np.flatnonzero((values[1:] > 0) != (values[:-1] > 0))
        assert found.size == changes.size
        assert np.all((grid[changes] <= found) & (found <= grid[changes + 1]))
        seen += found.size
        for zero in found[:: max(1, found.size // 5)]:
            around = [force(exact, mpf(zero) + shift) for shift in (mpf(-1e-13), mpf(1e-13))]
            assert around[0] * around[1] < 0
    assert seen > 0


def test_a_force_that_just_touches_zero() -> None:
    """At the quiet limit both zeros are one; a part in 10¹² beside it there are two, or none."""
    for harmonics in ([], [(3, 0.2, 0.3)], [(20, 0.01, 0.7), (41, 0.002, 0.1)]):
        limit = rattle.Gear(0.4, 0.1, 0.6, restitution=0.9, harmonics=harmonics).quiet_limit
        for scale, count in ((1 - 1e-12, 0), (1 + 1e-12, 2)):
            gear = rattle.Gear(0.4, limit * scale, 0.6, restitution=0.9, harmonics=harmonics)
            assert gear.contact_force_zeros.size == count


@pytest.mark.parametrize(("count", "highest"), [(0, 2), (4, 12), (30, 200)])
def test_flight_law(count: int, highest: int) -> None:
    """F and F' to rounding for any time, short ones too."""
    rng = np.random.default_rng(11 + count)
    for _ in range(30):
        ours, exact = random_gear(rng, count, highest)
        point, tau, w = ours._point, float(rng.random()), float(rng.normal())
        departure = np.empty((2, point.harmonics.shape[1]))
        flight = prepare_forced_flight(tau, w, ours.delta, point.drift, point.harmonics, departure)
        for s in 10.0 ** rng.uniform(-9, 1, 5):
            f0, f1, _f2, _lost = evaluate_forced_flight(float(s), flight, point.harmonics, departure)
            height, speed = state(exact, mpf(tau), mpf(w), mpf(s))
            scale = abs(w) + point.drift + sum(2 * np.pi * k * ours.epsilon * a for k, a, _ in exact.harmonics)
            bend = sum((2 * np.pi * k) ** 2 * ours.epsilon * a for k, a, _ in exact.harmonics)
            assert abs(f0 - height) < 1e-14 * highest * s * (abs(w) + min(scale, s * (bend + scale)))
            assert abs(f1 - speed) < 1e-14 * highest * (abs(w) + min(scale, s * (bend + scale)))


@pytest.mark.parametrize(("count", "highest"), [(0, 2), (4, 12), (30, 200)])
def test_first_impacts(count: int, highest: int) -> None:
    rng = np.random.default_rng(13 + count)
    for _ in range(either(12 if count < 30 else 3, 100 if count < 30 else 20)):
        ours, exact = random_gear(rng, count, highest)
        wall = int(rng.choice([1, -1]))
        tau, speed = float(rng.random()), float(10.0 ** rng.uniform(-3, 0.5))
        s, target, w1 = ours.first_impact(wall, tau, -wall * speed)
        time, hit, velocity = first_impact(exact, wall, tau, -wall * speed)
        assert target == hit
        bend = abs(force(exact, mpf(tau) + time)) / abs(velocity)
        assert abs(s - time) < 1e-13 * highest * time * (1 + bend)
        assert abs(w1 - velocity) < 1e-12 * highest * (abs(velocity) + bend)


@pytest.mark.parametrize("count", [0, 5])
def test_grazes(count: int) -> None:
    """A flight whose extremum is within 1e-12 of the other wall meets it or not, as 40 digits say."""
    rng = np.random.default_rng(17 + count)
    done = 0
    while done < either(8, 40):
        ours, exact = random_gear(rng, count, 9)
        tau, speed = float(rng.random()), float(rng.uniform(0.5, 3.0))
        far = exact._replace(beta=1e3)
        grid = np.linspace(1e-3, 3.0, 3000)
        speeds = [float(state(far, mpf(tau), mpf(-speed), mpf(float(s)))[1]) for s in grid[::10]]
        turn = next((i for i in range(1, len(speeds)) if speeds[i - 1] < 0 < speeds[i]), None)
        if turn is None:
            continue
        ends = mpf(float(grid[::10][turn - 1])), mpf(float(grid[::10][turn]))
        at = bisected(lambda s, v=speed, t=tau, far=far: state(far, mpf(t), mpf(-v), s)[1], *ends)
        lowest = state(far, mpf(tau), mpf(-speed), at)[0]
        if not lowest < -0.05:
            continue
        done += 1
        for side in (1, -1):
            beta = float(-lowest / 2 * (1 + side * mpf(1e-12)))
            gear = rattle.Gear(
                ours.delta, ours.epsilon, beta, restitution=0.8, load=ours.load, harmonics=ours.harmonics
            )
            expected = first_impact(exact._replace(beta=beta), 1, tau, -speed)
            found = gear.first_impact(1, tau, -speed)
            assert found.next_wall == expected[1] == (1 if side > 0 else -1) or expected[0] < at * 0.9
            assert found.next_wall == expected[1]
            assert abs(found.flight_time - expected[0]) < 1e-6


def test_one_cosine_is_that_of_the_elastic_gear() -> None:
    """Without load, harmonics and restitution, flights are those of `rattle.Gear` to rounding."""
    rng = np.random.default_rng(3)
    for _ in range(300):
        delta, epsilon, beta = (float(x) for x in rng.uniform((0.05, 0.0, 0.2), (1.0, 0.3, 1.0)))
        elastic, same = rattle.Gear(delta, epsilon, beta), make_inelastic_point(delta, epsilon, beta, 1.0, 0.0)
        assert same.harmonics.shape == (3, 1)
        wall, tau, speed = int(rng.choice([1, -1])), float(rng.random()), float(10.0 ** rng.uniform(-3, 0.7))
        other = rattle.inelastic.InelasticGear(delta, epsilon, beta).first_impact(wall, tau, -wall * speed)
        first = elastic.first_impact(wall, tau, -wall * speed)
        assert other.next_wall == first.next_wall
        assert other.flight_time == pytest.approx(first.flight_time, rel=1e-9)
