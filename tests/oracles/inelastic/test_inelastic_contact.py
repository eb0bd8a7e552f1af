"""Chatter that completes, contact phases and their release, against a brute force that shares no code."""

import math

import numpy as np
import pytest
from depth import either
from inelastic_march import CONTACT, IMPACT, RELEASE, march

import rattle
from rattle.inelastic import InelasticGear
from rattle.inelastic.map.contact import is_chatter_captured
from rattle.inelastic.map.harmonics import contact_force_and_rate

BUMPS = [(3, 0.12, 0.3), (8, 0.03, 0.6)]


def arrays(gear: InelasticGear) -> tuple[np.ndarray, ...]:
    rows = [(1.0, 1.0, 0.0), *gear.harmonics]
    orders, sizes, phases = (np.array([float(x) for x in column]) for column in zip(*rows, strict=True))
    return orders, gear.epsilon * sizes, phases


def marched(gear: InelasticGear, tau: float, v: float, periods: float) -> np.ndarray:
    events = np.zeros((200_000, 4))
    drift = 4 * math.pi * (1 + gear.load)
    numbers = gear.delta, drift, gear.beta, gear.restitution, 1e-9
    n, *_rest, quiet = march(tau, -v, 1, tau + periods, *numbers, *arrays(gear), events)
    events = events[:n]
    return np.vstack([events, [np.inf, 0, 0, 0]]) if quiet else events


def random_gear(rng: np.random.Generator) -> InelasticGear:
    delta = float(rng.uniform(0.1, 0.8))
    harmonics = [(int(k), float(rng.uniform(0, 0.6) / k**2), float(rng.random())) for k in (2, 5, 9)]
    load = float(rng.choice([0.0, 1.0]))
    epsilon = (
        float(rng.uniform(0.7, 4.0))
        * rattle.Gear(delta, 0.1, 0.6, restitution=0.9, load=load, harmonics=harmonics).quiet_limit
    )
    return InelasticGear(
        delta,
        epsilon,
        float(np.exp(rng.uniform(np.log(0.005), np.log(0.8)))),
        float(rng.uniform(0.3, 0.9)),
        load,
        harmonics,
    )


def test_captured_means_that_the_chatter_completes() -> None:
    """Up to the bound, every impact is on the same wall, and contact begins before the force turns."""
    rng, seen = np.random.default_rng(4), 0
    while seen < either(60, 600):
        gear = random_gear(rng)
        point, tau = gear._point, float(rng.random())
        force, _rate = contact_force_and_rate(tau, gear.delta, point.drift, point.harmonics)
        if force <= 0.0:
            continue
        fastest = min(point.capture * force * force, math.sqrt(1.44 * gear.beta * force))
        assert is_chatter_captured(1, fastest * (1 - 1e-9), force, point)
        assert point.quiet_invariant > 0.0 or not is_chatter_captured(1, fastest * (1 + 1e-9), force, point)
        events = marched(gear, tau, fastest * (1 - 1e-9), 2.0)
        first = int(np.argmax(events[:, 1] != IMPACT))
        assert events[first, 1] == CONTACT
        assert np.all(events[:first, 2] == 1)
        zeros = gear.contact_force_zeros
        if zeros.size:
            ahead = np.min((zeros - tau) % 1.0)
            assert events[first, 0] - tau < ahead
            assert events[first + 1, 1] == RELEASE
            assert events[first + 1, 0] - tau == pytest.approx(ahead, abs=1e-9)
        seen += 1


