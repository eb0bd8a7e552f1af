"""B and D, the motions P(1,1,1), over a piece of the plane: equations (16.1) to (19.3) of docs/proofs.md.

The unknowns are s, the time from the impact on Σ⁺ to the impact on Σ⁻, X = ε cos 2πτ and Y = ε sin 2πτ, where τ is the
phase of the impact on Σ⁺. The closure equations (16.2) and (16.3) are linear in X and Y, so at given δ, β and s they
have one solution. The solutions at all s form a curve ε(s). B is a motion where ε falls with s, D one where ε rises.

The interval 0 ≤ s ≤ 1 is bisected into cells. Each cell is enclosed over all δ of the piece, until it is proved either
that it has no motion with an ε of the piece, or that all of its solutions are admissible and ε(s) is monotone.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from itertools import groupby
from typing import NamedTuple, TypeVar

from rattle.errors import NotProvedError
from rattle.proof.areas.piece import SHORTEST_PART, PlanePiece, hull, lower_end, upper_end
from rattle.proof.balls import PI, arb, arb_series

#: A cell is not halved if its width in s, in forcing periods, is at most this.
NARROWEST_CELL = 2.0**-20
#: Sign of dε/ds along the solutions that are motions B or D.
SLOPE_SIGN = {"B": -1, "D": 1}

Number = TypeVar("Number", arb, arb_series)
Equation = tuple[arb_series, arb_series, arb_series]


class EnclosedFunctions(NamedTuple):
    """Several functions of (s, δ), enclosed over a cell by the mean value theorem.

    centre: the values at the centre of the cell.
    by_s, by_delta: balls that contain the partial derivatives over the whole cell.
    over_cell: balls that contain the values over the whole cell.
    """

    centre: list[arb]
    by_s: list[arb]
    by_delta: list[arb]
    over_cell: list[arb]


def closure_equations(s: arb_series, delta: arb_series, beta: arb) -> tuple[Equation, Equation]:
    """Return equations (16.2) and (16.3) of docs/proofs.md, each as (factor of X, factor of Y, right side)."""
    a, b, end = (-delta * s).exp(), (-delta * (1 - s)).exp(), (-delta).exp()
    sine, cosine = (2 * PI() * s).sin(), (2 * PI() * s).cos()
    down, up = 1 - 2 * a + end, 1 - 2 * b + end
    k = 4 * PI() * (1 - a) / (delta * (1 - end))  # K of (16.1), docs/proofs.md
    first = up * sine, down + up * cosine, 4 * (1 - a) * (1 - b) - delta * (1 - end)
    second = 1 - cosine + k * b * sine, sine - k + k * b * cosine, 2 * beta + 4 * PI() * s - 2 * k * (1 - b)
    return first, second


def speed_series(s: arb_series, delta: arb_series, x: arb_series, y: arb_series) -> tuple[arb_series, arb_series]:
    """Return the speeds v after the impact on Σ⁺ and u after the impact on Σ⁻, (16.4) to (16.7) of docs/proofs.md.

    s is the time from Σ⁺ to Σ⁻. x and y are ε cos 2πτ and ε sin 2πτ, with τ the phase of the impact on Σ⁺.

    Returns
    -------
    tuple[arb_series, arb_series]
        v and u.
    """
    later = y * (2 * PI() * s).cos() + x * (2 * PI() * s).sin()
    a, b, lost = (-delta * s).exp(), (-delta * (1 - s)).exp(), 1 - (-delta).exp()
    p = 4 * PI() * (2 - y - b * (2 - later)) / lost
    q = 4 * PI() * (2 - later - a * (2 - y)) / lost
    v = p - 4 * PI() + 2 * PI() * y
    u = 4 * PI() - 2 * PI() * later - q
    return v, u


def stability_margin_series(s: arb_series, delta: arb_series, solution: Sequence[arb_series]) -> list[arb_series]:
    """Return the stability margins (1 + E − T) uv/2 and (1 + E + T) uv/2, (19.2) and (19.3) of docs/proofs.md.

    E = e^(−δ) is the determinant, and T the trace, of the tangent map over the forcing period.

    Parameters
    ----------
    solution : Sequence[arb_series]
        X, Y, v and u.

    Returns
    -------
    list[arb_series]
        Both margins; the motion attracts if and only if both are positive.
    """
    x, y, v, u = solution
    a, b, end = (-delta * s).exp(), (-delta * (1 - s)).exp(), (-delta).exp()
    sine, cosine = (2 * PI() * s).sin(), (2 * PI() * s).cos()
    force_plus = force_at_phase(delta, x, y)
    force_minus = force_at_phase(delta, x * cosine - y * sine, y * cosine + x * sine)
    linear = (1 - end) * (force_plus * u - force_minus * v) / delta
    product = 2 * (1 - a) * (1 - b) * force_plus * force_minus / (delta * delta)
    return [linear + product, (1 + end) * u * v - linear - product]


def force_at_phase(delta: Number, cosine: Number, sine: Number) -> Number:
    """Return the contact force g at a time t, from cosine = ε cos 2πt and sine = ε sin 2πt."""
    return 4 * PI() * delta - 4 * PI() ** 2 * cosine - 2 * PI() * delta * sine


def solve_two_linear_equations(first: Sequence[arb], second: Sequence[arb]) -> list[arb]:
    """Return [X, Y] that solves two equations (factor of X, factor of Y, right side), by Cramer's rule."""
    (a11, a12, b1), (a21, a22, b2) = first, second
    determinant = a11 * a22 - a12 * a21
    return [(b1 * a22 - a12 * b2) / determinant, (a11 * b2 - a21 * b1) / determinant]


