"""Check certificates of bifurcation points independently of the finder, in mpmath's intervals.

The only other file it needs is `rattle/proof/check.py`, which has the intervals and the pieces of a motion. Unknown are
the times t and velocities w after all impacts, and those of δ and ε that are not known exactly. Let T be the trace of
the tangent map of a motion of m forcing periods, and E = e^(−δm). The condition is

    T = 1 + E     where a multiplier is 1 (saddle-node),
    T = −1 − E    where a multiplier is −1 (flip),
    w = 0         where an impact grazes.

docs/proofs.md has the lemmas.
"""

import json
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

from mpmath import fp

from rattle.proof.check import (
    IV,
    MOST_PARTS,
    SLACK,
    TWO_PI,
    UNIT,
    ZERO,
    Interval,
    MotionPiece,
    Refused,
    exact_fraction,
    is_positive,
    require,
    sine_and_cosine,
)

# half-width of the box in times and parameters, and how much larger it is in velocities
RADIUS, FASTER = IV.mpf(10) ** -16, 1000
FREE = ("delta", "epsilon")
P11, P111, GRAZE = ([1], None), ([1, -1], None), ([1, -1], 1)
#: Walls and grazing impact of each named curve. A certificate with another name may have any walls.
NAMES = {
    ("SN", "SN1"): P11, ("PD", "PDC"): P11, ("SN", "SN2"): P111, ("PD", "PD1"): P111, ("PD", "PD2"): P111,
    **{("GR", name): GRAZE for name in ("G1", "G2", "COD20", "COD21", "COD22", "COD23")},
}  # fmt: skip


class ParameterJet:
    """An interval with its derivatives by all unknowns."""

    def __init__(self, value: Interval, slopes: Sequence[Interval] = ()) -> None:
        self.value, self.slopes = value, slopes

    def chained(self, value: Interval, slope: Interval) -> "ParameterJet":
        """Return f(self) from the value and the derivative of f (chain rule)."""
        return ParameterJet(value, [slope * each for each in self.slopes])

    def combined(self, other: Any, value: Interval, by: Interval, by_other: Interval) -> "ParameterJet":
        """Return f(self, other) from the value of f and its derivatives by both arguments (chain rule)."""
        own, others = self.slopes or [ZERO] * len(other.slopes), other.slopes or [ZERO] * len(self.slopes)
        return ParameterJet(value, [by * a + by_other * b for a, b in zip(own, others, strict=True)])

    def __add__(self, other: Any) -> "ParameterJet":
        """Return the sum."""
        other = jet(other)
        return self.combined(other, self.value + other.value, ZERO + 1, ZERO + 1)

    def __mul__(self, other: Any) -> "ParameterJet":
        """Return the product."""
        other = jet(other)
        return self.combined(other, self.value * other.value, other.value, self.value)

    def __neg__(self) -> "ParameterJet":
        """Return the negative."""
        return self.chained(-self.value, ZERO - 1)

    def __sub__(self, other: Any) -> "ParameterJet":
        """Return the difference."""
        return self + -jet(other)

    def __truediv__(self, other: "ParameterJet") -> "ParameterJet":
        """Return the quotient."""
        return self * other.chained(1 / other.value, -1 / other.value**2)

    __radd__, __rmul__ = __add__, __mul__

    def exp(self) -> "ParameterJet":
        """Return the exponential."""
        value = IV.exp(self.value) * (1 + SLACK)
        return self.chained(value, value)

    def turned(self) -> "tuple[ParameterJet, ParameterJet]":
        """Return the sine and cosine of 2π times the jet."""
        sine, cosine = sine_and_cosine(self.value)
        return self.chained(sine, TWO_PI * cosine), self.chained(cosine, -TWO_PI * sine)


def jet(x: Any) -> ParameterJet:
    """Return x as a jet. A plain number has no derivatives."""
    return x if isinstance(x, ParameterJet) else ParameterJet(ZERO + x)


