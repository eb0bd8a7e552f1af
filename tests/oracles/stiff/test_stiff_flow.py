"""Flights and contacts of the stiff gear against 60 digits, scipy's integrator, dense samples and invariants."""

import math

import numpy as np
import pytest
from depth import either
from mpmath import mp, mpf
from stiff_high_precision import Contact, integrated

from rattle.flight.first_impact import OK, SIGMA_MINUS, SIGMA_PLUS
from rattle.flight.forcing import force_fourier_coefficients
from rattle.stiff import StiffGear
from rattle.stiff.map import contact, flow
from rattle.stiff.map.quiet import quiet_depth, quiet_limit
from rattle.stiff.map.return_map import StiffPoint, step, step_with_tangent

BETA = 0.6
EPS = np.finfo(float).eps


def state_after(wall, tau, x0, w0, delta, epsilon, kappa, s):
    forced = force_fourier_coefficients(wall, math.sin(2 * math.pi * tau), math.cos(2 * math.pi * tau), delta, epsilon)
    return contact.contact_state(s, contact.Contact(x0, w0, *forced, delta, kappa))[:2]


def random_contact(rng):
    """A wall, a phase and parameters from κ = 1 to 1e10 and δ = 0.01 to 5, underdamped to overdamped."""
    kappa = 10 ** rng.uniform(0, 10)
    return rng.choice([1, -1]), rng.random(), 10 ** rng.uniform(-2, 0.7), rng.uniform(0, 2), kappa


@pytest.mark.parametrize("entry", ["fast", "slow", "deep"])
def test_contact_agrees_with_60_digits(entry: str) -> None:
    rng = np.random.default_rng(7)
    for _ in range(either(60, 150)):
        wall, tau, delta, epsilon, kappa = random_contact(rng)
        omega = math.sqrt(2 * kappa)
        w0 = {"fast": rng.uniform(0.1, 10), "slow": 10 ** rng.uniform(-12, -2), "deep": rng.normal()}[entry]
        x0 = rng.random() / omega if entry == "deep" else 0.0
        s = 10 ** rng.uniform(-6, 0.5) / omega if entry == "slow" else rng.uniform(0, 4) / omega
        x, v = state_after(wall, tau, x0, w0, delta, epsilon, kappa, s)
        exact, exact_v = Contact(wall, tau, x0, w0, delta, epsilon, kappa).at(s)
        force = 4 * math.pi * delta + 2 * math.pi * epsilon * (2 * math.pi + delta)
        scale = x0 + abs(w0) * min(s, 1 / omega) + force * min(s, 1 / omega) ** 2
        # near resonance, κ = 2π², the response is a difference of terms 1/δ as large
        error = 40 * EPS * (1 + (kappa < 100) / delta)
        assert abs(x - exact) < error * scale
        assert abs(v - exact_v) < 40 * EPS * (abs(w0) + force * min(s, 1 / omega) + omega * x0) * (
            1 + (kappa < 100) / delta
        )


@pytest.mark.parametrize("off", [0.0, 1e-14, -1e-14, 1e-9, -1e-9, 1e-5, -1e-5, 1e-2, -1e-2])
def test_nearly_critical_contact_loses_no_digits(off: float) -> None:
    for delta in (0.5, 5.0, 40.0):
        kappa = delta**2 / 8 * (1 + off)
        for s in (0.01, 0.3, 2.0):
            x, v = state_after(1, 0.2, 0.1, 1.0, delta, 0.1, kappa, s)
            mp.dps = 60
            # equal roots would divide by zero: beside them
            exact, exact_v = Contact(1, 0.2, 0.1, 1.0, delta, 0.1, mpf(kappa) * (1 + mpf(10) ** -30)).at(s)
            assert abs(x - exact) < 1e-14 * max(1.0, abs(exact)) * (1 + delta)
            assert abs(v - exact_v) < 1e-14 * (1 + delta) ** 2


@pytest.mark.parametrize(("delta", "kappa"), [(5.0, 1.0), (50.0, 1.0), (1e3, 3.0), (1e6, 10.0)])
def test_overdamped_contact_agrees_with_60_digits(delta: float, kappa: float) -> None:
    for s in (1e-8, 1e-4, 0.01, 0.4, 30.0):
        x, v = state_after(1, 0.3, 0.2, 2.0, delta, 0.3, kappa, s)
        exact, exact_v = Contact(1, 0.3, 0.2, 2.0, delta, 0.3, kappa).at(s)
        assert abs(x - exact) < 1e-13 * max(1.0, abs(exact))
        assert abs(v - exact_v) < 1e-12 * max(1.0, abs(exact_v))


def sampled_end(wall, tau, x0, w0, delta, epsilon, kappa, longest, n=20_001):
    """The first sample at which the depth is below zero, in double precision from complex roots; inf if none is."""
    exact = Contact(wall, tau, x0, w0, delta, epsilon, kappa)
    mean, swing = float(exact.mean), complex(exact.swing)
    parts, roots = [complex(p) for p in exact.parts], [complex(r) for r in exact.roots]
    s = longest * np.arange(1, n) / (n - 1)
    x = mean + (swing * np.exp(2j * np.pi * (tau + s))).real
    x += sum((part * np.exp(root * s)).real for part, root in zip(parts, roots, strict=True))
    noise = 1e-13 * (abs(mean) + abs(swing) + sum(abs(part) for part in parts))
    below = np.flatnonzero(x < -noise)
    return s[below[0]] if below.size else math.inf