class SolutionCell:
    """The solutions of (16.2) and (16.3), docs/proofs.md, with start ≤ s ≤ end, at all δ of a ball and one β.

    s is the time from the impact on Σ⁺ to the impact on Σ⁻.
    """

    def __init__(self, start: arb, end: arb, delta: arb, beta: arb) -> None:
        self.start, self.end, self.delta, self.beta = start, end, delta, beta
        self.s = hull(start, end)

    @cached_property
    def halves(self) -> tuple[SolutionCell, SolutionCell]:
        """The two halves of the cell. Raises NotProvedError if the cell is as narrow as NARROWEST_CELL."""
        middle = (self.start + self.end) / 2
        if not self.end - self.start > NARROWEST_CELL:
            raise NotProvedError(
                f"it is undecided whether a motion B or D reaches Σ⁻ {float(middle):.4f} forcing periods after Σ⁺: "
                "try a smaller block"
            )
        return self.cell_between(self.start, middle), self.cell_between(middle, self.end)

    def cell_between(self, start: arb, end: arb) -> SolutionCell:
        """Return the cell start ≤ s ≤ end at the δ and β of this cell; s is the time from Σ⁺ to Σ⁻."""
        return SolutionCell(start, end, self.delta, self.beta)

    def _enclose_by_mean_value(self, centre: Iterable[arb], by_s: Iterable[arb], by_delta: Iterable[arb]) -> list[arb]:
        """Return enclosures of functions over the cell, from values at its centre and derivatives over the cell."""
        ds, dd = self.s - self.s.mid(), self.delta - self.delta.mid()
        return [m + f * ds + g * dd for m, f, g in zip(centre, by_s, by_delta, strict=True)]

    @cached_property
    def equations(self) -> tuple[EnclosedFunctions, EnclosedFunctions]:
        """Enclosures of the factor of X, the factor of Y and the right side of (16.2) and of (16.3), docs/proofs.md."""
        s, delta, beta = self.s, self.delta, self.beta
        at_centre = closure_equations(arb_series([s.mid()]), arb_series([delta.mid()]), beta)
        along_s = closure_equations(arb_series([s, 1]), arb_series([delta]), beta)
        along_delta = closure_equations(arb_series([s]), arb_series([delta, 1]), beta)
        first, second = (
            ([term[0] for term in centre], [term[1] for term in by_s], [term[1] for term in by_delta])
            for centre, by_s, by_delta in zip(at_centre, along_s, along_delta, strict=True)
        )
        return EnclosedFunctions(*first, self._enclose_by_mean_value(*first)), EnclosedFunctions(
            *second, self._enclose_by_mean_value(*second)
        )

    @cached_property
    def epsilon_lower_bound(self) -> arb:
        """A lower bound of ε for all solutions of the cell, by (16.8) of docs/proofs.md."""
        bounds = []
        for equation in self.equations:
            factor_x, factor_y, right = equation.over_cell
            bounds.append(right.abs_lower() / (factor_x.abs_upper() ** 2 + factor_y.abs_upper() ** 2).sqrt())
        return max((lower_end(bound) for bound in bounds), key=float)

    @cached_property
    def solution(self) -> EnclosedFunctions:
        """Enclosures of (X, Y, v, u): the solution (X, Y) of (16.2) and (16.3), docs/proofs.md, and its speeds."""
        first, second = self.equations
        rough = solve_two_linear_equations(first.over_cell, second.over_cell)
        # the derivative of A (X, Y) = b is A (X, Y)' = b' − A' (X, Y)
        xy_s, xy_delta = (
            solve_two_linear_equations(
                *(
                    [*equation.over_cell[:2], right - factor_x * rough[0] - factor_y * rough[1]]
                    for equation, (factor_x, factor_y, right) in zip(self.equations, derivatives, strict=True)
                )
            )
            for derivatives in ((first.by_s, second.by_s), (first.by_delta, second.by_delta))
        )
        xy_centre = solve_two_linear_equations(first.centre, second.centre)
        xy = self._enclose_by_mean_value(xy_centre, xy_s, xy_delta)

        s, delta = self.s, self.delta
        xy_along_s = (arb_series([value, slope]) for value, slope in zip(xy, xy_s, strict=True))
        xy_along_delta = (arb_series([value, slope]) for value, slope in zip(xy, xy_delta, strict=True))
        speeds_s = [speed[1] for speed in speed_series(arb_series([s, 1]), arb_series([delta]), *xy_along_s)]
        speeds_delta = [speed[1] for speed in speed_series(arb_series([s]), arb_series([delta, 1]), *xy_along_delta)]
        at_centre = (arb_series([number]) for number in (s.mid(), delta.mid(), *xy_centre))
        speeds_centre = [speed[0] for speed in speed_series(*at_centre)]
        speeds = self._enclose_by_mean_value(speeds_centre, speeds_s, speeds_delta)
        return EnclosedFunctions(
            centre=[*xy_centre, *speeds_centre],
            by_s=[*xy_s, *speeds_s],
            by_delta=[*xy_delta, *speeds_delta],
            over_cell=[*xy, *speeds],
        )

    @cached_property
    def is_solvable(self) -> bool:
        """True if (16.2) and (16.3), docs/proofs.md, are proved to have one solution at all s and δ of the cell."""
        (a11, a12, _), (a21, a22, _) = (equation.over_cell for equation in self.equations)
        regular = not (a11 * a22 - a12 * a21).contains(0)
        return regular and all(number.is_finite() for numbers in self.solution for number in numbers)

    @cached_property
    def epsilon_squared_s_derivative(self) -> arb:
        """The derivative ∂ε²/∂s over the cell, where ε² = X² + Y²."""
        (x, y, *_), (x_s, y_s, *_) = self.solution.over_cell, self.solution.by_s
        return 2 * (x * x_s + y * y_s)

    @cached_property
    def epsilon_squared_delta_derivative(self) -> arb:
        """The derivative ∂ε²/∂δ over the cell, where ε² = X² + Y²."""
        (x, y, *_), (x_delta, y_delta, *_) = self.solution.over_cell, self.solution.by_delta
        return 2 * (x * x_delta + y * y_delta)

    @cached_property
    def epsilon_squared(self) -> arb:
        """An enclosure of ε² = X² + Y² over the cell."""
        x, y, *_ = self.solution.centre
        return self._enclose_by_mean_value(
            [x * x + y * y], [self.epsilon_squared_s_derivative], [self.epsilon_squared_delta_derivative]
        )[0]

    def bound_square_plus_speed(self, sign: int) -> arb:
        """Return bounds of sign · ε² + λu over the cell, for some λ ≥ 0 that makes the bounds narrow.

        u is the speed after Σ⁻.

        Returns
        -------
        arb
            The bounds. Lemma 17 of docs/proofs.md uses them; it holds for any λ ≥ 0.
        """
        x, y, _, u = self.solution.centre
        u_s, u_delta = self.solution.by_s[3], self.solution.by_delta[3]
        # with this λ the derivative of the sum by s is nearly 0 (Lemma 17 of docs/proofs.md)
        factor = max(0.0, -sign * float(self.epsilon_squared_s_derivative.mid()) / float(u_s.mid()))
        centre = sign * (x * x + y * y) + factor * u
        by_s = sign * self.epsilon_squared_s_derivative + factor * u_s
        by_delta = sign * self.epsilon_squared_delta_derivative + factor * u_delta
        return self._enclose_by_mean_value([centre], [by_s], [by_delta])[0]

    def has_no_motion(self, epsilon: arb) -> bool:
        """Return whether no solution of the cell with speeds v > 0 after Σ⁺ and u > 0 after Σ⁻ has an ε in this ball.

        Returns
        -------
        bool
            True if that is proved, False if such a solution may exist.
        """
        if self.epsilon_lower_bound > epsilon:
            return True
        if not self.is_solvable:
            return False
        _, _, v, u = self.solution.over_cell
        low, high = range_of_epsilon_squared(epsilon)
        if v < 0 or u < 0 or self.epsilon_squared < low or self.epsilon_squared > high:
            return True
        # a motion has u > 0, so ±ε² ≤ ±ε² + λu: an upper bound of this sum may prove ε to be outside the ball `epsilon`
        return bool(self.bound_square_plus_speed(1) < low or self.bound_square_plus_speed(-1) < -high)

    def are_all_solutions_of_type(self, letter: str, epsilon: arb) -> bool | None:
        """Return whether all solutions of the cell with an ε in this ball are admissible motions `letter`, B or D.

        Returns
        -------
        bool | None
            True if all are; then ε(s) is strictly monotone on the cell.
            False if none is: the cell has no motion with such an ε, or its motions are of the other letter.
            None if neither is proved.
        """
        if self.has_no_motion(epsilon):
            return False
        if not self.is_solvable:
            return None
        slope = SLOPE_SIGN[letter] * self.epsilon_squared_s_derivative
        if slope < 0:
            return False
        if not (slope > 0 and self.solution.over_cell[2] > 0):
            return None
        low, high = range_of_epsilon_squared(epsilon)
        reaches_sigma_minus = self.solution.over_cell[3] > 0
        # A motion needs a speed u > 0 after Σ⁻. Solutions with u ≤ 0 have ±ε² ≥ ±ε² + λu, with the λ ≥ 0 of
        # `bound_square_plus_speed`. If a lower bound of this sum proves that their ε is outside the ball `epsilon`, all
        # solutions with an ε in the ball have u > 0.
        reaches_sigma_minus = (
            reaches_sigma_minus or self.bound_square_plus_speed(1) > high or self.bound_square_plus_speed(-1) > -low
        )
        return True if reaches_sigma_minus and self.is_monotone_between_impacts else None

    @cached_property
    def is_monotone_between_impacts(self) -> bool:
        """True if Φ is proved to fall from Σ⁺ to Σ⁻ and to rise all the way back, by Lemma 18 of docs/proofs.md."""
        falls = self._has_velocity_sign(-1, arb(0), lower_end(self.s))
        return falls and self._has_velocity_sign(1, upper_end(self.s), arb(1))

    def _has_velocity_sign(self, sign: int, start: arb, end: arb) -> bool:
        """Return whether Φ' is proved to have this sign between the times `start` and `end` after the impact on Σ⁺."""
        # at an impact Φ' has this sign, because v > 0 and u > 0; a part that begins or ends at an impact relies on this
        parts = [(start, end)]
        while parts:
            low, high = parts.pop()
            if not self._has_velocity_sign_on_part(sign, low, high):
                if high - low < SHORTEST_PART:
                    return False
                middle = (low + high) / 2
                parts += [(low, middle), (middle, high)]
        return True

    def _has_velocity_sign_on_part(self, sign: int, low: arb, high: arb) -> bool:
        """Return whether Φ' is proved to have this sign between the times `low` and `high` of one flight."""
        # the impact on Σ⁻ may be at any s of the cell, so a part that ends or begins at this impact contains all s
        lower_s, upper_s = lower_end(self.s), upper_end(self.s)
        t = hull(low, upper_s if high == lower_s else high)
        t = hull(lower_s, t) if low == upper_s else t
        force = sign * self.force(t)
        if force > 0:  # sign · e^(δt) Φ' grows: it suffices that sign · Φ' > 0 at the start of the part
            starts_at_impact = low in (0, upper_s)
            return starts_at_impact or bool(sign * self.velocity(low, sign) > 0)
        if force < 0:  # sign · e^(δt) Φ' falls: it suffices that sign · Φ' > 0 at the end of the part
            ends_at_impact = high in (1, lower_s)
            return ends_at_impact or bool(sign * self.velocity(high, sign) > 0)
        return bool(sign * self.velocity(t, sign) > 0)

    def force(self, t: arb) -> arb:
        """Return the contact force g at the time t after the impact on Σ⁺."""
        x, y, *_ = self.solution.over_cell
        sine, cosine = (2 * t).sin_cos_pi()
        return force_at_phase(self.delta, x * cosine - y * sine, y * cosine + x * sine)

    def velocity(self, t: arb, sign: int) -> arb:
        """Return Φ' a time t after the impact on Σ⁺, on the flight to Σ⁻ (sign −1) or back (1).

        Returns
        -------
        arb
            The enclosure by (18.1) of docs/proofs.md.
        """
        x, y, v, u = self.solution.over_cell
        departure, start = (self.s, u) if sign > 0 else (arb(0), -v)
        sine, cosine = (2 * t).sin_cos_pi()
        sine0, cosine0 = (2 * departure).sin_cos_pi()
        swing = 2 * PI() * ((y * cosine + x * sine) - (y * cosine0 + x * sine0))
        rest = 4 * PI() - 2 * PI() * (y * cosine0 + x * sine0) - start
        return start - swing - rest * (-self.delta * (t - departure)).expm1()

    @cached_property
    def stability_margin_bounds(self) -> list[arb]:
        """The stability margins (19.2) and (19.3) of docs/proofs.md over the cell; motions attract if both are > 0."""
        solution, s, delta = self.solution, self.s, self.delta
        along_s = [arb_series([x, slope]) for x, slope in zip(solution.over_cell, solution.by_s, strict=True)]
        along_delta = [arb_series([x, slope]) for x, slope in zip(solution.over_cell, solution.by_delta, strict=True)]
        at_centre = [arb_series([x]) for x in solution.centre]
        centre = stability_margin_series(arb_series([s.mid()]), arb_series([delta.mid()]), at_centre)
        by_s = stability_margin_series(arb_series([s, 1]), arb_series([delta]), along_s)
        by_delta = stability_margin_series(arb_series([s]), arb_series([delta, 1]), along_delta)
        return self._enclose_by_mean_value([x[0] for x in centre], [x[1] for x in by_s], [x[1] for x in by_delta])

    @property
    def attracts(self) -> bool | None:
        """True if all solutions attract, False if none does (one multiplier outside the unit circle), else None."""
        above, below = self.stability_margin_bounds
        if above < 0 or below < 0:
            return False
        return True if above > 0 and below > 0 else None