class Bifurcation:
    """The statement of a certificate, as equations whose zero is the bifurcation point."""

    def __init__(self, document: Any) -> None:
        require(document["model"] == "impacting", "the model is not impacting")
        self.walls, self.m, self.kind, self.impact = (document[key] for key in ("walls", "m", "kind", "impact"))
        self.n, self.name = len(self.walls), document["name"]
        whole = [self.m, *self.walls] + ([] if self.impact is None else [self.impact])
        require(all(type(x) is int for x in whole) and self.m > 0 and {*self.walls} <= {1, -1}, "walls must be 1 or -1")
        require(self.kind in ("SN", "PD", "GR") and (self.impact is None) == (self.kind != "GR"), "the kind is unknown")
        require(
            self.impact is None or 0 <= self.impact < self.n > 1, "the number of the grazing impact is out of range"
        )
        if self.name != self.kind:
            meant = NAMES.get((self.kind, self.name))
            require(meant == (self.walls, self.impact) and self.m == 1, f"the name {self.name} does not fit the walls")
        self.point = self.name if self.name[:3] == "COD" else None
        known, solved = document["known"], document["solved"]
        require(
            {*known, *solved} == {"beta", *FREE} and "beta" in known, "the parameters are not delta, epsilon and beta"
        )
        require(
            len(known) + len(solved) == 3 and len(solved) == (2 if self.point else 1),
            "the number of solved parameters is wrong",
        )
        self.known = {name: exact_fraction(value) for name, value in known.items()}
        self.free = [name for name in FREE if name in solved]
        self.ends = [[exact_fraction(end) for end in solved[name]] for name in self.free]
        self.times, self.radius = [exact_fraction(t) for t in document["times"]], exact_fraction(document["radius"])
        require(
            len(self.times) == self.n and is_positive(*self.known.values()),
            "times must be one for each wall, and parameters positive",
        )

    def parameters(self, at: Sequence[Any]) -> list[Any]:
        """Return δ and ε at the unknowns x, as jets."""
        free = iter(at[2 * self.n :])
        return [self.known[name] if name in self.known else next(free) for name in FREE]

    def centre(self) -> list[Interval]:
        """Approximate the unknowns: the departure velocity of each flight between its two times, then parameters."""
        free = [(low + high) / 2 for low, high in self.ends]
        delta, epsilon = self.parameters([ZERO] * (2 * self.n) + free)
        found = []
        for i, t in enumerate(self.times):
            j = (i + 1) % self.n
            u, (sine, cosine) = self.times[j] + (0 if j else self.m) - t, sine_and_cosine(t)
            lacks = (self.walls[j] - self.walls[i]) * self.known["beta"] - 2 * TWO_PI * u
            lacks -= epsilon * (sine_and_cosine(self.times[j])[1] - cosine)
            w = 2 * TWO_PI - TWO_PI * epsilon * sine + lacks * delta / (1 - IV.exp(-delta * u))
            found += [t, w if i != self.impact else ZERO]
        return [IV.mpf(x.mid) for x in found + free]

    def equations(self, x: Sequence[Interval]) -> tuple[list[Interval], list[list[Interval]]]:
        """Return the values of all equations, which vanish at the point, and their derivatives by the unknowns."""
        unit = [[ZERO + (i == j) for j in range(len(x))] for i in range(len(x))]
        at = [ParameterJet(value, slopes) for value, slopes in zip(x, unit, strict=True)]
        delta, epsilon = (jet(each) for each in self.parameters(at))
        values, pieces, turn = [], [], jet(TWO_PI)
        for i in range(self.n):
            j = (i + 1) % self.n
            t, w, t1, w1 = at[2 * i], at[2 * i + 1], at[2 * j] + (0 if j else self.m), at[2 * j + 1]
            (sine, cosine), (sine1, cosine1) = t.turned(), t1.turned()
            kept = (-(delta * (t1 - t))).exp()
            reach, pushed = (jet(1) - kept) / delta, w - 2 * turn + turn * epsilon * sine
            y = reach * pushed + 2 * turn * (t1 - t) + epsilon * (cosine1 - cosine)
            v = kept * pushed + 2 * turn - turn * epsilon * sine1
            values += [y - (self.walls[j] - self.walls[i]) * self.known["beta"], -v - w1]
            force = turn * (2 * delta - epsilon * (turn * cosine1 + delta * sine1))
            pieces.append((reach, kept, None if j == self.impact else -2 * force, w1))
        if self.impact is not None:
            values.append(at[2 * self.impact + 1])
        if self.kind != "GR" or self.point:
            values.append(self.condition(pieces, delta))
        return [each.value for each in values], [each.slopes for each in values]

    def condition(self, pieces: Sequence[Any], delta: ParameterJet) -> ParameterJet:
        """Return the bifurcation condition from the tangent map in (Φ, Φ'), starting at the graze or first impact."""
        a, b, c, d, speeds = jet(1), jet(0), jet(0), jet(1), jet(1)
        first = self.impact or 0
        for i in range(self.n):
            reach, kept, push, w = pieces[(first + i) % self.n]
            a, b, c, d = a + reach * c, b + reach * d, kept * c, kept * d
            # w times the impact's tangent map [[-1, 0], [push/w, -1]], because the map itself is large at a small speed
            # w
            if push is not None:
                a, b, c, d = -a * w, -b * w, push * a - c * w, push * b - d * w
                speeds = speeds * w
        trace, half = a + d, (delta * (-self.m / IV.mpf(2))).exp()
        at_one, at_minus_one = speeds * (half * half + 1), -speeds * (half * half + 1)
        conditions = {
            "SN": trace - at_one, "PD": trace - at_minus_one,
            "COD20": trace - at_minus_one, "COD21": trace - speeds * half * 2, "COD22": trace - at_one, "COD23": b,
        }  # fmt: skip
        return conditions[self.point or self.kind]

    def enclosed(self) -> list[Interval]:
        """Enclose the one zero in the box of unknowns by Krawczyk's operator (lemma 2)."""
        x = self.centre()
        size = len(x)
        radii = [RADIUS * (FASTER if i < 2 * self.n and i % 2 else 1) for i in range(size)]
        spread = [radius * UNIT for radius in radii]
        values, rows = self.equations(x)
        require(len(values) == size, "the unknowns are not as many as the equations")
        about = (fp.matrix([[each.mid for each in row] for row in rows]) ** -1).tolist()
        for _ in range(6):  # the first application proves the zero, later ones shrink its enclosure
            _, rows = self.equations([a + b for a, b in zip(x, spread, strict=True)])
            moved = []
            for i, line in enumerate(about):
                less = [sum((line[k] * rows[k][j] for k in range(size)), ZERO - (i == j)) for j in range(size)]
                moved.append(-sum(a * b + c * d for a, b, c, d in zip(line, values, less, spread, strict=True)))
            inside = (is_positive(radius - dx, radius + dx) for radius, dx in zip(radii, moved, strict=True))
            require(all(inside), "Krawczyk's operator does not map the box into itself")
            spread = moved
        return [a + b for a, b in zip(x, spread, strict=True)]

    def require_happens(self, x: Sequence[Interval]) -> None:
        """Raise Refused unless each piece joins its two walls, meets none between, and only the graze has speed 0."""
        delta, epsilon = self.parameters(x)
        motion: Any = SimpleNamespace(
            walls=self.walls, m=self.m, k=[ZERO], delta=delta, epsilon=epsilon, beta=self.known["beta"]
        )
        for i in range(self.n):
            piece, j = MotionPiece(motion, i, x), (i + 1) % self.n
            require(is_positive(piece.duration), f"piece {i + 1} has no duration")
            require(i == self.impact or is_positive(-piece.wall * piece.w), f"piece {i + 1} begins behind its wall")
            grazes = i == self.impact, j == self.impact
            require(stays(piece, *grazes), f"piece {i + 1} is not proved clear of the walls")

    def require_least_period(self, x: Sequence[Interval]) -> None:
        """Raise Refused unless no divisor of the m forcing periods is a period (lemma 7)."""
        made = [i for i in range(self.n) if i != self.impact]
        walls, times = [self.walls[i] for i in made], [x[2 * i] for i in made]
        times += [t + self.m for t in times]
        for parts in range(2, len(walls) + 1):
            shift = len(walls) // parts
            if self.m % parts == len(walls) % parts == 0 and [*walls[shift:], *walls[:shift]] == walls:
                gaps = [b - a - self.m // parts for a, b in zip(times, times[shift:], strict=False)]
                require(
                    any(is_positive(gap) or is_positive(-gap) for gap in gaps),
                    f"the motion may repeat {parts} times within its period",
                )


def stays(piece: MotionPiece, begins_grazing: bool, ends_grazing: bool) -> bool:
    """Return whether a piece is proved clear of the walls between its ends, one of which may be a graze.

    At a graze Φ' = 0 and Φ'' points into the gap, so Φ' keeps one sign near it and Φ leaves the wall.

    Returns
    -------
    bool
        False means undecided.
    """
    if not (begins_grazing or ends_grazing):
        return piece.stays()
    wall = piece.wall if begins_grazing else piece.target
    part = piece.duration.b
    for _ in range(MOST_PARTS):
        part = part / 2
        u = IV.mpf([0, part.b]) if begins_grazing else IV.mpf([(piece.duration - part).a, piece.duration.b])
        if is_positive(-wall * (piece.force(u) - piece.delta * piece.after(u)[1])):
            break
    else:
        return False
    low, high = (part.a, piece.duration.b) if begins_grazing else (ZERO, (piece.duration - part).b)
    ends = [IV.mpf(low), IV.mpf(high)]
    beside = piece.after(ends[0] if begins_grazing else ends[1])[0]
    return clear(piece, beside) and lasts(piece, *ends)


def clear(piece: MotionPiece, y: Interval) -> bool:
    """Return whether y is clear of both walls."""
    return is_positive((1 - piece.wall) * piece.beta - y, (1 + piece.wall) * piece.beta + y)


def lasts(piece: MotionPiece, low: Interval, high: Interval) -> bool:
    """Return whether a piece is clear of the walls between two times at which it is clear, or on its own wall."""
    parts = [(low.a, high.b)]
    for _ in range(MOST_PARTS):
        low, high = parts.pop()
        part, middle = IV.mpf([low, high]), (low + high).mid / 2
        slope = piece.after(part)[1]
        if not (is_positive(slope) or is_positive(-slope)):
            y = piece.after(middle)[0]
            if not clear(piece, y):
                return False
            if not clear(piece, y + slope * (part - middle)):
                parts += [(low, middle), (middle, high)]
        if not parts:
            return True
    return False


def check(text: str) -> str:
    """Prove the theorem of a certificate and return it as a sentence. Raises Refused."""
    try:
        document = json.loads(text)
        require(document["format"] == 1 and document["theorem"] == "bifurcation", "the certificate's format is unknown")
        claim = Bifurcation(document)
        x = claim.enclosed()
        for value, (low, high) in zip(x[2 * claim.n :], claim.ends, strict=True):
            require(is_positive(value - low, high - value), "a parameter is not proved to be between its ends")
        for value, time in zip(x[: 2 * claim.n : 2], claim.times, strict=True):
            require(
                is_positive(claim.radius - (value - time), claim.radius + (value - time)),
                "a time is farther from its centre than the radius",
            )
        require(is_positive(*claim.parameters(x)), "a parameter is not positive")
        claim.require_happens(x)
        claim.require_least_period(x)
        side = {"G1": 1, "G2": -1}.get(claim.name, 0)
        require(
            side == 0 or is_positive(side * sine_and_cosine(x[0])[1]),
            "the grazing motion is A in place of C, or C in place of A",
        )
        where = ", ".join(f"{name} = {value}" for name, value in document["known"].items())
        return f"{claim.name} of {document['walls']}, at {where}: {', '.join(claim.free)} to {max_width(claim):.0e}"
    except (LookupError, TypeError, ValueError, ArithmeticError, AttributeError, RecursionError) as error:
        raise Refused(f"the certificate cannot be read: {error}") from error


def max_width(claim: Bifurcation) -> float:
    """Return the width of the widest enclosure of a parameter in a claim."""
    return max(float((high - low).b) for low, high in claim.ends)
