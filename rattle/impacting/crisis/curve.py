"""Follow the crisis in the (δ, ε) plane: each contact is the first guess of the next contact.

The curve is followed in steps of δ, and close to COD22 in steps of ε − SN1.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from rattle.errors import RattleError, require, require_number
from rattle.impacting.crisis.contact import Crisis, frame, reach, root_slope, solve_contact, solve_delta
from rattle.impacting.crisis.escape import is_chaotic_below
from rattle.impacting.crisis.search import boundary_crisis, end_of_curve, touched
from rattle.orbits.saddles import Array

START = 0.98  # the curve begins at this multiple of the δ of COD22
CLOSEST = 1e-5  # least ε − SN1 to which the curve is followed close to COD22, relative to SN1
RATIO = 0.75  # ratio of successive ε − SN1 close to COD22
WINDOW, BRACKET = 0.05, 0.01  # half-widths around a guess, relative to it: of the window in s, of the unknown δ or ε
DOMAIN = 0.3  # widest window of s, as a share of a fundamental domain
# relative distance below the contact at which no other piece of W^u(A) may touch; samples per unit of ln s of this
# check
MARGIN, CHECKED = 1e-3, 4000
SMALLEST = 1e-4  # smallest step in δ, relative to the δ of COD22; a shorter one ends the curve
WIDEST = 0.05  # widest window of periodic motion to cross, relative to the δ of COD22
INSIDE = 0.6  # share of the series of W^s(A); a contact beyond it is followed for one more return at the next point


@dataclass(frozen=True)
class CrisisCurve:
    """The curve of crises of one half-backlash: contacts in order, from small damping towards COD22.

    `changes` holds the contacts at which the shape of the contact changes between a corner and a smooth bend. `low_end`
    and `high_end` say why the curve ends.
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


def _guess(known: list[Crisis], x: Array, y: Array, at: float) -> Array:
    """Extrapolate the columns of y (n, k), whose values at x (n,) are known, to `at` from the last three points."""
    near = slice(-3, None) if len(known) > 2 else slice(-len(known), None)
    powers = np.polyfit(x[near] - x[-1], y[near], min(2, len(known) - 1))
    return np.asarray([np.polyval(column, at - x[-1]) for column in powers.T], np.float64)


def _window(known: list[Crisis], s: float) -> tuple[float, float]:
    last = known[-1]
    rate = np.log(frame(last.delta, last.epsilon, last.beta).unstable.multiplier)
    width = float(min(WINDOW * (4.0 if len(known) == 1 else 1.0), DOMAIN * rate))
    return s * (1.0 - width), s * (1.0 + width)


def _steps(last: Crisis) -> int:
    return last.steps + (1 if reach(last) > INSIDE else 0)


def in_delta(known: list[Crisis], delta: float) -> Crisis:
    """Return the contact at delta that continues the known contacts, the nearest one last. Raises RattleError."""
    y = np.log([[point.gap, point.parameter] for point in known])
    gap, s = np.exp(_guess(known, np.array([point.delta for point in known]), y, delta))
    return solve_contact(delta, known[-1].beta, float(gap), _window(known, float(s)), _steps(known[-1]), BRACKET)


def in_gap(known: list[Crisis], gap: float, end: float) -> Crisis:
    """Return the contact at SN1 + gap that continues the known contacts. Near COD22, δ − δ(COD22) scales with √gap."""
    last = known[-1]
    root = np.sqrt([point.gap for point in known])
    y = np.array([[point.delta - end, point.parameter] for point in known]) / root[:, None]
    offset, s = _guess(known, root, y, float(np.sqrt(gap))) * np.sqrt(gap)
    bracket = BRACKET * max(abs(float(offset)), float(np.sqrt(gap)) * 0.01)
    return solve_delta(
        end + float(offset), last.beta, gap, _window(known, float(s)), _steps(last), bracket, abs(last.delta - end)
    )


