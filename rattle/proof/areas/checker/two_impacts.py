"""The motions B and D, which are P(1,1,1).

Unknown are s, the time from the impact on Σ⁺ to the one on Σ⁻, and φ, the phase half-way between them.
"""

from collections.abc import Callable
from fractions import Fraction
from itertools import groupby

from .intervals import (
    IV,
    ONE,
    PI,
    ZERO,
    Interval,
    Jet,
    ParameterBox,
    decayed,
    force,
    interval_between,
    less,
    middle,
    require,
    sine_and_cosine_of,
)

SHARE = Fraction(1, 64)  # narrowest cell of s, in widths of the column in δ
SHORTEST = 2.0**-13  # shortest part of a flight, in forcing periods
Part = tuple[Fraction, Fraction]


class Terms:
    """The terms that all equations share: s, δ, a = e^(−δs), b = e^(−δ(1−s)), E = ab, and sine and cosine of πs."""

    def __init__(self, s: Jet, d: Jet) -> None:
        self.s, self.d, self.a, self.b, self.end = s, d, (d * s).decay(), (d * (1 - s)).decay(), d.decay()
        self.sine, self.cosine = s.turn(1)


def system(t: Terms, beta: Interval) -> list[Jet]:
    """Return the coefficients of the two linear equations in (Z₁, Z₂) = ε (sin φ, cos φ), φ = 2πτ + πs.

        a₁₁ Z₁ + a₁₂ Z₂ = b₁
        a₂₁ Z₁ + a₂₂ Z₂ = b₂

    Returns
    -------
    list[Jet]
        a₁₁, a₁₂, b₁, a₂₁, a₂₂ and b₂.
    """
    late, lost = 1 - t.b, 1 - t.end
    both, k = (1 - t.a) * late, (1 - t.a) / (t.d * lost) * (4 * PI)
    first = both * t.cosine * -2, (t.b - t.a) * t.sine * 2, t.d * lost - both * 4
    return [*first, t.sine * 2 - k * late * t.cosine, k * (1 + t.b) * t.sine, t.s * (4 * PI) + 2 * beta - k * late * 2]


def speeds(t: Terms, z: list[Jet]) -> list[Jet]:
    """Return the speed v after Σ⁺, the speed u after Σ⁻, and ε², at the solution z = (Z₁, Z₂)."""
    mean, apart, lost = t.cosine * z[0], t.sine * z[1], 1 - t.end
    p = ((1 - t.b) * (2 - mean) + (1 + t.b) * apart) / lost
    q = ((1 - t.a) * (2 - mean) - (1 + t.a) * apart) / lost
    return [(p * 2 + mean - apart - 2) * (2 * PI), (2 - mean - apart - q * 2) * (2 * PI), z[0] * z[0] + z[1] * z[1]]


def room(t: Terms, z: list[Jet]) -> list[Jet]:
    """Return uv (1 + E − T) and uv (1 + E + T), which are both positive where the motion attracts (lemma 19).

    The tangent map of an impact at velocity w is [[−1, 0], [2g/w, −1]].

    Returns
    -------
    list[Jet]
        Both margins. T is the trace of the product of the tangent maps of both flights and both impacts.
    """
    v, u, _ = speeds(t, z)
    c0, s0, c1, s1 = t.cosine * z[1], t.sine * z[0], t.cosine * z[0], t.sine * z[1]
    top, bottom = force(t.d, c0 + s0, c1 - s1) * 2, force(t.d, c0 - s0, c1 + s1) * 2
    first, second = (1 - t.a) / t.d, (1 - t.b) / t.d
    # v times the product of the flight's tangent map and the impact's
    down = first * top - v, -(first * v), t.a * top, -(t.a * v)
    up = -(second * bottom) - u, -(second * u), -(t.b * bottom), -(t.b * u)
    trace, one = up[0] * down[0] + up[1] * down[2] + up[2] * down[1] + up[3] * down[3], (1 + t.end) * u * v
    return [one - trace, one + trace]


