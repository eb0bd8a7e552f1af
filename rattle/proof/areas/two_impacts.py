"""The motions B and D, which are P(1,1,1), over a piece of the plane (lemmas 16 to 19 of docs/proofs.md).

Let s be the time from Σ⁺ to Σ⁻, and

    X = ε cos 2πτ,   Y = ε sin 2πτ,   Y' = Y cos 2πs + X sin 2πs,
    a = e^(−δs),     b = e^(−δ(1−s)), E = ab,
    K = 4π(1 − a)/(δ(1 − E)).

Flights of durations s and 1 − s close to a periodic motion if and only if

    Y (1 − 2a + E) + Y' (1 − 2b + E) = 4 (1 − a)(1 − b) − δ (1 − E),
    K (2 − Y − b (2 − Y')) + X (1 − cos 2πs) + Y sin 2πs = 2β + 4πs.

Both equations are linear in X and Y, so at each δ all solutions form one curve ε(s). B lies where ε falls with s, D
where it rises.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from itertools import groupby
from typing import TypeVar

from rattle.errors import NotProvedError
from rattle.proof.areas.piece import FINEST, PlanePiece, hull, lower, upper
from rattle.proof.balls import PI, arb, arb_series

NARROWEST = 2.0**-20  # width of the narrowest cell of s, in forcing periods


Number = TypeVar("Number", arb, arb_series)
RISES = {"B": -1, "D": 1}  # sign of dε/ds along the family
Row = tuple[arb_series, arb_series, arb_series]
Solution = tuple[arb, arb]


def rows(s: arb_series, delta: arb_series, beta: arb) -> tuple[Row, Row]:
    """Return the two equations, each as the factor of X, the factor of Y and the right-hand side."""
    a, b, end = (-delta * s).exp(), (-delta * (1 - s)).exp(), (-delta).exp()
    sine, cosine = (2 * PI() * s).sin(), (2 * PI() * s).cos()
    down, up, k = 1 - 2 * a + end, 1 - 2 * b + end, 4 * PI() * (1 - a) / (delta * (1 - end))
    first = up * sine, down + up * cosine, 4 * (1 - a) * (1 - b) - delta * (1 - end)
    second = 1 - cosine + k * b * sine, sine - k + k * b * cosine, 2 * beta + 4 * PI() * s - 2 * k * (1 - b)
    return first, second


def speed_series(s: arb_series, delta: arb_series, x: arb_series, y: arb_series) -> tuple[arb_series, arb_series]:
    """Return the speed v after Σ⁺ and the speed u after Σ⁻, as series."""
    later = y * (2 * PI() * s).cos() + x * (2 * PI() * s).sin()
    a, b, lost = (-delta * s).exp(), (-delta * (1 - s)).exp(), 1 - (-delta).exp()
    p, q = 4 * PI() * (2 - y - b * (2 - later)) / lost, 4 * PI() * (2 - later - a * (2 - y)) / lost
    return p - 4 * PI() + 2 * PI() * y, 4 * PI() - 2 * PI() * later - q


def room_series(s: arb_series, delta: arb_series, found: Sequence[arb_series]) -> list[arb_series]:
    """Return (1 + E − T) uv/2 and (1 + E + T) uv/2, which are both positive where the motion attracts.

    The trace of the tangent map is T = 1 + E − S(k₀ + k₁) + S₀S₁k₀k₁ with k₀ = 2g/v, k₁ = −2g/u, S = (1 − E)/δ,
    S₀ = (1 − a)/δ and S₁ = (1 − b)/δ (lemma 19).

    Returns
    -------
    list[arb_series]
        Both margins.
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
    """Return the contact force g at the time when ε cos 2πt = cosine and ε sin 2πt = sine."""
    return 4 * PI() * delta - 4 * PI() ** 2 * cosine - 2 * PI() * delta * sine


def solve_series(factors: Sequence[Sequence[arb]], sums: Sequence[arb]) -> Solution:
    """Solve the two linear equations for X and Y by Cramer's rule."""
    (a11, a12), (a21, a22) = factors
    determinant = a11 * a22 - a12 * a21
    return (sums[0] * a22 - a12 * sums[1]) / determinant, (a11 * sums[1] - a21 * sums[0]) / determinant


