"""First impacts by proof, by search and by panels: millions of flights, and every claim of docs/kernel.md."""

import math
from pathlib import Path

import mpmath as mp
import numpy as np
import panel_march
import pytest
import random_flights as flights
from compiled import compiled
from depth import either

import rattle
from rattle.flight import coefficients, generate_coefficients
from rattle.flight.contact_phase import stays_in_contact
from rattle.flight.first_impact import first_impact_by_safe_search
from rattle.flight.forcing import DRIFT, TWO_PI, find_negative_force_arc
from rattle.flight.guess import (
    ERROR,
    convert_flight_to_single_precision,
    estimate_minimum,
    guess_time_of_turn_or_arrival,
    refine_time_at_level,
    sum_of_height_term_sizes,
    sum_of_slope_term_sizes,
    taylor_coefficients,
    time_step_to_level,
)
from rattle.flight.law import evaluate, evaluate32, evaluate_short, flight_from_phase
from rattle.flight.proof import convert_arc_to_single_precision, has_at_most_one_turn, height_lower_bound

F32 = np.float32
RNG_SEED = 2009


# ---- proof, search, panels ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("regime", "count", "march_every", "proved_share"),
    [
        (flights.PLANE, either(100_000, 10_000_000), 10, (0.45, 0.75)),
        (flights.WIDE, either(60_000, 2_000_000), 10, (0.3, 0.65)),
    ],
    ids=["plane", "wide"],
)
def test_no_wrong_wall_and_exact_times(regime, count, march_every, proved_share):
    """A quarter of these flights turn within 1e-12…1e-3 of the other wall."""
    seen, worst, misses = flights.compare(count, RNG_SEED, regime, 0.25, march_every, 1e-13)
    counted = dict(zip(flights.SEEN, seen.tolist(), strict=True))
    print(counted, f"largest relative difference of a proved time {worst:.1e}")
    assert counted["wrong_wall"] == counted["late"] == 0, misses
    assert counted["march_wall"] == counted["march_time"] == 0, misses
    assert counted["no_impact"] == 0
    assert counted["marched"] == count // march_every
    assert proved_share[0] < counted["proved"] / count < proved_share[1]


def test_a_second_minimum_behind_the_first_is_not_skipped():
    """The contact force is negative between two minima; the first stays 1.4e-11 above Σ⁻, the second would be below."""
    gear = rattle.Gear(0.602553483479871, 0.20864912633360722, 0.4583770890793262)
    time, wall, _speed = gear.first_impact(1, 0.4422210007314643, -5.479190756429324)
    assert wall == -1
    assert time == pytest.approx(0.639671945577, rel=1e-9)


def test_a_flight_that_turns_after_the_end_is_not_proved_clear():
    """Two flights that pass Σ⁻ while the pinned minimum lies beyond: once a wrong wall."""
    found = rattle.iterate(
        0.9824168914024013, 1.1767241159757615, 0.0069764760106167945, 5.867939155668595, 1, 0.011521449897146497
    )
    assert found.n_minus == 1
    gear = rattle.Gear(0.0871196166679768, 0.41796841232496484, 0.02394609977874814)
    time, wall, _speed = gear.first_impact(1, 0.2082163116971535, -1.3996976366040719)
    assert wall == -1
    assert time == pytest.approx(0.0333571, rel=1e-5)


@pytest.mark.parametrize(
    "flight",
    [
        (0.2560554693793288, -10.346595788215485, 1765.9538287594678, 2.0017296335647714, 0.0018808159550177707),
        (0.26032356376304483, -14.753704997028006, 1442.858592142415, 2.004803805560765, 0.000806126105201851),
    ],
)
def test_the_search_finds_a_minimum_at_huge_damping(flight):
    """Newton's steps to it are 1/δ there: the search once ran out of them and passed Σ⁻."""
    tau, w, delta, epsilon, beta = flight
    status, s, wall, *_ = first_impact_by_safe_search(1, tau, flight_from_phase(tau, w, delta, epsilon, DRIFT), beta)
    march_status, march_wall, march_s = panel_march.march(1, tau, w, delta, epsilon, beta, DRIFT)
    assert (status, wall) == (march_status, march_wall) == (0, -1)
    assert s == pytest.approx(march_s, rel=1e-11)


@pytest.mark.parametrize("regime", [flights.PLANE, flights.WIDE])
def test_flights_backwards_in_time_retrace(regime):
    """The search with δ, 4π, τ and w reversed, from the arrival of a flight, comes back to its departure."""
    lost, worst = _retraced(either(20_000, 200_000), 3, regime)
    print(f"not retraced {lost}, worst time against its condition {worst:.1e}")
    assert lost == 0
    assert worst < 1e-12