def test_motions_are_those_of_the_brute_force() -> None:
    """Impacts, releases and contacts one by one, on both walls, until rounding is stretched to 1e-6."""
    rng, contacts, below = np.random.default_rng(6), 0, 0
    for _ in range(either(30, 300)):
        gear = random_gear(rng)
        tau, v = float(rng.random()), float(rng.uniform(0.2, 4.0))
        periods = 3.0
        events = marched(gear, tau, v, periods)
        motion = gear.trajectory(tau, v, periods, 3001)
        impacts = events[events[:, 1] == IMPACT]
        slow = 1e-2  # slower ones may belong to a chatter that is summed
        seen = impacts[(impacts[:, 3] > slow) & (impacts[:, 0] < tau + periods)]
        ours = np.stack([motion.impact_time + tau, motion.impact_wall, motion.impact_speed], axis=1)
        ours = ours[ours[:, 2] > slow]
        count = min(len(ours), len(seen), 40)
        assert count > 0
        assert ours[:count, 0] == pytest.approx(seen[:count, 0], abs=1e-6)
        np.testing.assert_array_equal(ours[:count, 1], seen[:count, 2])
        resting = (motion.velocity == 0.0) & (np.abs(motion.phi) == gear.beta)
        kinds = events[(events[:, 1] == CONTACT) | (events[:, 1] == RELEASE)]
        held = np.zeros(motion.time.size, bool)
        for i, (time, kind, _wall, _speed) in enumerate(kinds):
            if kind == CONTACT:
                end = kinds[i + 1][0] if i + 1 < len(kinds) else np.inf
                held |= (motion.time + tau > time) & (motion.time + tau < end)
                contacts += 1
                below += _wall < 0
        assert np.mean(held != resting) < 2e-3
    assert contacts > 10
    assert below > 0


def test_impulses_balance_with_contact() -> None:
    """(1 + r)(Σv₊ − Σv₋) and the force in contact balance the drift δq, of periodic motions with contact phases."""
    rng, seen = np.random.default_rng(8), 0
    while seen < either(6, 60):
        gear = random_gear(rng)
        for x in gear.attractors(16):
            if x.kind != "periodic" or not x.contacts or x.m > 20:
                continue
            point = gear._point
            motion = gear.trajectory(x.tau, x.v, x.m + 1e-9, 20_001)
            impulse = (1 + gear.restitution) * float((motion.impact_wall * motion.impact_speed).sum())
            resting = (motion.velocity == 0.0) & (np.abs(motion.phi) == gear.beta)
            edges = np.flatnonzero(np.diff(resting.astype(int)) == 1)
            for edge in edges:
                before = np.flatnonzero(motion.impact_time <= motion.time[edge + 1])[-1]
                begin, wall = motion.impact_time[before] + x.tau, motion.impact_wall[before]
                zeros = gear.contact_force_zeros
                end = begin + np.min((zeros - begin) % 1.0)
                t, weights = np.polynomial.legendre.leggauss(60)
                grid = 0.5 * (begin + end) + 0.5 * (end - begin) * t
                force = np.array(
                    [contact_force_and_rate(s % 1.0, gear.delta, point.drift, point.harmonics)[0] for s in grid]
                )
                pressed = 0.5 * (end - begin) * float(weights @ force)
                # from there to the release Φ' goes from that of departure to 0
                impulse += pressed - wall * gear.restitution * motion.impact_speed[before]
            if resting[0] or resting[-1] or edges.size != x.contacts:
                continue  # in contact at its ends, or for less than the time between two samples
            assert impulse / x.m == pytest.approx(gear.delta * point.drift, rel=1e-8), (gear, x)
            seen += 1


def test_quiet_is_contact_that_is_never_released() -> None:
    """Below the quiet limit all goes quiet at strong restitution losses; just above it nothing does."""
    limit = InelasticGear(0.6, 0.1, 0.6, 0.5).quiet_limit
    below = InelasticGear(0.6, 0.99 * limit, 0.6, 0.5).attractors(64)
    above = InelasticGear(0.6, 1.01 * limit, 0.6, 0.5).attractors(64)
    assert "quiet" in {x.kind for x in below}
    assert "quiet" not in {x.kind for x in above}
    assert any(x.contacts for x in above)


def test_contact_forgets() -> None:
    """States that are captured before one release go on alike, to the bit, and the tangent map is 0."""
    gear = InelasticGear(0.6, 0.25, 0.6, 0.6, 0.0, BUMPS)
    zeros = gear.contact_force_zeros
    assert zeros.size
    tau = float(zeros[0] - 0.02) % 1.0
    found = [gear.impact(tau - shift, speed) for shift in (0.0, 1e-3) for speed in (1e-4, 2e-4)]
    point = gear._point
    force, _rate = contact_force_and_rate(tau, gear.delta, point.drift, point.harmonics)
    if force > 0:
        assert len({(each.tau, each.v) for each in found}) == 1
        assert not found[0].tangent.any()
