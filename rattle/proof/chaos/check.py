"""Check certificates of horseshoes, with mpmath's intervals and none of the finder's code.

Of this project the program imports only `rattle/proof/check.py`, for intervals. A set is a parallelogram
(t, v) = centre + ξ unstable + η stable with |ξ| ≤ 1 and |η| ≤ 1, where v is the speed after an impact on Σ⁺ at time t.
The lemmas and the numbers of equations are those of docs/proofs.md.
"""

import json
import math
from fractions import Fraction
from functools import cached_property
from typing import Any

from rattle.proof.check import (
    IV,
    SLACK,
    TWO_PI,
    UNIT,
    ZERO,
    Interval,
    Refusal,
    interval_of_text,
    is_positive,
    require,
    sine_and_cosine,
)

#: A set is cut into at most MOST_PARTS parts, and the time of a flight into at most MOST_TIMES parts. A part that is
#: cut further counts too.
MOST_PARTS, MOST_TIMES = 4000, 300
#: A certificate may have at most MOST_SETS sets and MOST_LOOPS loops, and a loop at most MOST_LENGTH steps.
MOST_SETS, MOST_LOOPS, MOST_LENGTH = 2000, 200, 100
Vector = tuple[Interval, Interval]
Part = tuple[float, float, float, float]  # a part of a set: ξ and η of its middle, half widths in ξ and η
#: The whole of a set, and its edges ξ = −1 and ξ = 1.
WHOLE, EDGES = (0.0, 0.0, 1.0, 1.0), ((-1.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 1.0))


