"""The boundary crisis of the chaotic attractor with A: the first ε at which W^u(A), on the side of the attractor, meets
W^s(A).

W^u(A) is one number s long (`rattle.saddles`). The orbit of W(s) comes back to A and leaves it on the side of the
attractor or on the other, by the sign of its unstable coordinate there; m(ε), the least of them along a piece of
W^u(A), vanishes where that piece touches W^s(A), be it with a corner, which the square root at Γ makes, or with a
smooth bend.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from rattle.curves.codimension import codimension_two
from rattle.errors import RattleError, real_array, require, require_number
from rattle.images import escapes
from rattle.iterate import fold
from rattle.limits import sn1
from rattle.saddles import Array, Local, local_manifold, period_one_saddle, unstable_coordinate

GONE = 0.8  # a speed below this part of A's is beyond W^s(A): on the way to rest
SAMPLES, CHECKED = 4000, 40000  # points per unit of ln s on W^u(A), and once more below the crisis
SCANNED = np.geomspace(1e-3, 3.0, 40)  # ε above SN1 that are tried, relative
HALVINGS = 12
GRID, ZOOMS = 41, 13  # a minimum along s: this many points, then between the neighbours of the least
RADIUS = 0.3  # about A, in (τ, v), where a return is judged
MOST_ROUNDS = 40
NEAR, CLOSE = 0.3, 1e-5  # a return, relative to the farthest; and the approach at which the contact is solved
MOST_PIECES = 6
LOWEST = 0.6  # δ; below, W^u(A) escapes in several intervals of ε (docs/crisis.md)
MARGIN = 1e-4  # how far below the crisis, relative to SN1, no other piece may touch


@dataclass(frozen=True)
class Crisis:
    """A boundary crisis with A at (delta, epsilon, beta).

    contact: "corner" or "tangency". piece: impacts on Σ⁻ between successive impacts on Σ⁺ along the orbit of the
    contact, from the first to the last that is not 0 (at a corner on its side with more of them). parameter: s of the
    contact on W^u(A), arclength at A. approach: distance from A, in (τ, v), to which its orbit was followed.
    """

    delta: float
    epsilon: float
    beta: float
    contact: str
    piece: tuple[int, ...]
    parameter: float
    approach: float


class _Unstable:
    """W^u(A) on the attractor's side at one parameter point."""

    def __init__(self, delta: float, epsilon: float, beta: float) -> None:
        self.saddle = period_one_saddle("A", delta, epsilon, beta)
        self.local: Local = local_manifold(self.saddle, stable=False)
        self.row = unstable_coordinate(self.saddle)
        self.at = np.array([[self.saddle.tau], [self.saddle.v]])

    def escaping(self, density: int) -> Array:
        """The longest run of samples s of a fundamental domain that leave beyond W^s(A), with one more on both sides;
        empty if none leaves.
        """
        local, o, rate = self.local, self.saddle, np.log(self.local.multiplier)
        samples = int(200 + density * rate)
        s = local.size * np.exp(rate * np.linspace(-1.0, 0.0, samples))
        tau, v = local.at(s)
        most = 15 + int((np.log(1.0 / local.size) + np.log(density)) / rate)
        gone = escapes(fold(tau), v, GONE * o.v, most, o.delta, o.epsilon, o.beta) <= most
        edges = np.flatnonzero(np.diff(np.concatenate([[False], gone, [False]]).astype(int)))
        if not edges.size:
            return s[:0]
        runs = edges.reshape(-1, 2)
        first, last = runs[np.argmax(runs[:, 1] - runs[:, 0])]
        return np.asarray(s[max(first - 1, 0) : last + 1], np.float64)

    def distances(self, s: float, most: int) -> Array:
        """Distances (n,) from A of F(W(s)), F²(W(s)), … until the orbit has gone."""
        states, found = self.local.image(np.array([s]), 0)[1], []
        for _ in range(most):
            ok, states, _, _ = self.local.map(states, 1)
            found.append(float(np.hypot(*(states - self.at))[0]))
            if not ok.all() or states[1, 0] < GONE * self.saddle.v:
                break
        return np.array(found)

    def least(self, window: tuple[float, float], n: int) -> tuple[float, float]:
        """The least unstable coordinate of F^n(W(s)) in a window of s, and its s, by finer and finer grids."""
        low, high = window
        for _ in range(ZOOMS):
            s = np.linspace(low, high, GRID)
            ok, states, _, _ = self.local.image(s, n)
            off = states - self.at
            values = np.where(ok & (np.hypot(*off) < RADIUS), self.row @ off, np.inf)
            i = int(np.argmin(values))
            low, high = s[max(i - 1, 0)], s[min(i + 1, GRID - 1)]
        return float(values[i]), float(s[i])

    def piece(self, s: float, n: int) -> tuple[int, ...]:
        """Impacts on Σ⁻ in each of the n steps from W(s), from the first that has any to the last."""
        counts = [0] + [int(self.local.image(np.array([s]), j)[3][0]) for j in range(1, n + 1)]
        letters = np.diff(counts)
        some = np.flatnonzero(letters)
        return tuple(int(x) for x in letters[some[0] : some[-1] + 1]) if some.size else ()


