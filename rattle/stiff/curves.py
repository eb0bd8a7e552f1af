"""The bifurcation curves of A–D of the stiff gear in the (δ, ε) plane at one stiffness.

All of G1, SN2 and G2 are folds of P(1,1,1): a graze is no bifurcation here, but next to it, at a slight contact with
Σ⁻, the motion meets another in a saddle-node. So G1 and SN2 are one smooth curve through a cusp, where C, B and D
become one (COD23 of the impacting model), and SN1 goes on as G2 where A and C are born grazing (COD22).
"""

from collections.abc import Iterator

import numpy as np

from rattle.arclength import Problem
from rattle.bifurcations import Kind, condition
from rattle.curves.curve import Curve, Described
from rattle.curves.following import Window, traced
from rattle.curves.trace import limit_of_contact, spread_between, window_range
from rattle.errors import RattleError, require, require_number
from rattle.impact_equations import TWO_PI, Array
from rattle.stiff.closure import LEAST_CONTACT, Cycle, closure, happens, softness, struck, trace_of
from rattle.stiff.equations import StiffItinerary
from rattle.stiff.families import PLUS, PLUS_MINUS, Family, crossings, families, span_of
from rattle.stiff.following import between
from rattle.stiff.motion import orbit_of
from rattle.stiff.quiet import quiet_limit

#: The letters that meet in each fold.
FOLDS = {"SN1": "AC", "SN2": "BD", "G1": "BC", "G2": "AD"}
FLIP, QUIET = "PD1", "quiet_limit"
MEANINGS = {
    "SN1": "saddle-node at which A and C, P(1,1,0), are born as ε grows; goes on as G2 where they are born grazing",
    "SN2": "saddle-node at which B and D, P(1,1,1), are born as ε grows; ends with G1 in a cusp",
    FLIP: "flip at which D, P(1,1,1), loses stability beside its birth",
    "G1": "saddle-node at which C, which has begun to touch Σ⁻, and B meet, next to the graze; ends with SN2 in a cusp",
    "G2": "saddle-node at which A, which has begun to touch Σ⁻, and D meet, next to the graze; goes on as SN1",
    QUIET: "limit of permanent contact with Σ⁺: above it the teeth separate",
}
NAMES = tuple(MEANINGS)
GOES_ON = {"SN1": ", it goes on as G2", "G2": ", it goes on as SN1"}  # at a graze
NEAR = 1e-2  # of the shortest contact, beside a fold: whether ε is least or greatest there
BISECTIONS = 30


def trace(
    name: str,
    beta: float = 0.6,
    kappa: float = 1e4,
    delta: tuple[float, float] = (0.3, 1.2),
    epsilon: tuple[float, float] = (0.0, 1.0),
) -> Curve:
    """The bifurcation curve `name`, one of NAMES, of the stiff gear inside a window of the (δ, ε) plane.

    SN1: A and C are born; SN2: B and D; G1: C and B meet, G2: A and D, both next to the graze with Σ⁻; PD1: the flip of
    D that is next to its birth; quiet_limit: permanent contact with Σ⁺ is lost. Points are solutions to rounding, as
    those of `rattle.curves.trace`; tau and v are those of the departure from Σ⁺. Raises ParameterError, and RattleError
    where rounding keeps the curve from being followed.
    """
    require(isinstance(name, str) and name in NAMES, f"name must be one of {', '.join(NAMES)}, got {name!r}")
    beta, kappa = require_number("beta", beta, positive=True), require_number("kappa", kappa, positive=True)
    window = Window(window_range("delta", delta, positive=True), window_range("epsilon", epsilon))
    dampings = np.array([*spread_between(*window.delta), *window.delta])
    try:
        if name == QUIET:
            return _quiet_limit(beta, kappa, window, dampings)
        return _traced(name, beta, kappa, window, dampings)
    except np.linalg.LinAlgError as error:
        raise RattleError(
            f"{name} cannot be followed for beta = {beta}, kappa = {kappa} in {window}: {error}"
        ) from error


def describe(name: str) -> str:
    """What happens on a curve, to which motions. Raises ParameterError on an unknown name."""
    require(isinstance(name, str) and name in NAMES, f"name must be one of {', '.join(NAMES)}, got {name!r}")
    return f"{MEANINGS[name]} (docs/stiff.md)"


def _traced(name: str, beta: float, kappa: float, window: Window, dampings: Array) -> Curve:
    walls = (1,) if name == "SN1" else (1, -1)
    itinerary = StiffItinerary(walls, 1, beta, softness(kappa))
    kind = Kind.FLIP if name == FLIP else Kind.SADDLE_NODE

    def left(x: Array) -> str | None:
        cycle = Cycle(PLUS if name == "SN1" else PLUS_MINUS, 1, float(x[-2]), beta, kappa)
        return _left(name, np.delete(x, -2), cycle)

    def described(x: Array) -> Described:
        orbit = orbit_of(itinerary, x)
        return Described(orbit.tau, orbit.v, np.array(orbit.multipliers))

    starts = _starts(name, beta, kappa, window, dampings)
    problem, times = condition(itinerary, kind), itinerary.contacts
    return traced(name, beta, problem, starts, window, left, described, lambda _, reason: reason, times)