class CheckedFlightBundle:
    """The flights that leave a wall at (time, velocity) = middle + a sides[0] + b sides[1], where |a|, |b| ≤ 1.

    hull: intervals that contain the times and the velocities of all departures.
    """

    def __init__(self, claim: "HorseshoeClaim", wall: int, middle: Vector, sides: tuple[Vector, Vector]) -> None:
        self.claim, self.wall, self.middle, self.sides = claim, wall, middle, sides
        self.hull = tuple(x + UNIT * (abs(a) + abs(b)) for x, a, b in zip(middle, *sides, strict=True))

    def flight_state(self, start: Vector, t: Interval) -> Vector:
        """Return Φ(t) − Φ(t₀) and Φ'(t) for flights from `start` = (t₀, w₀), by (1.4) to (1.6) of docs/proofs.md."""
        (sine, cosine), (sine1, cosine1), d, e = (
            sine_and_cosine(start[0]),
            sine_and_cosine(t),
            self.claim.delta,
            self.claim.epsilon,
        )
        kept, pushed = self.decay_factor(start, t), start[1] - 2 * TWO_PI + TWO_PI * e * sine
        y = 2 * TWO_PI * (t - start[0]) + e * (cosine1 - cosine) + (1 - kept) / d * pushed
        return y, 2 * TWO_PI - TWO_PI * e * sine1 + kept * pushed

    def decay_factor(self, start: Vector, t: Interval) -> Interval:
        """Return e^(−δ(t − t₀)) for flights from `start` = (t₀, w₀)."""
        return IV.exp(-self.claim.delta * (t - start[0])) * (1 + SLACK)

    def state_derivatives(self, t: Interval) -> tuple[Vector, Vector]:
        """Return the derivatives of Φ(t) and Φ'(t) by a and by b, for departures middle + a sides[0] + b sides[1]."""
        # with c = e^(−δ(t − t₀)), s = (1 − c)/δ and w₀' = Φ'' at the departure: ∂Φ/∂t₀ = −(w₀ + s w₀'), ∂Φ/∂w₀ = s,
        # ∂Φ'/∂t₀ = −c w₀', ∂Φ'/∂w₀ = c
        c = self.decay_factor((self.hull[0], self.hull[1]), t)
        s = (1 - c) / self.claim.delta
        y, v = (-self.hull[1] - s * self.initial_acceleration, s), (-c * self.initial_acceleration, c)
        heights, speeds = ([by[0] * side[0] + by[1] * side[1] for side in self.sides] for by in (y, v))
        return (heights[0], heights[1]), (speeds[0], speeds[1])

    @cached_property
    def initial_acceleration(self) -> Interval:
        """The acceleration Φ'' at the departure, over all departures of the parallelogram."""
        return self.claim.force(self.hull[0]) - self.claim.delta * self.hull[1]

    def state_at(self, t: Interval) -> Vector:
        """Return enclosures of Φ(t) − Φ(t₀) and Φ'(t) over all flights from the parallelogram of departures."""
        (y, v), (heights, speeds) = self.flight_state(self.middle, t), self.state_derivatives(t)
        return y + UNIT * (abs(heights[0]) + abs(heights[1])), v + UNIT * (abs(speeds[0]) + abs(speeds[1]))

    def states_after_impact(self, target: int) -> tuple[Vector, tuple[Vector, Vector]]:
        """Return a parallelogram that contains the states (time, velocity) of all flights after impact on `target`.

        Returns
        -------
        tuple[Vector, tuple[Vector, Vector]]
            The centre of the parallelogram, and its half sides: vectors from the centre to the middles of two sides.

        Raises
        ------
        Refusal
            If a flight may graze, or meet another wall first.
        """
        end = (target - self.wall) * self.claim.beta
        time = self.guess_arrival_time(target)
        for _ in range(5):
            y, v = self.flight_state(self.middle, time)
            time = IV.mpf((time - (y - end) / v).mid)
        delay = self.enclose_delay(
            self.flight_state(self.middle, time)[0] - end, time, IV.mpf(10) ** -30, only_middle=True
        )
        landing = time + delay  # arrival time of the flight from the middle
        delay = self.enclose_delay(self.state_at(landing)[0] - end, time, IV.mpf(10) ** -20, only_middle=False)
        arrival = time + delay  # arrival times of all flights
        speed = self.state_at(arrival)[1]
        require(
            is_positive(-self.wall * self.hull[1], target * speed), "a flight may start or end behind a wall, or graze"
        )
        require(self.stays_between_walls(arrival), "a flight is not proved to meet no other wall before its end")
        heights, speeds = self.state_derivatives(arrival)
        pull = self.claim.force(arrival) - self.claim.delta * speed
        moved = [(-h / speed, -(v - pull * h / speed)) for h, v in zip(heights, speeds, strict=True)]
        return (landing, -self.flight_state(self.middle, landing)[1]), (moved[0], moved[1])

    def enclose_delay(self, missed: Interval, time: Interval, bound: Interval, only_middle: bool) -> Interval:
        """Return the delay after `time` with which flights reach their wall, by Newton's interval method.

        Parameters
        ----------
        missed : Interval
            Φ minus the position of the wall, at `time`.
        bound : Interval
            First guess of a bound of the delay.
        only_middle : bool
            True: enclose the delay of the flight from the middle. False: enclose the delays of all flights.

        Returns
        -------
        Interval
            An enclosure of the delay; each flight reaches the wall exactly once within it.

        Raises
        ------
        Refusal
            If a flight may graze, or no bound of the delay is found.
        """
        for _ in range(8):
            around = time + bound * UNIT
            speed = self.flight_state(self.middle, around)[1] if only_middle else self.state_at(around)[1]
            require(is_positive(speed) or is_positive(-speed), "a flight may graze")
            delay = -missed / speed
            if is_positive(bound - delay, bound + delay):
                return delay
            bound = IV.mpf(1.3) * max(bound, IV.mpf(abs(delay).b))
        raise Refusal("the time of an impact is not enclosed")

    def guess_arrival_time(self, target: int) -> Interval:
        """Return a guess of the time at which the flight from the middle departure reaches `target`. Raises Refusal."""
        t0, w, d, e, b = (float(x.mid) for x in (*self.middle, self.claim.delta, self.claim.epsilon, self.claim.beta))
        turn, end = 2 * math.pi, (target - self.wall) * b
        pushed = w - 2 * turn + turn * e * math.sin(turn * t0)

        def height(t: float) -> float:
            """Return Φ(t) minus the position of the wall."""
            gone = e * (math.cos(turn * t) - math.cos(turn * t0)) - math.expm1(-d * (t - t0)) / d * pushed
            return 2 * turn * (t - t0) + gone - end

        low, step = t0 + 1e-6, 2e-3
        for _ in range(4000):
            if height(low) * height(low + step) <= 0:
                high = low + step
                for _ in range(60):
                    middle = (low + high) / 2
                    low, high = (low, middle) if height(low) * height(middle) <= 0 else (middle, high)
                return IV.mpf(low)
            low += step
        raise Refusal("a flight does not reach its wall within 8 forcing periods")

    def stays_between_walls(self, arrival: Interval) -> bool:
        """Return whether all flights are proved to meet no wall before their arrival, by Lemma 6 of docs/proofs.md.

        arrival: an interval that contains the arrival times of all flights from the parallelogram of departures.

        Returns
        -------
        bool
            False if this is not proved.
        """
        parts = [(IV.mpf(self.hull[0].a), IV.mpf(arrival.b))]
        above, below = (1 - self.wall) * self.claim.beta, (1 + self.wall) * self.claim.beta
        for _ in range(MOST_TIMES):
            low, high = parts.pop()
            part, middle = IV.mpf([low.a, high.b]), IV.mpf(((low + high) / 2).mid)
            slope = self.state_at(part)[1]
            if not (is_positive(slope) or is_positive(-slope)):
                y = self.state_at(middle)[0] + slope * (part - middle)
                if not is_positive(above - y, below + y):
                    parts += [(low, middle), (middle, high)]
            if not parts:
                return True
        return False


