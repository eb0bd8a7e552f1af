"""Order spectra against the equation of motion, by quadrature; densities against trains whose density is known."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from pieces import CELLS, contact_force, nodes, stable_orbits

import rattle
from rattle.intensity import spectrum
from rattle.intensity.visit import Impacts
from rattle.stiff import StiffGear
from rattle.stiff.map.quiet import quiet_depth

HIGHEST = 6.0


@pytest.mark.parametrize("name", CELLS)
def test_lines_are_those_of_the_equation_of_motion(name: str) -> None:
    """Force of the walls = contact force − (iω)² Φ − iωδ Φ at every order, with Φ from quadrature."""
    gear = CELLS[name]
    for each in [*stable_orbits(gear), *gear.orbits()]:
        found, at = gear.spectrum(each, HIGHEST), nodes(gear, each)
        np.testing.assert_allclose(found.order, np.arange(HIGHEST * each.m + 1) / each.m, rtol=1e-15)
        omega = 2 * np.pi * found.order
        waves = at.weight * np.exp(-1j * omega[:, None] * at.time) / each.m
        walls = waves @ contact_force(gear, at.time) - (1j * omega * gear.delta - omega**2) * (waves @ at.phi)
        size = 4 * math.pi * gear.delta
        np.testing.assert_allclose(found.amplitude, -walls, rtol=0, atol=1e-7 * size)
        assert found.amplitude[0] == pytest.approx(-size, rel=1e-10)


def test_lines_of_the_impacting_gear_are_sums_over_impacts() -> None:
    gear = CELLS["the paper's"]
    for each in stable_orbits(gear):
        found, impacts = gear.spectrum(each, HIGHEST), gear.impacts(each)
        waves = np.exp(-2j * np.pi * found.order[:, None] * impacts.time)
        np.testing.assert_allclose(found.amplitude, waves @ (-2 * impacts.wall * impacts.speed) / each.m, atol=1e-11)


def test_quiet_motion_has_the_lines_of_its_contact() -> None:
    time = np.arange(256) / 256
    impacting, stiff = rattle.Gear(0.6, 0.05), StiffGear(0.6, 0.05, kappa=200.0)
    spring = 2 * stiff.kappa * quiet_depth(0.6, 0.05, stiff.kappa, time)[0]
    for gear, force in ((impacting, contact_force(impacting, time)), (stiff, spring)):
        found = gear.spectrum(gear.attractors(8)[0], HIGHEST)
        np.testing.assert_allclose(found.amplitude, -np.fft.rfft(force)[:7] / 256, atol=1e-12)


def poisson(rate: float, periods: float, seed: int) -> Impacts:
    """Impulses at random, of random size and wall: no order is louder than another."""
    rng = np.random.default_rng(seed)
    time = np.sort(rng.uniform(0, periods, rng.poisson(rate * periods)))
    speed, wall = rng.uniform(0, 2, time.size), rng.choice([-1, 1], time.size)
    return Impacts(time, wall, speed, speed, np.zeros(time.size), 2 * speed)


def test_the_density_of_random_impulses_is_flat() -> None:
    rate, length = 3.0, 16.0
    periods = 0.5 * (spectrum.SEGMENTS + 1) * length
    level = rate * 16 / 3  # of the mean square of an impulse
    order, point = np.arange(257) / length, SimpleNamespace(delta=1.0, epsilon=0.0)
    hits, means = [], []
    for seed in range(8):
        found = spectrum._welch_density(poisson(rate, periods, seed), order, 0.0, length, point, math.inf)
        means.append(found.density[1:].mean())  # its standard error is 1.7 % of the level
        hits.append((found.low[1:] < level) & (level < found.high[1:]))
    assert np.mean(means) == pytest.approx(level, rel=0.02)
    assert 0.93 < np.mean(hits) < 0.97


def test_chaos_has_the_power_of_its_impulses() -> None:
    """Far up, where impacts have forgotten each other's phases, the density is the rate of their squared impulses."""
    gear = rattle.Gear(0.6, 0.1)
    attractor = next(each for each in gear.attractors(16) if each.kind == "chaotic")
    found = gear.spectrum(attractor, 64.0, 16)
    between = (found.order > 24) & (np.abs(found.order - np.rint(found.order)) > 0.2)
    impacts = gear.impacts(attractor, 8000.0)
    assert found.density[between].mean() == pytest.approx((impacts.impulse**2).sum() / 8000.0, rel=0.05)
    assert np.all(found.low < found.density)
    assert np.all(found.density < found.high)


@pytest.mark.parametrize("name", CELLS)
def test_the_density_of_a_periodic_motion_has_peaks_of_its_lines(name: str) -> None:
    """Hann's window makes of a line the peak |c|² (∫w)²/∫w² = |c|² 2L/3, and 0 from the second order beside it on."""
    gear = CELLS[name]
    for each in stable_orbits(gear)[:2]:
        length = 4.0 * each.m
        highest = int(min(0.8 / max(gear.impacts(each).duration.max(), 1e-9), 64.0))
        assert highest >= 2
        lines = gear.spectrum(each, highest)
        order = np.arange(highest * length + 1) / length
        impacts = gear.impacts(each, 0.5 * (spectrum.SEGMENTS + 1) * length)
        found = spectrum._welch_density(impacts, order, each.tau, length, gear._point, gear._stiffness)
        peaks = np.abs(lines.amplitude) ** 2 * 2 * length / 3
        np.testing.assert_allclose(found.density[::4], peaks, rtol=1e-6, atol=1e-6 * peaks.max())
        np.testing.assert_allclose(found.density[2::4], 0.0, atol=1e-6 * peaks.max())


def test_what_has_no_spectrum_is_refused() -> None:
    gear = rattle.Gear(0.6, 0.1)
    c = gear.orbits()[-1]
    undecided = rattle.Attractor("undecided", 0, 0, 0, 1.0, (0, 1), (0, 0), 0.0, 0.1, 1.0)
    for motion, options, said in (
        (undecided, {}, "undecided"),
        (c, {"highest": 0.0}, "highest"),
        (c, {"highest": 1e9}, "make `highest` smaller"),
        (c, {"resolution": 2}, "resolution"),
    ):
        with pytest.raises(rattle.RattleError, match=said):
            gear.spectrum(motion, **options)
