"""Check certificates of periodic motions of the gear: run `python check.py FILE`.

The program needs this file, Python and mpmath, and nothing else of this project. It trusts mpmath's interval operations
+ − × ÷ and roots; the values of pi, exp, sin and cos are widened by 2⁻²⁸⁰.

An event is an impact, or the beginning or the end of a contact. Between two events a piece of the motion solves
y'' + δy' + ky = g(t), with k = 0 in a flight and k = 2κ in a contact. The unknowns x are the time and the velocity
after each event, in turn. The lemmas and the numbers of equations are those of docs/proofs.md.
"""

import json
import re
import sys
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from mpmath import fp
from mpmath.ctx_iv import MPIntervalContext

Interval = Any
IV = MPIntervalContext()
IV.prec = 320
ZERO, UNIT, SLACK = IV.mpf(0), IV.mpf([-1, 1]), IV.mpf([-(2.0**-280), 2.0**-280])
TWO_PI = 2 * (IV.pi + SLACK)
#: Most parts into which the time of a flight or contact is bisected.
MOST_PARTS = 4000
#: Most events of a motion: impacts, or beginnings and ends of contacts.
MOST_EVENTS = 1024
NUMBER = re.compile(r"-?\d{1,400}(\.\d{1,1100}|/\d{1,1100})?")


class Refusal(Exception):  # noqa: N818 - a refusal is an answer of the checker, not a fault
    """The certificate is not proved; the message says why."""


def require(ok: bool, why: str) -> None:
    """Raise Refusal with this message unless ok."""
    if not ok:
        raise Refusal(why)


def interval_of_text(text: str) -> Interval:
    """Return a narrow interval that contains the exact number in a text, a decimal or a ratio. Raises Refusal."""
    require(bool(NUMBER.fullmatch(text)), f"{text[:40]!r} must be a decimal or a ratio of integers")
    number = Fraction(text)
    return IV.mpf(number.numerator) / IV.mpf(number.denominator)


def is_positive(*intervals: Interval) -> bool:
    """Return whether all numbers of all intervals are > 0; False if an end is not a number."""
    return all(bool(x.a > 0) and bool(x.b > 0) for x in intervals)


def sine_and_cosine(x: Interval) -> tuple[Interval, Interval]:
    """Return the sine and the cosine of 2πx."""
    return IV.sin(TWO_PI * x) + SLACK, IV.cos(TWO_PI * x) + SLACK


