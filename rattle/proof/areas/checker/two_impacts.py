"""B and D, the motions P(1,1,1): equations (16.1) and (16.9) to (16.13) of docs/proofs.md.

The unknowns are s, the time from the impact on Σ⁺ to the impact on Σ⁻, Z₁ = ε sin φ and Z₂ = ε cos φ, where φ is the
phase of the forcing half-way between these impacts.
"""

from collections.abc import Callable
from fractions import Fraction
from itertools import groupby

from .intervals import (
    IV,
    ONE,
    PI,
    ZERO,
    EquationTerms,
    Interval,
    Jet,
    ParameterBox,
    exp_minus,
    force_of_phase,
    interval_between,
    is_less,
    midpoint,
    require,
    sine_and_cosine_of,
)

#: Ratio of the width in s of the narrowest cell to the width in δ of the block.
SHARE = Fraction(1, 64)
#: Shortest part of a flight that is bisected, in forcing periods.
SHORTEST = 2.0**-13
Part = tuple[Fraction, Fraction]


def half_way_equations(t: EquationTerms, beta: Interval) -> list[Jet]:
    """Return (16.10) and (16.11) of docs/proofs.md, each as the factor of Z₁, the factor of Z₂ and the right side."""
    late, lost = 1 - t.b, 1 - t.end
    both, k = (1 - t.a) * late, (1 - t.a) / (t.d * lost) * (4 * PI)
    first = both * t.cosine * -2, (t.b - t.a) * t.sine * 2, t.d * lost - both * 4
    second = t.sine * 2 - k * late * t.cosine, k * (1 + t.b) * t.sine, t.s * (4 * PI) + 2 * beta - k * late * 2
    return [*first, *second]


def speeds_and_square(t: EquationTerms, z: list[Jet]) -> list[Jet]:
    """Return the speeds v after Σ⁺ and u after Σ⁻, and ε², from z = (Z₁, Z₂): (16.12), (16.13) of docs/proofs.md."""
    mean, apart, lost = t.cosine * z[0], t.sine * z[1], 1 - t.end
    p = ((1 - t.b) * (2 - mean) + (1 + t.b) * apart) / lost
    q = ((1 - t.a) * (2 - mean) - (1 + t.a) * apart) / lost
    v = (p * 2 + mean - apart - 2) * (2 * PI)
    u = (2 - mean - apart - q * 2) * (2 * PI)
    return [v, u, z[0] * z[0] + z[1] * z[1]]


def stability_margins(t: EquationTerms, z: list[Jet]) -> list[Jet]:
    """Return the stability margins (1 + E − T) uv and (1 + E + T) uv of a P(1,1,1).

    z: Z₁ and Z₂ of the motion, the solution of (16.10) and (16.11) of docs/proofs.md. E is e^(−δ), and v and u are the
    speeds after Σ⁺ and after Σ⁻. T is the trace of the tangent map, a product of matrices: [[1, S], [0, 1 − δS]] of
    each flight of duration t, with S = (1 − e^(−δt))/δ, and [[−1, 0], [2g/w, −1]] of each impact that is reached with
    velocity w.

    Returns
    -------
    list[Jet]
        Both margins; the motion attracts if and only if both are positive.
    """
    v, u, _ = speeds_and_square(t, z)
    c0, s0, c1, s1 = t.cosine * z[1], t.sine * z[0], t.cosine * z[0], t.sine * z[1]
    top, bottom = force_of_phase(t.d, c0 + s0, c1 - s1) * 2, force_of_phase(t.d, c0 - s0, c1 + s1) * 2
    first, second = (1 - t.a) / t.d, (1 - t.b) / t.d
    # v times the map of the impact on Σ⁺ and the flight to Σ⁻; u times the map of the impact on Σ⁻ and the flight back
    down = first * top - v, -(first * v), t.a * top, -(t.a * v)
    up = -(second * bottom) - u, -(second * u), -(t.b * bottom), -(t.b * u)
    trace, one = up[0] * down[0] + up[1] * down[2] + up[2] * down[1] + up[3] * down[3], (1 + t.end) * u * v
    return [one - trace, one + trace]


