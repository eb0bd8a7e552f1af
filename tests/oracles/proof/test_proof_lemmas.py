"""Each step of a proof alone: bounds hold whatever they are taken about, and no wall is passed unseen."""

import math
from fractions import Fraction
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from depth import either
from flint import arb, arb_mat
from high_precision import Flight as ExactFlight
from mpmath import mp, mpf
from scipy.optimize import brentq

import rattle
from rattle.proof import check, finder, flights, impacting, krawczyk, stiff
from rattle.proof.balls import ball, exact_ends, interval_ball, precision
from rattle.proof.bifurcations.prove import certify_codimension_two
from rattle.stiff.map.contact import ENDS, find_contact_end

GRAZING = 1e-6


def model_point(delta, epsilon, beta):
    return flights.ModelPoint(*(ball(Fraction(x)) for x in (delta, epsilon, beta)))


def random_flights(number, seed):
    """(δ, ε, β, wall, target, t0, t1): flights through given places at given times, most of which pass a wall."""
    rng = np.random.default_rng(seed)
    for _ in range(number):
        wall, target = (int(x) for x in rng.choice([1, -1], 2))
        t0 = rng.uniform(0, 1)
        yield (
            rng.uniform(0.2, 1.5), rng.uniform(0, 0.5), rng.uniform(0.2, 1.2), wall, target,
            t0, t0 + rng.choice([rng.uniform(0, 1), rng.uniform(0, 2.5)]),
        )  # fmt: skip


def between(delta, epsilon, beta, wall, target, t0, t1):
    """The flight in balls, which leaves exactly these doubles."""
    t0, t1 = arb(t0), arb(t1)
    turns = (2 * t0).sin_cos_pi(), (2 * t1).sin_cos_pi()
    here = model_point(delta, epsilon, beta)
    return flights.enclose_flight(here, t0, t1, *turns, here.beta * (target - wall))


def happens(delta, epsilon, beta, wall, target, t0, t1, w0):
    """Return whether the compiled search, which cannot skip a crossing, ends there too; None near a graze."""
    if -wall * w0 < GRAZING:
        return False if -wall * w0 < -GRAZING else None
    found = rattle.Gear(delta, epsilon, beta).first_impact(wall, t0 % 1, w0)
    if found.next_wall == target and abs(found.flight_time - (t1 - t0)) < 1e-7:
        return True if abs(found.impact_velocity) > GRAZING else None
    return False


def proved(flight, wall, target):
    try:
        flights.require_first_impact(flight, wall, target, "the flight")
    except rattle.NotProvedError:
        return False
    return True


def test_a_flight_is_proved_if_and_only_if_it_happens():
    answers = {True: [], False: []}
    with precision():
        for case in random_flights(either(3000, 100_000), 1):
            flight = between(*case)
            truth = happens(*case, float(flight.w0))
            if truth is not None:
                answers[truth].append(proved(flight, case[3], case[4]))
    assert len(answers[True]) > either(400, 10_000)
    assert all(answers[True])
    assert not any(answers[False])


def test_the_checker_says_the_same_of_flights():
    answers = {True: [], False: []}
    with precision():
        for case in random_flights(either(200, 5000), 2):
            delta, epsilon, beta, wall, target, t0, t1 = case
            w0 = between(*case).w0
            truth = happens(*case, float(w0))
            if truth is None or -wall * float(w0) < 0:
                continue
            x = [check.IV.mpf(t0), check.IV.mpf([float(w0) - 1e-14, float(w0) + 1e-14]), check.IV.mpf(t1), 0]
            known = [check.IV.mpf(y) for y in (delta, epsilon, beta)]
            motion = SimpleNamespace(
                walls=[wall, target], m=0, k=[check.ZERO], delta=known[0], epsilon=known[1], beta=known[2]
            )
            answers[truth].append(check.MotionPiece(motion, 0, x).is_uninterrupted())
    assert len(answers[True]) > 20
    assert all(answers[True])
    assert not any(answers[False])


