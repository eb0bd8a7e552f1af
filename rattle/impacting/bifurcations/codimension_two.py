"""Codimension-two points, where bifurcation curves of the period-one motions meet, and the order of their contact.

All these points lie on one smooth grazing curve. On its part G1 the motion C grazes Σ⁻, on its part G2 the motion A.
Let T be the sum of the multipliers of the grazing motion without the impact on Σ⁻, E = e^(−δ), and M = (det J(1) + det
J(−1))/2 for the motion with both impacts (`rattle.impacting.orbits.equations`). Along the grazing curve the points are

    COD20: T = −1 − E        COD21: T = 2 e^(−δ/2)        COD23: M = 0        COD22: T = 1 + E (τ = 3/4).

Near the graze, where the speed u at Σ⁻ is small, the trace of B and D is proportional to M/u. Their saddle-node has the
trace 1 + E and their flip the trace −1 − E. Both therefore reach the graze where M vanishes, at COD23. In the paper
these curves end at COD21, where the multipliers become real; COD21 and COD23 differ (docs/paper.md).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np

from rattle.continuation.arclength import ContinuationProblem, plane_scale, solve_with_fixed_unknown, tangent_at
from rattle.continuation.conditions import equations_of_bifurcation
from rattle.errors import RattleError, require_number
from rattle.impacting.bifurcations.registry import CURVES
from rattle.impacting.bifurcations.starts import family_members
from rattle.impacting.orbits import closed_form
from rattle.numerics.complex_step import Array

#: Least half-backlash. Below it, rounding no longer separates the codimension-two points, which lie near δ = 4β/π.
LEAST_BACKLASH = 1e-6
Residual = Callable[[float, float], float]


def _scaled_cosine_of_graze(delta: float, beta: float) -> float:
    """Return 1 + e^(−δ) − T for the grazing motion at this damping; it is proportional to ε cos 2πτ of the motion.

    T is the sum of the multipliers of the grazing motion without the impact on Σ⁻.

    Returns
    -------
    float
        1 + e^(−δ) − T; NaN if there is no graze.
    """
    cosine, _ = closed_form.first_graze_cosine_and_epsilon(delta, beta)
    return 4 * math.pi * -math.expm1(-delta) * cosine / delta**2


def _residual_of_flip_at_graze(delta: float, beta: float) -> float:
    """Return a number that vanishes where the grazing motion flips, at COD20."""
    return _scaled_cosine_of_graze(delta, beta) - 2 * (1 + math.exp(-delta))


def _residual_of_equal_multipliers(delta: float, beta: float) -> float:
    """Return a number that vanishes where both multipliers of the grazing motion are e^(−δ/2), at COD21."""
    return _scaled_cosine_of_graze(delta, beta) - (1 - math.exp(-delta / 2)) ** 2


def _residual_of_multiplier_two_thirds(delta: float, beta: float) -> float:
    """Return a number that vanishes where the larger multiplier of the grazing motion is 2/3."""
    return _scaled_cosine_of_graze(delta, beta) - (1 / 3 - math.exp(-delta) / 2)


def _negative_mean_determinant(delta: float, beta: float) -> float:
    """Return −M = −(det J(1) + det J(−1))/2 of the grazing motion. It is 0 at COD23, and NaN if there is no graze.

    J(λ) is the Jacobian of the impact equations; its determinant is 0 if λ is a multiplier.

    Returns
    -------
    float
        −M.
    """
    sigma = closed_form.find_next_grazing_sigma(closed_form.EDGE, delta, beta)
    if not sigma < 0.5:
        return math.nan
    at = family_members(np.array([sigma]), delta, beta)
    return -float(at.saddle_node_determinant[0] + at.flip_determinant[0]) / 2


@dataclass(frozen=True)
class CodimensionTwoCondition:
    """The condition that a codimension-two point meets on the grazing curve, and the curves that meet at this point.

    residual: a function of (δ, β) that is 0 at the point. curves: {name of a curve: side of the point on which this
    curve exists}, −1 for smaller δ and +1 for larger δ.
    """

    meaning: str
    residual: Residual
    curves: dict[str, int]


POINTS = {
    "COD20": CodimensionTwoCondition(
        "C flips as it grazes: a multiplier is −1", _residual_of_flip_at_graze, {"PDC": -1, "G1": -1}
    ),
    "COD21": CodimensionTwoCondition(
        "the multipliers of the grazing C become equal, and real", _residual_of_equal_multipliers, {"G1": -1}
    ),
    "COD23": CodimensionTwoCondition(
        "SN2 and PD1 end on G1: beyond this point C meets D instead of B",
        _negative_mean_determinant,
        {"SN2": -1, "PD1": -1, "G1": -1},
    ),
    "COD22": CodimensionTwoCondition(
        "SN1 ends where A and C are born grazing: G1 becomes G2",
        _scaled_cosine_of_graze,
        {"SN1": -1, "G1": -1, "G2": 1},
    ),
}


@dataclass(frozen=True)
class CodimensionTwo:
    """A codimension-two point of the (δ, ε) plane.

    Attributes
    ----------
    name, meaning
        The name of the point, and its meaning in words.
    delta, epsilon
        The parameters of the point.
    curves : tuple[str, ...]
        The curves that meet at the point.
    tangency : dict
        For each pair of curves the measured order p in |ε₁ − ε₂| ∝ |Δδ|^p, where Δδ is the distance in δ from the
        point: 1 if they cross, 2 if they touch. At extreme backlash a pair is left out if one of its curves cannot be
        followed.
    """

    name: str
    meaning: str
    delta: float
    epsilon: float
    curves: tuple[str, ...]
    tangency: dict[tuple[str, str], float]


def codimension_two(beta: float = 0.6) -> tuple[CodimensionTwo, ...]:
    """Return the codimension-two points COD20, COD21, COD23 and COD22 (by rising δ at β = 0.6) of a half-backlash.

    Positions are accurate to about 1e-12. The order in which two curves touch or cross at a point is fitted over three
    decades of the distance in δ. COD21 and COD22 are in the paper (section 5.2), COD20 and COD23 are not.

    Returns
    -------
    tuple[CodimensionTwo, ...]
        The points that exist at this half-backlash; none below β = 1e-6.

    Raises
    ------
    ParameterError
        If beta is outside its domain.
    """
    beta = require_number("beta", beta, positive=True)
    return _cached_codimension_two_points(beta)


@lru_cache(maxsize=64)
def _cached_codimension_two_points(beta: float) -> tuple[CodimensionTwo, ...]:
    found = []
    for name, definition in POINTS.items():
        try:
            delta, epsilon = _point_on_grazing_curve(name, definition.residual, beta)
        except RattleError:
            continue
        tangency = _tangency_orders(definition.curves, delta, epsilon, beta)
        found.append(CodimensionTwo(name, definition.meaning, delta, epsilon, tuple(definition.curves), tangency))
    return tuple(found)


@lru_cache(maxsize=256)
def _point_on_grazing_curve(name: str, residual: Residual, beta: float) -> tuple[float, float]:
    """Return (δ, ε) of the point with the least δ among the grazing curve's points at which `residual` falls to 0."""
    if beta < LEAST_BACKLASH:
        raise RattleError(f"{name} needs beta of at least {LEAST_BACKLASH:g} in double precision, got {beta}")
    from scipy.optimize import brentq  # imported here because it takes a quarter of a second to load

    # COD22 is near δ = 4β/π, where a bounce of speed 2πδ is about as high as the distance 2β between the walls
    scan = np.geomspace(0.05, 8.0, 400) * 4 * beta / np.pi
    values = np.array([residual(x, beta) for x in scan])
    falls = np.flatnonzero((values[:-1] > 0) & (values[1:] <= 0))
    if not falls.size:
        raise RattleError(f"{name} was not found at beta = {beta}: choose another beta")
    lo, hi = scan[falls[0]], scan[falls[0] + 1]
    delta = float(brentq(residual, lo, hi, args=(beta,), xtol=1e-15 * beta, rtol=4 * np.finfo(float).eps))
    return delta, float(closed_form.first_graze_cosine_and_epsilon(delta, beta)[1])