class SolutionCell:
    """All solutions with s between two numbers, at all δ of a ball and one β."""

    def __init__(self, start: arb, end: arb, delta: arb, beta: arb) -> None:
        self.start, self.end, self.delta, self.beta = start, end, delta, beta
        self.s = hull(start, end)

    @cached_property
    def halves(self) -> tuple[SolutionCell, SolutionCell]:
        """The two halves of the cell in s. Raises NotProvedError for a cell narrower than NARROWEST."""
        middle = (self.start + self.end) / 2
        if not self.end - self.start > NARROWEST:
            raise NotProvedError(f"which P(1,1,1) exist near s = {float(middle):.4f} is undecided")
        return self.between(self.start, middle), self.between(middle, self.end)

    def between(self, start: arb, end: arb) -> SolutionCell:
        """Return the cell of solutions with s between start and end, at the same δ."""
        return SolutionCell(start, end, self.delta, self.beta)

    @cached_property
    def system(self) -> tuple[list[list[arb]], ...]:
        """The equations at the cell's midpoint, their derivatives by s and by δ, and the equations over the cell."""
        s, delta, beta = self.s, self.delta, self.beta
        middle = rows(arb_series([s.mid()]), arb_series([delta.mid()]), beta)
        by_s = rows(arb_series([s, 1]), arb_series([delta]), beta)
        by_delta = rows(arb_series([s]), arb_series([delta, 1]), beta)
        found = [[each[0] for each in row] for row in middle]
        changes = [[[each[1] for each in row] for row in two] for two in (by_s, by_delta)]
        return found, *changes, [self._moved(*three) for three in zip(found, *changes, strict=True)]

    def _moved(self, middle: Iterable[arb], by_s: Iterable[arb], by_delta: Iterable[arb]) -> list[arb]:
        """Enclose functions over the cell from midpoint values and derivatives (mean value theorem)."""
        ds, dd = self.s - self.s.mid(), self.delta - self.delta.mid()
        return [m + f * ds + g * dd for m, f, g in zip(middle, by_s, by_delta, strict=True)]

    @cached_property
    def least(self) -> arb:
        """Lower bound of ε over all solutions: each equation a X + a' Y = b implies ε ≥ |b|/√(a² + a'²)."""
        bounds = [b.abs_lower() / (a.abs_upper() ** 2 + c.abs_upper() ** 2).sqrt() for a, c, b in self.system[3]]
        return max((lower(bound) for bound in bounds), key=float)

    @cached_property
    def solution(self) -> tuple[list[arb], ...]:
        """X, Y, v and u over the cell, their derivatives by s and by δ, and their values at the midpoint."""
        middle, by_s, by_delta, found = self.system
        factors = [row[:2] for row in found]
        x, y = solve_series(factors, [row[2] for row in found])
        changes = []
        for derived in (by_s, by_delta):  # differentiate A (X, Y) = b: A (X', Y') = b' − A' (X, Y)
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
        """True if the equations are proved to have one solution at every s and δ of the cell."""
        (a11, a12, _), (a21, a22, _) = self.system[3]
        return not (a11 * a22 - a12 * a21).contains(0) and all(x.is_finite() for each in self.solution for x in each)

    @cached_property
    def rise(self) -> arb:
        """Enclosure of ∂ε²/∂s."""
        (x, y, *_), (xs, ys, *_), *_ = self.solution
        return 2 * (x * xs + y * ys)

    @cached_property
    def moves(self) -> arb:
        """Enclosure of ∂ε²/∂δ."""
        (x, y, *_), _, (xd, yd, *_), _ = self.solution
        return 2 * (x * xd + y * yd)

    @cached_property
    def square(self) -> arb:
        """Enclosure of ε²."""
        x, y, *_ = self.solution[3]
        return self._moved([x * x + y * y], [self.rise], [self.moves])[0]

    def mixed(self, sign: int, share: float) -> arb:
        """Enclose sign · ε² + share · u in one step (lemma 17).

        Both terms change with s and δ, but with a suitable weight `share` their sum hardly does.

        Returns
        -------
        arb
            An upper bound of sign · ε² wherever u ≥ 0.
        """
        _, (*_, us), (*_, ud), (x, y, _, u) = self.solution
        parts = (sign * (x * x + y * y) + share * u, sign * self.rise + share * us, sign * self.moves + share * ud)
        return self._moved(*([part] for part in parts))[0]

    def share(self, sign: int) -> float:
        """Return the weight λ ≥ 0 for which sign · ε² + λu changes least with s."""
        return max(0.0, -sign * float(self.rise.mid()) / float(self.solution[1][3].mid()))

    def empty(self, epsilon: arb) -> bool:
        """Return whether the cell is proved to hold no motion with these ε.

        A cell is empty if v > 0, u > 0 and an ε in the given range nowhere hold together.

        Returns
        -------
        bool
            True if it is empty. False does not mean that a motion exists.
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
        """Return whether all solutions with these ε are admissible motions of the given letter.

        Returns
        -------
        bool | None
            True if that is proved of all of them, False if it is proved of none, None if undecided.
        """
        if self.empty(epsilon) or (self.solvable and -RISES[letter] * self.rise > 0):
            return False
        if not self.solvable or not (RISES[letter] * self.rise > 0 and self.solution[0][2] > 0):
            return None
        low, high = squares(epsilon)
        hits = self.solution[0][3] > 0  # otherwise u ≤ 0 must imply an ε outside the range
        hits = hits or self.mixed(1, self.share(1)) > high or self.mixed(-1, self.share(-1)) > -low
        return True if hits and self.flies else None

    @cached_property
    def flies(self) -> bool:
        """True if Φ is proved to fall monotonically from Σ⁺ to Σ⁻ and to rise monotonically back (lemma 18)."""
        return self._keeps(-1, arb(0), lower(self.s)) and self._keeps(1, upper(self.s), arb(1))

    def _keeps(self, sign: int, start: arb, end: arb) -> bool:
        """Return whether Φ' is proved to keep the sign of both ends from Σ⁺ (start 0) to s, or from s to Σ⁺ (end 1)."""
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
        if force > 0:  # |M| grows, so the sign of Φ' at the beginning is enough
            return low in (0, upper_s) or bool(sign * at(low, sign) > 0)
        if force < 0:
            return high in (1, lower_s) or bool(sign * at(high, sign) > 0)
        return bool(sign * at(t, sign) > 0)

    def force(self, t: arb) -> arb:
        """Enclose the contact force g at the time t after Σ⁺."""
        x, y, *_ = self.solution[0]
        sine, cosine = (2 * t).sin_cos_pi()
        return series_force(self.delta, x * cosine - y * sine, y * cosine + x * sine)

    def slope(self, t: arb, sign: int) -> arb:
        """Enclose Φ' at the time t after Σ⁺, on the flight to Σ⁻ (sign −1) or back (sign 1)."""
        x, y, v, u = self.solution[0]
        since, start = (self.s, u) if sign > 0 else (arb(0), -v)
        sine, cosine = (2 * t).sin_cos_pi()
        sine0, cosine0 = (2 * since).sin_cos_pi()
        swing = 2 * PI() * ((y * cosine + x * sine) - (y * cosine0 + x * sine0))
        rest = 4 * PI() - 2 * PI() * (y * cosine0 + x * sine0) - start
        return start - swing - rest * (-self.delta * (t - since)).expm1()

    @cached_property
    def room(self) -> list[arb]:
        """Enclosures of (1 + E − T) uv/2 and (1 + E + T) uv/2, where T is the trace of the tangent map."""
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
        """True if both multipliers lie inside the unit circle, False if one lies outside, None if undecided."""
        above, below = self.room
        if above < 0 or below < 0:
            return False
        return True if above > 0 and below > 0 else None


