"""Prove points of bifurcation curves, from computed numbers to certificates."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from rattle._version import __version__
from rattle.continuation.arclength import tangent_at, with_value
from rattle.continuation.conditions import MULTIPLIER, Kind, condition
from rattle.continuation.curves import QUIET_LIMIT
from rattle.errors import NotProvedError, require, require_number, require_one_of
from rattle.impacting.bifurcations.codimension_two import codimension_two
from rattle.impacting.bifurcations.events import Event
from rattle.impacting.bifurcations.registry import CURVES, Definition
from rattle.impacting.orbits.equations import Itinerary
from rattle.impacting.orbits.periodic import follow_impacts
from rattle.numerics.complex_step import Array
from rattle.proof.balls import BITS, VERSIONS, arb, ball, ends, precision
from rattle.proof.bifurcations.certificate import BifurcationCertificate
from rattle.proof.bifurcations.systems import FREE, CurveMotion, System, require_happens
from rattle.proof.certificate import Ends, Exact, exact_number
from rattle.proof.finder import LONG, require_least_period
from rattle.proof.krawczyk import enclosed

#: Margins of a published enclosure, as a multiple of the ball's width and absolute, so that other rounding confirms it.
ROOM, LEAST = 10**4, Fraction(1, 10**20)
SAME_PLACE = 1e-9  # largest relative distance that rounding may leave between a point and its curve


def certify_curve_point(
    name: str, delta: Exact, epsilon: Exact, beta: Exact = "0.6", motion: tuple[float, float] | None = None
) -> BifurcationCertificate:
    """Prove a point of a bifurcation curve of the period-one motions (`rattle.curves`), near (δ, ε).

    Of δ and ε, the parameter along which the curve runs is taken as exactly the given number; the other is enclosed.
    Needs the extra `proof`. Source: docs/proofs.md.

    Parameters
    ----------
    name : str
        The curve, such as "SN1" or "G2".
    delta, epsilon : float, str or Fraction
        A point close to the curve.
    beta : float, str or Fraction
        Half-backlash.
    motion : tuple[float, float] | None
        Phase and speed (τ, v) of the departure from Σ⁺, as a `Curve` gives them. Needed near folds of the curve.

    Returns
    -------
    BifurcationCertificate
        A theorem about the point. `rattle certify --check` verifies it independently.

    Raises
    ------
    ParameterError
        If an argument is not allowed.
    NotProvedError
        If no point of the curve is that close, or the proof fails.
    """
    require(name != QUIET_LIMIT, f"{QUIET_LIMIT} is a formula: name one of {', '.join(CURVES)}")
    require_one_of("name", name, CURVES)
    numbers = {
        "delta": exact_number("delta", delta),
        "epsilon": exact_number("epsilon", epsilon),
        "beta": exact_number("beta", beta),
    }
    require(min(numbers.values()) > 0, "delta, epsilon and beta must be positive")
    d, e, half = (float(number) for number in numbers.values())
    definition = CURVES[name]
    problem = condition(definition.itinerary(half), definition.kind, definition.impact)
    solved = [
        with_value(problem, guess, index, value)
        for guess in _guesses(definition, d, e, half, motion)
        for index, value in ((-2, d), (-1, e))
    ]
    tau = None if motion is None else motion[0]
    near = [(_apart(x, d, e, tau), i, x) for i, x in enumerate(solved) if x is not None]
    if not near or min(near)[0] > SAME_PLACE:
        raise NotProvedError(f"{name} has no point close to delta = {d!r}, epsilon = {e!r}; give a point on the curve")
    x = min(near)[2]
    if (why := definition.belongs(x)) is not None:
        raise NotProvedError(f"the point is not on {name}: {why}")
    tangent = tangent_at(problem, x, np.eye(x.size)[-2])
    along = "delta" if abs(tangent[-2]) >= abs(tangent[-1]) else "epsilon"
    bifurcating = CurveMotion(definition.walls, 1, definition.kind, definition.impact)
    return _certified(name, bifurcating, x, numbers["beta"], {along: numbers[along]})


def _guesses(
    definition: Definition, delta: float, epsilon: float, beta: float, motion: tuple[float, float] | None
) -> Sequence[Array]:
    """Return starting values (n + 2,) of the unknowns, from the flights after (τ, v) or else from closed forms."""
    if motion is not None and definition.impact is None:
        itinerary, x = follow_impacts(delta, epsilon, beta, *motion, definition.walls.count(1))
        if itinerary.walls == definition.walls:
            return [x]
    return definition.starts(delta, beta)


def _apart(x: Array, delta: float, epsilon: float, tau: float | None) -> float:
    phase = 0.0 if tau is None else abs((x[0] - tau + 0.5) % 1.0 - 0.5)
    return float(max(abs(x[-2] - delta) / delta, abs(x[-1] - epsilon) / epsilon, phase))


def certify_event(event: Event, beta: Exact | None = None) -> BifurcationCertificate:
    """Prove a saddle-node, flip or graze that a branch of any periodic motion passes (`rattle.branch`).

    The proof is made at exactly the damping of the event. Needs the extra `proof`.

    Parameters
    ----------
    event : BranchEvent
        An event of a branch in ε.
    beta : float, str or Fraction
        Half-backlash.

    Returns
    -------
    BifurcationCertificate
        A theorem about the point. `rattle certify --check` verifies it independently.

    Raises
    ------
    ParameterError
        If an argument is not allowed.
    NotProvedError
        If the proof fails.
    """
    require(isinstance(event, Event), f"event must be an Event of a branch, got {type(event).__name__}")
    itinerary = event.itinerary
    number = exact_number("beta", itinerary.beta if beta is None else beta)
    require(float(number) == itinerary.beta, f"beta of the event is {itinerary.beta!r}, not {beta}")
    x = with_value(condition(itinerary, event.kind, event.impact), event.unknowns, -2, event.delta)
    if x is None:
        raise NotProvedError("the curve of the event has no solution at its damping")
    motion = CurveMotion(tuple(int(wall) for wall in itinerary.walls), itinerary.m, event.kind, event.impact)
    return _certified(str(event.kind), motion, x, number, {"delta": exact_number("delta", event.delta)})


def certify_codimension_two(beta: Exact = "0.6") -> tuple[BifurcationCertificate, ...]:
    """Prove the codimension-two points COD20 to COD23 that exist at a half-backlash.

    Parameters
    ----------
    beta : float, str or Fraction
        Half-backlash.

    Returns
    -------
    tuple[BifurcationCertificate, ...]
        One certificate for each existing point, in the order COD20, COD21, COD23, COD22.

    Raises
    ------
    ParameterError
        If the half-backlash is not allowed.
    NotProvedError
        If a proof fails.
    """
    number = exact_number("beta", beta)
    half = require_number("beta", float(number), positive=True)
    graze = CURVES["G1"]
    problem = condition(graze.itinerary(half), graze.kind, graze.impact)
    found = []
    for point in codimension_two(half):
        solved = (with_value(problem, guess, -2, point.delta) for guess in graze.starts(point.delta, half))
        near = [x for x in solved if x is not None and abs(x[-1] - point.epsilon) < SAME_PLACE]
        if not near:
            raise NotProvedError(f"no grazing motion was found at {point.name}, so it is not proved")
        motion = CurveMotion(graze.walls, 1, graze.kind, graze.impact, point.name)
        found.append(_certified(point.name, motion, near[0], number, {}))
    return tuple(found)


def _certified(
    name: str, motion: CurveMotion, x: Array, beta: Fraction, known: dict[str, Fraction]
) -> BifurcationCertificate:
    """Prove the solution near the unknowns x (n + 2,) and return its certificate."""
    n, free = motion.n, [i for i, parameter in enumerate(FREE) if parameter not in known]
    phi = _null_vector(motion, x, float(beta))
    start = np.concatenate([x[:n], x[n:][free], phi])
    with precision(BITS if n <= LONG else 2 * BITS):
        system = System(motion, ball(beta), {key: ball(value) for key, value in known.items()}, phi.tolist())
        found = enclosed(system, start)
        require_happens(system, found.zero)
        repeats = [i for i in range(n) if i != motion.impact]
        require_least_period([found.zero[i] for i in repeats], [motion.walls[i] for i in repeats], motion.m)
        return BifurcationCertificate(
            name=name,
            motion=motion,
            known={"beta": beta, **known},
            solved={FREE[i]: _published(each) for i, each in zip(free, found.zero[n:], strict=False)},
            times=tuple(found.centre[:n]),
            radius=found.radius,
            versions={"gear-rattle": __version__, **VERSIONS},
        )


def _null_vector(motion: CurveMotion, x: Array, beta: float) -> Array:
    """Return the unit null vector φ (n,) of J(±1) at a saddle-node or a flip."""
    if motion.kind is Kind.GRAZING:
        return np.empty(0)
    itinerary = Itinerary(motion.walls, motion.m, beta)
    return np.asarray(np.linalg.svd(itinerary.jacobian(x, MULTIPLIER[motion.kind]))[2][-1], np.float64)


def _published(x: arb) -> Ends:
    low, high = ends(x)
    room = max(ROOM * (high - low), LEAST)
    unit = Fraction(1, 10**30)
    return (low - room) // unit * unit, -(-(high + room) // unit) * unit