def test_a_contact_is_proved_if_and_only_if_it_lasts():
    """Both programs prove it to the end that the compiled search finds, and not to a later zero of the formula."""
    rng, seen = np.random.default_rng(3), 0
    for _ in range(either(40, 2000)):
        delta, epsilon, beta, kappa = rng.uniform(0.2, 1.5), rng.uniform(0, 0.4), 0.6, 10 ** rng.uniform(1.5, 5)
        wall, t0, u = int(rng.choice([1, -1])), rng.uniform(0, 1), rng.uniform(0.5, 6)
        status, lasts, *_ = find_contact_end(wall, t0, 0.0, u, delta, epsilon, kappa, math.inf)
        if status != ENDS:
            continue
        with precision():
            walls = stiff.StiffParameters(model_point(delta, epsilon, beta), ball(Fraction(kappa)))
            whole = stiff.ContactEnclosure(walls, arb(t0), arb(t0), arb(wall * u))

            def height(t, whole=whole, wall=wall):
                return float(wall * whole.state_at(arb(t))[0])

            later = t0 + lasts + np.linspace(0.01, 2.0, 400) * math.pi / math.sqrt(2 * kappa)
            again = later[[height(t) > 0 for t in later]]
            if again.size == 0 or again[0] == later[0]:
                continue
            seen += 1
            second = brentq(height, t0 + lasts + 1e-3 * (again[0] - t0 - lasts), again[0])
            for end, truth in ((t0 + lasts, True), (second, False)):
                contact = stiff.ContactEnclosure(walls, arb(t0), arb(end), arb(wall * u))
                try:
                    stiff.require_contact_lasts(contact, wall, "the contact")
                    assert truth
                except rattle.NotProvedError:
                    assert not truth
                numbers = [check.IV.mpf(x) for x in (delta, epsilon, beta)]
                motion = SimpleNamespace(
                    walls=[wall, wall], m=0, k=[check.IV.mpf(2 * kappa)],
                    delta=numbers[0], epsilon=numbers[1], beta=numbers[2],
                )  # fmt: skip
                x = [check.IV.mpf(y) for y in (t0, wall * u, end, 0)]
                assert check.MotionPiece(motion, 0, x).is_uninterrupted() == truth
    assert seen > either(20, 1000)


def test_bounds_of_an_extremum_hold_wherever_they_are_taken(monkeypatch):
    """There are two minima and a maximum between, at any place of their pieces; the extrema have 40 digits."""
    rng, told = np.random.default_rng(4), 0
    with precision():
        cases = ((case, between(*case)) for case in random_flights(10_000, 6))
        case, flight = next(each for each in cases if len(list(flights.enclose_extrema(each[1], ""))) == 3)
        truth = [height for _, height in flights.enclose_extrema(flight, "")]
        start = mpf(flight.w0.str(38, radius=False))
        monkeypatch.setattr(flights, "_guess_extremum_time", lambda _flight, start, end: float(rng.uniform(start, end)))
        for _ in range(either(200, 5000)):
            for (_, bound), height in zip(flights.enclose_extrema(flight, ""), truth, strict=True):
                assert bound.contains(height.mid())
                told += float(bound.rad()) < 0.1
        delta, epsilon, beta, wall, _target, t0, t1 = case
        exact = ExactFlight(wall, t0, start, delta, epsilon, beta)
        times = [mpf(t1 - t0) * k / 1000 for k in range(1, 1000)]
        turns = [mp.findroot(exact.velocity, (a, b), solver="anderson") for a, b in pairwise(times)
                 if exact.velocity(a) * exact.velocity(b) < 0]  # fmt: skip
        for turn, height in zip(turns, truth, strict=True):
            low, high = (mpf(end.numerator) / end.denominator for end in exact_ends(height))
            assert low < exact.position(turn) - exact.start < high
    assert told > 10  # bounds that say something


def test_a_place_where_the_force_vanishes_within_rounding_of_an_end_is_no_hole():
    """A flight that begins, or ends, where g changes sign: the piece beyond has its extremum all the same."""
    with precision():
        here = model_point(0.5, 0.3, 0.6)
        for edge in here.phases_of_zero_force:
            for nudge in (0.0, 1e-40, -1e-40, 1e-12, -1e-12):
                t0 = edge + arb(nudge)
                for length in (0.05, 0.4, 0.9):
                    t1 = t0 + length
                    turns = (2 * t0).sin_cos_pi(), (2 * t1).sin_cos_pi()
                    flight = flights.enclose_flight(here, t0, t1, *turns, arb(0))
                    truth = happens(0.5, 0.3, 0.6, 1, 1, float(t0), float(t1), float(flight.w0))
                    assert truth is None or proved(flight, 1, 1) == truth