def squares(epsilon: arb) -> tuple[arb, arb]:
    """Return the least and the largest ε². An enclosure of numbers ≥ 0 may begin below 0."""
    least = lower(epsilon)
    return least**2 if least > 0 else arb(0), upper(epsilon) ** 2


def cells(piece: PlanePiece) -> tuple[SolutionCell, SolutionCell]:
    """Return two cells that together hold all solutions, 0 ≤ s ≤ 1, at the δ of a piece."""
    return SolutionCell(arb(0), arb(1), piece.delta, piece.beta).halves


def motions(piece: PlanePiece, all_s: tuple[SolutionCell, SolutionCell], letter: str) -> list[list[SolutionCell]]:
    """Return the motions B (D) that exist at every point of the piece, each as the list of cells that hold it.

    Returns
    -------
    list[list[SolutionCell]]
        One list of neighbouring cells for each motion.

    Raises
    ------
    NotProvedError
        If the number of motions is undecided.
    """
    decided: list[tuple[bool, SolutionCell]] = []
    waiting = list(reversed(all_s))
    while waiting:
        cell = waiting.pop()
        here = cell.holds(letter, piece.epsilon)
        if here is None:
            waiting += reversed(cell.halves)
        else:
            decided.append((here, cell))
    if decided[0][0] or decided[-1][0]:
        raise NotProvedError("a family of P(1,1,1) is not proved to end inside 0 < s < 1")
    runs = [[cell for _, cell in group] for here, group in groupby(decided, lambda each: each[0]) if here]
    return [run for run in runs if _crosses(piece, run, RISES[letter])]


def attracts(piece: PlanePiece, run: Iterable[SolutionCell]) -> bool:
    """Return whether both multipliers lie inside the unit circle in every cell that may hold the motion.

    Returns
    -------
    bool
        True if both lie inside everywhere, False if one lies outside everywhere.

    Raises
    ------
    NotProvedError
        If neither is proved.
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
            raise NotProvedError("a P(1,1,1) attracts in one part of the block and not in another")
    return True in verdicts


def _crosses(piece: PlanePiece, run: list[SolutionCell], rises: int) -> bool:
    """Return whether ε(s), which is monotone over these cells, takes each ε of the piece exactly once.

    The neighbouring cells are empty, so at the ends of the run ε lies outside the piece at every δ. Testing one δ
    therefore decides the side.

    Returns
    -------
    bool
        True if every ε is taken, False if none is.

    Raises
    ------
    NotProvedError
        If neither is proved.
    """
    (low, high), sides = squares(piece.epsilon), []
    for s in (run[0].start, run[-1].end):
        square = SolutionCell(s, s, piece.delta.mid(), piece.beta).square
        sides.append(1 if square > high else -1 if square < low else 0)
    if 0 in sides:
        raise NotProvedError("the side on which a family of P(1,1,1) leaves the block is undecided")
    return sides == [-rises, rises]
