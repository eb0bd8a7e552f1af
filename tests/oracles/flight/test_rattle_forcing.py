"""The forcing against 40-digit derivatives of ε cos 2πt, and against sums of it."""

import cmath
import math
import re
from pathlib import Path

import mpmath as mp
import numpy as np
import pytest

import rattle
from rattle.flight import forcing
from rattle.flight.forcing import Forcing

RATTLE = Path(rattle.__file__).parent
#: Rooms that ask the forcing; proofs and the paper have their own formulas, because they check these.
ASK = ("flight", "orbits", "impacting", "stiff", "attractors", "families", "intensity", "continuation")
#: Closed forms of one cosine, each said so in its module; sound is a ringing body's.
OWN = {
    "attractors/measures.py",
    "flight/between.py",
    "flight/forcing.py",
    "impacting/attractors/boundary_distance.py",
    "impacting/bifurcations/registry.py",
    "intensity/sound.py",
    "intensity/spectrum.py",
    "orbits/saddles.py",
    "stiff/bifurcations/curves.py",
    "stiff/map/contact.py",
    "stiff/map/quiet.py",
    "stiff/orbits/closure.py",
}


def derivative(order, t, epsilon):
    """The derivative of e of this order at t, in 40 digits."""
    with mp.workdps(40):
        turn = 2 * mp.pi
        return mp.mpf(epsilon) * turn**order * mp.cos(turn * mp.mpf(t) + order * mp.pi / 2)


def force(t, delta, epsilon):
    """g at t, in 40 digits."""
    return 4 * mp.pi * mp.mpf(delta) + derivative(2, t, epsilon) + delta * derivative(1, t, epsilon)


def integral(t, s, delta, epsilon):
    """∫ g over a time s from t on, in 40 digits, from what g is the derivative of."""
    with mp.workdps(40):
        end = mp.mpf(t) + mp.mpf(s)
        changes = [derivative(order, end, epsilon) - derivative(order, t, epsilon) for order in (0, 1)]
        return 4 * mp.pi * mp.mpf(delta) * mp.mpf(s) + changes[1] + delta * changes[0]


@pytest.fixture
def rng():
    return np.random.default_rng(58)


def test_derivatives_of_the_forcing(rng):
    for _ in range(200):
        t, epsilon, x = rng.random(), rng.uniform(0, 0.5), rng.uniform(-1, 1)
        at = forcing.sine_cosine_at(t)
        assert at == pytest.approx((math.sin(2 * math.pi * t), math.cos(2 * math.pi * t)), abs=1e-15)
        for order, found in (
            (1, forcing.add_slope(x, *at, epsilon) - x),
            (2, forcing.add_acceleration(x, *at, epsilon) - x),
            (3, forcing.third_derivative(*at, epsilon)),
            (4, forcing.fourth_derivative(*at, epsilon)),
        ):
            assert found == pytest.approx(float(derivative(order, t, epsilon)), abs=1e-14 * (2 * math.pi) ** order)
        third, fourth, minus_fifth = (
            each(np.float32(at[0]), np.float32(at[1]), np.float32(epsilon))
            for each in (
                forcing.forcing_third_derivative32,
                forcing.forcing_fourth_derivative32,
                forcing.minus_forcing_fifth_derivative32,
            )
        )
        assert third == pytest.approx(float(derivative(3, t, epsilon)), abs=2e-4)
        assert fourth == pytest.approx(float(derivative(4, t, epsilon)), abs=2e-3)
        assert minus_fifth == pytest.approx(float(-derivative(5, t, epsilon)), abs=1e-2)


def test_changes_of_the_forcing_over_a_flight(rng):
    for s in (1e-7, 1e-3, 0.2, 1.7):
        t0, epsilon = rng.random(), rng.uniform(0.01, 0.5)
        with mp.workdps(40):
            drop = derivative(0, t0, epsilon) + s * derivative(1, t0, epsilon) - derivative(0, t0 + mp.mpf(s), epsilon)
            loss = derivative(1, t0, epsilon) - derivative(1, t0 + mp.mpf(s), epsilon)
        step, (sine0, cosine0) = forcing.versines(s), forcing.sine_cosine_at(t0)
        dsin, cosine1 = forcing.sine_change_and_new_cosine(step, sine0, cosine0)
        tolerance = 1e-8 if s < 1e-6 else 1e-12
        found = forcing.drop_below_tangent_line(step, sine0, cosine0, epsilon)
        assert found == pytest.approx(float(drop), rel=tolerance, abs=1e-15 * s)
        assert forcing.slope_loss_from_sine_change(dsin, epsilon) == pytest.approx(float(loss), rel=tolerance)
        later = sine0 + dsin, cosine1
        assert later == pytest.approx(forcing.sine_cosine_at((t0 + s) % 1.0), abs=1e-14)
        assert forcing.slope_loss(sine0, cosine0, *later, epsilon) == pytest.approx(float(loss), abs=1e-14)
        after = forcing.IN_DOUBLE.add_acceleration_at_changed_phase(0.25, sine0, dsin, cosine1, epsilon)
        assert after == pytest.approx(forcing.add_acceleration(0.25, *later, epsilon), abs=1e-14)
        change = forcing.analytic_forcing_change(complex(t0), complex(t0 + s), complex(s), epsilon)
        assert change == pytest.approx(float(s * derivative(1, t0, epsilon) - drop), abs=1e-14)


def test_a_short_step_of_the_phase(rng):
    for u in (1e-4, -1e-4, 1e-6):
        sine, cosine = forcing.sine_cosine_at(t0 := rng.random())
        later = forcing.advance_sine_and_cosine(forcing.short_versine_and_sine(u), sine, cosine)
        assert later == pytest.approx(forcing.sine_cosine_at(t0 + u), abs=3e-15)