class CertifiedMotion:
    """The motion that a certificate states.

    itinerary: the walls of its impacts or contacts, 1 for Σ⁺ and −1 for Σ⁻.
    walls: the wall of each event, which is an impact, or the beginning or the end of a contact.
    m: the number of forcing periods.
    k: the stiffness after each event: [0] for the impacting gear, whose events are followed by flights; [2κ, 0] for the
    stiff gear, whose contacts and flights alternate.
    velocity_factor: an event multiplies the velocity by this factor, −1 for the impacting and 1 for the stiff gear.
    centre, radii: the centre and the half-widths of the box of the unknowns x.
    """

    def __init__(self, document: Any) -> None:
        names = ["delta", "epsilon", "beta", *{"impacting": [], "stiff": ["kappa"]}[document["model"]]]
        require({*document["parameters"]} == {*names}, f"`parameters` must be {', '.join(names)}")
        self.delta, self.epsilon, self.beta, *kappa = (interval_of_text(document["parameters"][name]) for name in names)
        self.itinerary, (self.m, *counts) = document["walls"], document["label"]
        whole = all(type(x) is int for x in [self.m, *self.itinerary]) and self.m > 0 and {*self.itinerary} <= {1, -1}
        require(
            whole,
            "each of `walls` must be 1 or -1, and the first number of `label`, the forcing periods, a positive integer",
        )
        require(counts == [self.itinerary.count(1), self.itinerary.count(-1)], "`label` must count the walls 1 and -1")
        self.k, self.velocity_factor = ([2 * kappa[0], ZERO], 1) if kappa else ([ZERO], -1)
        self.walls = [wall for wall in self.itinerary for _ in self.k]
        times, speeds = document["times"], document["speeds"]
        require(
            len(times) == len(speeds) == len(self.walls) <= MOST_EVENTS,
            f"`times` and `speeds` must have one number for each event, at most {MOST_EVENTS}",
        )
        signs = [-wall * (-1 if kappa and i % 2 == 0 else 1) for i, wall in enumerate(self.walls)]
        self.centre = [
            x
            for t, v, sign in zip(times, speeds, signs, strict=True)
            for x in (interval_of_text(t), sign * interval_of_text(v))
        ]
        self.radii = [interval_of_text(document[name]) for name in ("time_radius", "speed_radius")] * len(self.walls)
        require(
            is_positive(self.delta, self.beta, *kappa, *self.radii),
            "delta, beta, kappa and both radii must be positive",
        )

    def pieces(self, x: Sequence[Interval]) -> "list[MotionPiece]":
        """Return the flights and contacts of the motion in order, for the unknowns x."""
        return [MotionPiece(self, i, x) for i in range(len(self.walls))]

    def equations(self, x: Sequence[Interval]) -> tuple[list[Interval], list[dict[int, Interval]]]:
        """Return the residual of the motion's equations and its Jacobian, at the unknowns x.

        Each flight and each contact has two equations. By the first it ends on the next wall. By the second its final
        velocity, which an impact reverses, is the initial velocity of the next flight or contact.

        Returns
        -------
        tuple[list[Interval], list[dict[int, Interval]]]
            The residual, which is 0 for a motion; and the rows of the Jacobian as {unknown: derivative}.
        """
        values, rows = [], []
        for p in self.pieces(x):
            (y, v), (c, s, c1, s1) = p.state_after(p.duration), p.tangent(p.duration)
            start, end = p.force(ZERO) - self.delta * p.w, p.force(p.duration) - self.delta * v - p.k * y
            values += [y - (p.target - p.wall) * self.beta, self.velocity_factor * v - p.next_velocity]
            by_y, by_v = (
                (-c * p.w - s * start, s, v, ZERO),
                (-c1 * p.w - s1 * start, s1, end, ZERO - self.velocity_factor),
            )
            for sign, derivatives in ((1, by_y), (self.velocity_factor, by_v)):
                rows.append(dict.fromkeys(p.unknowns, ZERO))
                for unknown, value in zip(p.unknowns, derivatives, strict=True):
                    rows[-1][unknown] += sign * value
        return values, rows

    def enclose_motion(self) -> list[Interval]:
        """Return intervals that contain the only motion in the box (Lemma 2 of docs/proofs.md). Raises Refusal."""
        x, n, spread = self.centre, len(self.centre), [radius * UNIT for radius in self.radii]
        values, rows = self.equations(x)
        about = (fp.matrix([[row.get(j, ZERO).mid for j in range(n)] for row in rows]) ** -1).tolist()
        for _ in range(6):  # the first step proves existence, further steps make the intervals narrower
            _, rows = self.equations([a + b for a, b in zip(x, spread, strict=True)])
            moved = []
            for i, line in enumerate(about):
                less = [
                    sum((line[k] * rows[k][j] for k in range(n) if j in rows[k]), ZERO - (i == j)) for j in range(n)
                ]
                moved.append(-sum(a * b + c * d for a, b, c, d in zip(line, values, less, spread, strict=True)))
            inside = (is_positive(radius - dx, radius + dx) for radius, dx in zip(self.radii, moved, strict=True))
            require(
                all(inside),
                "the box of the certificate is not mapped into itself: it is not proved to contain one motion",
            )
            spread = moved
        return [a + b for a, b in zip(x, spread, strict=True)]

    def require_admissible(self, x: Sequence[Interval]) -> None:
        """Raise Refusal unless each flight and contact is proved to reach its end, with speeds > 0 at both ends."""
        for i, p in enumerate(self.pieces(x), 1):
            # sign of the velocity at the start: a contact moves into its wall, a flight away from it
            side = p.wall if p.k != 0 else -p.wall
            speeds = side * p.w, (-p.wall if p.k != 0 else p.target) * self.velocity_factor * p.next_velocity
            require(
                is_positive(p.duration, *speeds),
                f"piece {i} is not proved to take time, and to start and end with velocities that its walls allow",
            )
            require(p.is_uninterrupted(), f"piece {i} is not proved to reach its end before another event")

    def require_least_period(self, x: Sequence[Interval]) -> None:
        """Raise Refusal unless m forcing periods are proved to be the least period (Lemma 7 of docs/proofs.md)."""
        n, times = len(self.itinerary), [*x[::2], *(t + self.m for t in x[::2])]
        for parts in range(2, n + 1):
            shift = n // parts
            shifted = [*self.itinerary[shift:], *self.itinerary[:shift]]
            if self.m % parts == n % parts == 0 and shifted == self.itinerary:
                gaps = [b - a - self.m // parts for a, b in zip(times, times[shift * len(self.k) :], strict=False)]
                require(
                    any(is_positive(gap) or is_positive(-gap) for gap in gaps),
                    f"the motion may repeat {parts} times in {self.m} forcing periods",
                )

    def trace(self, x: Sequence[Interval]) -> Interval:
        """Return the trace of the tangent map of (Φ, Φ') over the period, as in Lemma 8 of docs/proofs.md."""
        a, b, c, d = ZERO + 1, ZERO, ZERO, ZERO + 1
        for p in self.pieces(x):
            e, f, g, h = p.tangent(p.duration)
            a, b, c, d = e * a + f * c, e * b + f * d, g * a + h * c, g * b + h * d
            if self.velocity_factor < 0:
                # the tangent map of an impact that is reached with velocity v is [[−1, 0], [2g/v, −1]]
                kick = -2 * p.force(p.duration) / p.next_velocity
                a, b, c, d = -a, -b, kick * a - c, kick * b - d
        return a + d


class MotionPiece:
    """A flight or a contact, from event i of a motion to the next; y = Φ − Φ(start) solves y'' + δy' + ky = g(t).

    An event is an impact, or the beginning or the end of a contact; k is 0 in a flight and 2κ in a contact.
    t, w: time and velocity at the start; next_velocity: velocity after the next event; duration: time between the
    events.
    unknowns: the indices of t, w, the next time and `next_velocity` among the unknowns. wall, target: walls of both
    events.
    cosine, sine: P and Q of the particular solution, (1.12) and (1.13) of docs/proofs.md. y0, v0: the value and the
    derivative of this solution at the start.
    """

    def __init__(self, motion: CertifiedMotion, i: int, x: Sequence[Interval]) -> None:
        j = (i + 1) % len(motion.walls)
        self.unknowns, self.wall, self.target = (2 * i, 2 * i + 1, 2 * j, 2 * j + 1), motion.walls[i], motion.walls[j]
        self.t, self.w, t1, self.next_velocity = (x[unknown] for unknown in self.unknowns)
        self.duration, self.k = t1 + (0 if j else motion.m) - self.t, motion.k[i % len(motion.k)]
        self.delta, self.epsilon, self.beta = motion.delta, motion.epsilon, motion.beta
        stiff, loss = self.k - TWO_PI**2, TWO_PI * self.delta
        a, b, size = -(TWO_PI**2) * self.epsilon, -loss * self.epsilon, stiff**2 + loss**2
        self.cosine, self.sine = (a * stiff - b * loss) / size, (b * stiff + a * loss) / size
        self.y0, self.v0 = self.forced_solution(ZERO)

    def force(self, u: Interval) -> Interval:
        """Return the contact force g, (1.2) of docs/proofs.md, at the time u after the start."""
        sine, cosine = sine_and_cosine(self.t + u)
        return TWO_PI * (2 * self.delta - self.epsilon * (TWO_PI * cosine + self.delta * sine))

    def forced_solution(self, u: Interval) -> tuple[Interval, Interval]:
        """Return the forced solution for y = Φ − Φ(start), and its derivative, at the time u after the start."""
        sine, cosine = sine_and_cosine(self.t + u)
        y, v = self.cosine * cosine + self.sine * sine, TWO_PI * (self.sine * cosine - self.cosine * sine)
        flies = self.k == 0
        return y + 2 * TWO_PI * (u if flies else self.delta / self.k), v + (2 * TWO_PI if flies else 0)

    def tangent(self, u: Interval) -> tuple[Interval, Interval, Interval, Interval]:
        """Return (C, S, −kS, C − δS), the map of (y, y') over a time u without forcing (1.15 of docs/proofs.md)."""
        c, kept = ZERO + 1, IV.exp(-self.delta * u / 2) * (1 + SLACK)
        s = (1 - kept**2) / self.delta
        if self.k != 0:
            # `IV.sqrt` raises ValueError for an overdamped contact; `check` then refuses the certificate
            rate = IV.sqrt(self.k - self.delta**2 / 4)
            sine, cosine = sine_and_cosine(rate * u / TWO_PI)
            c, s = kept * (cosine + self.delta * sine / (2 * rate)), kept * sine / rate
        return c, s, -self.k * s, c - self.delta * s

    def state_after(self, u: Interval) -> tuple[Interval, Interval]:
        """Return the displacement y = Φ − Φ(start) and its derivative y' at a time u after the start."""
        (c, s, c1, s1), (y, v), pushed = self.tangent(u), self.forced_solution(u), self.w - self.v0
        return y - c * self.y0 + s * pushed, v - c1 * self.y0 + s1 * pushed

    def is_uninterrupted(self) -> bool:
        """Return whether this flight is proved to meet no wall, or this contact to last, until the next event.

        The proof uses Lemma 6 of docs/proofs.md.

        Returns
        -------
        bool
            False if this is not proved.
        """

        def is_clear(y: Interval) -> bool:
            """Return whether at the displacement y a flight is between the walls, or a contact beyond its wall."""
            free = (1 - self.wall) * self.beta - y, (1 + self.wall) * self.beta + y
            return is_positive(self.wall * y) if self.k != 0 else is_positive(*free)

        parts = [(ZERO, self.duration.b)]
        # at both ends of a part y is clear (`is_clear`) or on a wall; so if y' has one sign, y is clear within the part
        for _ in range(MOST_PARTS):
            low, high = parts.pop()
            part, middle = IV.mpf([low, high]), (low + high).mid / 2
            slope = self.state_after(part)[1]
            if not (is_positive(slope) or is_positive(-slope)):
                y = self.state_after(middle)[0]
                if not is_clear(y):
                    return False
                if not is_clear(y + slope * (part - middle)):  # the sum encloses y on the part
                    parts += [(low, middle), (middle, high)]
            if not parts:
                return True
        return False


def characteristic_roots(trace: Interval, determinant: Interval) -> list[Interval]:
    """Return the roots λ₁ and λ₂ of λ² − trace λ + determinant as [Re λ₁, Im λ₁, Re λ₂, Im λ₂]."""
    half, square = trace / 2, trace**2 / 4 - determinant
    root = IV.sqrt(abs(square))
    if is_positive(square):
        return [half + root, ZERO, half - root, ZERO]
    return [half, root, half, -root] if is_positive(-square) else [half + root * UNIT, root * UNIT] * 2


def check(text: str) -> str:
    """Prove the theorem of a certificate, a JSON document, and return it in words. Raises Refusal."""
    try:
        document = json.loads(text)
        require(document["format"] == 1, "`format` must be 1")
        motion = CertifiedMotion(document)
        x = motion.enclose_motion()
        motion.require_admissible(x)
        motion.require_least_period(x)
        trace, determinant = motion.trace(x), IV.exp(-motion.delta * motion.m) * (1 + SLACK)
        claims = [document["trace"], document["determinant"], *document["multipliers"]]
        for x, ends in zip([trace, determinant, *characteristic_roots(trace, determinant)], claims, strict=True):
            low, high = (interval_of_text(end) for end in ends)
            ok = is_positive(x - low, high - x) or x == low == high == ZERO
            require(ok, f"trace, determinant or a multiplier is not proved to be between {' and '.join(ends)}")
        room = 1 + determinant - trace, 1 + determinant + trace
        outside, verdict = is_positive(-room[0]) or is_positive(-room[1]), document["verdict"]
        require(
            {"attracting": is_positive(*room), "saddle": outside}.get(verdict, verdict == "undecided"),
            f"the verdict {verdict!r} is not proved",
        )
        where = ", ".join(f"{name} = {value}" for name, value in document["parameters"].items())
        return f"P({', '.join(map(str, document['label']))}), {verdict}, at {where}"
    except (LookupError, TypeError, ValueError, ArithmeticError, AttributeError, RecursionError) as error:
        raise Refusal(
            f"the certificate cannot be checked, perhaps because it is incomplete or malformed: {error}"
        ) from error


def main(path: str) -> int:
    """Check the certificate on each line of a file, and print the results. Return 1 if one is refused, else 0."""
    status = 0
    with open(path, encoding="utf-8") as file:
        for number, line in enumerate(file, 1):
            try:
                print(f"proved: {check(line)}")
            except Refusal as why:
                print(f"NOT PROVED, line {number}: {why}")
                status = 1
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