class Cell(ParameterBox):
    """The solutions of (16.10) and (16.11), docs/proofs.md, with s in an interval, at all δ of another interval.

    s is the time from the impact on Σ⁺ to the impact on Σ⁻.
    """

    def __init__(self, s: Interval, d: Interval, beta: Interval) -> None:
        super().__init__(s, d)
        self.known: dict[Callable[..., list[Jet]], list[Jet]] = {}
        self.over, self.mid = EquationTerms(*self.jets), EquationTerms(*self.centre)
        over, centre = (half_way_equations(terms, beta) for terms in (self.over, self.mid))
        # the equations are a Z₁ + c Z₂ = b and e Z₁ + g Z₂ = h
        a, c, b, e, g, h = (self.mean_value(m.x, o) for m, o in zip(centre, over, strict=True))
        # lower bounds of ε², (16.8) of docs/proofs.md
        self.least_squares = [b**2 / (a**2 + c**2), h**2 / (e**2 + g**2)]
        self.solvable = is_less(ZERO, a * g - c * e) or is_less(a * g - c * e, ZERO)
        if self.solvable:

            def solve(right: Interval, other: Interval) -> tuple[Interval, Interval]:
                """Return Z₁ and Z₂ for the right sides `right` and `other` of the two equations, by Cramer's rule."""
                return (right * g - c * other) / (a * g - c * e), (a * other - e * right) / (a * g - c * e)

            z = solve(b, h)
            # the derivative of A Z = b is A Z' = b' − A' Z
            by = [[-(x * z[0] + y * z[1] - w) for x, y, w in zip(p[::3], p[1::3], p[2::3], strict=True)]
                  for p in ([o.s for o in over], [o.d for o in over])]  # fmt: skip
            by_s, by_d = solve(*by[0]), solve(*by[1])
            a, c, b, e, g, h = (m.x for m in centre)
            self.z0 = [Jet(x) for x in solve(b, h)]
            self.z = [
                Jet(self.mean_value(m.x, Jet(x, p, q)), p, q) for m, x, p, q in zip(self.z0, z, by_s, by_d, strict=True)
            ]
            self.v, self.u, self.square = self.enclose(speeds_and_square)
            self.middle = [each.x for each in speeds_and_square(self.mid, self.z0)]

    def enclose(self, of: Callable[..., list[Jet]]) -> list[Jet]:
        """Enclose the functions that `of` computes from the equations' terms and solution, with their derivatives."""
        if of not in self.known:
            centre, over = of(self.mid, self.z0), of(self.over, self.z)
            self.known[of] = [Jet(self.mean_value(m.x, o), o.s, o.d) for m, o in zip(centre, over, strict=True)]
        return self.known[of]

    def has_no_motion(self, low: Interval, high: Interval) -> bool:
        """Return whether it is proved that no solution of the cell has low ≤ ε² ≤ high and both speeds above 0."""
        if any(is_less(high, bound) for bound in self.least_squares):
            return True
        if not self.solvable:
            return False
        if is_less(self.v.x, ZERO) or is_less(self.u.x, ZERO):
            return True
        if is_less(self.square.x, low) or is_less(high, self.square.x):
            return True
        return is_less(self.square_plus_speed(1), low) or is_less(self.square_plus_speed(-1), -high)

    def all_solutions_are(self, slope: int, low: Interval, high: Interval) -> bool | None:
        """Return whether all solutions with low ≤ ε² ≤ high are admissible motions B (slope −1) or D (slope 1).

        B are the solutions at which ε falls as s grows, D those at which ε rises; s is the time from Σ⁺ to Σ⁻.

        Returns
        -------
        bool | None
            True if all are, False if none is, None if undecided.
        """
        if self.has_no_motion(low, high) or (self.solvable and is_less(slope * self.square.s, ZERO)):
            return False
        if not (self.solvable and is_less(ZERO, slope * self.square.s) and is_less(ZERO, self.v.x)):
            return None
        # the motion reaches Σ⁻ where u > 0; solutions with u ≤ 0 are allowed if their ε² is proved outside low … high
        reaches = is_less(ZERO, self.u.x) or is_less(high, self.square_plus_speed(1))
        if not (reaches or is_less(-low, self.square_plus_speed(-1))):
            return None
        return True if self.is_monotone(-1, ZERO, self.s) and self.is_monotone(1, self.s, ONE) else None

    def square_plus_speed(self, sign: int) -> Interval:
        """Return bounds of sign · ε² + λu over the cell, u the speed after Σ⁻, for a λ ≥ 0 that makes them narrow."""
        # with this λ the derivative of the sum by s is nearly 0 (Lemma 17 of docs/proofs.md)
        factor = max(0.0, -sign * float(self.square.s.mid.a) / float(self.u.s.mid.a))
        _, u, square = self.middle
        return self.mean_value(sign * square + factor * u, self.square * sign + self.u * factor)

    def is_monotone(self, sign: int, start: Interval, end: Interval) -> bool:
        """Return whether Φ is proved to be monotone on a flight from time `start` to `end`, with Φ' of this sign."""
        parts = [(start.b, end.a)]
        while parts:
            low, high = parts.pop()
            first, last = low == start.b, high == end.a
            t = IV.mpf([start.a if first else low, end.b if last else high])
            push = sign * self.force_at(t)
            # sign · e^(δt) Φ' grows if push > 0, and falls if push < 0: its sign at one end of the part is enough
            at, known = (low, first) if is_less(ZERO, push) else (high, last) if is_less(push, ZERO) else (t, False)
            if not (known or is_less(ZERO, sign * self.velocity(sign, at))):
                if is_less(high - low, SHORTEST):
                    return False
                parts += [(low, midpoint(t).a), (midpoint(t).a, high)]
        return True

    def force_at(self, t: Interval) -> Interval:
        """Return the contact force g, a time t after the impact on Σ⁺."""
        sine, cosine = sine_and_cosine_of(2 * PI * t - PI * self.s)
        z1, z2 = (z.x for z in self.z)
        return force_of_phase(self.d, z2 * cosine - z1 * sine, z1 * cosine + z2 * sine)

    def velocity(self, sign: int, t: Interval) -> Interval:
        """Return Φ' a time t after the impact on Σ⁺, on the flight to Σ⁻ (sign −1) or on the flight back (1)."""
        departure, w = (ZERO, -self.v.x) if sign < 0 else (self.s, self.u.x)
        z1, z2 = (z.x for z in self.z)

        def forced_velocity(at: Interval) -> Interval:
            """Return the velocity of the particular solution 4πt + ε cos 2πt of the flight's equation."""
            sine, cosine = sine_and_cosine_of(2 * PI * at - PI * self.s)
            return 4 * PI - 2 * PI * (z1 * cosine + z2 * sine)

        return forced_velocity(t) + (w - forced_velocity(departure)) * exp_minus(self.d * (t - departure))