def test_no_end_of_contact_is_skipped() -> None:
    rng, kinds, contacts = np.random.default_rng(11), {contact.ENDS: 0, contact.STAYS: 0}, either(150, 400)
    for i in range(contacts):
        wall, tau, delta, epsilon, _ = random_contact(rng)
        kappa = 10 ** rng.uniform(0, 4 if i % 2 else 2)
        if i % 4 == 0:  # about where contact is just lost
            epsilon, wall = float(quiet_limit(delta, kappa)) * rng.uniform(0.5, 1.05), 1
        w0 = 10 ** rng.uniform(-4, 1)
        status, s, _x, v, _sine, _lost = contact.find_contact_end(wall, tau, 0.0, w0, delta, epsilon, kappa, math.inf)
        kinds[status] += 1
        exact = Contact(wall, tau, 0.0, w0, delta, epsilon, kappa)
        if status == contact.STAYS:
            assert sampled_end(wall, tau, 0.0, w0, delta, epsilon, kappa, 30.0) == math.inf
        else:
            assert status == contact.ENDS
            assert sampled_end(wall, tau, 0.0, w0, delta, epsilon, kappa, s * (1 - 1e-6)) == math.inf
            depth, velocity = exact.at(s)
            assert velocity <= 1e-9
            assert abs(depth) < 1e-12 * (s * (abs(velocity) + w0) + s * s / delta)
            assert abs(velocity - v) < 1e-9 * (1 + w0)
    assert min(kinds.values()) > contacts / 20


@pytest.mark.parametrize("kappa", [1.0, 30.0, 1e3, 1e6, 1e10])
def test_a_grazing_contact_is_short_and_exact(kappa: float) -> None:
    """A contact entered with speed w where the force pulls away from the wall lasts 2w/|h|, however small w is."""
    delta, epsilon, tau = 0.6, 0.4, 0.0
    pull = -(4 * math.pi * delta - 4 * math.pi**2 * epsilon)
    for w in (1e-3, 1e-6, 1e-9, 1e-14, 1e-30):
        if w * math.sqrt(2 * kappa) > 1e-2 * pull:
            continue
        status, s, _x, v, _sine, _lost = contact.find_contact_end(1, tau, 0.0, w, delta, epsilon, kappa, math.inf)
        assert status == contact.ENDS
        assert s == pytest.approx(2 * w / pull, rel=1e-3 + 20 * w + kappa * w**2)
        assert v == pytest.approx(-w, rel=1e-3 + 20 * w + kappa * w**2)


def test_runs_agree_with_solve_ivp() -> None:
    rng, contacts = np.random.default_rng(5), np.zeros(2)
    for i in range(60):
        kappa, delta = 10 ** rng.uniform(0, 4.5), 10 ** rng.uniform(-2, 0.7)
        epsilon, beta = rng.uniform(0, 0.4) * (i % 5 > 0), rng.uniform(0.1, 2)
        tau, position, w, duration = rng.random(), rng.uniform(-beta, beta), 4 * rng.normal(), rng.uniform(0.3, 2)
        status, wall, end, w1, n_plus, n_minus, *tangent = flow.flow(
            flow.GAP, tau, position, w, duration, delta, epsilon, beta, kappa
        )
        assert status == OK
        expected, expected_w, plus, minus = integrated(tau, position, w, duration, delta, epsilon, beta, kappa)
        growth = max(1.0, *np.abs(tangent))
        assert (n_plus, n_minus) == (plus, minus)
        assert (end if wall == 0 else wall * (beta + end)) == pytest.approx(expected, abs=1e-9 * growth)
        assert w1 == pytest.approx(expected_w, abs=1e-8 * growth)
        contacts += n_plus, n_minus
    assert contacts.min() > 30


@pytest.mark.parametrize("kappa", [1.0, 50.0, 1e4, 1e7, 1e10])
def test_tangent_has_the_determinant_of_the_divergence(kappa: float) -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        delta, epsilon = 10 ** rng.uniform(-2, 0.7), rng.uniform(0, 0.4)
        periods = 2
        found = flow.flow(flow.GAP, 0.0, 0.1, 4 * rng.normal(), periods, delta, epsilon, BETA, kappa)
        j00, j01, j10, j11 = found[6:]
        size = abs(j00 * j11) + abs(j01 * j10)
        error = 1e-12 * size * (1 + EPS * kappa * 1e4)
        assert j00 * j11 - j01 * j10 == pytest.approx(math.exp(-delta * periods), abs=error)