@compiled
def _retraced(n, seed, regime):
    np.random.seed(seed)
    lost, worst = 0, 0.0
    for _ in range(n):
        wall, tau, w, delta, epsilon, beta = flights.random_flight(regime, False)
        found = first_impact_by_safe_search(wall, tau, flight_from_phase(tau, w, delta, epsilon, DRIFT), beta)
        s, target, w1, lost_decay = found[1], found[2], found[3], found[4]
        # backwards, an error of s grows as e^(δs), and speeds below 1e-3 make a graze at either end
        if min(abs(w), abs(w1)) < 1e-3 or lost_decay > 1.0 - 1e-3:
            continue
        later = -(tau + s)
        later -= math.floor(later)
        back = first_impact_by_safe_search(target, later, flight_from_phase(later, -w1, -delta, epsilon, -DRIFT), beta)
        if back[0] != 0 or back[2] != wall:
            lost += 1
            continue
        condition = (1.0 + abs(w) + abs(w1) + epsilon) * (1.0 + s) / (abs(w) * (1.0 - lost_decay))
        worst = max(worst, abs(back[1] - s) / condition)
    return lost, worst


# ---- the pieces of the proof ----------------------------------------------------------------------------------------


def test_the_negative_arc_is_where_the_contact_force_is_negative():
    """Against its sign on a grid, forwards and backwards in time (δ < 0)."""
    rng = np.random.default_rng(8)
    theta = 2 * np.pi * np.arange(4096) / 4096
    found = 0
    for _ in range(1500):
        delta = rng.choice([-1, 1]) * 10 ** rng.uniform(-2, 1)
        limit = 2 * abs(delta) / math.hypot(2 * np.pi, delta)
        epsilon = limit * 10 ** rng.uniform(-0.5, 1.5)
        force = abs(delta) * DRIFT - TWO_PI * epsilon * (TWO_PI * np.cos(theta) + delta * np.sin(theta))
        exists, leave, length, sin_entry, sin_exit = find_negative_force_arc(delta, epsilon)
        assert exists == (epsilon > limit)
        if not exists:
            assert force.min() > 0
            continue
        found += 1
        phase = theta / (2 * np.pi)
        to_exit = (leave - phase) % 1
        edge = np.minimum(to_exit, 1 - to_exit) < 1e-9
        edge |= np.abs(to_exit - length) < 1e-9
        assert np.array_equal((to_exit < length)[~edge], (force < 0)[~edge])
        assert math.sin(2 * np.pi * leave) == pytest.approx(sin_exit, abs=1e-13)
        assert math.sin(2 * np.pi * (leave - length)) == pytest.approx(sin_entry, abs=1e-13)
    assert found > 500


@compiled
def _single_precision(n, seed):
    """Largest error of evaluate32 over its scales: F and F', each in units of ERROR."""
    np.random.seed(seed)
    worst0, worst1 = 0.0, 0.0
    for k in range(n):
        regime = flights.PLANE if k % 2 == 0 else flights.WIDE
        _wall, tau, w, delta, epsilon, _beta = flights.random_flight(regime, False)
        longest = min(2.0 / delta, 8.0)
        s = F32(np.random.uniform(0.0, longest) if k % 3 else flights.log_uniform(1e-7, longest))
        flight = flight_from_phase(tau, w, delta, epsilon, DRIFT)
        short = convert_flight_to_single_precision(flight)
        found = evaluate32(s, short)
        true = evaluate(float(s), flight)
        worst0 = max(worst0, abs(found[0] - true[0]) / sum_of_height_term_sizes(s, short))
        worst1 = max(worst1, abs(found[1] - true[1]) / sum_of_slope_term_sizes(short))
    return worst0 / ERROR, worst1 / ERROR


def test_single_precision_is_as_good_as_the_proof_says():
    worst0, worst1 = _single_precision(either(300_000, 1_000_000), 9)
    print(f"errors over ERROR × scale: F {worst0:.3f}, F' {worst1:.3f}")
    assert worst0 < 0.5
    assert worst1 < 0.5


@compiled
def _lowest(tau, w, delta, epsilon, longest):
    """The lowest F on [0, longest] of a flight without walls, turning points between grid points included."""
    theta = TWO_PI * tau
    sin0, cos0 = math.sin(theta), math.cos(theta)
    a = DRIFT - TWO_PI * epsilon * sin0 - w
    lowest, s, f1 = 0.0, 0.0, w
    steps = 1 + int(64.0 * longest)
    for k in range(1, steps + 1):
        e = longest * k / steps
        e0, e1, _f2, _f3, _d = panel_march.after(e, theta, w, a, sin0, cos0, delta, epsilon)
        if f1 < 0.0 < e1:
            t = s - f1 * (e - s) / (e1 - f1)
            for _ in range(4):
                x0, x1, x2, _x3, _d = panel_march.after(t, theta, w, a, sin0, cos0, delta, epsilon)
                t = min(max(t - x1 / x2, s), e)
            lowest = min(lowest, x0)
        lowest = min(lowest, e0)
        s, f1 = e, e1
    return lowest


