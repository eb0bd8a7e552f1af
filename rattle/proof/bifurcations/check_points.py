"""Check certificates of points of bifurcation curves, with mpmath's intervals and none of the finder's code.

Of this project the program imports only `rattle/proof/check.py`, for intervals and the pieces of motions. A piece is a
flight from one impact to the next.

The unknowns x are the time t and the velocity w after each impact, in turn, then δ, ε or both: the parameters that the
certificate encloses. Let T be the trace of the motion's tangent map and E = e^(−δm). Then T = 1 + E at a saddle-node
(multiplier 1), T = −1 − E at a flip (multiplier −1), and w = 0 at a graze. The lemmas are in docs/proofs.md.
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
    Refusal,
    interval_of_text,
    is_positive,
    require,
    sine_and_cosine,
)

#: Half-width, in times and parameters, of the box that is proved to contain exactly one zero.
RADIUS = IV.mpf(10) ** -16
#: Half-width of the box in velocities, divided by its half-width in times.
VELOCITY_FACTOR = 1000
#: Parameters that may be unknowns.
POSSIBLE_UNKNOWNS = ("delta", "epsilon")
#: Walls, and index of the grazing impact (None: no graze), of P(1,1,0), P(1,1,1), and P(1,1,1) with a graze on Σ⁻.
P11, P111, GRAZE = ([1], None), ([1, -1], None), ([1, -1], 1)
#: {(kind, name): (walls, grazing impact)} of named curves and points. Any other certificate has its kind as its name.
NAMED_MOTIONS = {
    ("SN", "SN1"): P11, ("PD", "PDC"): P11, ("SN", "SN2"): P111, ("PD", "PD1"): P111, ("PD", "PD2"): P111,
    **{("GR", name): GRAZE for name in ("G1", "G2", "COD20", "COD21", "COD22", "COD23")},
}  # fmt: skip


class ParameterJet:
    """A number (`value`) with its derivatives with respect to all unknowns (`slopes`), as intervals.

    A constant has an empty list of slopes.
    """

    def __init__(self, value: Interval, slopes: Sequence[Interval] = ()) -> None:
        self.value, self.slopes = value, slopes

    def apply_chain_rule(self, value: Interval, slope: Interval) -> "ParameterJet":
        """Return f(self) by the chain rule; `value` and `slope` are the values of f and f' at this number."""
        return ParameterJet(value, [slope * each for each in self.slopes])

    def apply_binary_chain_rule(self, other: Any, value: Interval, by: Interval, by_other: Interval) -> "ParameterJet":
        """Return f(self, other) by the chain rule, from its `value` and its partial derivatives `by` and `by_other`."""
        own, others = self.slopes or [ZERO] * len(other.slopes), other.slopes or [ZERO] * len(self.slopes)
        return ParameterJet(value, [by * a + by_other * b for a, b in zip(own, others, strict=True)])

    def __add__(self, other: Any) -> "ParameterJet":
        """Return this number plus `other`, a jet or a constant."""
        other = as_jet(other)
        return self.apply_binary_chain_rule(other, self.value + other.value, ZERO + 1, ZERO + 1)

    def __mul__(self, other: Any) -> "ParameterJet":
        """Return this number times `other`, a jet or a constant."""
        other = as_jet(other)
        return self.apply_binary_chain_rule(other, self.value * other.value, other.value, self.value)

    def __neg__(self) -> "ParameterJet":
        """Return minus this number."""
        return self.apply_chain_rule(-self.value, ZERO - 1)

    def __sub__(self, other: Any) -> "ParameterJet":
        """Return this number minus `other`, a jet or a constant."""
        return self + -as_jet(other)

    def __truediv__(self, other: "ParameterJet") -> "ParameterJet":
        """Return this number divided by the jet `other`."""
        return self * other.apply_chain_rule(1 / other.value, -1 / other.value**2)

    __radd__, __rmul__ = __add__, __mul__

    def exp(self) -> "ParameterJet":
        """Return e^x, x being this number."""
        value = IV.exp(self.value) * (1 + SLACK)
        return self.apply_chain_rule(value, value)

    def sine_and_cosine(self) -> "tuple[ParameterJet, ParameterJet]":
        """Return the sine and the cosine of 2πx, x being this number."""
        sine, cosine = sine_and_cosine(self.value)
        return self.apply_chain_rule(sine, TWO_PI * cosine), self.apply_chain_rule(cosine, -TWO_PI * sine)