class HorseshoeClaim:
    """The statement of a certificate: parameters, sets and loops.

    sets, numbers: each set, as six intervals and as six exact numbers. These are the coordinates (t, v) of its centre,
    of its half side `unstable` and of its half side `stable`.
    loops: for each loop the numbers of its sets, the impacts on Σ⁻ in each step, and the forcing periods of each step.
    """

    def __init__(self, document: Any) -> None:
        require(document["model"] == "impacting", "`model` must be 'impacting'")
        require(
            {*document["parameters"]} == {"delta", "epsilon", "beta"}, "`parameters` must be delta, epsilon and beta"
        )
        self.delta, self.epsilon, self.beta = (
            interval_of_text(document["parameters"][n]) for n in ("delta", "epsilon", "beta")
        )
        require(is_positive(self.delta, self.epsilon, self.beta), "all parameters must be positive")
        require(0 < len(document["sets"]) <= MOST_SETS, f"the number of sets must be from 1 to {MOST_SETS}")
        self.sets = [[interval_of_text(number) for number in each] for each in document["sets"]]
        self.numbers = [[Fraction(number) for number in each] for each in document["sets"]]
        require(all(len(each) == 6 for each in self.sets), "each set must be six numbers")
        self.loops = [(each["sets"], each["sigma_minus"], each["periods"]) for each in document["loops"]]
        require(1 < len(self.loops) <= MOST_LOOPS, f"the number of loops must be from 2 to {MOST_LOOPS}")
        for sets, words, periods in self.loops:
            whole = all(type(x) is int and x >= 0 for x in [*sets, *words]) and all(type(x) is int for x in periods)
            fits = len(words) == len(periods) == len(sets) + 1 <= MOST_LENGTH and all(x < len(self.sets) for x in sets)
            require(
                whole and fits and max(words) <= MOST_LENGTH and sum(periods) > 0,
                "a loop must list whole numbers in `sets`, `sigma_minus` and `periods`, where `sets` has one element "
                "less than either of the others, and `periods` has a sum above 0",
            )

    def force(self, t: Interval) -> Interval:
        """Return the contact force g(t), (1.2) of docs/proofs.md."""
        sine, cosine = sine_and_cosine(t)
        return TWO_PI * (2 * self.delta - self.epsilon * (TWO_PI * cosine + self.delta * sine))

    def image(self, source: int, part: Part, word: int) -> tuple[Vector, tuple[Vector, Vector]]:
        """Return a parallelogram that contains the image under Π of a part of a set.

        word: the number of impacts on Σ⁻ between the two impacts on Σ⁺.

        Returns
        -------
        tuple[Vector, tuple[Vector, Vector]]
            The image of the middle of the part, and the two half sides of the parallelogram.
        """
        (t, v, *along), (xi, eta, width, height) = self.sets[source], part
        middle = t + xi * along[0] + eta * along[2], -(v + xi * along[1] + eta * along[3])
        sides = (width * along[0], -width * along[1]), (height * along[2], -height * along[3])
        wall = 1
        for target in (*[-1] * word, 1):
            middle, sides = CheckedFlightBundle(self, wall, middle, sides).states_after_impact(target)
            wall = target
        return (middle[0], -middle[1]), (
            (sides[0][0], -sides[0][1]), (sides[1][0], -sides[1][1]),
        )  # fmt: skip

    def image_in_set_coordinates(
        self, target: int, periods: int, image: tuple[Vector, tuple[Vector, Vector]]
    ) -> tuple[Vector, list[Any]]:
        """Return an image in the coordinates (ξ, η) of the set `target`, which is shifted by `periods` forcing periods.

        image: the centre (t, v) and the two half sides of a parallelogram that contains the image.

        Returns
        -------
        tuple[Vector, list[Any]]
            Intervals of ξ and η over the image. Then, for each half side of the parallelogram (a vector), the larger of
            its two extents, in ξ and in η.
        """
        (t, v, a, c, b, d), (middle, sides) = self.sets[target], image
        size = a * d - b * c
        require(is_positive(size) or is_positive(-size), "the sides of a set are parallel, so it has no area")
        away = middle[0] - t - periods, middle[1] - v
        start, *extents = (((d * x - b * y) / size, (a * y - c * x) / size) for x, y in (away, *sides))
        xi, eta = (start[i] + UNIT * (abs(extents[0][i]) + abs(extents[1][i])) for i in range(2))
        return (xi, eta), [max(float(abs(x).b) for x in each) for each in extents]

    def require_covering(self, source: int, target: int, word: int, periods: int) -> None:
        """Raise Refusal unless the set `source` covers the set `target` (Lemma 11 of docs/proofs.md).

        The target is shifted by `periods` forcing periods, and `word` is the number of impacts on Σ⁻ in the step from
        source to target. In the target's coordinates Π maps one edge ξ = ±1 of the source to ξ < −1 and the other to
        ξ > 1, and no point of the source to |ξ| ≤ 1 ≤ |η|.
        """
        went = [self.sides_of_parts(source, target, word, periods, edge, inside_allowed=False) for edge in EDGES]
        require(
            went in ([{-1}, {1}], [{1}, {-1}]),
            f"the edges of set {source} are not mapped to both sides of set {target}",
        )
        self.sides_of_parts(source, target, word, periods, WHOLE, inside_allowed=True)

    def sides_of_parts(
        self, source: int, target: int, word: int, periods: int, part: Part, inside_allowed: bool
    ) -> set[int]:
        """Return the sides of the set `target` to which Π maps a part of the set `source`.

        The part is halved until a side is proved for each of the smaller parts. The target is shifted by `periods`
        forcing periods, and `word` is the number of impacts on Σ⁻ in the step from source to target.

        Returns
        -------
        set[int]
            In the coordinates (ξ, η) of the target: 1 if Π maps a smaller part to ξ > 1, −1 if it maps one to ξ < −1.
            If `inside_allowed`, also 0 if it maps one to |η| < 1.

        Raises
        ------
        Refusal
            If the side of a smaller part is not proved.
        """
        parts, sides = [part], set()
        for _ in range(MOST_PARTS):
            here, extents = parts.pop(), [1.0, 1.0]
            try:
                (xi, eta), extents = self.image_in_set_coordinates(target, periods, self.image(source, here, word))
                if is_positive(xi - 1) or is_positive(-1 - xi):
                    sides.add(1 if is_positive(xi) else -1)
                elif inside_allowed and is_positive(1 - eta, 1 + eta):
                    sides.add(0)
                else:
                    parts += halve_part(here, extents)
            except Refusal:
                parts += halve_part(here, extents)
            if not parts:
                return sides
        raise Refusal(f"set {source} is not proved to cover set {target}")

    def require_disjoint(self, one: int, other: int) -> None:
        """Raise Refusal unless the sets with these two numbers are proved to be disjoint, with times taken modulo 1."""
        for periods in (-2, -1, 0, 1, 2):
            a, b = self.corners(one, 0), self.corners(other, periods)
            normals = [(c[i][1] - c[0][1], c[0][0] - c[i][0]) for c in (a, b) for i in (1, 2)]
            along = [[[x * t + y * v for t, v in c] for c in (a, b)] for x, y in normals]
            ok = any(max(p) < min(q) or max(q) < min(p) for p, q in along)
            require(ok, f"sets {one} and {other} may meet")

    def corners(self, number: int, periods: int) -> list[tuple[Fraction, Fraction]]:
        """Return the corners (t, v) of set `number`, shifted by `periods` forcing periods."""
        t, v, *along = self.numbers[number]
        require(
            abs(t) + abs(along[0]) + abs(along[2]) < 1.5,
            f"the times of set {number} must be within 1.5 forcing periods of 0",
        )
        signs = [(x, y) for x in (-1, 1) for y in (-1, 1)]
        return [(t + periods + x * along[0] + y * along[2], v + x * along[1] + y * along[3]) for x, y in signs]