@compiled
def _depths(n, seed, regime):
    """Return how many of n flights have a bound, how many bounds are above the true minimum, the mean distance."""
    np.random.seed(seed)
    given, wrong, apart = 0, 0, 0.0
    for _ in range(n):
        wall, tau, w, delta, epsilon, beta = flights.random_flight(regime, np.random.random() < 0.3)
        if wall < 0:
            continue
        flight = flight_from_phase(tau, w, delta, epsilon, DRIFT)
        short, gap, up = convert_flight_to_single_precision(flight), F32(2.0 * beta), F32(1.0)
        s = guess_time_of_turn_or_arrival(up, gap, F32(1.0 / delta), short)
        series = taylor_coefficients(s, short)
        _height, minimum = estimate_minimum(s, series, short)
        s += time_step_to_level(True, F32(0.0), series)
        s, _u, _speed = refine_time_at_level(s, F32(0.0), short)
        arc = convert_arc_to_single_precision(find_negative_force_arc(delta, epsilon))
        certain = has_at_most_one_turn(up, True, F32(tau), s, minimum.time, short, arc)
        bound = height_lower_bound(s, minimum, short.delta)
        if bound > -1e29 and certain and s > 0.0 and minimum.time < s and delta * s < 2.0:
            if not evaluate_short(float(s), flight)[1] > 0.0:
                continue
            given += 1
            true = _lowest(tau, w, delta, epsilon, float(s))
            wrong += bound > true
            apart += true - bound
    return given, wrong, apart / given


def test_the_bound_of_the_depth_is_a_bound():
    for regime, count in ((flights.PLANE, either(150_000, 600_000)), (flights.WIDE, either(100_000, 400_000))):
        given, wrong, apart = _depths(count, 10, regime)
        print(f"bounds {given}, wrong {wrong}, mean distance to the minimum {apart:.1e}")
        assert wrong == 0
        assert given > 0.1 * count


def test_coefficients_are_those_of_their_generator():
    assert generate_coefficients.coefficients_module_text() == Path(coefficients.__file__).read_text()


@pytest.mark.parametrize("name", [p.name for p in generate_coefficients.polynomial_specs()])
def test_stated_bounds_of_the_polynomials_hold(name):
    """On a grid of its own, against the functions in closed form."""
    closed = {
        "DECAY": lambda x: (mp.exp(-x) - 1 + x) / x**2,
        "VERSINE": lambda q: (1 - mp.cos(mp.sqrt(q))) / q,
        "SINE_DEFECT": lambda q: (mp.sqrt(q) - mp.sin(mp.sqrt(q))) / mp.sqrt(q) ** 3,
        "MEAN_COSINE": lambda q: mp.sin(mp.sqrt(q)) / mp.sqrt(q),
        "MEAN_SINE": lambda q: (1 - mp.cos(mp.sqrt(q))) / q,
    }
    source = Path(coefficients.__file__).read_text().splitlines()
    comment = source[source.index(f"{name} = (") - 1]
    stated = float(comment.rsplit(" ", 1)[1])
    low, high = (mp.mpf(x) for x in comment[comment.index("on [") + 4 : comment.rindex("]")].split(", "))
    c = [mp.mpf(float(x)) for x in reversed(getattr(coefficients, name))]
    with mp.workdps(50):
        for k in range(1, 700):
            x = low + (high - low) * (mp.mpf(k) - mp.mpf("0.43")) / 700
            true = closed[name.removesuffix("_32")](x)
            value = mp.mpf(0)
            for coefficient in c:
                value = value * x + coefficient
            off = abs(value - true)
            assert off <= stated * (1 if "absolute" in comment else abs(true))


# ---- rest -----------------------------------------------------------------------------------------------------------


def test_a_graze_goes_on_and_a_pressed_ball_rests():
    """Above the quiet limit the force at phase 0 points into the gap from Σ⁺ and presses on Σ⁻; at 1/2 the reverse."""
    delta, epsilon, beta = 0.6, 0.5, 0.6
    assert not stays_in_contact(1, 0.0, 0.0, delta, epsilon, DRIFT)
    assert stays_in_contact(-1, 0.0, 0.0, delta, epsilon, DRIFT)
    assert stays_in_contact(1, 0.0, 0.5, delta, epsilon, DRIFT)
    assert not stays_in_contact(-1, 0.0, 0.5, delta, epsilon, DRIFT)
    assert not stays_in_contact(1, -1e-3, 0.5, delta, epsilon, DRIFT)
    for wall, tau in ((1, 0.0), (-1, 0.5)):  # speed 0, and yet a flight
        status, s, target, w1, *_ = first_impact_by_safe_search(
            wall, tau, flight_from_phase(tau, 0.0, delta, epsilon, DRIFT), beta
        )
        assert (status, s > 0, target * w1 > 0) == (0, True, True)


def test_a_ball_pressed_on_a_wall_stops_and_keeps_its_state():
    """At the smallest speeds there is no next flight: fewer impacts than asked, the last state kept."""
    found = rattle.iterate(0.6, 0.01, 0.5, [1e-200, 1.0], [10, 3])
    assert found.n_plus[0] < 10
    assert found.n_plus[1] == 3
    assert np.isfinite(found.tau).all()
    assert np.isfinite(found.v).all()