def test_tangent_of_a_return_is_its_derivative() -> None:
    rng = np.random.default_rng(2)
    tried = 0
    while tried < 20:
        point = StiffPoint(rng.uniform(0.2, 1.2), rng.uniform(0, 0.2), BETA, 10 ** rng.uniform(2, 5))
        tau, v, h = rng.random(), rng.uniform(2, 6), 1e-6
        status, *_, j00, j01, j10, j11, log_det = step_with_tangent(tau, v, point)
        ends = [step(tau + a, v + b, point) for a, b in ((h, 0), (-h, 0), (0, h), (0, -h))]
        if status != OK or len({end[4] for end in ends}) > 1:
            continue
        tried += 1
        quotient = [[(p[i] - m[i]) / (2 * h) for p, m in (ends[:2], ends[2:])] for i in (1, 2)]
        found = np.array([[j00, j01], [j10, j11]])
        np.testing.assert_allclose(found, quotient, rtol=2e-5, atol=2e-5 * np.abs(found).max())
        v1 = step(tau, v, point)[2]
        assert np.linalg.det(found) == pytest.approx(math.exp(log_det) * v / v1, rel=1e-9)


def test_a_return_is_a_flight_from_wall_to_wall() -> None:
    for wall_speed in (0.5, 3.0, 6.0):
        gear = StiffGear(0.6, 0.1, BETA, 1e4)
        back = gear.impact(0.3, wall_speed)
        end = gear.flight(BETA, -wall_speed, 0.3, back.time)
        assert (end.position, end.velocity) == pytest.approx((BETA, -back.v), abs=1e-11)
        assert (end.n_plus, end.n_minus) == (1, back.n_minus)
        pressed = gear.flight(BETA, wall_speed, 0.3, 1e-3)  # starts in contact
        assert pressed.position > BETA
        assert np.linalg.det(pressed.tangent) == pytest.approx(math.exp(-0.6e-3))


def test_runs_compose() -> None:
    """A run cut anywhere, also inside a contact, ends where the whole run does."""
    for kappa in (2.0, 300.0, 1e5):
        whole = flow.flow(flow.GAP, 0.2, 0.1, 3.0, 2.5, 0.6, 0.1, BETA, kappa)
        for cut in np.linspace(0.05, 2.45, 25):
            first = flow.flow(flow.GAP, 0.2, 0.1, 3.0, cut, 0.6, 0.1, BETA, kappa)
            wall, position, w = first[1:4]
            second = flow.flow(np.int64(wall), (0.2 + cut) % 1.0, position, w, 2.5 - cut, 0.6, 0.1, BETA, kappa)
            assert second[1] == whole[1]
            np.testing.assert_allclose(second[2:4], whole[2:4], rtol=1e-9, atol=1e-10)
            assert first[4] + second[4] == whole[4]
            assert first[5] + second[5] == whole[5]
            np.testing.assert_allclose(
                np.reshape(second[6:], (2, 2)) @ np.reshape(first[6:], (2, 2)),
                np.reshape(whole[6:], (2, 2)),
                rtol=1e-7,
                atol=1e-8 * np.abs(whole[6:]).max(),
            )


def test_permanent_contact_is_the_closed_form() -> None:
    rng = np.random.default_rng(1)
    for _ in range(30):
        delta, kappa = 10 ** rng.uniform(-2, 0.7), 10 ** rng.uniform(0, 8)
        limit = float(quiet_limit(delta, kappa))
        tau = rng.random()
        for share, stays in ((0.0, True), (0.99, True), (1.01, False)):
            x, w = quiet_depth(delta, share * limit, kappa, tau)
            times = np.linspace(0, 1, 2001)
            assert (quiet_depth(delta, share * limit, kappa, times)[0].min() > 0) == stays
            if x <= 0:
                continue
            status = contact.find_contact_end(1, tau, float(x), float(w), delta, share * limit, kappa, math.inf)[0]
            assert (status == contact.STAYS) == stays
            if stays:
                found = flow.flow(SIGMA_PLUS, tau, float(x), float(w), 3.0, delta, share * limit, BETA, kappa)
                assert found[:2] == (OK, SIGMA_PLUS)
                assert found[4:6] == (0, 0)
                assert found[2] == pytest.approx(float(x), rel=1e-9)


def test_hostile_corners_end() -> None:
    """Every return ends or is quiet, from κ = 1 to 1e10, at rest in the gap, at grazes and with no eccentricity."""
    for kappa in (1.0, 2 * math.pi**2, 1e3, 1e10):
        for delta in (0.01, 0.6, 5.0):
            for epsilon in (0.0, 0.05, 1.0):
                for beta in (0.1, 2.0):
                    point = StiffPoint(delta, epsilon, beta, kappa)
                    for tau, v in ((0.0, 1e-12), (0.3, 0.1), (0.999999, 6.0)):
                        status, tau1, v1, time, _n = step(tau, v, point)
                        assert status in (OK, flow.QUIET)
                        assert 0 <= tau1 < 1
                        assert v1 >= 0
                        assert time > 0
                        if epsilon >= quiet_limit(delta, kappa):
                            assert status == OK
                    found = flow.flow(SIGMA_MINUS, 0.1, 0.0, 0.0, 1.0, delta, epsilon, beta, kappa)
                    assert found[0] == OK
