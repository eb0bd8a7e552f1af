"""Enclosures of the impact map Π on a small set of departures (t, v) from Σ⁺, t the time and v the speed.

The method is Lemma 14 of docs/proofs.md. A set is a parallelogram middle + sides [−1, 1]². All flights from a set form
a bundle; the flight from its middle is the middle flight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from rattle.errors import NotProvedError
from rattle.flight import first_impact, law
from rattle.flight.forcing import DRIFT
from rattle.proof.balls import arb, arb_mat
from rattle.proof.flights import FlightEnclosure, ModelPoint, proved_sign, require_first_impact

#: The guessed interval of arrival times is made wider by the factor WIDENING, at most MOST_WIDENINGS times.
WIDENING = 1.25
MOST_WIDENINGS = 6
#: Number of Newton steps for the arrival time of the flight from the middle of a set.
MOST_NEWTON = 3
#: Most parts of the time of a flight that are tested; a part that fails its test is bisected.
MOST_PARTS = 200
#: Largest error of the arrival time of the flight from the middle of a set, in forcing periods.
ARRIVAL_ERROR = 1e-15


class ImageOfSet(NamedTuple):
    """The image of a set under Π: the image of its middle, and the derivatives of Π over the whole set.

    slope: derivatives of (t, v) with respect to the coordinates of the set in [−1, 1]².
    """

    middle: tuple[arb, arb]
    slope: arb_mat


@dataclass(frozen=True)
class Arrival:
    """The end of the flight from the middle of a set, and derivatives over all flights from the set.

    time, velocity: time and velocity at the end of this flight. slope: derivatives (2, 2) of time and velocity at
    the end with respect to time and velocity of departure.
    """

    time: arb
    velocity: arb
    slope: arb_mat


def enclose_image(point: ModelPoint, centre: tuple[arb, arb], sides: arb_mat, walls: Sequence[int]) -> ImageOfSet:
    """Return the image under Π of all (t, v) in centre + sides [−1, 1]².

    Parameters
    ----------
    walls : Sequence[int]
        The walls that these motions meet between two impacts on Σ⁺.

    Returns
    -------
    ImageOfSet
        Enclosures of the image of the centre and of the derivatives.

    Raises
    ------
    NotProvedError
        If it is not proved that all motions meet exactly these walls.
    """
    # `turn` changes the sign of velocities: impacts reverse them, and the speed v after Σ⁺ is the velocity −v
    turn = arb_mat([[1, 0], [0, -1]])
    middle, sides, wall = (centre[0], -centre[1]), turn * sides, 1
    for target in (*walls, 1):
        here = enclose_arrival(point, middle, sides, wall, target)
        middle, sides, wall = (here.time, -here.velocity), turn * here.slope * sides, target
    return ImageOfSet((middle[0], -middle[1]), turn * sides)


def enclose_arrival(point: ModelPoint, middle: tuple[arb, arb], sides: arb_mat, wall: int, target: int) -> Arrival:
    """Enclose the end of all flights that leave `wall` at the times and velocities middle + sides [−1, 1]².

    Their first impact is proved to be on `target`.

    Returns
    -------
    Arrival
        The end of the flight from the middle, and derivatives over all flights.

    Raises
    ------
    NotProvedError
        If a flight may graze, or meet another wall first, or the time of its end is not enclosed.
    """
    distance, name = point.beta * (target - wall), "a flight"
    time = _middle_arrival_time(point, middle, wall, target)
    # Newton's interval method encloses how much later the flights end than the flight from the middle
    bundle = FlightBundle(point, middle, sides)
    at_middle = bundle.enclose_middle_flight(time)
    by_t0, by_w0 = _flight_derivatives(at_middle, time)
    guess = abs(largest_change_over_sides(sides, by_t0[0], by_w0[0]) / at_middle.w1) + arb(1e-25)
    missed = bundle.height(time) - distance
    for _ in range(MOST_WIDENINGS):
        guess = guess.upper() * WIDENING
        late = arb(0, 1) * guess
        speed = bundle.enclose_flights(time + late).w1
        if not (speed > 0 or speed < 0):
            raise NotProvedError(f"{name} may graze: the parallelogram of states is too large or too close to a graze")
        moved = -missed / speed
        if abs(moved) < guess:
            break
        guess = guess.max(abs(moved))
    else:
        raise NotProvedError(f"the time at which {name} ends is not enclosed: the parallelogram of states is too large")
    here = bundle.enclose_flights(time + moved)
    bundle.require_no_other_impact(here, wall, target, name)
    (height_t0, speed_t0), (height_w0, speed_w0) = _flight_derivatives(here, here.t1)
    pull = point.force(*(2 * here.t1).sin_cos_pi()) - point.delta * here.w1
    late_t0, late_w0 = -height_t0 / here.w1, -height_w0 / here.w1
    slope = arb_mat([[late_t0, late_w0], [speed_t0 + pull * late_t0, speed_w0 + pull * late_w0]])
    return Arrival(time, at_middle.w1, slope)


def largest_change_over_sides(sides: arb_mat, by_t0: arb, by_w0: arb) -> arb:
    """Return the largest value of by_t0 · dt₀ + by_w0 · dw₀ over all (dt₀, dw₀) in sides [−1, 1]²."""
    return sum((abs(by_t0 * sides[0, j] + by_w0 * sides[1, j]) for j in range(2)), arb(0))


@dataclass(frozen=True)
class FlightBundle:
    """A set of flights from a wall: (time, velocity) at departure is in the parallelogram middle + sides [−1, 1]²."""

    point: ModelPoint
    middle: tuple[arb, arb]
    sides: arb_mat

    @cached_property
    def hull(self) -> tuple[arb, arb]:
        """Balls that contain the times t0 and the velocities w0 of all departures."""
        unit = arb(0, 1)
        t0, w0 = (self.middle[i] + unit * sum((abs(self.sides[i, j]) for j in range(2)), arb(0)) for i in range(2))
        return t0, w0

    def enclose_middle_flight(self, t: arb) -> FlightEnclosure:
        """Return an enclosure of the flight that starts at the middle of the set, until the time t."""
        return _flight_from_start(self.point, *self.middle, t)

    def enclose_flights(self, t: arb) -> FlightEnclosure:
        """Return an enclosure of all flights that start in the set, until the time t."""
        return _flight_from_start(self.point, *self.hull, t)

    def height(self, t: arb) -> arb:
        """Return an enclosure of Φ(t) − Φ(t₀) over all flights that start in the set, by the mean value theorem."""
        return self._state_component(t, 0)

    def velocity(self, t: arb) -> arb:
        """Return Φ'(t) over all flights that start in the set, by the mean value theorem."""
        return self._state_component(t, 1)

    def _state_component(self, t: arb, which: int) -> arb:
        """Return Φ(t) − Φ(t₀) if `which` is 0, Φ'(t) if it is 1, over all flights that start in the set."""
        by_t0, by_w0 = _flight_derivatives(self.enclose_flights(t), t)
        return self.enclose_middle_flight(t).state_at(t)[which] + arb(0, 1) * largest_change_over_sides(
            self.sides, by_t0[which], by_w0[which]
        )

    def require_no_other_impact(self, enclosure: FlightEnclosure, wall: int, target: int, name: str) -> None:
        """Prove that all flights from the set meet no wall between their start on `wall` and their end on `target`.

        enclosure: an enclosure of all these flights. name: their name in messages.

        The extrema of Φ are tried first (Lemma 3 of docs/proofs.md). If they do not decide, the time is bisected until
        in each part Φ' has one sign or Φ is strictly between the walls (Lemma 6).

        Raises
        ------
        NotProvedError
            If a flight may meet a wall before its end.
        """
        try:
            require_first_impact(enclosure, wall, target, name)
        except NotProvedError:
            if (
                proved_sign(enclosure.w0) != -wall
                or proved_sign(enclosure.w1) != target
                or not enclosure.t1 > enclosure.t0
            ):
                raise
        else:
            return
        above, below = enclosure.point.beta * (1 - wall), -enclosure.point.beta * (1 + wall)
        parts = [(enclosure.t0.lower(), enclosure.t1.upper())]
        for _ in range(MOST_PARTS):
            start, end = parts.pop()
            part = start.union(end)
            middle, slope = part.mid(), self.velocity(part)
            if not (slope > 0 or slope < 0):
                height = self.height(middle) + slope * (part - middle)
                if not (height < above and height > below):
                    parts += [(start, middle), (middle, end)]
            if not parts:
                return
        raise NotProvedError(
            f"{name} may meet a wall before its end: the parallelogram of states is too large or too close to a graze"
        )


