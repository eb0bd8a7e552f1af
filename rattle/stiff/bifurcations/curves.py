"""The bifurcation curves of A–D of the stiff gear in the (δ, ε) plane at one stiffness.

G1, SN2 and G2 are all folds of P(1,1,1). A graze is no bifurcation in this gear, but next to it, where the contact with
Σ⁻ is slight, the motion meets another motion in a saddle-node. G1 and SN2 are therefore one smooth curve with a cusp at
which C, B and D merge (COD23 of the impacting model). SN1 continues as G2 where A and C are born grazing (COD22).
"""

from collections.abc import Iterator

import numpy as np

from rattle.continuation.arclength import ContinuationProblem
from rattle.continuation.conditions import EventKind, equations_of_bifurcation, scale_of_unknowns
from rattle.continuation.curve_continuation import (
    Curve,
    MotionAtCurvePoint,
    PlaneWindow,
    evenly_spaced_numbers_between,
    require_window_range,
    trace_curve_of_problem,
    trace_quiet_limit,
)
from rattle.errors import RattleError, require_number, require_one_of
from rattle.flight.forcing import TWO_PI
from rattle.flight.impact_law import ELASTIC
from rattle.numerics.complex_step import Array
from rattle.stiff.map.quiet import quiet_limit
from rattle.stiff.orbits.closure import (
    LEAST_CONTACT,
    ContactCycle,
    is_admissible,
    softness,
    tangent_map_trace,
    time_at_sigma_minus,
    write_residuals,
)
from rattle.stiff.orbits.equations import StiffItinerary
from rattle.stiff.orbits.families import (
    PLUS,
    PLUS_MINUS,
    StiffFamily,
    families_of_a_to_d,
    highest_followed_epsilon,
    indices_of_sign_changes,
)
from rattle.stiff.orbits.family_continuation import solve_family_above_chord
from rattle.stiff.orbits.periodic import orbit_of

#: For each fold curve, the letters of the two motions that meet there.
FOLDS = {"SN1": "AC", "SN2": "BD", "G1": "BC", "G2": "AD"}
FLIPS, QUIET = ("PD1", "PDC", "PD2"), "quiet_limit"
BORN_WITH = ("A", "B")  # motions that are born together with D in a fold: A at G2, B at SN2
ONE_CONTACT_CURVES = ("SN1", "PDC")  # curves of P(1,1,0); all others belong to P(1,1,1)
MEANINGS = {
    "SN1": "saddle-node at which A and C, P(1,1,0), are born as ε grows; goes on as G2 where they are born grazing",
    "SN2": "saddle-node at which B and D, P(1,1,1), are born as ε grows; ends with G1 in a cusp",
    "PD1": "flip at which D, P(1,1,1), loses stability beside its birth",
    "G1": "saddle-node at which C, which has begun to touch Σ⁻, and B meet, next to the graze; ends with SN2 in a cusp",
    "G2": "saddle-node at which A, which has begun to touch Σ⁻, and D meet, next to the graze; goes on as SN1",
    "PDC": "flip at which C, P(1,1,0), loses stability as ε grows; ends where C begins to touch Σ⁻",
    "PD2": "flip at which D, P(1,1,1), becomes stable again at high ε; beyond the fold of this curve, at which D loses "
    "stability again",
    QUIET: "limit of permanent contact with Σ⁺: above it the teeth separate",
}
NAMES = tuple(MEANINGS)
# words appended to the reason why a curve ends at a graze, by the name of the curve
GOES_ON = {"SN1": ", it goes on as G2", "G2": ", it goes on as SN1"}
DIFFERENCE_STEP = 1e-2  # step of the difference quotient at a fold, relative to the duration of the shortest contact
BISECTIONS = 30  # halvings of the interval in which a flip is located


