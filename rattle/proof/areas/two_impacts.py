"""B and D, which are P(1,1,1), over a piece of the plane.

With the time s from Σ⁺ to Σ⁻, X = ε cos 2πτ, Y = ε sin 2πτ, Y' = Y cos 2πs + X sin 2πs, a = e^(−δs), b = e^(−δ(1−s)), E
= ab and K = 4π(1 − a)/δ(1 − E), flights of s and 1 − s close to a motion if and only if

    Y (1 − 2a + E) + Y' (1 − 2b + E) = 4 (1 − a)(1 − b) − δ (1 − E)
    K (2 − Y − b (2 − Y')) + X (1 − cos 2πs) + Y sin 2πs = 2β + 4πs.

Both are linear in X and Y: at each δ all solutions are one curve ε(s). B is where ε falls, D where it rises.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from itertools import groupby
from typing import TypeVar

from rattle.errors import NotProvedError
from rattle.proof.areas.piece import FINEST, PlanePiece, hull, lower, upper
from rattle.proof.balls import PI, arb, arb_series

NARROWEST = 2.0**-20  # cell of s


Number = TypeVar("Number", arb, arb_series)
RISES = {"B": -1, "D": 1}  # ε with s
Row = tuple[arb_series, arb_series, arb_series]
Solution = tuple[arb, arb]


def rows(s: arb_series, delta: arb_series, beta: arb) -> tuple[Row, Row]:
    """Return the equations, each as the factors of X and of Y and what they add up to."""
    a, b, end = (-delta * s).exp(), (-delta * (1 - s)).exp(), (-delta).exp()
    sine, cosine = (2 * PI() * s).sin(), (2 * PI() * s).cos()
    down, up, k = 1 - 2 * a + end, 1 - 2 * b + end, 4 * PI() * (1 - a) / (delta * (1 - end))
    first = up * sine, down + up * cosine, 4 * (1 - a) * (1 - b) - delta * (1 - end)
    second = 1 - cosine + k * b * sine, sine - k + k * b * cosine, 2 * beta + 4 * PI() * s - 2 * k * (1 - b)
    return first, second


def speed_series(s: arb_series, delta: arb_series, x: arb_series, y: arb_series) -> tuple[arb_series, arb_series]:
    """Return v after Σ⁺ and u after Σ⁻."""
    later = y * (2 * PI() * s).cos() + x * (2 * PI() * s).sin()
    a, b, lost = (-delta * s).exp(), (-delta * (1 - s)).exp(), 1 - (-delta).exp()
    p, q = 4 * PI() * (2 - y - b * (2 - later)) / lost, 4 * PI() * (2 - later - a * (2 - y)) / lost
    return p - 4 * PI() + 2 * PI() * y, 4 * PI() - 2 * PI() * later - q


def room_series(s: arb_series, delta: arb_series, found: Sequence[arb_series]) -> list[arb_series]:
    """Return 1 + E − T and 1 + E + T, both times uv/2, of the trace T of two impacts.

    T = 1 + E − S(k₀ + k₁) + S₀S₁k₀k₁ with k = 2g/v and −2g/u, where S = (1 − E)/δ, S₀ = (1 − a)/δ and S₁ = (1 − b)/δ.

    Returns
    -------
    list[arb_series]
        Both series.
    """
    x, y, v, u = found
    a, b, end = (-delta * s).exp(), (-delta * (1 - s)).exp(), (-delta).exp()
    sine, cosine = (2 * PI() * s).sin(), (2 * PI() * s).cos()
    at_top = series_force(delta, x, y)
    at_bottom = series_force(delta, x * cosine - y * sine, y * cosine + x * sine)
    mixed = (1 - end) * (at_top * u - at_bottom * v) / delta
    both = 2 * (1 - a) * (1 - b) * at_top * at_bottom / (delta * delta)
    return [mixed + both, (1 + end) * u * v - mixed - both]


def series_force(delta: Number, cosine: Number, sine: Number) -> Number:
    """Return g where ε cos 2πt and ε sin 2πt are these."""
    return 4 * PI() * delta - 4 * PI() ** 2 * cosine - 2 * PI() * delta * sine


def solve_series(factors: Sequence[Sequence[arb]], sums: Sequence[arb]) -> Solution:
    """X and Y, by Cramer's rule."""
    (a11, a12), (a21, a22) = factors
    determinant = a11 * a22 - a12 * a21
    return (sums[0] * a22 - a12 * sums[1]) / determinant, (a11 * sums[1] - a21 * sums[0]) / determinant