class Column:
    """The cells (`Cell`) with 0 ≤ s ≤ 1 over one interval of δ, kept for further claims about this interval.

    s is the time from Σ⁺ to Σ⁻.
    """

    def __init__(self, delta: Part, beta: Fraction) -> None:
        self.d, self.beta = interval_between(*delta), interval_between(beta, beta)
        self.narrowest = SHARE * (delta[1] - delta[0])
        self.cells: dict[Part, Cell] = {}

    def cell(self, low: Fraction, high: Fraction) -> Cell:
        """Return the cell low ≤ s ≤ high, s being the time from Σ⁺ to Σ⁻."""
        if (low, high) not in self.cells:
            self.cells[low, high] = Cell(interval_between(low, high), self.d, self.beta)
        return self.cells[low, high]

    def parts_of_motions(self, slope: int, low: Interval, high: Interval) -> list[list[Part]]:
        """Enclose the motions D (slope 1: ε² rises with s) or B (slope −1: ε² falls with s) that have low ≤ ε² ≤ high.

        s is the time from Σ⁺ to Σ⁻.

        Returns
        -------
        list[list[Part]]
            For each motion, the neighbouring parts of 0 ≤ s ≤ 1 that contain its s.
        """
        decided, parts = [], [(Fraction(0), Fraction(1))]
        while parts:
            first, last = parts.pop()
            answer = self.cell(first, last).all_solutions_are(slope, low, high)
            if answer is None:
                wide = last - first > self.narrowest
                require(
                    wide, f"it is undecided whether a B or D takes {float(first):.4f} forcing periods from Σ⁺ to Σ⁻"
                )
                parts += [((first + last) / 2, last), (first, (first + last) / 2)]
            else:
                decided.append((answer, (first, last)))
        require(
            not decided[0][0] and not decided[-1][0],
            "a motion B or D may have both impacts at the same phase",
        )
        runs = [[part for _, part in group] for answer, group in groupby(decided, lambda each: each[0]) if answer]
        return [run for run in runs if self.crosses_block(run, slope, low, high)]

    def crosses_block(self, run: list[Part], slope: int, low: Interval, high: Interval) -> bool:
        """Return whether ε²(s), monotone on neighbouring parts of 0 ≤ s ≤ 1, takes each value from low to high once.

        s is the time from Σ⁺ to Σ⁻. run: the parts in order. slope: 1 if ε² rises on them, −1 if it falls.

        Returns
        -------
        bool
            True if each value is taken exactly once, False if ε²(s) takes none of these values.

        Raises
        ------
        BlockRefused
            If neither is proved.
        """
        # at each end of the run ε² is outside low … high, and by continuity on the same side at every δ,
        # so one δ shows the side
        sides = []
        for s in (run[0][0], run[-1][1]):
            square = Cell(interval_between(s, s), midpoint(self.d), self.beta).square.x
            require(
                is_less(square, low) or is_less(high, square), "it is undecided where the solutions leave the block"
            )
            sides.append(1 if is_less(high, square) else -1)
        return sides == [-slope, slope]

    def attracts(self, run: list[Part], low: Interval, high: Interval) -> bool:
        """Return True if a motion B or D attracts at all points of the block, False if at none.

        run: the parts of the interval 0 ≤ s ≤ 1 that contain the motion's time s from Σ⁺ to Σ⁻. low, high: the ends of
        the block in ε².

        Returns
        -------
        bool
            The proved stability.

        Raises
        ------
        BlockRefused
            If neither is proved.
        """
        verdicts, parts = set(), list(run)
        while parts:
            first, last = parts.pop()
            cell = self.cell(first, last)
            if cell.has_no_motion(low, high):
                continue
            above, below = (each.x for each in cell.enclose(stability_margins))
            inside = is_less(ZERO, above) and is_less(ZERO, below)
            if inside or is_less(above, ZERO) or is_less(below, ZERO):
                verdicts.add(inside)
                require(len(verdicts) == 1, "B or D is not proved to have the same stability on the whole block")
            else:
                require(last - first > self.narrowest, "it is undecided whether B or D attracts on the whole block")
                parts += [(first, (first + last) / 2), ((first + last) / 2, last)]
        return True in verdicts