def trace(
    name: str,
    beta: float = 0.6,
    kappa: float = 1e4,
    delta: tuple[float, float] = (0.3, 1.2),
    epsilon: tuple[float, float] = (0.0, 1.0),
) -> Curve:
    """Return the bifurcation curve `name`, one of NAMES, of the stiff gear inside a window of the (δ, ε) plane.

    At SN1, A and C are born; at SN2, B and D are born. At G1, C and B meet, and at G2, A and D meet, both next to the
    graze with Σ⁻. PD1 is the flip of D next to its birth; at PD2, D becomes stable again at higher ε. PDC is the flip
    of C. At quiet_limit permanent contact with Σ⁺ is lost. Points are solutions to rounding, as on the curves of
    `rattle.impacting.bifurcations.curve_tracing`; tau and v are phase and speed of the departure from Σ⁺.

    Returns
    -------
    Curve
        The pieces of the curve inside the window, each with its points in order from one end to the other.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    RattleError
        If rounding prevents the curve from being followed.
    """
    require_one_of("name", name, NAMES)
    beta, kappa = require_number("beta", beta, positive=True), require_number("kappa", kappa, positive=True)
    window = PlaneWindow(require_window_range("delta", delta, positive=True), require_window_range("epsilon", epsilon))
    dampings = np.array([*evenly_spaced_numbers_between(*window.delta), *window.delta])
    try:
        if name == QUIET:
            return _quiet_limit_curve(beta, kappa, window, dampings)
        return _trace_family_curve(name, beta, kappa, window, dampings)
    except np.linalg.LinAlgError as error:
        raise RattleError(
            f"{name} cannot be followed at beta = {beta:g} and kappa = {kappa:g} with {window} ({error}): choose "
            "another window"
        ) from error


def describe(name: str) -> str:
    """Return a description of a curve, its event and its motions. Raises ParameterError on an unknown name."""
    require_one_of("name", name, NAMES)
    return f"{MEANINGS[name]} (docs/stiff.md)"


def _trace_family_curve(name: str, beta: float, kappa: float, window: PlaneWindow, dampings: Array) -> Curve:
    walls = PLUS if name in ONE_CONTACT_CURVES else PLUS_MINUS
    itinerary = StiffItinerary(tuple(walls.tolist()), 1, beta, softness(kappa))
    kind = EventKind.FLIP if name in FLIPS else EventKind.SADDLE_NODE

    def reason_to_leave(x: Array) -> str | None:
        return _reason_to_leave(name, np.delete(x, -2), ContactCycle(walls, 1, float(x[-2]), beta, kappa))

    def motion_at_curve_point(x: Array) -> MotionAtCurvePoint:
        orbit = orbit_of(itinerary, x)
        return MotionAtCurvePoint(orbit.tau, orbit.v, np.array(orbit.multipliers))

    starts = _starting_points(name, beta, kappa, window, dampings)
    problem, times = equations_of_bifurcation(itinerary, kind), itinerary.n_contacts
    return trace_curve_of_problem(
        name, beta, problem, starts, window, reason_to_leave, motion_at_curve_point, lambda _, reason: reason, times
    )


def _starting_points(name: str, beta: float, kappa: float, window: PlaneWindow, dampings: Array) -> Iterator[Array]:
    """Yield guesses of the unknowns (2c + 2,) of motions on a curve at these dampings."""
    for delta in dampings.tolist():
        for family in families_of_a_to_d(delta, beta, kappa, highest_followed_epsilon(delta, window.epsilon[1])):
            for y in _motions_on_curve(name, family):
                yield np.insert(y, y.size - 1, delta)


def _motions_on_curve(name: str, family: StiffFamily) -> list[Array]:
    """Return the folds or flips of a family that lie on the bifurcation curve with this name.

    Motions P(1,1,1) count only if the middle of the contact with Σ⁻ comes more than half a period after the middle of
    the contact with Σ⁺, as on the paper's curves. (At half a period the impacting P(1,1,1) have a pole of ε.)

    Returns
    -------
    list[Array]
        For each motion the times of its contacts, their durations multiplied by √(2κ), and ε; in the family's order.
    """
    if name in FLIPS:
        found = _flips_on_curve(name, family)
    else:
        pairs = ("".join(sorted(family.letters[i : i + 2])) for i in range(family.folds.size))
        found = [family.points[k] for k, pair in zip(family.folds, pairs, strict=True) if pair == FOLDS[name]]
    half = 0.5 * softness(family.cycle.kappa)
    late = [y for y in found if y.size == 3 or y[1] - y[0] + half * (y[3] - y[2]) > 0.5]
    return [y for y in late if is_admissible(y, family.cycle)]


def _flips_on_curve(name: str, family: StiffFamily) -> list[Array]:
    """Return the flips of a family that lie on the curve with this name: flips of C for PDC, of D for PD1 and PD2."""
    if (family.cycle.walls.size == 1) != (name in ONE_CONTACT_CURVES):
        return []
    flip, found = 1.0 + ELASTIC.determinant(family.cycle.delta, 1, 1), []
    edges = [0, *family.folds.tolist(), len(family.points) - 1]
    for i, letter in enumerate(family.letters):
        if letter != ("C" if name == "PDC" else "D"):
            continue
        points = family.points[edges[i] : edges[i + 1] + 1]
        above = np.array([tangent_map_trace(y, family.cycle) + flip for y in points])
        turns = indices_of_sign_changes(above)
        if name == "PD1":
            before, after = ("", *family.letters)[i], (*family.letters, "")[i + 1]
            turns = sorted({*(turns[:1] if before in BORN_WITH else ()), *(turns[-1:] if after in BORN_WITH else ())})
        elif name == "PD2":
            # `above` is negative beyond a flip, so D gains stability as ε grows where `above` rises with ε
            gained = np.diff(above) * np.diff(points[:, -1]) > 0.0
            turns = [k for k in turns if gained[k]]
        found += [_flip_by_bisection(points[k], points[k + 1], family.cycle, flip) for k in turns]
    return found