def test_bounds_hold_at_every_phase(rng):
    t = np.linspace(0, 1, 4001)
    for _ in range(20):
        epsilon, t0 = rng.uniform(0.01, 0.5), rng.random()
        slopes, accelerations = (np.array([float(derivative(order, x, epsilon)) for x in t[::20]]) for order in (1, 2))
        assert abs(slopes).max() <= forcing.largest_forcing_slope(epsilon) * (1 + 1e-12)
        assert abs(accelerations).max() <= float(forcing.largest_acceleration32(np.float32(epsilon))) * (1 + 1e-6)
        assert np.ptp(slopes) <= float(forcing.forcing_slope_range32(np.float32(epsilon))) * (1 + 1e-6)
        sine, cosine = forcing.sine_cosine_at(t0)
        loss = float(derivative(1, t0, epsilon)) - slopes.min()
        largest = forcing.largest_slope_loss32(np.float32(sine), np.float32(cosine), np.float32(epsilon))
        assert loss <= float(largest) + 1e-6


def test_the_contact_force_and_what_is_known_of_it(rng):
    t = np.linspace(0, 1, 2001)
    for _ in range(20):
        delta, epsilon = rng.uniform(0.05, 2.0), rng.uniform(0.01, 0.5)
        exact = np.array([float(force(x, delta, epsilon)) for x in t])
        found = [forcing.contact_force(*forcing.sine_cosine_at(x), delta, epsilon, forcing.DRIFT) for x in t]
        assert found == pytest.approx(exact, abs=1e-12)
        assert exact[:-1].mean() == pytest.approx(forcing.mean_contact_force(delta), rel=1e-12)
        kernel_swing, swing = forcing.contact_force_amplitude(delta, epsilon), np.ptp(exact) / 2
        assert swing == pytest.approx(kernel_swing, rel=1e-5)
        share = kernel_swing / exact[:-1].mean()
        assert forcing.relative_force_amplitude(delta, epsilon) == pytest.approx(share, rel=1e-12)
        assert Forcing(epsilon).relative_force_amplitude(delta) == pytest.approx(share, rel=1e-12)
        assert Forcing(epsilon).least_force(np.float64(delta)) == pytest.approx(exact.min(), abs=1e-4)
        assert abs((t[np.argmin(exact)] - forcing.phase_of_least_force(delta) + 0.5) % 1.0 - 0.5) < 1e-3
        assert forcing.has_force_amplitude_above(0.99 * share, delta, epsilon)
        assert not forcing.has_force_amplitude_above(1.01 * share, delta, epsilon)
        lines = sum(
            size * cmath.exp(1j * frequency * 0.3) for frequency, size in Forcing(epsilon).spectral_lines(delta)
        )
        assert lines.real == pytest.approx(float(force(0.3, delta, epsilon)), rel=1e-13)
        assert lines.imag == pytest.approx(0.0, abs=1e-12)
        rate = float(derivative(3, 0.3, epsilon) + delta * derivative(2, 0.3, epsilon))
        assert forcing.contact_force_rate(*forcing.sine_cosine_at(0.3), delta, epsilon) == pytest.approx(
            rate, rel=1e-12
        )
        arc = forcing.find_negative_force_arc(delta, epsilon)
        assert arc.exists == (exact.min() < 0.0)
        if arc.exists:
            entry = forcing.phase_of_arc_entry(delta, 1.0 / share)
            assert abs((arc.exit_phase - arc.length - entry + 0.5) % 1.0 - 0.5) < 1e-12
            assert abs(float(force(entry, delta, epsilon))) < 1e-12


def test_the_quiet_limit_is_where_the_force_just_reaches_zero():
    for delta in (0.02, 0.6, 3.0):
        epsilon = float(forcing.quiet_eccentricity(np.float64(delta)))
        phase = forcing.phase_of_least_force(delta)
        assert abs(float(force(phase, delta, epsilon))) < 1e-14
        assert forcing.damping_at_quiet_limit(epsilon) == pytest.approx(delta, rel=1e-12)
        assert np.abs(Forcing(epsilon).quiet_limit_residuals(np.float64(phase), np.float64(delta))).max() < 1e-14


def test_the_force_ahead_of_a_contact_and_its_integral(rng):
    for _ in range(50):
        delta, epsilon, t, s = rng.uniform(0.05, 2), rng.uniform(0, 0.5), rng.random(), rng.uniform(0, 2)
        wall = int(rng.choice([1, -1]))
        mean, a, b = forcing.force_fourier_coefficients(wall, *forcing.sine_cosine_at(t), delta, epsilon)
        ahead = mean + a * math.cos(2 * math.pi * s) + b * math.sin(2 * math.pi * s)
        assert ahead == pytest.approx(wall * float(force(t + s, delta, epsilon)), abs=1e-12)
        exact = wall * float(integral(t, s, delta, epsilon))
        assert forcing.force_integral(s, mean, a, b) == pytest.approx(exact, abs=1e-12)
        analytic = forcing.force_fourier_coefficients_of_complex_phase(
            wall, *forcing.sine_cosine_of_complex_time(complex(t)), delta, epsilon
        )
        assert analytic == pytest.approx((mean, a, b), abs=1e-12)


def test_nothing_else_evaluates_the_forcing():
    """A sine or cosine elsewhere is of something else, or in a module that says that it holds for one cosine."""
    evaluates = re.compile(r"\b(?:math|np)\.(?:sin|cos)\(|TWO_PI \* epsilon|2 \* np\.pi \* epsilon")
    found = {
        path.relative_to(RATTLE).as_posix()
        for room in ASK
        for path in (RATTLE / room).rglob("*.py")
        if evaluates.search(path.read_text())
    }
    assert found == OWN