def _flight_from_start(point: ModelPoint, t0: arb, w0: arb, t1: arb) -> FlightEnclosure:
    """Return the flight from time t0 and velocity w0 until t1; its derivatives with respect to times are NaN."""
    (sin0, cos0), sin1 = (2 * t0).sin_cos_pi(), (2 * t1).sin_pi()
    rest, decay, none = point.drift - point.velocity_amplitude * sin0 - w0, (-point.delta * (t1 - t0)).exp(), arb.nan()
    w1 = point.drift - point.velocity_amplitude * sin1 - rest * decay
    return FlightEnclosure(point, t0, t1, rest, cos0, w0, w1, decay, none, none, none, none)


def _flight_derivatives(flight: FlightEnclosure, t: arb) -> tuple[tuple[arb, arb], tuple[arb, arb]]:
    """Return the derivatives of (Φ − Φ(t₀), Φ') at the time t with respect to t₀, then those with respect to w₀."""
    point, (sin0, _) = flight.point, (2 * flight.t0).sin_cos_pi()
    kept = (-point.delta * (t - flight.t0)).exp()
    reach = (1 - kept) / point.delta
    push = point.delta * flight.w0 - point.force(sin0, flight.cos0)
    return (reach * push - flight.w0, kept * push), (reach, kept)


def _middle_arrival_time(point: ModelPoint, middle: tuple[arb, arb], wall: int, target: int) -> arb:
    """Return the time at which the flight from (time, velocity) = middle ends on `target`. Raises NotProvedError."""
    numbers = (float(each) for each in (*middle, point.delta, point.epsilon, point.beta))
    t0, w0, delta, epsilon, beta = numbers
    status, length, met, _ = first_impact.first_impact(
        wall, float(law.fold_phase(t0)), w0, delta, epsilon, beta, DRIFT
    )[:4]
    if status != first_impact.OK or met != target:
        wall_name = "Σ⁺" if target > 0 else "Σ⁻"
        raise NotProvedError(
            f"the flight from the centre of a parallelogram of states does not end on {wall_name}, or no end is found"
        )
    time, distance = (middle[0] + arb(float(length))).mid(), point.beta * (target - wall)
    for _ in range(MOST_NEWTON):
        height, speed = _flight_from_start(point, *middle, time).state_at(time)
        time = (time - (height - distance) / speed).mid()
    late = arb(0, ARRIVAL_ERROR)
    missed, speed = (
        _flight_from_start(point, *middle, time).state_at(time)[0] - distance,
        _flight_from_start(point, *middle, time + late).w1,
    )
    if not (speed > 0 or speed < 0) or not abs(missed / speed) < ARRIVAL_ERROR:
        raise NotProvedError(
            "the time of an impact of the motion from the centre of a parallelogram of states is not enclosed: the "
            "impact may be a graze"
        )
    return time - missed / speed