def test_a_graze_is_refused():
    """At COD20 C's flight touches Σ⁻: as a flight of a period, as one that ends there, and as one that begins there."""
    point = certify_codimension_two()[0]
    with precision():
        delta, epsilon = (arb(0.5) * ball(sum(ends)) + arb(0, 1e-19) for ends in point.solved.values())
        tau, s = ball(point.times[0]), ball(point.times[1] - point.times[0])
        here = flights.ModelPoint(delta, epsilon, ball(point.known["beta"]))
        for t0, t1, wall, target in ((tau, tau + 1, 1, 1), (tau, tau + s, 1, -1), (tau + s, tau + 1, -1, 1)):
            t0, t1 = (t + ball(point.radius) * arb(0, 1) for t in (t0, t1))
            turns = (2 * t0).sin_cos_pi(), (2 * t1).sin_cos_pi()
            flight = flights.enclose_flight(here, t0, t1, *turns, here.beta * (target - wall))
            with pytest.raises(rattle.NotProvedError, match=r"touch|graze"):
                flights.require_first_impact(flight, wall, target, "the flight")


def test_verdicts_are_those_of_the_multipliers():
    with precision():
        determinant = arb(0.5)
        for trace, verdict in ((1.4, "attracting"), (-1.4, "attracting"), (1.6, "saddle"), (-1.6, "saddle")):
            assert finder.prove_stability_verdict(arb(trace), determinant) == verdict
        for trace in (1.5, -1.5):
            assert finder.prove_stability_verdict(arb(trace, 1e-20), determinant) == "undecided"
        half, none, same, again = finder.multiplier_enclosures(arb(2).sqrt(), determinant)  # a double one
        assert (half, none) == (same, again)
        assert none[0] < 0 < none[1]
        assert float(half[0]) < math.sqrt(0.5) < float(half[1])


def test_a_motion_listed_twice_is_not_of_twice_the_period():
    once = [arb("0.2", 1e-12), arb("0.7", 1e-12)]
    with precision():
        for times, walls, m in ((once, (1, 1), 1), ([*once, *(t + 1 for t in once)], (1, -1, 1, -1), 3)):
            finder.require_least_period(times, walls, m)
        twice = [*once, *(t + 1 for t in once)]
        with pytest.raises(
            rattle.NotProvedError, match="2 is not proved to be the least period of the motion, which may be 1"
        ):
            finder.require_least_period(twice, (1, -1, 1, -1), 2)
        apart = [*once, once[0] + 1, once[1] + arb("1.0000001")]
        finder.require_least_period(apart, (1, -1, 1, -1), 2)


def test_no_box_is_proved_where_there_are_two_motions():
    """The operator refuses a box that reaches from A to C, near where both are born."""
    gear = rattle.Gear(0.6, rattle.sn1(0.6) * (1 + 1e-9))
    a, c = (gear.orbit(each.tau, each.v) for each in gear.orbits() if each.name in "AC")
    assert 0 < c.tau - a.tau < 1e-4
    with precision():
        equations = impacting.ImpactingSystem(model_point(gear.delta, gear.epsilon, gear.beta), (1,), 1)
        middle = Fraction((a.tau + c.tau) / 2)
        wide = [interval_ball(Fraction(0), Fraction(c.tau - a.tau))]
        about = krawczyk.approximate_inverse(equations([ball(Fraction(a.tau))]).jacobian)
        x = [ball(middle)]
        step = about * krawczyk.column_vector(equations(x).residual)
        (moved,) = krawczyk._krawczyk_image(equations, x, step, about, wide)
        assert not abs(moved) < ball(Fraction(c.tau - a.tau))
    assert {str(rattle.certify(orbit).verdict) for orbit in (a, c)} == {"saddle", "attracting"}


def test_intervals_of_the_checker_hold_the_balls_of_the_finder():
    """The functions sin, cos and exp are evaluated on narrow and wide intervals by two libraries."""
    rng = np.random.default_rng(5)
    with precision():
        for _ in range(either(300, 20_000)):
            middle, radius = rng.uniform(-3, 3), 10 ** rng.uniform(-30, 0.5)
            x = check.IV.mpf([mpf(middle) - mpf(radius), mpf(middle) + mpf(radius)])
            inside = arb(middle) + arb(radius) * arb(rng.uniform(-0.999, 0.999))
            sine, cosine = check.sine_and_cosine(x)
            for found, value in (
                (sine, (2 * inside).sin_pi()),
                (cosine, (2 * inside).cos_pi()),
                (check.IV.exp(x) * (1 + check.SLACK), inside.exp()),
            ):
                low, high = (mpf(end.numerator) / end.denominator for end in exact_ends(value))
                assert bool(found.a < low)
                assert bool(found.b > high)