def _tangency_orders(curves: dict[str, int], delta: float, epsilon: float, beta: float) -> dict[tuple[str, str], float]:
    """Return the measured order of contact of each pair of curves at a codimension-two point.

    curves: for each name the side of the point on which the curve exists, −1 for smaller and +1 for larger δ. A pair is
    compared on the side of its second curve; if the first curve does not exist there, its virtual continuation is used.
    The pair of G1 and G2, and pairs that cannot be computed, are left out.
    The distances in δ are at most 1 % of the point's damping: farther away, curves that touch look like curves that
    cross.

    Returns
    -------
    dict[tuple[str, str], float]
        The order for each pair of names: 1 if the curves cross, 2 if they touch.
    """
    distances = np.geomspace(1e-5, 1e-2, 13) * delta * plane_scale(delta)
    orders = {}
    for one, other in combinations(curves, 2):
        if {one, other} == {"G1", "G2"}:
            continue  # G1 and G2 are parts of one smooth curve: they have no order of contact
        offsets = curves[other] * distances
        try:
            gaps = _epsilon_along_curve(one, delta, epsilon, beta, offsets) - _epsilon_along_curve(
                other, delta, epsilon, beta, offsets
            )
        except (RattleError, np.linalg.LinAlgError):
            continue
        orders[one, other] = float(np.polyfit(np.log(distances), np.log(np.abs(gaps)), 1)[0])
    return orders


