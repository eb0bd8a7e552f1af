"""Follow the boundary crisis in the (δ, ε) plane: each point of the curve is the first guess of the next point.

At a point of the curve W^u(A) has a contact with W^s(A): the two manifolds of the saddle A touch.

The curve is followed in steps of δ, and close to COD22 in steps of ε − SN1.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from rattle.errors import RattleError, require, require_number
from rattle.impacting.crisis.contact import (
    Crisis,
    manifold_contact_position,
    saddle_manifolds_at,
    solve_manifold_contact,
    solve_manifold_contact_above_sn1,
    square_root_coefficient,
)
from rattle.impacting.crisis.escape import is_chaotic_below_crisis
from rattle.impacting.crisis.search import boundary_crisis, delta_of_cod22, has_escaping_piece
from rattle.orbits.saddles import Array

START = 0.98  # the curve is followed in both directions from this multiple of the δ of COD22, by default
CLOSEST = 1e-5  # least ε − SN1 to which the curve is followed close to COD22, relative to ε of the first crisis
RATIO = 0.75  # ratio of successive ε − SN1 close to COD22
# WINDOW: half-width of the window in which s is searched, relative to the guess of s; four times as large if only one
# crisis is known. BRACKET: expected relative error of the guess of the other unknown. This unknown is ε − SN1 or, close
# to COD22, the distance in δ from COD22.
WINDOW, BRACKET = 0.05, 0.01
DOMAIN = 0.3  # largest half-width of the window of s, divided by the length of a fundamental domain, both in ln s
# a crisis is checked at a slightly smaller ε, where no piece of W^u(A) may escape: decrease of ε, relative to ε − SN1;
# number of samples of W^u(A) per unit of ln s in this check
MARGIN, CHECK_DENSITY = 1e-3, 4000
SMALLEST = 1e-4  # smallest step in δ, relative to the δ of COD22; the curve ends where it needs a smaller step
WIDEST = 0.05  # widest range of δ without chaos that the curve crosses, relative to the δ of COD22
# if `manifold_contact_position` of a crisis exceeds this, the orbit of the next crisis is followed for one more impact
INSIDE = 0.6


@dataclass(frozen=True)
class CrisisCurve:
    """The curve of boundary crises of one half-backlash: points in order, from small damping towards COD22.

    `changes` holds the points at which the contact changes between a corner and a tangency of W^u(A). `low_end` and
    `high_end` say why the curve ends at small and at large damping.
    """

    beta: float
    points: tuple[Crisis, ...]
    changes: tuple[Crisis, ...]
    low_end: str
    high_end: str

    @property
    def delta(self) -> Array:
        """Damping δ (n,) of the points."""
        return np.array([point.delta for point in self.points])

    @property
    def epsilon(self) -> Array:
        """Eccentricity ε (n,) of the points."""
        return np.array([point.epsilon for point in self.points])


def _extrapolate_crises(known: list[Crisis], x: Array, y: Array, target: float) -> Array:
    """Return k quantities at x = `target`, from their values y (n, k) at n known crises with coordinates x (n,).

    A parabola through the last three crises is extrapolated; with fewer crises a line or a constant.

    Returns
    -------
    Array
        Values (k,).
    """
    near = slice(-3, None) if len(known) > 2 else slice(-len(known), None)
    powers = np.polyfit(x[near] - x[-1], y[near], min(2, len(known) - 1))
    return np.asarray([np.polyval(column, target - x[-1]) for column in powers.T], np.float64)


def _window_to_search(known: list[Crisis], s: float) -> tuple[float, float]:
    """Return the window (low, high) of positions on W^u(A), around the guess s, in which the next contact is searched.

    known: the crises of the curve that are found so far; the last of them is the nearest to the next crisis.

    Returns
    -------
    tuple[float, float]
        The window. It is wider if only one crisis is known.
    """
    last = known[-1]
    rate = np.log(saddle_manifolds_at(last.delta, last.epsilon, last.beta).unstable_manifold.multiplier)
    width = float(min(WINDOW * (4.0 if len(known) == 1 else 1.0), DOMAIN * rate))
    return s * (1.0 - width), s * (1.0 + width)


def _count_impacts_of_next_crisis(last: Crisis) -> int:
    """Return the number of impacts on Σ⁺ in which the contact orbit of the crisis after `last` comes back to A."""
    return last.steps + (1 if manifold_contact_position(last) > INSIDE else 0)


def crisis_at_damping(known: list[Crisis], delta: float) -> Crisis:
    """Return the crisis at a damping. The search starts at a guess that is extrapolated from known crises.

    known: the crises found so far, in the order of the curve; the last of them is the nearest to the new one.

    Returns
    -------
    Crisis
        The crisis.

    Raises
    ------
    RattleError
        If no crisis is found at this damping.
    """
    y = np.log([[point.epsilon_above_sn1, point.parameter] for point in known])
    gap, s = np.exp(_extrapolate_crises(known, np.array([point.delta for point in known]), y, delta))
    return solve_manifold_contact(
        delta,
        known[-1].beta,
        float(gap),
        _window_to_search(known, float(s)),
        _count_impacts_of_next_crisis(known[-1]),
        BRACKET,
    )


def find_crisis_above_sn1(known: list[Crisis], gap: float, end: float) -> Crisis:
    """Return the crisis at ε = SN1 + gap, close to COD22, by a search that starts from an extrapolated guess.

    known: the crises found so far, in the order of the curve; the last of them is the nearest to COD22. end: δ of
    COD22. δ − end, which is nearly proportional to √gap, is extrapolated from `known`.

    Returns
    -------
    Crisis
        The crisis.
    """
    last = known[-1]
    root = np.sqrt([point.epsilon_above_sn1 for point in known])
    y = np.array([[point.delta - end, point.parameter] for point in known]) / root[:, None]
    offset, s = _extrapolate_crises(known, root, y, float(np.sqrt(gap))) * np.sqrt(gap)
    bracket = BRACKET * max(abs(float(offset)), float(np.sqrt(gap)) * 0.01)
    return solve_manifold_contact_above_sn1(
        end + float(offset),
        last.beta,
        gap,
        _window_to_search(known, float(s)),
        _count_impacts_of_next_crisis(last),
        bracket,
        abs(last.delta - end),
    )


def _follow_to_smaller_damping(start: Crisis, low: float, resolution: float, end: float) -> tuple[list[Crisis], str]:
    """Return the points of the crisis curve from `start` down to δ = `low`, and the reason why the curve ends."""
    # `chaotic` is the index of the last point with a chaotic attractor. Later points may lie in a short range of δ in
    # which the motion is periodic, and which the curve crosses.
    known, step, chaotic = [start], resolution, 0
    while known[-1].delta > low:
        step = min(step, resolution)
        delta = max(low, known[-1].delta - step)
        try:
            found = crisis_at_damping(known, delta)
            if has_escaping_piece(delta, found.beta, found.epsilon_above_sn1 * (1.0 - MARGIN), CHECK_DENSITY):
                raise RattleError("another piece of W^u(A) touches W^s(A) at a smaller epsilon")
        except RattleError as error:
            step /= 4.0
            if step < SMALLEST * end:
                why = f"at delta = {known[-1].delta:.5f} {error}"
                if chaotic < len(known) - 1:
                    why = f"below delta = {known[chaotic].delta:.5f} the attractor of W^u(A) is not chaotic, and {why}"
                return known[: chaotic + 1], why
            continue
        known.append(replace(found, chaotic=is_chaotic_below_crisis(found)))
        step *= 2.0
        if known[-1].chaotic:
            chaotic = len(known) - 1
        elif known[chaotic].delta - delta > WIDEST * end:
            return known[
                : chaotic + 1
            ], f"below delta = {known[chaotic].delta:.5f} the attractor of W^u(A) is not chaotic"
    return known, "the requested end"


def _follow_towards_cod22(start: Crisis, top: float, end: float) -> tuple[list[Crisis], str]:
    """Return the points of the crisis curve from `start` towards COD22, up to the first point beyond δ = `top`.

    `end` is δ of COD22.

    Returns
    -------
    tuple[list[Crisis], str]
        The points by rising δ, and the reason why they end before `top`; ignore the reason if they reach `top`.
    """
    known, last = [start], CLOSEST * start.epsilon
    while known[-1].epsilon_above_sn1 > last and known[-1].delta <= top:
        gap = max(known[-1].epsilon_above_sn1 * RATIO, 0.999 * last)
        try:
            known.append(find_crisis_above_sn1(known, gap, end))
        except RattleError as error:
            return known, str(error)
    return known, "it continues to COD22, and is not followed this close to SN1"


def _find_shape_changes(points: list[Crisis]) -> list[Crisis]:
    """Return the crises between these points at which the contact changes between corner and tangency.

    `square_root_coefficient` is 0 at such a crisis.

    Returns
    -------
    list[Crisis]
        The crises, in the order of the points.
    """
    from scipy.optimize import brentq

    found = []
    for one, other in pairwise(points):
        if one.contact == other.contact:
            continue

        def square_root_coefficient_at(delta: float, one: Crisis = one, other: Crisis = other) -> float:
            near = min(one, other, key=lambda point: abs(point.delta - delta))
            return square_root_coefficient(near if near.delta == delta else crisis_at_damping([near], delta))

        delta = float(brentq(square_root_coefficient_at, one.delta, other.delta, xtol=1e-10))
        near = min(one, other, key=lambda point: abs(point.delta - delta))
        found.append(crisis_at_damping([near], delta))
    return found


def crisis_curve(
    low: float | None = None, high: float | None = None, beta: float = 0.6, resolution: float = 0.01
) -> CrisisCurve:
    """Return the curve of boundary crises from δ = low (default: as far as it exists) to δ = high (default: COD22).

    Points are at most `resolution` apart in δ. Near COD22 the curve is followed in steps of ε − SN1, down to 1e-5 of
    SN1. ε is as accurate as in `boundary_crisis`, which finds the crisis from which the curve is followed.

    Returns
    -------
    CrisisCurve
        The points by rising δ, and the reasons why the curve goes no further at either end.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    RattleError
        If COD22 does not exist at this half-backlash, or no crisis is found at the damping where the search begins.
    """
    beta = require_number("beta", beta, positive=True)
    resolution = require_number("resolution", resolution, positive=True)
    end = delta_of_cod22(beta)
    bottom = 0.0 if low is None else require_number("low", low, positive=True)
    top = np.inf if high is None else require_number("high", high, positive=True)
    require(bottom < top, f"low must be below high, got low = {bottom:g} and high = {top:g}")
    start = boundary_crisis(min(max(START * end, bottom), top), beta)
    falling, low_end = _follow_to_smaller_damping(start, bottom, resolution, end)
    rising, high_end = [start], "the requested end"
    if top > start.delta:
        rising, high_end = _follow_towards_cod22(start, top, end)
        if rising[-1].delta > top:
            rising, high_end = rising[:-1], "the requested end"
            rising.append(crisis_at_damping(rising, top))
    points = [*falling[:0:-1], *rising]
    return CrisisCurve(beta, tuple(points), tuple(_find_shape_changes(points)), low_end, high_end)
