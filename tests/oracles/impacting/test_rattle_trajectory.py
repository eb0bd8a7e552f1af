"""Sampled motions against 40 digits, against the impact map, and against closed orbits."""

import flights_high_precision as exact
import numpy as np
import pytest
from high_precision import Flight
from mpmath import mpf

import rattle

PERIODS, POINTS = 2.5, 101


def reference(gear: rattle.Gear, tau: float, v: float, times: np.ndarray) -> list[tuple[float, float]]:
    """Φ and Φ' in 40 digits, from flight to flight."""
    found, start, now, wall = [], mpf(tau), mpf(0), 1
    parameters = gear.delta, gear.epsilon, gear.beta
    departed = wall, start, -mpf(v), *parameters
    end, following, arrival = exact.first_impact(*departed)
    for time in times:
        while mpf(float(time)) >= now + end:
            now, start, wall = now + end, start + end, following
            departed = wall, start, -arrival, *parameters
            end, following, arrival = exact.first_impact(*departed)
        flight, s = Flight(*departed), mpf(float(time)) - now
        found.append((float(flight.position(s)), float(flight.velocity(s))))
    return found


@pytest.mark.parametrize("seed", range(8))
def test_samples_in_40_digits(seed: int) -> None:
    rng = np.random.default_rng([seed, 7])
    gear = rattle.Gear(rng.uniform(0.2, 1.5), rng.uniform(0, 0.4), rng.uniform(0.2, 1.2))
    tau, v = rng.random(), rng.uniform(2, 7)
    found = gear.trajectory(tau, v, PERIODS, POINTS)
    np.testing.assert_array_equal(found.time, np.linspace(0, PERIODS, POINTS))
    expected = np.array(reference(gear, tau, v, found.time)).T
    np.testing.assert_allclose(found.phi, expected[0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.velocity, expected[1], rtol=0, atol=1e-8)


@pytest.mark.parametrize("seed", range(5))
def test_impacts_are_those_of_the_impact_map(seed: int) -> None:
    rng = np.random.default_rng([seed, 11])
    gear = rattle.Gear(rng.uniform(0.4, 1.0), rng.uniform(0.05, 0.3), rng.uniform(0.3, 1.2))
    tau, v = rng.random(), rng.uniform(1, 7)
    found = gear.trajectory(tau, v, 12.0, 500)
    assert np.all(np.abs(found.phi) <= gear.beta + 1e-12)
    assert np.all(np.diff(found.impact_time) > 0)
    upper = found.impact_wall == 1
    assert set(found.impact_wall.tolist()) <= {-1, 1}
    n = int(upper.sum())
    assert n > 2
    end = gear.iterate(tau, v, n)
    assert int(end.n_minus) == np.count_nonzero(found.impact_wall[: np.flatnonzero(upper)[-1]] == -1)
    assert found.impact_speed[upper][-1] == pytest.approx(float(end.v), rel=1e-6)
    phase = (tau + found.impact_time[upper][-1]) % 1
    assert abs(phase - float(end.tau)) < 1e-7


@pytest.mark.parametrize("name", ["C", "D", "A", "B"])
def test_a_closed_orbit_closes(name: str) -> None:
    gear = rattle.Gear(0.6, 0.072)
    orbit = next(orbit for orbit in gear.orbits() if orbit.name == name)
    found = gear.trajectory(orbit.tau, orbit.v, 3.0, 301)
    for values in (found.phi, found.velocity):
        np.testing.assert_allclose(
            values[101:200], values[1:100], atol=1e-9
        )  # the first is at an impact, on either side
    assert found.phi[0] == gear.beta
    assert found.velocity[0] == -orbit.v
    assert len(found.impact_time) in (2, 3) if orbit.n_minus == 0 else len(found.impact_time) in (5, 6)
    assert found.rest == np.inf


def test_quiet_motion_rests_and_no_other() -> None:
    """v falls by e^(−δ/3) a period, on average, down to 1e-4."""
    gear = rattle.Gear(0.6, 0.05)
    found = gear.trajectory(0.2, 0.4, 60.0, 6001)
    expected = 3 / gear.delta * np.log(0.4 / 1e-4)
    assert found.rest == pytest.approx(expected, abs=3)
    resting = found.time > found.rest
    assert np.all(found.phi[resting] == gear.beta)
    assert np.all(found.velocity[resting] == 0)
    assert np.all(found.impact_wall == 1)
    before = (found.time > 30) & ~resting
    assert np.all(found.phi[before] <= gear.beta)
    assert np.any(found.phi[before] < gear.beta)
    assert len(found.impact_time) > 10_000  # more than there is room for at first
    assert np.all(np.diff(found.impact_time) > 0)
    above = rattle.Gear(0.6, 1.01 * gear.quiet_limit)
    assert above.trajectory(0.2, 1e-3, 60.0, 100).rest == np.inf


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"v": 0.0}, "v must be greater"),
        ({"tau": np.nan}, "finite"),
        ({"periods": 0.0}, "periods"),
        ({"periods": 1e9}, "at most"),
        ({"points": 1}, "points"),
        ({"points": 2.5}, "points"),
    ],
)
def test_what_cannot_be_sampled(change: dict[str, float], words: str) -> None:
    given = {"tau": 0.2, "v": 4.0, "periods": 5.0, "points": 10} | change
    with pytest.raises(rattle.ParameterError, match=words):
        rattle.Gear(0.6, 0.1).trajectory(**given)