def as_jet(x: Any) -> ParameterJet:
    """Return x if it is a jet, or the constant jet of a number x."""
    return x if isinstance(x, ParameterJet) else ParameterJet(ZERO + x)


class BifurcationClaim:
    """The statement of a certificate: the walls and the kind of its motion, and the parameters.

    n: the number of impacts. impact: the number of the grazing impact, from 0, or None. point: the name of a
    codimension-two point, or None. known: {name: exact value} of the known parameters. free, ends: the names of the
    other parameters, and both ends of the interval that contains each.
    """

    def __init__(self, document: Any) -> None:
        require(document["model"] == "impacting", "`model` must be 'impacting'")
        self.walls, self.m, self.kind, self.impact = (document[key] for key in ("walls", "m", "kind", "impact"))
        self.n, self.name = len(self.walls), document["name"]
        whole = [self.m, *self.walls] + ([] if self.impact is None else [self.impact])
        require(
            all(type(x) is int for x in whole) and self.m > 0 and {*self.walls} <= {1, -1},
            "each of `walls` must be 1 or -1, `m` a positive whole number, and `impact` a whole number or null",
        )
        require(
            self.kind in ("SN", "PD", "GR") and (self.impact is None) == (self.kind != "GR"),
            "`kind` must be SN, PD or GR, and `impact` must be a number for GR and null for the others",
        )
        require(
            self.impact is None or 0 <= self.impact < self.n > 1,
            "`impact` must be the index, from 0, of the grazing impact in `walls`, which must have 2 elements or more",
        )
        if self.name != self.kind:
            meant = NAMED_MOTIONS.get((self.kind, self.name))
            require(
                meant == (self.walls, self.impact) and self.m == 1,
                f"the name {self.name!r} does not fit its kind, walls and impact",
            )
        self.point = self.name if self.name[:3] == "COD" else None
        known, solved = document["known"], document["solved"]
        require(
            {*known, *solved} == {"beta", *POSSIBLE_UNKNOWNS} and "beta" in known,
            "`known` and `solved` together must have beta, delta and epsilon, with beta in `known`",
        )
        require(
            len(known) + len(solved) == 3 and len(solved) == (2 if self.point else 1),
            "`solved` must have one parameter, or two parameters for a codimension-two point",
        )
        self.known = {name: interval_of_text(value) for name, value in known.items()}
        self.free = [name for name in POSSIBLE_UNKNOWNS if name in solved]
        self.ends = [[interval_of_text(end) for end in solved[name]] for name in self.free]
        self.times, self.radius = [interval_of_text(t) for t in document["times"]], interval_of_text(document["radius"])
        require(
            len(self.times) == self.n and is_positive(*self.known.values()),
            "`times` must have one number for each wall, and the known parameters must be positive",
        )

    def parameters(self, unknowns: Sequence[Any]) -> list[Any]:
        """Return [δ, ε]; a parameter that is not known exactly is taken from `unknowns`."""
        free = iter(unknowns[2 * self.n :])
        return [self.known[name] if name in self.known else next(free) for name in POSSIBLE_UNKNOWNS]

    def box_centre(self) -> list[Interval]:
        """Return the centre of the unknowns' box: the certificate's times, velocities from these times, parameters."""
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
        """Return the values at x of all equations, which are 0 at the bifurcation point, and their derivatives."""
        unit = [[ZERO + (i == j) for j in range(len(x))] for i in range(len(x))]
        at = [ParameterJet(value, slopes) for value, slopes in zip(x, unit, strict=True)]
        delta, epsilon = (as_jet(each) for each in self.parameters(at))
        values, pieces, turn = [], [], as_jet(TWO_PI)
        for i in range(self.n):
            j = (i + 1) % self.n
            t, w, t1, w1 = at[2 * i], at[2 * i + 1], at[2 * j] + (0 if j else self.m), at[2 * j + 1]
            (sine, cosine), (sine1, cosine1) = t.sine_and_cosine(), t1.sine_and_cosine()
            kept = (-(delta * (t1 - t))).exp()
            reach, pushed = (as_jet(1) - kept) / delta, w - 2 * turn + turn * epsilon * sine
            y = reach * pushed + 2 * turn * (t1 - t) + epsilon * (cosine1 - cosine)
            v = kept * pushed + 2 * turn - turn * epsilon * sine1
            values += [y - (self.walls[j] - self.walls[i]) * self.known["beta"], -v - w1]
            force = turn * (2 * delta - epsilon * (turn * cosine1 + delta * sine1))
            pieces.append((reach, kept, None if j == self.impact else -2 * force, w1))
        if self.impact is not None:
            values.append(at[2 * self.impact + 1])
        if self.kind != "GR" or self.point:
            values.append(self.bifurcation_condition(pieces, delta))
        return [each.value for each in values], [each.slopes for each in values]

    def bifurcation_condition(self, pieces: Sequence[Any], delta: ParameterJet) -> ParameterJet:
        """Return a number that is 0 if the motion bifurcates as stated: a condition on the tangent map of (Φ, Φ').

        The tangent map covers one period. It begins at the grazing impact, or at the first impact if no impact grazes.
        pieces: for each flight in order a tuple of four numbers. With the duration t of the flight the first two
        numbers are (1 − e^(−δt))/δ and e^(−δt). The third number is −2g with the contact force g at the end of the
        flight, or None if this end is the graze. The fourth number is the velocity after the end of the flight.

        Returns
        -------
        ParameterJet
            The condition multiplied by the velocities after all impacts but the graze.
        """
        a, b, c, d, speeds = as_jet(1), as_jet(0), as_jet(0), as_jet(1), as_jet(1)
        first = self.impact or 0
        for i in range(self.n):
            reach, kept, push, w = pieces[(first + i) % self.n]
            a, b, c, d = a + reach * c, b + reach * d, kept * c, kept * d
            # an impact has the tangent map [[−1, 0], [push/w, −1]], push = −2g; its product with w is finite at w = 0
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

    def enclose_point(self) -> list[Interval]:
        """Return intervals around the equations' only zero in the box (Lemma 2 of docs/proofs.md). Raises Refusal."""
        x = self.box_centre()
        size = len(x)
        radii = [RADIUS * (VELOCITY_FACTOR if i < 2 * self.n and i % 2 else 1) for i in range(size)]
        spread = [radius * UNIT for radius in radii]
        values, rows = self.equations(x)
        require(
            len(values) == size, f"`kind` and `name` have {len(values)} equations, but the motion has {size} unknowns"
        )
        about = (fp.matrix([[each.mid for each in row] for row in rows]) ** -1).tolist()
        for _ in range(6):  # the first step proves existence, further steps make the intervals narrower
            _, rows = self.equations([a + b for a, b in zip(x, spread, strict=True)])
            moved = []
            for i, line in enumerate(about):
                less = [sum((line[k] * rows[k][j] for k in range(size)), ZERO - (i == j)) for j in range(size)]
                moved.append(-sum(a * b + c * d for a, b, c, d in zip(line, values, less, spread, strict=True)))
            inside = (is_positive(radius - dx, radius + dx) for radius, dx in zip(radii, moved, strict=True))
            require(
                all(inside),
                "the box of the certificate is not mapped into itself: it is not proved to contain one point",
            )
            spread = moved
        return [a + b for a, b in zip(x, spread, strict=True)]

    def require_admissible(self, x: Sequence[Interval]) -> None:
        """Raise Refusal unless each flight is proved to meet no wall between its ends, with speed 0 at a graze only."""
        delta, epsilon = self.parameters(x)
        motion: Any = SimpleNamespace(
            walls=self.walls, m=self.m, k=[ZERO], delta=delta, epsilon=epsilon, beta=self.known["beta"]
        )
        for i in range(self.n):
            piece, j = MotionPiece(motion, i, x), (i + 1) % self.n
            require(is_positive(piece.duration), f"the duration of piece {i + 1} is not proved to be positive")
            require(
                i == self.impact or is_positive(-piece.wall * piece.w),
                f"piece {i + 1} is not proved to start from the inner side of its wall",
            )
            grazes = i == self.impact, j == self.impact
            require(meets_no_wall(piece, *grazes), f"piece {i + 1} is not proved to meet no wall before its end")

    def require_least_period(self, x: Sequence[Interval]) -> None:
        """Raise Refusal unless m forcing periods are proved to be the least period (Lemma 7 of docs/proofs.md)."""
        made = [i for i in range(self.n) if i != self.impact]
        walls, times = [self.walls[i] for i in made], [x[2 * i] for i in made]
        times += [t + self.m for t in times]
        for parts in range(2, len(walls) + 1):
            shift = len(walls) // parts
            if self.m % parts == len(walls) % parts == 0 and [*walls[shift:], *walls[:shift]] == walls:
                gaps = [b - a - self.m // parts for a, b in zip(times, times[shift:], strict=False)]
                require(
                    any(is_positive(gap) or is_positive(-gap) for gap in gaps),
                    f"the motion may repeat {parts} times in {self.m} forcing periods",
                )


def meets_no_wall(piece: MotionPiece, begins_grazing: bool, ends_grazing: bool) -> bool:
    """Return whether the flight `piece` is proved to meet no wall between its ends, one of which may be a graze.

    At the graze Φ' = 0 and Φ'' points away from the wall. Φ'' is proved to keep this sign during a short time next to
    the graze, so Φ is strictly inside the wall there. The rest of the flight is proved by `stays_between_walls_during`.

    Returns
    -------
    bool
        False if this is not proved.
    """
    if not (begins_grazing or ends_grazing):
        return piece.is_uninterrupted()
    wall = piece.wall if begins_grazing else piece.target
    part = piece.duration.b
    for _ in range(MOST_PARTS):
        part = part / 2
        u = IV.mpf([0, part.b]) if begins_grazing else IV.mpf([(piece.duration - part).a, piece.duration.b])
        if is_positive(-wall * (piece.force(u) - piece.delta * piece.state_after(u)[1])):
            break
    else:
        return False
    low, high = (part.a, piece.duration.b) if begins_grazing else (ZERO, (piece.duration - part).b)
    ends = [IV.mpf(low), IV.mpf(high)]
    beside = piece.state_after(ends[0] if begins_grazing else ends[1])[0]
    return is_between_walls(piece, beside) and stays_between_walls_during(piece, *ends)


def is_between_walls(piece: MotionPiece, y: Interval) -> bool:
    """Return whether Φ(start of the flight `piece`) + y is proved to be strictly between the walls."""
    return is_positive((1 - piece.wall) * piece.beta - y, (1 + piece.wall) * piece.beta + y)


def stays_between_walls_during(piece: MotionPiece, low: Interval, high: Interval) -> bool:
    """Return whether the flight `piece` is proved to stay strictly inside the walls from `low` to `high`.

    low, high: times after the start of the flight, at which it must be between the walls or on one of them.

    Returns
    -------
    bool
        False if this is not proved.
    """
    parts = [(low.a, high.b)]
    for _ in range(MOST_PARTS):
        low, high = parts.pop()
        part, middle = IV.mpf([low, high]), (low + high).mid / 2
        slope = piece.state_after(part)[1]
        if not (is_positive(slope) or is_positive(-slope)):
            y = piece.state_after(middle)[0]
            if not is_between_walls(piece, y):
                return False
            if not is_between_walls(piece, y + slope * (part - middle)):
                parts += [(low, middle), (middle, high)]
        if not parts:
            return True
    return False


def check(text: str) -> str:
    """Prove the theorem of a certificate, a JSON document, and return it in words. Raises Refusal."""
    try:
        document = json.loads(text)
        require(
            document["format"] == 1 and document["theorem"] == "bifurcation",
            "`format` and `theorem` must be 1 and 'bifurcation'",
        )
        claim = BifurcationClaim(document)
        x = claim.enclose_point()
        for value, (low, high) in zip(x[2 * claim.n :], claim.ends, strict=True):
            require(
                is_positive(value - low, high - value), "a parameter in `solved` is not proved to be between its ends"
            )
        for value, time in zip(x[: 2 * claim.n : 2], claim.times, strict=True):
            require(
                is_positive(claim.radius - (value - time), claim.radius + (value - time)),
                "a time is not proved to be within `radius` of its centre",
            )
        require(is_positive(*claim.parameters(x)), "delta and epsilon are not proved to be positive")
        claim.require_admissible(x)
        claim.require_least_period(x)
        side = {"G1": 1, "G2": -1}.get(claim.name, 0)
        require(
            side == 0 or is_positive(side * sine_and_cosine(x[0])[1]),
            "the grazing motion of G1 is C and that of G2 is A: here name and motion do not fit",
        )
        where = ", ".join(f"{name} = {value}" for name, value in document["known"].items())
        free = ", ".join(claim.free)
        return f"{claim.name} of {document['walls']}, at {where}: {free} to {widest_interval_width(claim):.0e}"
    except (LookupError, TypeError, ValueError, ArithmeticError, AttributeError, RecursionError) as error:
        raise Refusal(
            f"the certificate cannot be checked, perhaps because it is incomplete or malformed: {error}"
        ) from error


def widest_interval_width(claim: BifurcationClaim) -> float:
    """Return the width of the widest interval that a certificate states for an unknown parameter."""
    return max(float((high - low).b) for low, high in claim.ends)