def _down(start: Crisis, to: float, resolution: float, end: float) -> tuple[list[Crisis], str]:
    """Return the contacts from `start` down to δ = to, through windows of periodic motion, and why they end."""
    known, step, chaotic = [start], resolution, 0  # chaotic: number of the last contact with a chaotic attractor
    while known[-1].delta > to:
        step = min(step, resolution)
        delta = max(to, known[-1].delta - step)
        try:
            found = in_delta(known, delta)
            if touched(delta, found.beta, found.gap * (1.0 - MARGIN), CHECKED):
                raise RattleError("another piece of W^u(A) touches W^s(A) first")
        except RattleError as error:
            step /= 4.0
            if step < SMALLEST * end:
                why = f"at delta = {known[-1].delta:.5f} {error}"
                if chaotic < len(known) - 1:
                    why = f"below delta = {known[chaotic].delta:.5f} the attractor of W^u(A) is not chaotic, and {why}"
                return known[: chaotic + 1], why
            continue
        known.append(replace(found, chaotic=is_chaotic_below(found)))
        step *= 2.0
        if known[-1].chaotic:
            chaotic = len(known) - 1
        elif known[chaotic].delta - delta > WIDEST * end:
            return known[
                : chaotic + 1
            ], f"below delta = {known[chaotic].delta:.5f} the attractor of W^u(A) is not chaotic"
    return known, "the requested end"


def _up(start: Crisis, top: float, end: float) -> tuple[list[Crisis], str]:
    """Return the contacts from `start` towards COD22, up to the first one beyond δ = top, and why they end."""
    known, last = [start], CLOSEST * start.epsilon
    while known[-1].gap > last and known[-1].delta <= top:
        gap = max(known[-1].gap * RATIO, 0.999 * last)
        try:
            known.append(in_gap(known, gap, end))
        except RattleError as error:
            return known, str(error)
    return known, "it continues to COD22, and is not followed this close to SN1"


def _changes(points: list[Crisis]) -> list[Crisis]:
    """Return the contacts at which corner and tangency change places: the coefficient `root_slope` vanishes there."""
    from scipy.optimize import brentq

    found = []
    for one, other in pairwise(points):
        if one.contact == other.contact:
            continue

        def slope(delta: float, one: Crisis = one, other: Crisis = other) -> float:
            near = min(one, other, key=lambda point: abs(point.delta - delta))
            return root_slope(near if near.delta == delta else in_delta([near], delta))

        delta = float(brentq(slope, one.delta, other.delta, xtol=1e-10))
        near = min(one, other, key=lambda point: abs(point.delta - delta))
        found.append(in_delta([near], delta))
    return found


def crisis_curve(
    low: float | None = None, high: float | None = None, beta: float = 0.6, resolution: float = 0.01
) -> CrisisCurve:
    """Return the curve of boundary crises from δ = low (default: as far as it exists) to δ = high (default: COD22).

    Points are at most `resolution` apart in δ. Near COD22 the curve is followed in steps of ε − SN1, down to 1e-5 of
    SN1. ε is as accurate as in `boundary_crisis`, which gives the first point.

    Returns
    -------
    CrisisCurve
        Contacts by rising δ, and why the curve ends on both sides.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    RattleError
        If there is no crisis where the curve should begin.
    """
    beta = require_number("beta", beta, positive=True)
    resolution = require_number("resolution", resolution, positive=True)
    end = end_of_curve(beta)
    bottom = 0.0 if low is None else require_number("low", low, positive=True)
    top = np.inf if high is None else require_number("high", high, positive=True)
    require(bottom < top, f"low must be below high, got {bottom} and {top}")
    start = boundary_crisis(min(max(START * end, bottom), top), beta)
    falling, low_end = _down(start, bottom, resolution, end)
    rising, high_end = [start], "the requested end"
    if top > start.delta:
        rising, high_end = _up(start, top, end)
        if rising[-1].delta > top:
            rising, high_end = rising[:-1], "the requested end"
            rising.append(in_delta(rising, top))
    points = [*falling[:0:-1], *rising]
    return CrisisCurve(beta, tuple(points), tuple(_changes(points)), low_end, high_end)