def _flip_by_bisection(a: Array, b: Array, cycle: ContactCycle, flip: float) -> Array:
    """Return a motion close to the flip between the motions a and b of a family.

    flip: 1 + e^(−δ), which is minus the trace of the tangent map at a flip.

    Returns
    -------
    Array
        The unknowns of the motion.
    """
    sign, y = tangent_map_trace(a, cycle) + flip > 0.0, np.empty(a.size)
    for _ in range(BISECTIONS):
        if not solve_family_above_chord(a, b, 0.5, cycle, y):
            break
        a, b = (y.copy(), b) if (tangent_map_trace(y, cycle) + flip > 0.0) == sign else (a, y.copy())
    return a


def _reason_to_leave(name: str, y: Array, cycle: ContactCycle) -> str | None:
    """Return the reason in words why a solution is not on the curve with this name; None if it is on the curve."""
    c = cycle.walls.size
    if c == 2 and y[3] <= LEAST_CONTACT:
        return f"graze: contact with Σ⁻ is lost{GOES_ON.get(name, '')}"
    if not is_admissible(y, cycle):
        meets = c == 1 and not np.isnan(time_at_sigma_minus(y, cycle))
        return f"graze: contact with Σ⁻ is made{GOES_ON.get(name, '')}" if meets else "the motion is virtual"
    if name in ("SN2", "G1") and _is_maximum_of_epsilon(y, cycle) != (name == "G1"):
        return "cusp: SN2 and G1 meet"
    return None


def _is_maximum_of_epsilon(y: Array, cycle: ContactCycle) -> bool:
    """Return whether ε has a maximum along a family of motions at its fold y.

    Let R be the residuals of the equations, and φ and ψ the right and left null vectors of their Jacobian at fixed ε.
    Along the family ε has the second derivative −(ψ · D²R[φ, φ])/(ψ · ∂R/∂ε), which is negative at a maximum.

    Returns
    -------
    bool
        True for a maximum, False for a minimum.
    """
    n = y.size - 1
    value, matrix, ahead, behind = np.empty(n), *(np.empty((n, n + 1)) for _ in range(3))
    write_residuals(y, cycle, value, matrix)
    left, _, right = np.linalg.svd(matrix[:, :n])
    step = DIFFERENCE_STEP * np.append(right[-1], 0.0) * min(1.0, float(y[n // 2 : n].min()))
    write_residuals(y + step, cycle, value, ahead)
    write_residuals(y - step, cycle, value, behind)
    bend = (ahead - behind) @ step
    return float(left[:, -1] @ bend) * float(left[:, -1] @ matrix[:, n]) > 0.0


def _quiet_limit_curve(beta: float, kappa: float, window: PlaneWindow, dampings: Array) -> Curve:
    """Return the curve on which permanent contact just reaches depth 0: its depth and the rate of its depth are 0.

    The unknowns are x = (phase, δ, ε). `rattle.stiff.map.quiet` has the formula for the depth.

    Returns
    -------
    Curve
        `quiet_limit`, in pieces inside the window.
    """

    def equations(x: Array) -> Array:
        phase, delta, epsilon = TWO_PI * x[..., 0], x[..., 1], x[..., 2]
        sine, cosine = np.sin(phase), np.cos(phase)
        a, b = 2 * kappa - TWO_PI**2, TWO_PI * delta
        scale = kappa / (a * a + b * b)
        p, q = -(TWO_PI**2) * (a - delta**2) * scale, -2 * TWO_PI * delta * kappa * scale
        return np.stack([TWO_PI * delta + epsilon * (p * cosine + q * sine), q * cosine - p * sine], axis=-1)

    def guess(delta: float) -> Array:
        a = 2 * kappa - TWO_PI**2
        phase = np.arctan2(2 * TWO_PI * delta * kappa, TWO_PI**2 * (a - delta**2)) / TWO_PI
        return np.array([phase, delta, float(quiet_limit(delta, kappa))])

    return trace_quiet_limit(
        beta, ContinuationProblem(equations, scale=scale_of_unknowns), (guess(float(d)) for d in dampings), window
    )