class Cell(ParameterBox):
    """All solutions whose s lies in one interval, at all δ of another."""

    def __init__(self, s: Interval, d: Interval, beta: Interval) -> None:
        super().__init__(s, d)
        self.known: dict[Callable[..., list[Jet]], list[Jet]] = {}
        self.over, self.mid = Terms(*self.jets), Terms(*self.centre)
        over, centre = (system(terms, beta) for terms in (self.over, self.mid))
        a, c, b, e, g, h = (self.about(m.x, o) for m, o in zip(centre, over, strict=True))
        self.least = [b**2 / (a**2 + c**2), h**2 / (e**2 + g**2)]  # lower bounds of ε², one from each equation
        self.solvable = less(ZERO, a * g - c * e) or less(a * g - c * e, ZERO)
        if self.solvable:

            def solve(right: Interval, other: Interval) -> tuple[Interval, Interval]:
                return (right * g - c * other) / (a * g - c * e), (a * other - e * right) / (a * g - c * e)

            z = solve(b, h)
            by = [[-(x * z[0] + y * z[1] - w) for x, y, w in zip(p[::3], p[1::3], p[2::3], strict=True)]
                  for p in ([o.s for o in over], [o.d for o in over])]  # fmt: skip
            by_s, by_d = solve(*by[0]), solve(*by[1])
            a, c, b, e, g, h = (m.x for m in centre)
            self.z0 = [Jet(x) for x in solve(b, h)]
            self.z = [
                Jet(self.about(m.x, Jet(x, p, q)), p, q) for m, x, p, q in zip(self.z0, z, by_s, by_d, strict=True)
            ]
            self.v, self.u, self.e = self.enclose(speeds)
            self.middle = [each.x for each in speeds(self.mid, self.z0)]

    def enclose(self, of: Callable[..., list[Jet]]) -> list[Jet]:
        """Enclose the values and derivatives of a function of (terms, z) over the cell."""
        if of not in self.known:
            centre, over = of(self.mid, self.z0), of(self.over, self.z)
            self.known[of] = [Jet(self.about(m.x, o), o.s, o.d) for m, o in zip(centre, over, strict=True)]
        return self.known[of]

    def lacks(self, low: Interval, high: Interval) -> bool:
        """Return whether the cell is proved to hold no motion with ε² between low and high."""
        if any(less(high, bound) for bound in self.least):
            return True
        if not self.solvable:
            return False
        if less(self.v.x, ZERO) or less(self.u.x, ZERO) or less(self.e.x, low) or less(high, self.e.x):
            return True
        return less(self.mixed(1), low) or less(self.mixed(-1), -high)

    def holds(self, rises: int, low: Interval, high: Interval) -> bool | None:
        """Return whether all solutions with ε² between low and high are admissible and lie where ε(s) rises (falls).

        Returns
        -------
        bool | None
            True if that is proved of all of them, False if it is proved of none, None if undecided.
        """
        if self.lacks(low, high) or (self.solvable and less(rises * self.e.s, ZERO)):
            return False
        if not (self.solvable and less(ZERO, rises * self.e.s) and less(ZERO, self.v.x)):
            return None
        # u > 0 wherever ε² lies between low and high
        hits = less(ZERO, self.u.x) or less(high, self.mixed(1)) or less(-low, self.mixed(-1))
        return True if hits and self.falls(1, ZERO, self.s) and self.falls(-1, self.s, ONE) else None

    def mixed(self, sign: int) -> Interval:
        """Enclose sign · ε² + λu with a λ ≥ 0 that makes the sum hardly change with s (lemma 17)."""
        share = max(0.0, -sign * float(self.e.s.mid.a) / float(self.u.s.mid.a))
        _, u, e = self.middle
        return self.about(sign * e + share * u, self.e * sign + self.u * share)

    def falls(self, sign: int, start: Interval, end: Interval) -> bool:
        """Return whether Φ is proved monotone between two events, falling (sign 1) or rising (sign −1).

        The time s is one of the events. Φ' is known to have the right sign at both.

        Returns
        -------
        bool
            False means undecided.
        """
        parts = [(start.b, end.a)]
        while parts:
            low, high = parts.pop()
            first, last = low == start.b, high == end.a
            t = IV.mpf([start.a if first else low, end.b if last else high])
            push = -sign * self.push(t)  # e^(δt) |Φ'| grows where this is positive
            at, known = (low, first) if less(ZERO, push) else (high, last) if less(push, ZERO) else (t, False)
            if not (known or less(ZERO, -sign * self.velocity(sign, at))):
                if less(high - low, SHORTEST):
                    return False
                parts += [(low, middle(t).a), (middle(t).a, high)]
        return True

    def push(self, t: Interval) -> Interval:
        """Enclose the contact force g at the time t after Σ⁺."""
        sine, cosine = sine_and_cosine_of(2 * PI * t - PI * self.s)
        z1, z2 = (z.x for z in self.z)
        return force(self.d, z2 * cosine - z1 * sine, z1 * cosine + z2 * sine)

    def velocity(self, sign: int, t: Interval) -> Interval:
        """Enclose Φ' at the time t after Σ⁺, as the driven solution and a decaying one from the previous event."""
        since, w = (ZERO, -self.v.x) if sign > 0 else (self.s, self.u.x)
        z1, z2 = (z.x for z in self.z)

        def driven(at: Interval) -> Interval:
            sine, cosine = sine_and_cosine_of(2 * PI * at - PI * self.s)
            return 4 * PI - 2 * PI * (z1 * cosine + z2 * sine)

        return driven(t) + (w - driven(since)) * decayed(self.d * (t - since))