class SolutionCell:
    """Cell of all solutions with s between two numbers, over all δ and at the β of a piece."""

    def __init__(self, start: arb, end: arb, delta: arb, beta: arb) -> None:
        self.start, self.end, self.delta, self.beta = start, end, delta, beta
        self.s = hull(start, end)

    @cached_property
    def halves(self) -> tuple[SolutionCell, SolutionCell]:
        """Return both halves of the cell."""
        middle = (self.start + self.end) / 2
        if not self.end - self.start > NARROWEST:
            raise NotProvedError(f"about s = {float(middle):.4f} it is not told which motions of two impacts there are")
        return self.between(self.start, middle), self.between(middle, self.end)

    def between(self, start: arb, end: arb) -> SolutionCell:
        """Return another cell, between these s, at the same δ."""
        return SolutionCell(start, end, self.delta, self.beta)

    @cached_property
    def system(self) -> tuple[list[list[arb]], ...]:
        """The rows in the middle, their derivatives by s and by δ, and the rows, over the cell."""
        s, delta, beta = self.s, self.delta, self.beta
        middle = rows(arb_series([s.mid()]), arb_series([delta.mid()]), beta)
        by_s = rows(arb_series([s, 1]), arb_series([delta]), beta)
        by_delta = rows(arb_series([s]), arb_series([delta, 1]), beta)
        found = [[each[0] for each in row] for row in middle]
        changes = [[[each[1] for each in row] for row in two] for two in (by_s, by_delta)]
        return found, *changes, [self._moved(*three) for three in zip(found, *changes, strict=True)]

    def _moved(self, middle: Iterable[arb], by_s: Iterable[arb], by_delta: Iterable[arb]) -> list[arb]:
        """Return enclosures over the cell by the mean value theorem, from the middle and the derivatives by s and δ."""
        ds, dd = self.s - self.s.mid(), self.delta - self.delta.mid()
        return [m + f * ds + g * dd for m, f, g in zip(middle, by_s, by_delta, strict=True)]

    @cached_property
    def least(self) -> arb:
        """No solution has an ε below this: |b| ≤ ε √(a² + a'²) for each row."""
        bounds = [b.abs_lower() / (a.abs_upper() ** 2 + c.abs_upper() ** 2).sqrt() for a, c, b in self.system[3]]
        return max((lower(bound) for bound in bounds), key=float)

    @cached_property
    def solution(self) -> tuple[list[arb], ...]:
        """X, Y, v and u, and their derivatives by s and by δ, over the cell; they in the middle."""
        middle, by_s, by_delta, found = self.system
        factors = [row[:2] for row in found]
        x, y = solve_series(factors, [row[2] for row in found])
        changes = []
        for derived in (by_s, by_delta):  # of A(X, Y) = b: A(X', Y') = b' − A'(X, Y)
            changes.append(solve_series(factors, [b - a * x - c * y for a, c, b in derived]))
        centre = solve_series([row[:2] for row in middle], [row[2] for row in middle])
        x, y = self._moved(centre, *changes)
        s, delta, (xs, ys), (xd, yd) = self.s, self.delta, *changes
        vs, us = (
            z[1]
            for z in speed_series(arb_series([s, 1]), arb_series([delta]), arb_series([x, xs]), arb_series([y, ys]))
        )
        vd, ud = (
            z[1]
            for z in speed_series(arb_series([s]), arb_series([delta, 1]), arb_series([x, xd]), arb_series([y, yd]))
        )
        v, u = (z[0] for z in speed_series(*(arb_series([z]) for z in (s.mid(), delta.mid(), *centre))))
        speed = self._moved((v, u), (vs, us), (vd, ud))
        return [x, y, *speed], [xs, ys, vs, us], [xd, yd, vd, ud], [*centre, v, u]

    @cached_property
    def solvable(self) -> bool:
        """True if the equations have one solution throughout, and it is enclosed."""
        (a11, a12, _), (a21, a22, _) = self.system[3]
        return not (a11 * a22 - a12 * a21).contains(0) and all(x.is_finite() for each in self.solution for x in each)

    @cached_property
    def rise(self) -> arb:
        """∂ε²/∂s."""
        (x, y, *_), (xs, ys, *_), *_ = self.solution
        return 2 * (x * xs + y * ys)

    @cached_property
    def moves(self) -> arb:
        """∂ε²/∂δ."""
        (x, y, *_), _, (xd, yd, *_), _ = self.solution
        return 2 * (x * xd + y * yd)

    @cached_property
    def square(self) -> arb:
        """ε²."""
        x, y, *_ = self.solution[3]
        return self._moved([x * x + y * y], [self.rise], [self.moves])[0]

    def mixed(self, sign: int, share: float) -> arb:
        """± ε² + share u, as one: both change with s and δ, the sum may not."""
        _, (*_, us), (*_, ud), (x, y, _, u) = self.solution
        parts = (sign * (x * x + y * y) + share * u, sign * self.rise + share * us, sign * self.moves + share * ud)
        return self._moved(*([part] for part in parts))[0]

    def share(self, sign: int) -> float:
        """Return one with which the sum changes little with s, not below 0."""
        return max(0.0, -sign * float(self.rise.mid()) / float(self.solution[1][3].mid()))

    def empty(self, epsilon: arb) -> bool:
        """Return whether no motion with these ε is in the cell.

        It is empty where v > 0, u > 0 and ε between both nowhere hold together.

        Returns
        -------
        bool
            False means that a motion may be there.
        """
        if self.least > epsilon:
            return True
        if not self.solvable:
            return False
        _, _, v, u = self.solution[0]
        low, high = squares(epsilon)
        if v < 0 or u < 0 or self.square < low or self.square > high:
            return True
        return bool(self.mixed(1, self.share(1)) < low or self.mixed(-1, self.share(-1)) < -high)

    def holds(self, letter: str, epsilon: arb) -> bool | None:
        """Return whether all solutions with these ε are of this letter and happen.

        Returns
        -------
        bool | None
            False if none of them is and does, None if undecided.
        """
        if self.empty(epsilon) or (self.solvable and -RISES[letter] * self.rise > 0):
            return False
        if not self.solvable or not (RISES[letter] * self.rise > 0 and self.solution[0][2] > 0):
            return None
        low, high = squares(epsilon)
        hits = self.solution[0][3] > 0  # or u ≤ 0 is only beyond these ε
        hits = hits or self.mixed(1, self.share(1)) > high or self.mixed(-1, self.share(-1)) > -low
        return True if hits and self.flies else None

    @cached_property
    def flies(self) -> bool:
        """True if Φ falls all the way to Σ⁻ and rises all the way back: e^(δt) Φ' is monotone where g has a sign."""
        return self._keeps(-1, arb(0), lower(self.s)) and self._keeps(1, upper(self.s), arb(1))

    def _keeps(self, sign: int, start: arb, end: arb) -> bool:
        """Return whether Φ' has this sign from Σ⁺ (start 0) to s, or from s to Σ⁺ (end 1); the ends have it."""
        parts = [(start, end)]
        while parts:
            low, high = parts.pop()
            if not self._keeps_in(sign, low, high):
                if high - low < FINEST:
                    return False
                middle = (low + high) / 2
                parts += [(low, middle), (middle, high)]
        return True

    def _keeps_in(self, sign: int, low: arb, high: arb) -> bool:
        lower_s, upper_s = lower(self.s), upper(self.s)
        t = hull(low, upper_s if high == lower_s else high)
        t = hull(lower_s, t) if low == upper_s else t
        force, at = sign * self.force(t), self.slope
        if force > 0:  # M grows in size: what it is at the begin is enough
            return low in (0, upper_s) or bool(sign * at(low, sign) > 0)
        if force < 0:
            return high in (1, lower_s) or bool(sign * at(high, sign) > 0)
        return bool(sign * at(t, sign) > 0)

    def force(self, t: arb) -> arb:
        """Return g at the time t after Σ⁺."""
        x, y, *_ = self.solution[0]
        sine, cosine = (2 * t).sin_cos_pi()
        return series_force(self.delta, x * cosine - y * sine, y * cosine + x * sine)

    def slope(self, t: arb, sign: int) -> arb:
        """Φ' at the time t after Σ⁺, on the flight down (−1) or up (1), from where it begins."""
        x, y, v, u = self.solution[0]
        since, start = (self.s, u) if sign > 0 else (arb(0), -v)
        sine, cosine = (2 * t).sin_cos_pi()
        sine0, cosine0 = (2 * since).sin_cos_pi()
        swing = 2 * PI() * ((y * cosine + x * sine) - (y * cosine0 + x * sine0))
        rest = 4 * PI() - 2 * PI() * (y * cosine0 + x * sine0) - start
        return start - swing - rest * (-self.delta * (t - since)).expm1()

    @cached_property
    def room(self) -> list[arb]:
        """Margins of the trace T: 1 + E − T, 1 + E + T, both times uv/2."""
        here, by_s, by_delta, middle = self.solution
        s, delta = self.s, self.delta
        along_s = [arb_series([x, dx]) for x, dx in zip(here, by_s, strict=True)]
        along_delta = [arb_series([x, dx]) for x, dx in zip(here, by_delta, strict=True)]
        fixed = room_series(arb_series([s.mid()]), arb_series([delta.mid()]), [arb_series([x]) for x in middle])
        moved_s = room_series(arb_series([s, 1]), arb_series([delta]), along_s)
        moved_delta = room_series(arb_series([s]), arb_series([delta, 1]), along_delta)
        return self._moved([x[0] for x in fixed], [x[1] for x in moved_s], [x[1] for x in moved_delta])

    @property
    def attracts(self) -> bool | None:
        """True if both multipliers are inside the unit circle (else one is outside); None if undecided."""
        above, below = self.room
        if above < 0 or below < 0:
            return False
        return True if above > 0 and below > 0 else None