def _starts(name: str, beta: float, kappa: float, window: Window, dampings: Array) -> Iterator[Array]:
    """Guesses of the unknowns (2c + 2,) on a curve at these dampings."""
    span = span_of(window.epsilon[1])
    for delta in dampings.tolist():
        for family in families(delta, beta, kappa, span):
            for y in _events(name, family):
                yield np.insert(y, y.size - 1, delta)


def _events(name: str, family: Family) -> list[Array]:
    """The motions (2c + 1,) of a family that are on a curve. Σ⁻ comes later than half a period after Σ⁺, from middle to
    middle of the contacts: at 1/2 is the pole of the limit's P(1,1,1), and the paper's curves are beyond.
    """
    if name == FLIP:
        found = _flips(family)
    else:
        pairs = ("".join(sorted(family.letters[i : i + 2])) for i in range(family.folds.size))
        found = [family.points[k] for k, pair in zip(family.folds, pairs, strict=True) if pair == FOLDS[name]]
    half = 0.5 * softness(family.cycle.kappa)
    late = [y for y in found if y.size == 3 or y[1] - y[0] + half * (y[3] - y[2]) > 0.5]
    return [y for y in late if happens(y, family.cycle)]


def _flips(family: Family) -> list[Array]:
    """The flips of a family of P(1,1,1) next to a fold in which D is born, on its stretch of D."""
    cycle, found = family.cycle, []
    flip = 1.0 + np.exp(-cycle.delta)
    edges = [0, *family.folds.tolist(), len(family.points) - 1]
    for i, letter in enumerate(family.letters):
        for fold, step in ((i, 1), (i + 1, -1)):  # from either end of the stretch
            beside = family.letters[i - step] if 0 < fold < len(edges) - 1 else ""
            if letter != "D" or beside not in ("A", "B"):
                continue
            points = family.points[edges[i] : edges[i + 1] + 1][::step]
            for k in crossings(np.array([trace_of(y, cycle) + flip for y in points]))[:1]:
                found.append(_bisected(points[k], points[k + 1], cycle, flip))
    return found


def _bisected(a: Array, b: Array, cycle: Cycle, flip: float) -> Array:
    """The flip between two motions of a family, nearly."""
    sign, y = trace_of(a, cycle) + flip > 0.0, np.empty(a.size)
    for _ in range(BISECTIONS):
        if not between(a, b, 0.5, cycle, y):
            break
        a, b = (y.copy(), b) if (trace_of(y, cycle) + flip > 0.0) == sign else (a, y.copy())
    return a


def _left(name: str, y: Array, cycle: Cycle) -> str | None:
    """Why a solution is not on a curve, None if it is."""
    c = cycle.walls.size
    if c == 2 and y[3] <= LEAST_CONTACT:
        return f"graze: contact with Σ⁻ is lost{GOES_ON.get(name, '')}"
    if not happens(y, cycle):
        meets = c == 1 and not np.isnan(struck(y, cycle))
        return f"graze: contact with Σ⁻ is made{GOES_ON[name]}" if meets else "the motion does not happen"
    if name in ("SN2", "G1") and _is_greatest(y, cycle) != (name == "G1"):
        return "cusp: SN2 and G1 meet"
    return None


def _is_greatest(y: Array, cycle: Cycle) -> bool:
    """Whether ε is greatest at a fold along its family: −ψ R''φφ/ψR_ε < 0, with the null vectors φ and ψ of ∂R/∂y."""
    n = y.size - 1
    value, matrix, ahead, behind = np.empty(n), *(np.empty((n, n + 1)) for _ in range(3))
    closure(y, cycle, value, matrix)
    left, _, right = np.linalg.svd(matrix[:, :n])
    step = NEAR * np.append(right[-1], 0.0) * min(1.0, float(y[n // 2 : n].min()))
    closure(y + step, cycle, value, ahead)
    closure(y - step, cycle, value, behind)
    bend = (ahead - behind) @ step
    return float(left[:, -1] @ bend) * float(left[:, -1] @ matrix[:, n]) > 0.0


def _quiet_limit(beta: float, kappa: float, window: Window, dampings: Array) -> Curve:
    """x = (phase, δ, ε): the depth of permanent contact, times κ, and its rate vanish (`rattle.stiff.quiet`)."""

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

    return limit_of_contact(beta, Problem(equations), (guess(float(d)) for d in dampings), window)