def range_of_epsilon_squared(epsilon: arb) -> tuple[arb, arb]:
    """Return the least and the largest ε² for the ε ≥ 0 in a ball. Its lower end may be negative by rounding."""
    least = lower_end(epsilon)
    return least**2 if least > 0 else arb(0), upper_end(epsilon) ** 2


def initial_cells(piece: PlanePiece) -> tuple[SolutionCell, SolutionCell]:
    """Return the cells 0 ≤ s ≤ ½ and ½ ≤ s ≤ 1 at the δ of a piece, with which the bisection begins."""
    return SolutionCell(arb(0), arb(1), piece.delta, piece.beta).halves


def enclose_motions_in_cells(
    piece: PlanePiece, cells: tuple[SolutionCell, SolutionCell], letter: str
) -> list[list[SolutionCell]]:
    """Enclose the motions B (or D), whose number is proved to be the same at all points of the piece.

    Parameters
    ----------
    cells : tuple[SolutionCell, SolutionCell]
        The cells of `initial_cells`. They keep computed enclosures for other claims.
    letter : str
        "B" or "D".

    Returns
    -------
    list[list[SolutionCell]]
        For each motion that exists, the neighbouring cells that contain it.

    Raises
    ------
    NotProvedError
        If the number of motions is not proved to be the same at all points of the piece.
    """
    decided: list[tuple[bool, SolutionCell]] = []
    waiting = list(reversed(cells))
    while waiting:
        cell = waiting.pop()
        answer = cell.are_all_solutions_of_type(letter, piece.epsilon)
        if answer is None:
            waiting += reversed(cell.halves)
        else:
            decided.append((answer, cell))
    if decided[0][0] or decided[-1][0]:
        raise NotProvedError(f"a motion {letter} may have both impacts at the same phase: try a smaller block")
    runs = [[cell for _, cell in group] for answer, group in groupby(decided, lambda each: each[0]) if answer]
    return [run for run in runs if _crosses_block(piece, run, letter)]


