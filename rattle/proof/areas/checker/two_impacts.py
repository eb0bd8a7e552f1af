"""B and D, which are P(1,1,1): by the phase φ half-way between Σ⁺ and Σ⁻, s later."""

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

SHARE, SHORTEST = Fraction(1, 64), 2.0**-13  # of the width in δ, to which s is cut; a part of a flight
Part = tuple[Fraction, Fraction]


class Terms:
    """Terms of all equations: s, δ, a = e^(−δs), b = e^(−δ(1−s)), E = ab, and sine and cosine of πs."""

    def __init__(self, s: Jet, d: Jet) -> None:
        self.s, self.d, self.a, self.b, self.end = s, d, (d * s).decay(), (d * (1 - s)).decay(), d.decay()
        self.sine, self.cosine = s.turn(1)


def system(t: Terms, beta: Interval) -> list[Jet]:
    """Return a₁₁, a₁₂, b₁, a₂₁, a₂₂, b₂ of the equations of (Z₁, Z₂) = ε (sin φ, cos φ), φ = 2πτ + πs."""
    late, lost = 1 - t.b, 1 - t.end
    both, k = (1 - t.a) * late, (1 - t.a) / (t.d * lost) * (4 * PI)
    first = both * t.cosine * -2, (t.b - t.a) * t.sine * 2, t.d * lost - both * 4
    return [*first, t.sine * 2 - k * late * t.cosine, k * (1 + t.b) * t.sine, t.s * (4 * PI) + 2 * beta - k * late * 2]


def speeds(t: Terms, z: list[Jet]) -> list[Jet]:
    """Return v after Σ⁺, u after Σ⁻, and ε²."""
    mean, apart, lost = t.cosine * z[0], t.sine * z[1], 1 - t.end
    p = ((1 - t.b) * (2 - mean) + (1 + t.b) * apart) / lost
    q = ((1 - t.a) * (2 - mean) - (1 + t.a) * apart) / lost
    return [(p * 2 + mean - apart - 2) * (2 * PI), (2 - mean - apart - q * 2) * (2 * PI), z[0] * z[0] + z[1] * z[1]]


def room(t: Terms, z: list[Jet]) -> list[Jet]:
    """1 + E − T and 1 + E + T, times uv: T is the trace of flights and impacts, [[−1, 0], [2g/w, −1]] at velocity w."""
    v, u, _ = speeds(t, z)
    c0, s0, c1, s1 = t.cosine * z[1], t.sine * z[0], t.cosine * z[0], t.sine * z[1]
    top, bottom = force(t.d, c0 + s0, c1 - s1) * 2, force(t.d, c0 - s0, c1 + s1) * 2
    first, second = (1 - t.a) / t.d, (1 - t.b) / t.d
    down = first * top - v, -(first * v), t.a * top, -(t.a * v)  # the flight after the impact, times v
    up = -(second * bottom) - u, -(second * u), -(t.b * bottom), -(t.b * u)
    trace, one = up[0] * down[0] + up[1] * down[2] + up[2] * down[1] + up[3] * down[3], (1 + t.end) * u * v
    return [one - trace, one + trace]


