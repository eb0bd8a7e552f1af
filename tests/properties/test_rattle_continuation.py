"""Continuation at random places of (δ, ε, β): what must hold on every branch and curve, whatever the numbers.

CONTINUATION_SEED=N takes other places.
"""

import os
from functools import cache

import numpy as np
import pytest
from depth import deep, either

import rattle
from rattle.continuation.arclength import MOST_POINTS, ContinuationProblem
from rattle.continuation.curve_continuation import PlaneWindow, trace_pieces_in_window
from rattle.curves import bifurcation_curve, trace
from rattle.errors import ParameterError, RattleError
from rattle.impacting.bifurcations.branches import beyond, branch, continue_to, doubled
from rattle.impacting.bifurcations.cascade import cascade
from rattle.impacting.orbits.periodic import PeriodicOrbit, periodic_orbit

SEED = int(os.environ.get("CONTINUATION_SEED", 2009))
PLACES = either(4, 12)
MOST_IMPACTS = 16


@cache
def orbits():
    """Motions at random places where several exist: period-one ones, stable or not, and those that attract."""
    rng, found = np.random.default_rng(SEED), []
    for k in range(PLACES):
        beta = 0.6 if k % 3 == 0 else float(rng.uniform(0.2, 1.2))
        delta = float(beta * rng.uniform(0.5, 1.25))
        epsilon = float(rattle.sn1(delta, virtual=True) * rng.uniform(1.05, 2.2))
        gear = rattle.Gear(delta, epsilon, beta)
        starts = [(orbit.tau, orbit.v, 1) for orbit in gear.orbits()]
        starts += [(a.tau, a.v, a.n_plus) for a in gear.attractors(64) if a.kind == "periodic" and a.m > 1]
        for tau, v, n_plus in starts:
            orbit = periodic_orbit(delta, epsilon, tau, v, n_plus, beta)
            if len(orbit.walls) <= MOST_IMPACTS:
                found.append(orbit)
    return found


@cache
def branches():
    rng, found = np.random.default_rng([SEED, 1]), []
    for orbit in orbits():
        direction = (float(rng.normal(0, 0.1)), float(rng.normal(0, 0.03)))
        found += [branch(orbit), branch(orbit, "delta"), branch(orbit, direction)]
    return found


def flights_agree(orbit, tolerance=1e-9):
    """Return whether every flight and impact, recomputed, is the motion's; near a graze only to half the digits."""
    gear, ends = rattle.Gear(orbit.delta, orbit.epsilon, orbit.beta), [*orbit.times, orbit.times[0] + orbit.m]
    slowest = max(min(1.0, orbit.speeds.min()), 1e-6)
    for i, wall in enumerate(orbit.walls):
        flight, j = gear.first_impact(wall, ends[i], -wall * orbit.speeds[i]), (i + 1) % len(orbit.walls)
        if (
            flight.next_wall != orbit.walls[j]
            or abs(flight.flight_time - (ends[i + 1] - ends[i])) > tolerance / slowest
        ):
            return False
        if abs(abs(flight.impact_velocity) - orbit.speeds[j]) > tolerance / slowest:
            return False
    return True


@deep
def test_points_solve_the_impact_law():
    for found in branches():
        for i in np.flatnonzero(found.admissible):
            assert flights_agree(found.orbit(int(i))), (found.label, i, found.orbit(int(i)))


def test_virtual_points_do_not_happen():
    for found in branches():
        for i in np.flatnonzero(~found.admissible):
            orbit = found.orbit(int(i))
            assert orbit.speeds.min() <= 0 or not flights_agree(orbit, 1e-7), (found.label, i, orbit)


def test_product_of_the_multipliers():
    for found in branches():
        product = found.multipliers[0] * found.multipliers[1]
        regular = np.isfinite(product)
        expected = np.exp(-found.delta * found.itinerary.m)
        assert np.abs(product / expected - 1)[regular].max() < 1e-10, found.label


def test_branches_are_connected_and_inside():
    for found in branches():
        steps = np.abs(np.diff(np.column_stack([found.times, found.delta, found.epsilon]), axis=0))
        steps[:, :-2] = np.abs(np.diff(found.times - found.times[:, :1], axis=0))
        assert steps.max() < 0.15, found.label
        assert found.epsilon.min() >= 0
        assert found.delta.min() > 0