def attracts(piece: PlanePiece, run: Iterable[SolutionCell]) -> bool:
    """Return whether the motion that lies in a run of neighbouring cells attracts at every point of the piece.

    Returns
    -------
    bool
        True if both multipliers are inside the unit circle, False if one is outside, at every point.

    Raises
    ------
    NotProvedError
        If the stability is not proved to be the same at every point of the piece.
    """
    verdicts, waiting = set(), list(run)
    while waiting:
        cell = waiting.pop()
        if not cell.has_no_motion(piece.epsilon):
            verdict = cell.attracts
            if verdict is None:
                waiting += cell.halves
            else:
                verdicts.add(verdict)
        if len(verdicts) > 1:
            raise NotProvedError(
                "a motion P(1,1,1) is not proved to have the same stability on the whole block: try a smaller block"
            )
    return True in verdicts


def _crosses_block(piece: PlanePiece, run: list[SolutionCell], letter: str) -> bool:
    """Return whether ε(s) takes each ε of the piece exactly once along a run of cells, at every δ of the piece.

    ε(s) is monotone along the run, and the cells next to the run have no motion with an ε of the piece. So at each end
    of the run ε(s) is either below or above all ε of the piece. By continuity ε(s) is on the same side at every δ, so
    the side is computed at the middle δ alone.

    Returns
    -------
    bool
        False if ε(s) takes no ε of the piece.

    Raises
    ------
    NotProvedError
        If ε(s) at an end of the run is not proved to be below all ε of the piece, nor proved to be above them.
    """
    (low, high), sides = range_of_epsilon_squared(piece.epsilon), []
    for s in (run[0].start, run[-1].end):
        square = SolutionCell(s, s, piece.delta.mid(), piece.beta).epsilon_squared
        sides.append(1 if square > high else -1 if square < low else 0)
    if 0 in sides:
        raise NotProvedError(
            f"it is not proved whether the curve of motions {letter} ends below or above the block's range of ε: try a "
            "smaller block"
        )
    return sides == [-SLOPE_SIGN[letter], SLOPE_SIGN[letter]]