def _first_escape(delta: float, beta: float) -> tuple[float, float]:
    """Neighbouring ε: at the lower no sample escapes, at the higher one does."""
    start = float(sn1(delta))
    last = start
    for epsilon in start * (1.0 + SCANNED):
        if _Unstable(delta, epsilon, beta).escaping(SAMPLES).size:
            break
        last = epsilon
    else:
        raise RattleError(f"W^u(A) does not leave beyond W^s(A) at delta = {delta} up to epsilon = {epsilon}")
    if last == start:
        raise RattleError(f"W^u(A) leaves beyond W^s(A) at delta = {delta} from where A is born")
    low, high = last, epsilon
    for _ in range(HALVINGS):
        middle = (low + high) / 2.0
        low, high = (low, middle) if _Unstable(delta, middle, beta).escaping(SAMPLES).size else (middle, high)
    return low, high


def _contact(delta: float, beta: float, low: float, high: float) -> Crisis:
    """Where the piece of W^u(A) that escapes at `high` and not at `low` touches W^s(A); of the returns to A that its
    orbit makes, the one that touches at the least ε.
    """
    at = cache(lambda epsilon: _Unstable(delta, epsilon, beta))
    run = at(high).escaping(SAMPLES)
    away = at(high).distances(float(run[run.size // 2]), 100_000)
    inner = np.flatnonzero((away[1:-1] <= away[:-2]) & (away[1:-1] < away[2:]) & (away[1:-1] < NEAR * away.max())) + 1
    if not inner.size:
        raise RattleError(f"the orbit that escapes at epsilon = {high} does not return to A")
    found = []
    for n in inner + 1:  # F^n has distance away[n − 1]
        try:
            found.append(_touch(at, run, int(n), low, high))
        except RattleError as error:
            last = error
    if not found:
        raise last
    return min(found, key=lambda crisis: crisis.epsilon)


def _touch(at: Callable[[float], _Unstable], run: Array, n: int, low: float, high: float) -> Crisis:
    """The contact of the piece of W^u(A) about these samples at its return number n of F."""
    from scipy.optimize import brentq  # a quarter of a second to load

    width, saddle = run[-1] - run[0], at(high).saddle
    for _ in range(12):  # until a minimum lies inside
        window = (max(run[0] - width, 0.5 * run[0]), run[-1] + width)
        s = at(high).least(window, n)[1]
        if min(s - window[0], window[1] - s) > 0.1 * (window[1] - window[0]):
            break
        width *= 2.0
    approach, floor = np.inf, float(sn1(saddle.delta))
    while at(low).least(window, n)[0] <= 0.0:  # so short a piece escapes that no sample hit it
        low = max(low - 2.0 * (high - low), 0.5 * (low + floor))
    while at(high).least(window, n)[0] >= 0.0:  # an earlier return touches later
        if high - low > 0.1 * (high - floor):
            raise RattleError(f"return {n} near epsilon = {high} does not reach W^s(A)")
        high += 2.0 * (high - low)
    epsilon, half = (low + high) / 2.0, (high - low) / 2.0
    for _ in range(MOST_ROUNDS):

        def m(x: float, n: int = n, window: tuple[float, float] = window) -> float:
            return at(x).least(window, n)[0]

        while not m(epsilon - half) > 0.0 > m(epsilon + half):
            half /= 4.0
            if half < 1e-16:
                raise RattleError(f"the contact of W^u(A) with W^s(A) near epsilon = {epsilon} could not be solved")
        epsilon = float(brentq(m, epsilon - half, epsilon + half, xtol=1e-17, rtol=4 * np.finfo(float).eps))
        s = at(epsilon).least(window, n)[1]
        away = at(epsilon).distances(s, n + 60)
        if not n - 1 < away.size:
            raise RattleError(f"the contact of W^u(A) with W^s(A) near epsilon = {epsilon} could not be followed")
        approach, further = float(away[n - 1]), n
        while further < min(away.size, n + 3) and away[further] < away[further - 1]:
            further += 1
        if further == n:
            break
        width = (window[1] - window[0]) / at(epsilon).local.multiplier ** ((further - n) / 2.0)
        window = (s - width / 2.0, s + width / 2.0)
        n, half = further, min(half, approach)
    if min(s - window[0], window[1] - s) < 1e-3 * (window[1] - window[0]) or approach > CLOSE:
        raise RattleError(f"the contact of W^u(A) with W^s(A) near epsilon = {epsilon} is not isolated")
    sides = [at(epsilon).piece(s * (1.0 + side * 1e-9), n) for side in (-1, 1)]
    contact = "tangency" if sides[0] == sides[1] else "corner"
    return Crisis(saddle.delta, epsilon, saddle.beta, contact, max(sides, key=sum), s, approach)


def boundary_crisis(delta: float, beta: float = 0.6) -> Crisis:
    """The least ε at which W^u(A) touches W^s(A) at this damping, to 1e-10, and the piece of W^u(A) that touches.

    All dimensionless. The piece is the first among those that 4000 points per unit of ln s of W^u(A) show, checked with
    40000 just below. Raises ParameterError, and RattleError from COD22 on, below δ = 0.6 and at β ≠ 0.6, where it is
    not known that the first contact ends the attractor, and where none is found that can be solved. Source:
    docs/crisis.md; the paper leaves this open.
    """
    delta = require_number("delta", delta, positive=True)
    beta = require_number("beta", beta, positive=True)
    ends = [point for point in codimension_two(beta) if point.name == "COD22"]
    if not ends or delta >= ends[0].delta:
        raise RattleError(f"the crisis is known below COD22 only, and delta = {delta} is not below it at beta = {beta}")
    if beta != 0.6 or delta < LOWEST:
        raise RattleError(
            "the first contact of W^u(A) with W^s(A) is known to end the attractor at beta = 0.6 and delta from"
            f" {LOWEST} on only, not at beta = {beta}, delta = {delta}: it may escape in several intervals of epsilon"
        )
    floor = float(sn1(delta))
    low, high = _first_escape(delta, beta)
    for _ in range(MOST_PIECES):
        found = _contact(delta, beta, low, high)
        below = found.epsilon - MARGIN * (found.epsilon - floor)
        if not _Unstable(delta, below, beta).escaping(CHECKED).size:
            return found
        low, high = below - 10.0 * (found.epsilon - below), below
    raise RattleError(f"at delta = {delta} ever earlier pieces of W^u(A) touch W^s(A)")


def crisis_curve(delta: ArrayLike, beta: float = 0.6) -> tuple[Crisis, ...]:
    """`boundary_crisis` at every damping of delta (n,), in its order. Raises as that."""
    values = real_array("delta", delta)
    require(values.ndim == 1, f"delta must be one-dimensional, got shape {values.shape}")
    return tuple(boundary_crisis(float(x), beta) for x in values)