class Cell(ParameterBox):
    """All solutions with s in an interval, at all δ of another."""

    def __init__(self, s: Interval, d: Interval, beta: Interval) -> None:
        super().__init__(s, d)
        self.known: dict[Callable[..., list[Jet]], list[Jet]] = {}
        self.over, self.mid = Terms(*self.jets), Terms(*self.centre)
        over, centre = (system(terms, beta) for terms in (self.over, self.mid))
        a, c, b, e, g, h = (self.about(m.x, o) for m, o in zip(centre, over, strict=True))
        self.least = [b**2 / (a**2 + c**2), h**2 / (e**2 + g**2)]  # of ε², by each equation
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
            self.v, self.u, self.e = self.told(speeds)
            self.middle = [each.x for each in speeds(self.mid, self.z0)]

    def told(self, of: Callable[..., list[Jet]]) -> list[Jet]:
        """Values and derivatives over the cell."""
        if of not in self.known:
            centre, over = of(self.mid, self.z0), of(self.over, self.z)
            self.known[of] = [Jet(self.about(m.x, o), o.s, o.d) for m, o in zip(centre, over, strict=True)]
        return self.known[of]

    def lacks(self, low: Interval, high: Interval) -> bool:
        """Return whether no motion with ε² between these is here."""
        if any(less(high, bound) for bound in self.least):
            return True
        if not self.solvable:
            return False
        if less(self.v.x, ZERO) or less(self.u.x, ZERO) or less(self.e.x, low) or less(high, self.e.x):
            return True
        return less(self.mixed(1), low) or less(self.mixed(-1), -high)

    def holds(self, rises: int, low: Interval, high: Interval) -> bool | None:
        """Return whether all solutions with ε² between these happen and have such an ε(s); None if undecided."""
        if self.lacks(low, high) or (self.solvable and less(rises * self.e.s, ZERO)):
            return False
        if not (self.solvable and less(ZERO, rises * self.e.s) and less(ZERO, self.v.x)):
            return None
        hits = less(ZERO, self.u.x) or less(high, self.mixed(1)) or less(-low, self.mixed(-1))  # at these ε u > 0
        return True if hits and self.falls(1, ZERO, self.s) and self.falls(-1, self.s, ONE) else None

    def mixed(self, sign: int) -> Interval:
        """± ε² + λu, with a λ ≥ 0 for which it changes little with s: where u ≥ 0, ± ε² is not above it."""
        share = max(0.0, -sign * float(self.e.s.mid.a) / float(self.u.s.mid.a))
        _, u, e = self.middle
        return self.about(sign * e + share * u, self.e * sign + self.u * share)

    def falls(self, sign: int, start: Interval, end: Interval) -> bool:
        """Return whether Φ falls (−1: rises) between two events, of which s is one, if it does at both."""
        parts = [(start.b, end.a)]
        while parts:
            low, high = parts.pop()
            first, last = low == start.b, high == end.a
            t = IV.mpf([start.a if first else low, end.b if last else high])
            push = -sign * self.push(t)  # e^(δt) Φ' grows in size if positive
            at, known = (low, first) if less(ZERO, push) else (high, last) if less(push, ZERO) else (t, False)
            if not (known or less(ZERO, -sign * self.velocity(sign, at))):
                if less(high - low, SHORTEST):
                    return False
                parts += [(low, middle(t).a), (middle(t).a, high)]
        return True

    def push(self, t: Interval) -> Interval:
        """Return g at t after Σ⁺."""
        sine, cosine = sine_and_cosine_of(2 * PI * t - PI * self.s)
        z1, z2 = (z.x for z in self.z)
        return force(self.d, z2 * cosine - z1 * sine, z1 * cosine + z2 * sine)

    def velocity(self, sign: int, t: Interval) -> Interval:
        """Φ' at t after Σ⁺, from the event before: the part of it that decays, and the part that is driven."""
        since, w = (ZERO, -self.v.x) if sign > 0 else (self.s, self.u.x)
        z1, z2 = (z.x for z in self.z)

        def driven(at: Interval) -> Interval:
            sine, cosine = sine_and_cosine_of(2 * PI * at - PI * self.s)
            return 4 * PI - 2 * PI * (z1 * cosine + z2 * sine)

        return driven(t) + (w - driven(since)) * decayed(self.d * (t - since))


class Column:
    """All motions of one period at some δ."""

    def __init__(self, delta: Part, beta: Fraction) -> None:
        self.d, self.beta, self.narrowest = (
            interval_between(*delta),
            interval_between(beta, beta),
            SHARE * (delta[1] - delta[0]),
        )
        self.cells: dict[Part, Cell] = {}

    def cell(self, low: Fraction, high: Fraction) -> Cell:
        """Return the cell of solutions with s between two numbers."""
        if (low, high) not in self.cells:
            self.cells[low, high] = Cell(interval_between(low, high), self.d, self.beta)
        return self.cells[low, high]

    def runs(self, rises: int, low: Interval, high: Interval) -> list[list[Part]]:
        """Return the cells of each motion B (D) with ε² between these: where ε(s) takes each of these values once."""
        told, parts = [], [(Fraction(0), Fraction(1))]
        while parts:
            first, last = parts.pop()
            here = self.cell(first, last).holds(rises, low, high)
            if here is None:
                require(
                    last - first > self.narrowest,
                    f"about s = {float(first):.4f} it is not told whether B or D is there",
                )
                parts += [((first + last) / 2, last), (first, (first + last) / 2)]
            else:
                told.append((here, (first, last)))
        require(not told[0][0] and not told[-1][0], "a family of motions may not end")
        runs = [[part for _, part in group] for here, group in groupby(told, lambda each: each[0]) if here]
        return [run for run in runs if self.crosses(run, rises, low, high)]

    def crosses(self, run: list[Part], rises: int, low: Interval, high: Interval) -> bool:
        """Return whether ε goes through all these values along a run; at its ends it has none of them, at any δ."""
        sides = []
        for s in (run[0][0], run[-1][1]):
            e = Cell(interval_between(s, s), middle(self.d), self.beta).e.x
            require(less(e, low) or less(high, e), "it is not told where a family of motions ends")
            sides.append(1 if less(high, e) else -1)
        return sides == [-rises, rises]

    def attracts(self, run: list[Part], low: Interval, high: Interval) -> bool:
        """Return whether the motion attracts everywhere; else it does so nowhere."""
        verdicts, parts = set(), list(run)
        while parts:
            first, last = parts.pop()
            cell = self.cell(first, last)
            if cell.lacks(low, high):
                continue
            above, below = (each.x for each in cell.told(room))
            inside = less(ZERO, above) and less(ZERO, below)
            if inside or less(above, ZERO) or less(below, ZERO):
                verdicts.add(inside)
                require(len(verdicts) == 1, "a motion attracts in one part and not in another")
            else:
                require(last - first > self.narrowest, "it is not told whether a motion attracts")
                parts += [(first, (first + last) / 2), ((first + last) / 2, last)]
        return True in verdicts