def _epsilon_along_curve(name: str, delta: float, epsilon: float, beta: float, offsets: Array) -> Array:
    """Return ε of the curve `name` at dampings delta + offsets, also where the curve is virtual.

    (delta, epsilon) is a point of the curve.
    offsets (n,): all of one sign, the smallest size first, because the curve is followed from each to the next.

    Returns
    -------
    Array
        ε (n,).

    Raises
    ------
    RattleError
        If the curve cannot be followed.
    """
    definition = CURVES[name]
    problem = equations_of_bifurcation(definition.itinerary(beta), definition.kind, definition.impact)
    starts = definition.starting_points_at(delta, beta)
    if not starts:
        raise RattleError(f"the curve {name} cannot be followed: closed forms give no point of it at delta = {delta}")
    x = _solution_at_delta(problem, min(starts, key=lambda x: abs(float(x[-1]) - epsilon)), delta)
    rising = np.zeros(x.size)
    rising[-2] = 1.0
    tangent = tangent_at(problem, x, rising)
    found = []
    for offset in offsets:
        guess = x + (delta + offset - x[-2]) / tangent[-2] * tangent
        x = _solution_at_delta(problem, guess, delta + offset)
        tangent = tangent_at(problem, x, rising)
        found.append(x[-1])
    return np.array(found)


def _solution_at_delta(problem: ContinuationProblem, guess: Array, delta: float) -> Array:
    """Return the solution near a guess at this damping. Raises RattleError if Newton's method finds none."""
    x = solve_with_fixed_unknown(problem, guess, -2, delta)
    if x is None:
        raise RattleError(f"Newton's method finds no point of the bifurcation curve at delta = {delta}")
    return x


def robust_chaos_interval(beta: float = 0.6) -> tuple[float, float]:
    """Return the interval of dampings in which the paper's condition for robust chaos at G1 holds.

    The condition is that the larger multiplier of the grazing C is real and lies in (2/3, 1). The interval runs from
    COD21 to COD22. At large backlash both multipliers at COD21 are e^(−δ/2) < 2/3, and the interval begins where the
    larger multiplier reaches 2/3. Below COD23 the chaos is not born at G1 but exists there already (docs/paper.md).
    Source: paper, section 5.2.

    Returns
    -------
    tuple[float, float]
        The least and the largest δ.

    Raises
    ------
    ParameterError
        If beta is outside its domain.
    RattleError
        If this half-backlash has no COD21 or no COD22, or is below 1e-6.
    """
    beta = require_number("beta", beta, positive=True)
    lower, upper = (_point_on_grazing_curve(name, POINTS[name].residual, beta)[0] for name in ("COD21", "COD22"))
    if math.exp(-lower / 2) < 2 / 3:
        lower = _point_on_grazing_curve("multiplier 2/3", _residual_of_multiplier_two_thirds, beta)[0]
    return lower, upper
