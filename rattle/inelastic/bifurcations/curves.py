"""Trace a bifurcation curve of the inelastic gear through the (δ, ε) plane."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from rattle.continuation.arclength import ContinuationProblem
from rattle.continuation.conditions import equations_of_bifurcation, scale_of_unknowns
from rattle.continuation.curve_continuation import (
    QUIET_LIMIT,
    Curve,
    MotionAtCurvePoint,
    PlaneWindow,
    evenly_spaced_numbers_between,
    require_window_range,
    trace_curve_of_problem,
)
from rattle.errors import RattleError, broadcast_parameters, require, require_one_of
from rattle.flight.forcing import DRIFT, TWO_PI
from rattle.impacting.bifurcations.curve_tracing import ALL_EPSILON, LEAST_DELTA, REACH, motion_at_curve_point
from rattle.impacting.orbits.periodic import reason_for_virtual_motion
from rattle.inelastic.bifurcations.codimension_two import codimension_two_points_at
from rattle.inelastic.bifurcations.registry import INELASTIC_CURVES, NAMES
from rattle.inelastic.given import Harmonics, check_harmonics
from rattle.inelastic.map.harmonics import AMPLITUDE, ORDER, PHASE, harmonics_at_unit_epsilon
from rattle.inelastic.map.quiet import quiet_limit_with_phase
from rattle.inelastic.orbits.equations import add_load_to_problem, unknowns_without_load
from rattle.numerics.complex_step import Array

SAME_EPSILON = 1e-9  # rounding may raise ε of a point on the curve above the quiet limit by this, relative to the limit
SAME_POINT = 1e-6  # a curve ends at a codimension-two point if δ and ε of its end are within this distance of the point


def trace(
    name: str,
    beta: float = 0.6,
    restitution: float = 1.0,
    load: float = 0.0,
    harmonics: Harmonics = (),
    *,
    delta: tuple[float, float] = (0.3, 1.2),
    epsilon: tuple[float, float] = ALL_EPSILON,
) -> Curve:
    """Return a bifurcation curve of the period-one motions inside a window of the (δ, ε) plane.

    Parameters
    ----------
    name : str
        One of `rattle.inelastic.NAMES`, see `describe`.
    beta, restitution, load, harmonics
        As in `rattle.Gear`.
    delta, epsilon : tuple of float
        (low, high) of the window, dimensionless.

    Returns
    -------
    Curve
        The curve in pieces, whose points are solutions to rounding. tau and v: phase and speed after the impact on Σ⁺.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    RattleError
        If the forcing has harmonics and the curve is not the quiet limit, or if the curve cannot be followed.
    """
    require_one_of("name", name, NAMES)
    numbers = broadcast_parameters(1.0, 0.0, beta, restitution=restitution, load=load)[2:]
    beta, restitution, load = (float(each) for each in numbers)
    shape = check_harmonics(harmonics)
    window = PlaneWindow(require_window_range("delta", delta, positive=True), require_window_range("epsilon", epsilon))
    require(window.delta[1] >= LEAST_DELTA, f"delta must reach above {LEAST_DELTA:g}, got {delta!r}")
    dampings = _dampings_to_search(window, beta / (1.0 + load))
    try:
        if name == QUIET_LIMIT:
            return _quiet_limit_curve(beta, load, harmonics_at_unit_epsilon(shape), window, dampings)
        if shape:
            raise RattleError(
                f"{name} is traced for a forcing of one cosine only: leave out the harmonics, or trace {QUIET_LIMIT}"
            )
        return _trace_motion_curve(name, beta, restitution, load, window, dampings)
    except np.linalg.LinAlgError as error:
        raise RattleError(
            f"{name} cannot be followed at beta = {beta:g}, restitution = {restitution:g} and load = {load:g} with "
            f"{window} ({error}): choose another window"
        ) from error


def _dampings_to_search(window: PlaneWindow, beta: float) -> Array:
    """Return the dampings at which a curve is searched for: values spread over the window, and its edges in δ."""
    low, high = window.delta
    spread = evenly_spaced_numbers_between(low, high)
    # every curve has points below REACH · beta, which dampings spread over a wide window could miss
    if low < REACH * beta < high - low:
        spread = np.concatenate([evenly_spaced_numbers_between(low, REACH * beta), spread])
    return np.array([*spread, low, high])


def _trace_motion_curve(
    name: str, beta: float, restitution: float, load: float, window: PlaneWindow, dampings: Array
) -> Curve:
    definition, unit = INELASTIC_CURVES[name], 1.0 + load
    itinerary = definition.itinerary(beta / unit, restitution)

    def starting_points() -> Iterable[Array]:
        for d in dampings:
            for x in definition.starting_points_at(float(d), beta / unit, restitution):
                yield np.append(x[:-1], x[-1] * unit)

    def reason_to_leave(x: Array) -> str | None:
        return definition.reason_not_on_curve(x) or reason_for_virtual_motion(
            itinerary, unknowns_without_load(x, load), definition.impact
        )

    def describe_solution(x: Array) -> MotionAtCurvePoint:
        found = motion_at_curve_point(itinerary, unknowns_without_load(x, load), definition.impact)
        return found._replace(v=found.v * unit)

    problem = add_load_to_problem(equations_of_bifurcation(itinerary, definition.kind, definition.impact), load)

    def add_point_to_reason(x: Array, reason: str) -> str:
        at = (each for each in codimension_two_points_at(beta, restitution, load) if name in each.curves)
        near = [
            each.name for each in at if abs(x[-2] - each.delta) < SAME_POINT and abs(x[-1] - each.epsilon) < SAME_POINT
        ]
        return ": ".join([*near[:1], reason])

    return trace_curve_of_problem(
        name, beta, problem, starting_points(), window, reason_to_leave, describe_solution, add_point_to_reason
    )


def _quiet_limit_curve(
    beta: float, load: float, shape: NDArray[np.float64], window: PlaneWindow, dampings: Array
) -> Curve:
    """Return the curve on which the least contact force in a period is 0; its unknowns are (phase, δ, ε)."""
    order, turn = TWO_PI * shape[ORDER], TWO_PI * shape[PHASE]
    drift = DRIFT * (1.0 + load)

    def equations(x: NDArray) -> NDArray:
        tau, delta, epsilon = (x[..., i, None] for i in range(3))
        angle, size = order * tau + turn, shape[AMPLITUDE] * order
        sine, cosine = np.sin(angle), np.cos(angle)
        force = (size * (order * cosine + delta * sine)).sum(axis=-1)
        rate = (size * order * (order * sine - delta * cosine)).sum(axis=-1)
        drop = delta[..., 0] * drift - epsilon[..., 0] * force
        return np.stack([drop / TWO_PI, rate / TWO_PI**2], axis=-1)

    guesses = []
    for d in dampings:
        tau, epsilon = quiet_limit_with_phase(float(d), drift, shape)
        guesses.append(np.array([tau, d, epsilon]))

    def reason_to_leave(x: Array) -> str | None:
        first = quiet_limit_with_phase(float(x[-2]), drift, shape)[1]
        return None if x[-1] <= first * (1.0 + SAME_EPSILON) else "the contact force reaches 0 at another phase first"

    nothing = np.full(2, complex(np.nan, np.nan))
    return trace_curve_of_problem(
        QUIET_LIMIT,
        beta,
        ContinuationProblem(equations, scale=scale_of_unknowns),
        guesses,
        window,
        reason_to_leave,
        lambda x: MotionAtCurvePoint(float(x[0] - np.floor(x[0])), 0.0, nothing),
        lambda _, reason: reason,
    )
