"""What holds for every motion with restitution: determinants, exponents, and the symmetries of time."""

import math

import numpy as np
from depth import either

from rattle import inelastic
from rattle.flight.first_impact import OK
from rattle.inelastic import InelasticGear
from rattle.inelastic.map.cells import cells_of_forcing_shape, inelastic_point_of_cell
from rattle.inelastic.map.impact_map import InelasticPoint, step

MOTIONS = 300
FORCINGS = ((), [(2, 0.1, 0.2), (5, 0.02, 0.9)], [(20, 0.003, 0.4)])


def random_gear(rng: np.random.Generator, forcing: int) -> InelasticGear:
    delta, epsilon, r = rng.uniform(0.3, 0.9), rng.uniform(0.05, 0.3), rng.uniform(0.5, 0.99)
    return InelasticGear(delta, epsilon, 0.6, r, float(rng.choice([0.0, 0.5])), FORCINGS[forcing])


def log_determinant(gear: InelasticGear, tau: float, v: float, steps: int) -> tuple[float, float, int, float]:
    """ln|det| of so many returns in (τ, v²/2), their time and impacts, and the largest entry of their tangents.

    The tangent of each return by itself: nothing of what the library adds up along the way.
    """
    total, time, impacts, largest = 0.0, 0.0, 0, 0.0
    for _ in range(steps):
        found = gear.impact(tau, v)
        total += math.log(abs(np.linalg.det(found.tangent)) * found.v / v)
        time, impacts = time + found.time, impacts + 1 + found.n_minus
        largest = max(largest, float(np.abs(found.tangent).max()))
        tau, v = found.tau, found.v
    return total, time, impacts, largest


def test_multipliers_of_300_motions() -> None:
    """Their product is e^(−δm) r^(2n), and it is that of the determinants of the returns."""
    rng, seen = np.random.default_rng(11), 0
    while seen < either(60, MOTIONS):
        gear = random_gear(rng, seen % 3)
        for x in gear.attractors(16):
            if x.kind != "periodic" or x.contacts:
                continue
            orbit = gear.orbit(x.tau, x.v, x.n_plus)
            wanted = -gear.delta * orbit.m + 2 * (orbit.n_plus + orbit.n_minus) * math.log(gear.restitution)
            assert abs(math.log(abs(math.prod(orbit.multipliers))) - wanted) < 1e-9
            assert abs(sum(x.lyapunov) - wanted / orbit.m) < 1e-9
            total, time, impacts, largest = log_determinant(gear, orbit.tau, orbit.v, orbit.n_plus)
            assert impacts == orbit.n_plus + orbit.n_minus
            assert abs(time - orbit.m) < 1e-9
            if largest < 1e3:  # else the determinant is a difference of large products
                assert abs(total - wanted) < 1e-9
            seen += 1


def test_sum_rule_of_300_motions() -> None:
    """λ₁ + λ₂ = −δ + 2 ln r times the impacts a period, of any motion without contact, in chaos too."""
    rng, seen, chaotic = np.random.default_rng(12), 0, 0
    while seen < either(60, MOTIONS):
        gear = random_gear(rng, seen % 3)
        tau, v = float(rng.random()), float(rng.uniform(1.0, 6.0))
        numbers = gear.beta, gear.restitution, gear.load, gear.harmonics
        found = inelastic.iterate_tangent(gear.delta, gear.epsilon, tau, v, 400, *numbers)
        exponents = np.asarray(found.lyapunov)
        if found.n_plus < 400 or not np.isfinite(exponents).all():
            continue
        impacts = int(found.n_plus + found.n_minus)
        wanted = -gear.delta + 2 * math.log(gear.restitution) * impacts / float(found.time)
        assert abs(float(exponents.sum()) - wanted) < 1e-9 * max(1.0, abs(wanted))
        total, time, impacts, largest = log_determinant(gear, tau, v, 40)
        if largest < 1e3:
            wanted = -gear.delta * time + 2 * math.log(gear.restitution) * impacts
            assert abs(total - wanted) < 1e-9 * max(1.0, abs(wanted))
        chaotic += bool(exponents[0] > 0.05)
        seen += 1
    assert chaotic > 5


def point_of(
    delta: float, epsilon: float, r: float, load: float, shape: np.ndarray, beta: float = 0.6
) -> InelasticPoint:
    numbers = (np.array([x]) for x in (delta, epsilon, beta, r, load))
    return InelasticPoint(*inelastic_point_of_cell(0, cells_of_forcing_shape(*numbers, np.ascontiguousarray(shape))))


def test_a_shift_of_time_shifts_motions() -> None:
    """With e(t + c) every return is the same, c earlier: contact phases and quiet motion too."""
    rng, ended = np.random.default_rng(13), set()
    for _ in range(MOTIONS):
        delta, epsilon, r, load = (
            rng.uniform(0.3, 0.9),
            rng.uniform(0.03, 0.3),
            rng.uniform(0.5, 1.0),
            rng.choice([0, 0.7]),
        )
        orders = np.array([1.0, 3.0, 11.0])
        shape = np.array([orders, [1.0, 0.05, 0.004], rng.random(3)])
        shift = int(rng.integers(64)) / 64  # of the grid of phases that the bound of quiet motion is taken on
        tau, v = rng.random(), 10.0 ** rng.uniform(-6.0, 0.8)
        later = shape.copy()
        later[2] += orders * shift
        one = step(tau, v, point_of(delta, epsilon, r, load, shape))
        other = step((tau - shift) % 1.0, v, point_of(delta, epsilon, r, load, later))
        assert (one[0], *one[4:]) == (other[0], *other[4:])
        ended.add((one[0], one[5] > 0))
        if one[0] != OK:
            continue
        size = 1e-11 * (1.0 + 1.0 / one[2])  # a graze stretches rounding
        assert abs((one[1] - shift - other[1] + 0.5) % 1.0 - 0.5) < size
        assert abs(one[2] - other[2]) < size
        assert abs(one[3] - other[3]) < size
    assert len(ended) >= 3  # free flights, contact phases, quiet motion


def test_a_forcing_of_shorter_period_is_the_gear_of_that_period() -> None:
    """Orders k j at (δ, q) move as orders k at (δ/j, q/j), in time j times as fast."""
    rng, ended = np.random.default_rng(14), set()
    for _ in range(MOTIONS):
        j = int(rng.integers(2, 6))
        delta, epsilon, r = rng.uniform(0.3, 0.9), rng.uniform(0.01, 0.3), rng.uniform(0.5, 0.99)
        extra, tau, v = float(rng.choice([0.0, 0.3])), rng.random(), 10.0 ** rng.uniform(-6.0, 0.6)
        shape = np.array([[1.0, 2.0, 7.0], [1.0, 0.05, 0.004], rng.random(3)])
        faster = shape.copy()
        faster[0] *= j
        one = step(tau, v, point_of(delta / j, epsilon, r, extra, shape))
        other = step(tau / j, j * v, point_of(delta, epsilon, r, j * (1.0 + extra) - 1.0, faster))
        assert (one[0], *one[4:]) == (other[0], *other[4:])
        ended.add((one[0], one[5] > 0))
        if one[0] != OK:
            continue
        size = 1e-10 * (1.0 + 1.0 / one[2])
        assert abs((one[1] - j * other[1] + 0.5) % 1.0 - 0.5) < size
        assert abs(j * one[2] - other[2]) < j * size
        assert abs(one[3] - j * other[3]) < size
    assert len(ended) >= 3