def test_no_branch_jumps_to_a_neighbour():
    """The parameter turns where a multiplier passes 1, so the sign of det J(1) changes with that of its rate."""
    for found in branches():
        traces, decay = found.multipliers.sum(axis=0).real, np.exp(-found.delta * found.itinerary.m)
        for name, value in (("SN", traces - 1 - decay), ("PD", traces + 1 + decay)):
            for k in np.flatnonzero(value[:-1] * value[1:] < 0):
                kinds = {event.kind for event in found.events if event.after == k}
                assert kinds & {name, "GR", "PD"}, (found.label, found.delta[k], found.epsilon[k], found.itinerary.beta)


def test_existence_and_stability_change_at_events_only():
    for found in branches():
        at = {event.after for event in found.events}
        changes = (np.diff(found.admissible) | np.diff(found.stable)).nonzero()[0]
        assert set(changes.tolist()) <= at, (found.label, found.delta[0], found.epsilon[0], found.itinerary.beta)


def test_a_branch_does_not_depend_on_where_it_was_begun():
    for orbit in orbits():
        whole = branch(orbit, "epsilon", (0.7 * orbit.epsilon, 1.3 * orbit.epsilon))
        inside = np.flatnonzero(whole.admissible & (np.abs(whole.epsilon / orbit.epsilon - 1) < 0.29))
        other = whole.orbit(int(inside[len(inside) // 3]))
        again = branch(other, "epsilon", (0.7 * orbit.epsilon, 1.3 * orbit.epsilon))
        folds = [e.epsilon / orbit.epsilon for e in (*whole.events, *again.events) if e.kind == "SN"]
        if any(min(abs(fold - 0.7), abs(fold - 1.3)) < 0.02 for fold in folds):
            continue  # a step may leave the span and come back over such a fold
        one, two = (sorted((e.kind, round(e.epsilon, 8)) for e in found.events) for found in (whole, again))
        assert one == two, (orbit, other)


@pytest.mark.parametrize(
    ("name", "place"),
    [
        # it passed straight on where two branches nearly cross
        (
            (0.5382661311763738, 0.0822796378994746, 0.67298945, 4.42428129, 3, 0.6065423976755364),
            (-0.11297, -0.021093),
        ),
        (
            (0.2725310083608434, 0.0166499703360103, 0.66545011, 1.88154211, 4, 0.2433236076503376),
            (0.0890479, 0.013438),
        ),
    ],
)
def test_a_near_crossing_is_not_crossed(name, place):
    delta, epsilon, tau, v, n_plus, beta = name
    orbit = periodic_orbit(delta, epsilon, tau, v, n_plus, beta)
    coarse, fine = branch(orbit, place), branch(orbit, place, resolution=400)
    shared = [sorted((e.kind, round(e.delta, 9)) for e in found.events if e.delta > delta) for found in (coarse, fine)]
    assert shared[0] == shared[1]
    for found in (coarse, fine):
        at = {event.after for event in found.events}
        assert set(np.diff(found.stable).nonzero()[0].tolist()) <= at


def test_two_events_in_one_step():
    """Two flips 0.0008 apart, between neighbouring points of one of two branches that are the same."""
    orbit = periodic_orbit(0.5102259392598834, 0.0738020185040886, 0.7013300014795892, 4.272957863961546, 3)
    span = (0.051661412952862015, 0.09594262405531519)
    one = branch(orbit, "epsilon", span)
    two = branch(one.orbit(int(np.argmin(np.abs(one.epsilon - 0.0789126)))), "epsilon", span)
    flips = [0.07691781367, 0.07772233984]
    for found in (one, two):
        assert [e.epsilon for e in found.events if e.kind == "PD"] == pytest.approx(flips, abs=1e-10)


def test_a_closed_branch_ends_where_it_began():
    orbit = periodic_orbit(0.560902302552858, 0.1016516995810205, 0.54585242, 4.58419656, 2)
    found = branch(orbit, (0.17943357674660546, -0.046434390847543104))
    assert found.ends[0] == found.ends[1]
    assert found.ends[0].startswith("closed")
    assert found.orbit(-1).times == pytest.approx(found.orbit(0).times, abs=1e-8)
    assert found.delta[-1] == pytest.approx(found.delta[0], abs=1e-10)
    places = [(event.kind, round(event.delta, 8)) for event in found.events]
    assert len(places) == len(set(places))


# Curves


@cache
def curves_of_events():
    """Admissible events at random, three of each kind at most, with their curves."""
    rng, found = np.random.default_rng([SEED, 2]), []
    events = [event for each in branches() for event in each.events if event.admissible and event.itinerary.n <= 8]
    for kind in ("SN", "PD", "GR"):
        of_kind = [event for event in events if event.kind == kind]
        for event in rng.permutation(np.array(of_kind, object))[:3]:
            window = ((0.6 * event.delta, 1.4 * event.delta), (0.0, 2.0 * event.epsilon))
            found.append((event, bifurcation_curve(event, *window)))
    return found


def recomputed(curve, i, event):
    """The tangent matrix of the motion at a point of a curve, its (τ, v) afterwards; at a graze it misses the wall."""
    gear = rattle.Gear(float(curve.delta[i]), float(curve.epsilon[i]), curve.beta)
    tau, v, product = float(curve.tau[i]), float(curve.v[i]), np.eye(2)
    walls = event.itinerary.walls
    for _ in range(walls.count(1)):
        step = gear.impact(tau, v)
        product, tau, v = step.tangent @ product, step.tau, step.v
    return product, tau, v


def test_curves_hold_their_condition():
    """Multipliers of recomputed tangent matrices; on a grazing curve the motion misses or touches its wall and comes
    back to itself, within the root of rounding.
    """
    checked = 0
    for event, curve in curves_of_events():
        for i in range(1, len(curve) - 1, 4):
            if event.kind == "GR":
                continue
            product, tau, v = recomputed(curve, i, event)
            assert abs((tau - curve.tau[i] + 0.5) % 1 - 0.5) < 1e-7
            assert abs(v - curve.v[i]) < 1e-6
            decay = np.exp(-curve.delta[i] * event.itinerary.m)
            side = 1 if event.kind == "SN" else -1
            scale = np.abs(product).max()
            assert abs(np.trace(product) - side * (1 + decay)) < 1e-8 * max(scale, 1), (curve.name, i)
            checked += 1
    assert checked


def test_grazing_curves_graze():
    """The flight before the graze, without that impact, has its lowest point on the wall to 1e-8."""
    for event, curve in curves_of_events():
        if event.kind != "GR":
            continue
        for points in curve._points:
            for x in points[:: max(1, len(points) // 5)]:
                n = x.size - 2
                flights = event_itinerary(event).flights(x)
                graze = int(np.argmin(np.abs(flights.w0)))
                before = (graze - 1) % n
                s = x[graze] + (event.itinerary.m if graze == 0 else 0) - x[before]
                times = s * (1 + np.linspace(-1e-3, 1e-3, 2001))
                wall = event_itinerary(event).walls
                depth = wall[graze] * place(wall[before], x[before], flights.w0[before], times, x, curve.beta)
                assert abs(depth.max() - curve.beta) < 1e-8, curve.name


def event_itinerary(event):
    from rattle.impacting.bifurcations.curve_tracing import _rotate_to_sigma_plus

    return _rotate_to_sigma_plus(event)[0]


def place(wall, t0, w0, s, x, beta):
    """Φ along a flight, by the formula of the model's description."""
    delta, epsilon = x[-2:]
    c = (4 * np.pi - 2 * np.pi * epsilon * np.sin(2 * np.pi * t0) - w0) / delta
    swing = np.cos(2 * np.pi * (t0 + s)) - np.cos(2 * np.pi * t0)
    return wall * beta + c * np.expm1(-delta * s) + epsilon * swing + 4 * np.pi * s


def test_a_curve_goes_through_its_event_and_solves_for_its_points():
    for event, curve in curves_of_events():
        assert min(abs(e - event.epsilon) for e in curve.at(event.delta)) < 1e-9, curve.name
        rises = np.sign(np.diff(curve.epsilon))
        turns = {*curve.folds, *(np.flatnonzero(rises[:-1] * rises[1:] < 0) + 1).tolist()}
        smooth = set(range(1, len(curve) - 1, 5)) - {
            t + k for t in turns for k in (-1, 0, 1)
        }  # where one turns, rounding decides whether it has the value
        ends = curve.delta[[end.index for end in curve.ends]]
        smooth = {i for i in smooth if np.abs(curve.delta[i] - ends).min() > 1e-6}  # it may end where it is singular
        for i in sorted(smooth):
            assert min(abs(e - curve.epsilon[i]) for e in curve.at(float(curve.delta[i]))) < 1e-9, (curve.name, i)
            assert min(abs(d - curve.delta[i]) for d in curve.at(epsilon=float(curve.epsilon[i]))) < 1e-9, curve.name


def test_order_along_curves():
    traced = [trace(name) for name in ("SN2", "PD1", "PD2", "G1")]
    for curve in [*traced, *(curve for _, curve in curves_of_events())]:
        for piece in set(curve.piece.tolist()):
            index = np.flatnonzero(curve.piece == piece)
            assert (np.diff(curve.arclength[index]) > 0).all(), curve.name
            steps = np.sign(np.diff(curve.delta[index]))
            turns = {int(index[k + 1]) for k in np.flatnonzero(steps[:-1] * steps[1:] < 0)}
            assert turns == {fold for fold in curve.folds if fold in index}, curve.name


# Arguments


BAD_PAIRS = ["ab", (1,), (1, 2, 3), (np.nan, 1.0), ("a", "b"), (1j, 2), ((1, 2), 3), 5, (None, None), (True, False)]


@pytest.mark.parametrize("bad", [*BAD_PAIRS, "eps", None, (0, 0), (np.inf, 1.0)])
def test_a_bad_parameter(bad):
    with pytest.raises(ParameterError):
        branch(orbits()[0], bad)


@pytest.mark.parametrize("bad", [*BAD_PAIRS, (0.9, 1.0), (-np.inf, 1.0)])
def test_a_bad_span(bad):
    with pytest.raises(ParameterError):
        branch(orbits()[0], "epsilon", bad)


@pytest.mark.parametrize("bad", [0, -1, 2.5, "x", None, np.nan, 10**9])
def test_bad_counts(bad):
    with pytest.raises(ParameterError):
        branch(orbits()[0], resolution=bad)
    with pytest.raises(ParameterError):
        cascade(orbits()[0], doublings=bad)


@pytest.mark.parametrize("bad", [*BAD_PAIRS, (1e-3, 2e-3)])  # the last does not hold the event
def test_a_bad_window(bad):
    event = curves_of_events()[0][0]
    for arguments in ((bad,), ((0.1, 1.0), bad)):
        with pytest.raises(ParameterError):
            bifurcation_curve(event, *arguments)


@pytest.mark.parametrize("target", [("x", 0.1), (np.nan, 0.1), (-0.6, 0.1), (0.6, -0.1), ([0.6], 0.1), (0.6, np.inf)])
def test_a_bad_target(target):
    with pytest.raises(ParameterError):
        continue_to(orbits()[0], *target)


def test_something_else_than_a_motion_or_an_event():
    orbit, event = orbits()[0], curves_of_events()[0][0]
    for call in (
        lambda: branch(event),
        lambda: continue_to(None, 0.6, 0.1),
        lambda: doubled(orbit),
        lambda: beyond(orbit),
        lambda: bifurcation_curve(orbit),
    ):
        with pytest.raises(RattleError):
            call()


def test_spans_beyond_the_plane_and_tiny_ones():
    for orbit in orbits()[: either(2, 4)]:
        wide = branch(orbit, "epsilon", (-1.0, 1.0))
        assert wide.epsilon.min() >= 0
        assert branch(orbit, "delta", (-5.0, 5.0)).delta.min() > 0
        tiny = branch(orbit, "epsilon", (orbit.epsilon - 1e-10, orbit.epsilon + 1e-10))
        assert set(tiny.ends) == {"span"}
        assert np.ptp(tiny.epsilon) <= 2.1e-10
        same = continue_to(orbit, orbit.delta, orbit.epsilon)
        assert isinstance(same, PeriodicOrbit)
        assert same.times == pytest.approx(orbit.times, abs=1e-12)


def test_a_curve_of_too_many_points_says_so():
    waves = 500.0  # on each of which the curve turns four times, so that no step can be long

    def equations(x):
        return np.stack([x[..., 0], x[..., 2] - 0.5 - 0.4 * np.sin(2 * np.pi * waves * x[..., 1])], axis=-1)

    (piece,) = trace_pieces_in_window(
        ContinuationProblem(equations),
        [np.array([0.0, 0.5, 0.5])],
        PlaneWindow((0.0, 1.0), (0.0, 1.0)),
        lambda _: None,
    )
    assert len(piece.points) > MOST_POINTS
    assert piece.reasons == (f"a curve is followed for at most {MOST_POINTS} points",) * 2
    assert np.abs(equations(piece.points)).max() < 1e-9