class Column:
    """All motions B and D at the δ of one interval."""

    def __init__(self, delta: Part, beta: Fraction) -> None:
        self.d, self.beta, self.narrowest = (
            interval_between(*delta),
            interval_between(beta, beta),
            SHARE * (delta[1] - delta[0]),
        )
        self.cells: dict[Part, Cell] = {}

    def cell(self, low: Fraction, high: Fraction) -> Cell:
        """Return the cell of solutions with s between low and high, computed once."""
        if (low, high) not in self.cells:
            self.cells[low, high] = Cell(interval_between(low, high), self.d, self.beta)
        return self.cells[low, high]

    def runs(self, rises: int, low: Interval, high: Interval) -> list[list[Part]]:
        """Return the motions B (D) with ε² between low and high.

        Returns
        -------
        list[list[Part]]
            One list of neighbouring cells of s for each motion. Along it ε(s) takes every value exactly once.
        """
        decided, parts = [], [(Fraction(0), Fraction(1))]
        while parts:
            first, last = parts.pop()
            here = self.cell(first, last).holds(rises, low, high)
            if here is None:
                require(
                    last - first > self.narrowest,
                    f"whether B or D exists near s = {float(first):.4f} is undecided",
                )
                parts += [((first + last) / 2, last), (first, (first + last) / 2)]
            else:
                decided.append((here, (first, last)))
        require(not decided[0][0] and not decided[-1][0], "a family of B or D is not proved to end inside 0 < s < 1")
        runs = [[part for _, part in group] for here, group in groupby(decided, lambda each: each[0]) if here]
        return [run for run in runs if self.crosses(run, rises, low, high)]

    def crosses(self, run: list[Part], rises: int, low: Interval, high: Interval) -> bool:
        """Return whether ε² passes from below `low` to above `high` along a run, in the direction `rises`.

        At the ends of a run ε² lies outside [low, high] at every δ of the column, so testing one δ is enough.

        Returns
        -------
        bool
            False if ε² takes none of these values.
        """
        sides = []
        for s in (run[0][0], run[-1][1]):
            e = Cell(interval_between(s, s), middle(self.d), self.beta).e.x
            require(less(e, low) or less(high, e), "the side on which a family of B or D leaves the block is undecided")
            sides.append(1 if less(high, e) else -1)
        return sides == [-rises, rises]

    def attracts(self, run: list[Part], low: Interval, high: Interval) -> bool:
        """Return True if the motion attracts at all points, False if at none. Raises BlockRefused if undecided."""
        verdicts, parts = set(), list(run)
        while parts:
            first, last = parts.pop()
            cell = self.cell(first, last)
            if cell.lacks(low, high):
                continue
            above, below = (each.x for each in cell.enclose(room))
            inside = less(ZERO, above) and less(ZERO, below)
            if inside or less(above, ZERO) or less(below, ZERO):
                verdicts.add(inside)
                require(len(verdicts) == 1, "the motion attracts in one part of the block and not in another")
            else:
                require(last - first > self.narrowest, "whether the motion attracts is undecided")
                parts += [(first, (first + last) / 2), ((first + last) / 2, last)]
        return True in verdicts