def squares(epsilon: arb) -> tuple[arb, arb]:
    """Return the least and the largest ε²; a ball about numbers from 0 on may begin below."""
    least = lower(epsilon)
    return least**2 if least > 0 else arb(0), upper(epsilon) ** 2


def cells(piece: PlanePiece) -> tuple[SolutionCell, SolutionCell]:
    """Return all s, at the δ of a piece."""
    return SolutionCell(arb(0), arb(1), piece.delta, piece.beta).halves


def motions(piece: PlanePiece, all_s: tuple[SolutionCell, SolutionCell], letter: str) -> list[list[SolutionCell]]:
    """Return all B (D) that there are at each point of the piece, each by the cells that it is in.

    Returns
    -------
    list[list[SolutionCell]]
        A list of neighbouring cells for each motion.

    Raises
    ------
    NotProvedError
        If their number is not certain.
    """
    told: list[tuple[bool, SolutionCell]] = []
    waiting = list(reversed(all_s))
    while waiting:
        cell = waiting.pop()
        here = cell.holds(letter, piece.epsilon)
        if here is None:
            waiting += reversed(cell.halves)
        else:
            told.append((here, cell))
    if told[0][0] or told[-1][0]:
        raise NotProvedError("a family of motions of two impacts may not end")
    runs = [[cell for _, cell in group] for here, group in groupby(told, lambda each: each[0]) if here]
    return [run for run in runs if _crosses(piece, run, RISES[letter])]