def halve_part(part: Part, extents: list[float]) -> list[Part]:
    """Cut a part in two: halve its side whose image is longer. Raises Refusal if the part is too small.

    extents: for each side of the part the extent of the side's image, from `image_in_set_coordinates`.

    Returns
    -------
    list[Part]
        The two halves.
    """
    xi, eta, width, height = part
    require(max(width, height) > 2.0**-14, "a set is not proved to be stretched across the next set")
    if width and (not height or (extents[0], width) >= (extents[1], height)):
        return [(xi + side * width / 2, eta, width / 2, height) for side in (-1, 1)]
    return [(xi, eta + side * height / 2, width, height / 2) for side in (-1, 1)]


def check(text: str) -> str:
    """Prove the theorem of a certificate, a JSON document, and return it in words. Raises Refusal."""
    try:
        document = json.loads(text)
        require(
            document["format"] == 1 and document["theorem"] == "horseshoe",
            "`format` and `theorem` must be 1 and 'horseshoe'",
        )
        claim = HorseshoeClaim(document)
        heads = [(*sets, 0)[0] for sets, _, _ in claim.loops]
        for i, one in enumerate(heads):
            for other in heads[:i]:
                claim.require_disjoint(one, other)
        for name, number in (("impact", 1), ("period", 2)):
            h = interval_of_text(document[f"entropy_per_{name}"])
            lengths = [len(loop[1]) if number == 1 else sum(loop[2]) for loop in claim.loops]
            total = sum((IV.exp(-h * length) * (1 + SLACK) for length in lengths), ZERO)
            require(
                is_positive(h, total - 1), f"`entropy_per_{name}` must be positive and no larger than the loops prove"
            )
        for sets, words, periods in claim.loops:
            chain = [0, *sets, 0]
            for source, target, word, later in zip(chain, chain[1:], words, periods, strict=False):
                claim.require_covering(source, target, word, later)
        where = ", ".join(f"{name} = {value}" for name, value in document["parameters"].items())
        least = document["entropy_per_impact"], document["entropy_per_period"]
        return f"a horseshoe of entropy {least[0]} an impact on Σ⁺, {least[1]} a forcing period, at least, at {where}"
    except (LookupError, TypeError, ValueError, ArithmeticError, AttributeError, RecursionError) as error:
        raise Refusal(
            f"the certificate cannot be checked, perhaps because it is incomplete or malformed: {error}"
        ) from error
