"""The codimension-two points of the period-one motions, followed as curves in (δ, ε, r).

The first condition of every point is that P(1,1,0) grazes Σ⁻ (`rattle.impacting.bifurcations.codimension_two`).
With E = e^(−δ) the grazing motion's tangent map has the trace T = 1 + r²E − (1 + r)² π(1 − E) ε cos 2πτ/δ².
The second conditions are

    COD20: T = −1 − r²E     COD21: T = 2r e^(−δ/2)     COD22: cos 2πτ = 0, T = 1 + r²E     COD23: det J = 0.

Here J is the Jacobian of the equations of P(1,1,1), the motion with two impacts. At the graze the second impact arrives
and departs with speed 0, so det J does not depend on the multiplier. Saddle-node and flip of P(1,1,1) therefore reach
the graze where this determinant vanishes, at every restitution.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from rattle.continuation.arclength import (
    BoundsOfUnknown,
    ContinuationProblem,
    CurveFollower,
    OneWayPath,
    solve_with_fixed_unknown,
    tangent_at,
)
from rattle.errors import RattleError, require_number, require_one_of
from rattle.impacting.bifurcations.codimension_two import POINTS, CodimensionTwo, codimension_two
from rattle.impacting.orbits.equations import Itinerary
from rattle.impacting.orbits.periodic import reason_for_virtual_motion
from rattle.inelastic.bifurcations.starts import TWO_IMPACT_WALLS, graze_guesses
from rattle.inelastic.orbits.equations import InelasticItinerary
from rattle.notebook import Columns, TabularResult
from rattle.numerics.complex_step import Array

LEAST_RESTITUTION = 1e-3  # restitution down to which points are followed by default
LONGEST_STEP = 0.02  # longest continuation step, in the unknowns
LARGEST_DAMPING = 8.0  # largest damping to which points are followed, divided by the half-backlash
# indices of the unknowns: the times of the impact and of the graze, then the parameters δ, ε and r
TAU, MIDDLE, DELTA, EPSILON, R = range(5)
Residual = Callable[[NDArray], NDArray]


def _trace_at_graze(x: NDArray) -> NDArray:
    """Return the trace of the tangent map of the grazing P(1,1,0); x (…, 5): times of impact and graze, δ, ε, r."""
    delta, r = x[..., DELTA], x[..., R]
    decay = np.exp(-delta)
    cosine = x[..., EPSILON] * np.cos(2 * np.pi * x[..., TAU])
    return np.asarray(1.0 + r * r * decay - (1.0 + r) ** 2 * np.pi * (1.0 - decay) * cosine / (delta * delta))


def _flip_condition(x: NDArray) -> NDArray:
    """Return a number that is 0 if the grazing P(1,1,0) with unknowns x also flips, with a multiplier −1 (COD20)."""
    return np.asarray(_trace_at_graze(x) + 1.0 + x[..., R] ** 2 * np.exp(-x[..., DELTA]))


def _equal_multipliers_condition(x: NDArray) -> NDArray:
    """Return a number that is 0 if both multipliers of the grazing P(1,1,0) are equal and positive (COD21)."""
    return np.asarray(_trace_at_graze(x) - 2.0 * x[..., R] * np.exp(-0.5 * x[..., DELTA]))


def _saddle_node_condition(x: NDArray) -> NDArray:
    """Return a number that is 0 if the grazing P(1,1,0) is at SN1, where A and C are born (COD22)."""
    return np.asarray(np.cos(2 * np.pi * x[..., TAU]))


def _jacobian_determinant_at_graze(beta: float, x: NDArray) -> NDArray:
    """Return the determinant of the Jacobian of the equations of P(1,1,1) at the graze, which is 0 at COD23."""
    flights, r = Itinerary(TWO_IMPACT_WALLS, 1, beta).flights(x[..., :R]), x[..., R]
    first = flights.w0_t0[..., 0] + r * flights.w1_t1[..., 1]
    return np.asarray(first * (flights.w0_t0[..., 1] + r * flights.w1_t1[..., 0]))


def _conditions_besides_graze(beta: float) -> dict[str, Residual]:
    """Return the second condition of each codimension-two point; the first is that the motion grazes.

    Returns
    -------
    dict
        {name of the point: function of the unknowns that is 0 at the point}.
    """
    return {
        "COD20": _flip_condition,
        "COD21": _equal_multipliers_condition,
        "COD23": partial(_jacobian_determinant_at_graze, beta),
        "COD22": _saddle_node_condition,
    }


@dataclass(frozen=True, repr=False)
class CodimensionTwoCurve(TabularResult):
    """A codimension-two point as a curve over the restitution r at half-backlash beta, from r = 1 down.

    Attributes
    ----------
    delta, epsilon, restitution : ndarray, (n,)
        The parameters of the point.
    tau, speed : ndarray, (n,)
        Phase of the impact of the grazing motion, and the speed with which it leaves Σ⁺.
    residual : ndarray, (n,)
        The largest residual of the conditions.
    end : str
        The reason in words why the curve ends.
    """

    name: str
    beta: float
    delta: Array
    epsilon: Array
    restitution: Array
    tau: Array
    speed: Array
    residual: Array
    end: str
    _unknowns: Array = field(repr=False)

    def _caption(self) -> str:
        return f"{self.name} at β = {self.beta:g}, {self.delta.size} points; ends: {self.end}"

    def _columns(self) -> Columns:
        return {
            "delta": self.delta,
            "epsilon": self.epsilon,
            "restitution": self.restitution,
            "tau": self.tau,
            "speed": self.speed,
        }

    def at(self, restitution: float) -> tuple[float, float]:
        """Return the point (δ, ε) of the curve at this restitution, exact to rounding.

        Returns
        -------
        tuple of float
            δ and ε; if the curve passes this restitution more than once, at the first passage from r = 1 on.

        Raises
        ------
        RattleError
            If the curve does not reach this restitution, or Newton's method fails there.
        """
        r = require_number("restitution", restitution, positive=True)
        apart = self.restitution - r
        passed = np.flatnonzero(apart[:-1] * apart[1:] <= 0.0)
        if not passed.size:
            raise RattleError(
                f"{self.name} is known for a restitution from {self.restitution.min():.6g} to 1, got {r:g}"
            )
        i = int(passed[0])
        share = apart[i] / (apart[i] - apart[i + 1]) if apart[i] != apart[i + 1] else 0.0
        guess = self._unknowns[i] + share * (self._unknowns[i + 1] - self._unknowns[i])
        found = solve_with_fixed_unknown(_continuation_problem_of_point(self.name, self.beta), guess, R, r)
        if found is None:
            raise RattleError(
                f"Newton's method finds no {self.name} at restitution = {r:g}: give a slightly different restitution"
            )
        return float(found[DELTA]), float(found[EPSILON])


def _continuation_problem_of_point(name: str, beta: float) -> ContinuationProblem:
    """Return the four equations of a codimension-two point in five unknowns, as a continuation problem.

    Returns
    -------
    ContinuationProblem
        The laws of both impacts, the graze, and the second condition of the point.
    """
    condition = _conditions_besides_graze(beta)[name]

    def equations(x: NDArray) -> NDArray:
        flights, r = Itinerary(TWO_IMPACT_WALLS, 1, beta).flights(x[..., :R]), x[..., R]
        both = [flights.w0[..., i] + r * flights.w1[..., i - 1] for i in range(2)]
        return np.stack([*both, flights.w1[..., 0], condition(x)], axis=-1)

    return ContinuationProblem(equations)


def follow_codimension_two(name: str, beta: float = 0.6, lowest: float = LEAST_RESTITUTION) -> CodimensionTwoCurve:
    """Return a codimension-two point of the elastic gear as a curve in (δ, ε, r), from r = 1 down.

    Parameters
    ----------
    name : str
        The point: COD20, COD21, COD22 or COD23.
    beta : float
        Half-backlash > 0. For a gear with load, give its half-backlash divided by 1 + load, and multiply the resulting
        ε by 1 + load.
    lowest : float
        The least restitution to which the point is followed.

    Returns
    -------
    CodimensionTwoCurve
        The points of the curve, exact to rounding, as far as the grazing motion is admissible.

    Raises
    ------
    ParameterError
        If a number is outside its domain, or the name is unknown.
    RattleError
        If this point of the elastic gear is not found at this half-backlash.
    """
    require_one_of("name", name, tuple(_conditions_besides_graze(1.0)))
    beta = require_number("beta", beta, positive=True)
    known = {point.name: point for point in codimension_two(beta)}
    if name not in known:
        raise RattleError(f"no {name} of the elastic gear was found at beta = {beta:g}: give another beta")
    at = known[name]
    near = graze_guesses(at.delta, beta, 1.0)
    if not near:
        raise RattleError(
            f"the elastic gear has no graze at beta = {beta:g} from which {name} can be followed: give another beta"
        )
    problem = _continuation_problem_of_point(name, beta)
    closest = min(near, key=lambda x: abs(float(x[-1]) - at.epsilon))
    start = solve_with_fixed_unknown(problem, np.append(closest, 1.0), R, 1.0)
    if start is None:
        raise RattleError(f"Newton's method finds no {name} at restitution = 1, beta = {beta:g}: give another beta")

    def reason_to_end(x: Array) -> str | None:
        if not lowest <= x[R] <= 1.0:
            return f"restitution = {lowest:g}" if x[R] < lowest else "restitution = 1"
        if not 0.0 < x[DELTA] < LARGEST_DAMPING * beta:
            return "the damping leaves the range that is followed"
        return reason_for_virtual_motion(InelasticItinerary(TWO_IMPACT_WALLS, 1, beta, float(x[R])), x[:R], 1)

    bounds = (BoundsOfUnknown(R, lowest, 1.0), BoundsOfUnknown(DELTA, 1e-3, LARGEST_DAMPING * beta))
    follower = CurveFollower(problem, bounds, lambda x: reason_to_end(x) is None, lambda _: LONGEST_STEP)
    down = np.zeros(5)
    down[R] = -1.0
    path = follower.follow(start, tangent_at(problem, start, down))
    return _build_codimension_two_curve(name, beta, problem, path, reason_to_end)


def _build_codimension_two_curve(
    name: str, beta: float, problem: ContinuationProblem, path: OneWayPath, reason_to_end: Callable[[Array], str | None]
) -> CodimensionTwoCurve:
    x = path.points
    end = "the equations become singular"
    if path.first_point_outside is not None:
        end = reason_to_end(path.first_point_outside) or "the edge of its existence"
    speed = -Itinerary(TWO_IMPACT_WALLS, 1, beta).flights(x[:, :R]).w0[:, 0]
    residual = np.abs(problem.equations(x)).max(axis=-1)
    tau = x[:, TAU] - np.floor(x[:, TAU])
    return CodimensionTwoCurve(
        name, beta, x[:, DELTA], x[:, EPSILON], x[:, R], tau, np.asarray(speed), np.asarray(residual), end, x
    )


@lru_cache(maxsize=64)
def _cached_codimension_two_curve(name: str, beta: float) -> CodimensionTwoCurve:
    """Return the curve of a codimension-two point down to LEAST_RESTITUTION, computed once for each name and beta."""
    return follow_codimension_two(name, beta)


def codimension_two_points_at(beta: float, restitution: float, load: float = 0.0) -> tuple[CodimensionTwo, ...]:
    """Return the codimension-two points of the (δ, ε) plane at one restitution and load.

    Points that cannot be followed from r = 1 to this restitution are left out. `CodimensionTwo.tangency`, which is
    computed for the elastic gear only, is empty.

    Returns
    -------
    tuple of CodimensionTwo
        The points.
    """
    found = []
    for name, condition in POINTS.items():
        try:
            delta, epsilon = _cached_codimension_two_curve(name, beta / (1.0 + load)).at(restitution)
        except RattleError:
            continue
        found.append(
            CodimensionTwo(name, condition.meaning, delta, epsilon * (1.0 + load), tuple(condition.curves), {})
        )
    return tuple(found)
