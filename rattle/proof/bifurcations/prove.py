"""Prove that points of bifurcation curves exist near computed points, and certify them."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from rattle._version import __version__
from rattle.continuation.arclength import solve_with_fixed_unknown, tangent_at
from rattle.continuation.conditions import MULTIPLIER, EventKind, equations_of_bifurcation
from rattle.continuation.curve_continuation import QUIET_LIMIT
from rattle.errors import NotProvedError, require, require_number, require_one_of
from rattle.impacting.bifurcations.codimension_two import codimension_two
from rattle.impacting.bifurcations.events import Event
from rattle.impacting.bifurcations.registry import CURVES, CurveDefinition
from rattle.impacting.orbits.equations import Itinerary
from rattle.impacting.orbits.periodic import follow_impacts
from rattle.numerics.complex_step import Array
from rattle.proof.balls import BITS, VERSIONS, arb, ball, exact_ends, precision
from rattle.proof.bifurcations.certificate import BifurcationCertificate
from rattle.proof.bifurcations.systems import (
    POSSIBLE_UNKNOWNS,
    BifurcatingMotion,
    ExtendedSystem,
    require_admissible_at,
)
from rattle.proof.certificate import Ends, Exact, exact_number
from rattle.proof.finder import MOST_IMPACTS_AT_BITS, require_least_period
from rattle.proof.krawczyk import enclose_zero

#: A published enclosure is wider than its ball by this multiple of the ball's width: other programs round differently.
WIDENING = 10**4
#: Least amount by which a published enclosure is wider than its ball.
LEAST_WIDENING = Fraction(1, 10**20)
#: Largest relative distance between a given point and the curve that rounding can explain.
LARGEST_MISS = 1e-9


def certify_curve_point(
    name: str, delta: Exact, epsilon: Exact, beta: Exact = "0.6", motion: tuple[float, float] | None = None
) -> BifurcationCertificate:
    """Prove that a point of a bifurcation curve of the period-one motions (`rattle.curves`) is near (δ, ε).

    The parameter, δ or ε, that changes more along the curve is taken as exact; the proof encloses the other parameter.
    The extra `proof` is needed. The method is in docs/proofs.md.

    Parameters
    ----------
    name : str
        Name of the curve.
    delta, epsilon : Exact
        A point of the curve, up to rounding: numbers, text such as "0.6" or "3/5", or Fractions.
    beta : Exact
        The half-backlash.
    motion : tuple[float, float] | None
        Phase and speed (τ, v) of the departure from Σ⁺, as a `Curve` gives them. Needed near the folds of the curve.

    Returns
    -------
    BifurcationCertificate
        The theorem, which the independent checker verifies.

    Raises
    ------
    ParameterError
        If a parameter is not positive, or the name is not that of a curve.
    NotProvedError
        If no point of the curve is within rounding of (δ, ε), or the proof fails.
    """
    require(name != QUIET_LIMIT, f"{QUIET_LIMIT} is a formula, which needs no proof: choose one of {', '.join(CURVES)}")
    require_one_of("name", name, CURVES)
    numbers = {
        "delta": exact_number("delta", delta),
        "epsilon": exact_number("epsilon", epsilon),
        "beta": exact_number("beta", beta),
    }
    wrong = [key for key, number in numbers.items() if number <= 0]
    require(not wrong, f"{' and '.join(wrong)} must be positive")
    d, e, half = (float(number) for number in numbers.values())
    definition = CURVES[name]
    problem = equations_of_bifurcation(definition.itinerary(half), definition.kind, definition.impact)
    solved = [
        solve_with_fixed_unknown(problem, guess, index, value)
        for guess in _first_guesses(definition, d, e, half, motion)
        for index, value in ((-2, d), (-1, e))
    ]
    tau = None if motion is None else motion[0]
    near = [(_relative_distance(x, d, e, tau), i, x) for i, x in enumerate(solved) if x is not None]
    if not near or min(near)[0] > LARGEST_MISS:
        raise NotProvedError(
            f"{name} has no point within rounding of delta = {d!r}, epsilon = {e!r}: give a point of the curve"
        )
    x = min(near)[2]
    if (why := definition.reason_not_on_curve(x)) is not None:
        raise NotProvedError(f"the motion at this point does not belong to {name}: {why}")
    tangent = tangent_at(problem, x, np.eye(x.size)[-2])
    along = "delta" if abs(tangent[-2]) >= abs(tangent[-1]) else "epsilon"
    bifurcating = BifurcatingMotion(definition.walls, 1, definition.kind, definition.impact)
    return _prove_solution(name, bifurcating, x, numbers["beta"], {along: numbers[along]})


def _first_guesses(
    definition: CurveDefinition, delta: float, epsilon: float, beta: float, motion: tuple[float, float] | None
) -> Sequence[Array]:
    """Return first guesses (n + 2,) of the impact times, δ and ε of the motion that bifurcates on a curve.

    If a motion is given that meets the same walls as motions on the curve, it is the only guess, except on a graze.
    Otherwise the curve's definition supplies the guesses.

    Returns
    -------
    Sequence[Array]
        The guesses.
    """
    if motion is not None and definition.impact is None:
        itinerary, x = follow_impacts(delta, epsilon, beta, *motion, definition.walls.count(1))
        if itinerary.walls == definition.walls:
            return [x]
    return definition.starting_points_at(delta, beta)


def _relative_distance(x: Array, delta: float, epsilon: float, tau: float | None) -> float:
    """Return the distance of the unknowns x from (δ, ε, τ): the largest of three distances.

    The distances from δ and ε are relative. The distance in phase from τ is left out if τ is None.

    Returns
    -------
    float
        The largest distance.
    """
    phase = 0.0 if tau is None else abs((x[0] - tau + 0.5) % 1.0 - 0.5)
    return float(max(abs(x[-2] - delta) / delta, abs(x[-1] - epsilon) / epsilon, phase))


def certify_event(event: Event, beta: Exact | None = None) -> BifurcationCertificate:
    """Prove an event of a branch (`rattle.branch`): the saddle-node, flip or graze of any periodic motion.

    Parameters
    ----------
    event : Event
        The event. The proof takes the event's damping as exact.
    beta : Exact | None
        The half-backlash as an exact number, equal to that of the event up to rounding. If None, the event's double.

    Returns
    -------
    BifurcationCertificate
        The theorem, which the independent checker verifies.

    Raises
    ------
    ParameterError
        If `event` is no event of a branch, or `beta` is not its half-backlash.
    NotProvedError
        If the proof fails.
    """
    require(isinstance(event, Event), f"event must be an Event of a branch, got {type(event).__name__}")
    itinerary = event.itinerary
    number = exact_number("beta", itinerary.beta if beta is None else beta)
    require(float(number) == itinerary.beta, f"beta must be that of the event, {itinerary.beta!r}, got {beta}")
    x = solve_with_fixed_unknown(
        equations_of_bifurcation(itinerary, event.kind, event.impact), event.unknowns, -2, event.delta
    )
    if x is None:
        raise NotProvedError(
            f"Newton's method does not converge to the event at delta = {event.delta}: compute the branch again, and "
            "give an event of the new branch"
        )
    motion = BifurcatingMotion(tuple(int(wall) for wall in itinerary.walls), itinerary.m, event.kind, event.impact)
    return _prove_solution(str(event.kind), motion, x, number, {"delta": exact_number("delta", event.delta)})


def certify_codimension_two(beta: Exact = "0.6") -> tuple[BifurcationCertificate, ...]:
    """Prove the codimension-two points COD20, COD21, COD23 and COD22 at a half-backlash.

    Returns
    -------
    tuple[BifurcationCertificate, ...]
        One certificate for each point that exists at this half-backlash.

    Raises
    ------
    ParameterError
        If `beta` is not positive.
    NotProvedError
        If a proof fails.
    """
    number = exact_number("beta", beta)
    half = require_number("beta", float(number), positive=True)
    graze = CURVES["G1"]
    problem = equations_of_bifurcation(graze.itinerary(half), graze.kind, graze.impact)
    found = []
    for point in codimension_two(half):
        solved = (
            solve_with_fixed_unknown(problem, guess, -2, point.delta)
            for guess in graze.starting_points_at(point.delta, half)
        )
        near = [x for x in solved if x is not None and abs(x[-1] - point.epsilon) < LARGEST_MISS]
        if not near:
            raise NotProvedError(
                f"Newton's method finds no grazing motion at {point.name}, so {point.name} is not proved: choose "
                "another beta"
            )
        motion = BifurcatingMotion(graze.walls, 1, graze.kind, graze.impact, point.name)
        found.append(_prove_solution(point.name, motion, near[0], number, {}))
    return tuple(found)


def _prove_solution(
    name: str, motion: BifurcatingMotion, x: Array, beta: Fraction, known: dict[str, Fraction]
) -> BifurcationCertificate:
    """Prove that there is a bifurcation point near a computed bifurcation point.

    x (n + 2,): the computed impact times, δ and ε. known: {name: exact value} of the parameter that the proof takes as
    exact, "delta" or "epsilon"; {} at a codimension-two point, where both are enclosed.

    Returns
    -------
    BifurcationCertificate
        The theorem.
    """
    n, free = motion.n, [i for i, parameter in enumerate(POSSIBLE_UNKNOWNS) if parameter not in known]
    phi = _null_vector(motion, x, float(beta))
    start = np.concatenate([x[:n], x[n:][free], phi])
    with precision(BITS if n <= MOST_IMPACTS_AT_BITS else 2 * BITS):
        system = ExtendedSystem(motion, ball(beta), {key: ball(value) for key, value in known.items()}, phi.tolist())
        found = enclose_zero(system, start)
        require_admissible_at(system, found.zero)
        repeats = [i for i in range(n) if i != motion.impact]
        require_least_period([found.zero[i] for i in repeats], [motion.walls[i] for i in repeats], motion.m)
        return BifurcationCertificate(
            name=name,
            motion=motion,
            known={"beta": beta, **known},
            solved={POSSIBLE_UNKNOWNS[i]: _widened_ends(each) for i, each in zip(free, found.zero[n:], strict=False)},
            times=tuple(found.centre[:n]),
            radius=found.radius,
            versions={"gear-rattle": __version__, **VERSIONS},
        )


def _null_vector(motion: BifurcatingMotion, x: Array, beta: float) -> Array:
    """Return the unit null vector φ (n,) of the Jacobian J(μ) of the impact equations; at a graze an empty array.

    The multiplier μ is 1 at a saddle-node and −1 at a flip.

    Returns
    -------
    Array
        φ.
    """
    if motion.kind is EventKind.GRAZING:
        return np.empty(0)
    itinerary = Itinerary(motion.walls, motion.m, beta)
    return np.asarray(np.linalg.svd(itinerary.jacobian(x, MULTIPLIER[motion.kind]))[2][-1], np.float64)


def _widened_ends(x: arb) -> Ends:
    """Return the ends, in 30 decimals, of an interval wider than the ball x."""
    low, high = exact_ends(x)
    room = max(WIDENING * (high - low), LEAST_WIDENING)
    unit = Fraction(1, 10**30)
    return (low - room) // unit * unit, -(-(high + room) // unit) * unit