def test_boxes_hold_the_numbers_that_they_are_of():
    with precision():
        for text in ("0.1", "-123.456", "0.333333333333333333333333333333333333333333333"):
            centre, radius = Fraction(text), Fraction(1, 10**11)
            low, high = exact_ends(interval_ball(centre, radius))
            assert low <= centre - radius
            assert high >= centre + radius
            assert high - low < Fraction(2001, 10**14)


def test_a_bound_taken_far_behind_the_extremum_holds_where_the_speed_has_decayed(monkeypatch):
    """At strong damping Φ' is largest between a minimum and the place: the factor e^(δL) is needed there."""
    delta, epsilon, t0, t1 = 20.0, 1.9, 0.75, 1.22
    with precision():
        here, turns = model_point(delta, epsilon, 50.0), [(2 * arb(t)).sin_cos_pi() for t in (t0, t1)]
        still = flights.enclose_flight(here, arb(t0), arb(t1), *turns, arb(0))
        slope = here.delta / (1 - still.decay)  # of w0, by the distance
        flight = flights.enclose_flight(here, arb(t0), arb(t1), *turns, (arb(-0.1) - still.w0) / slope)
        assert here.phases_of_zero_force == () or not flights.force_zero_times(flight)
        ((_, truth),) = flights.enclose_extrema(flight, "")
        monkeypatch.setattr(flights, "_guess_extremum_time", lambda *_: t1 - 1e-3)
        ((_, bound),) = flights.enclose_extrema(flight, "")
        height, speed = flight.state_at(arb(t1 - 1e-3))
        assert height - truth > (t1 - t0) * speed
        assert bound.contains(truth)


class Square:
    """x² = 2."""

    def __init__(self, x):
        (self.x,) = x

    @property
    def residual(self):
        return [self.x**2 - 2]

    @property
    def jacobian(self):
        return arb_mat([[2 * self.x]])


def test_the_operator_encloses_the_zero_itself_and_not_what_was_computed():
    with precision():
        found = krawczyk.enclose_zero(Square, np.array([2**0.5 + 5e-10]))
        (zero,) = found.zero
        assert zero.overlaps(arb(2).sqrt())
        assert zero.rad() < 1e-26
        assert abs(ball(found.centre[0]) - arb(2).sqrt()) < ball(found.radius)
        with pytest.raises(rattle.NotProvedError, match="nearest exact solution"):
            krawczyk.enclose_zero(Square, np.array([2**0.5 + 1e-6]))
        with pytest.raises(rattle.NotProvedError, match="singular"):
            krawczyk.enclose_zero(Square, np.array([0.0]))


class Pair(Square):
    """x² = 1e-22: two zeros 2e-11 apart."""

    @property
    def residual(self):
        return [self.x**2 - arb("1e-22")]


def test_a_box_that_might_hold_two_zeros_is_made_smaller():
    with precision():
        found = krawczyk.enclose_zero(Pair, np.array([1e-11]))
        assert found.radius == Fraction(1, 10**13)
        assert found.zero[0].overlaps(arb("1e-11"))


def test_a_certificate_does_not_show_in_which_order_a_machine_adds_doubles(monkeypatch):
    """Libraries of linear algebra differ in the last bits by processor and number of threads."""
    gear = rattle.Gear(0.6, 0.089)
    orbit = next(gear.orbit(each.tau, each.v, each.n_plus) for each in gear.attractors() if each.n_plus == 4)
    plain, exactly_so = rattle.certify(orbit).json(), krawczyk.approximate_inverse
    for error in (1e-13, -1e-11):

        def inverse(matrix, error=error):
            found = exactly_so(matrix)
            return found + arb_mat(found.nrows(), found.ncols(), [error * each for each in found.entries()])

        monkeypatch.setattr(krawczyk, "approximate_inverse", inverse)
        assert rattle.certify(orbit).json() == plain