def attracts(piece: PlanePiece, run: Iterable[SolutionCell]) -> bool:
    """Return whether both multipliers are inside the unit circle wherever in these cells a motion is.

    Returns
    -------
    bool
        True if both are inside, False if one is outside everywhere.

    Raises
    ------
    NotProvedError
        If it is undecided.
    """
    verdicts, waiting = set(), list(run)
    while waiting:
        cell = waiting.pop()
        if not cell.empty(piece.epsilon):
            verdict = cell.attracts
            if verdict is None:
                waiting += cell.halves
            else:
                verdicts.add(verdict)
        if len(verdicts) > 1:
            raise NotProvedError("a motion of two impacts attracts in one part and not in another")
    return True in verdicts


def _crosses(piece: PlanePiece, run: list[SolutionCell], rises: int) -> bool:
    """Return whether ε(s), which is monotone over these cells, takes each ε of the piece once there.

    At their ends it takes none at any δ of the piece, because the cells beyond are empty: so one δ tells on which side
    it is.

    Returns
    -------
    bool
        False if it takes none of them.

    Raises
    ------
    NotProvedError
        If it is undecided.
    """
    (low, high), sides = squares(piece.epsilon), []
    for s in (run[0].start, run[-1].end):
        square = SolutionCell(s, s, piece.delta.mid(), piece.beta).square
        sides.append(1 if square > high else -1 if square < low else 0)
    if 0 in sides:
        raise NotProvedError("it is not told where a family of motions of two impacts ends")
    return sides == [-rises, rises]
