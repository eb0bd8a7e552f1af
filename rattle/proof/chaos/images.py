"""The image under Π of a small set of departures from Σ⁺, in balls: t is an impact's time, v the speed after it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from rattle.errors import NotProvedError
from rattle.flight import first_impact, law
from rattle.flight.forcing import DRIFT
from rattle.proof.balls import arb, arb_mat
from rattle.proof.flights import FlightEnclosure, ModelPlane, require_first, sign

GROWN = 1.25  # factor that widens the guessed ball of arrival times after each refusal
MOST_GROWN = 6
MOST_NEWTON = 3
MOST_PARTS = 200  # parts into which a flight may be cut
NEAR = 1e-15  # radius of the ball of the middle flight's arrival time


class Image(NamedTuple):
    """The image of a set's midpoint, and the derivatives of Π over the whole set by coordinates in [−1, 1]²."""

    middle: tuple[arb, arb]
    slope: arb_mat


@dataclass(frozen=True)
class Arrival:
    """Time and velocity of arrival of the middle flight, and their derivatives (2, 2) over the whole set."""

    time: arb
    velocity: arb
    slope: arb_mat


def image(plane: ModelPlane, centre: tuple[arb, arb], sides: arb_mat, walls: Sequence[int]) -> Image:
    """Return the image under Π of the states centre + sides [−1, 1]², whose motions meet `walls` before Σ⁺.

    Returns
    -------
    Image
        Enclosures of the time, the speed and the derivatives by the coordinates in [−1, 1]².

    Raises
    ------
    NotProvedError
        If the order of impacts is not proved for all states.
    """
    turn = arb_mat([[1, 0], [0, -1]])  # reverses the velocity: from a speed on Σ⁺ to a velocity, and at an impact
    middle, sides, wall = (centre[0], -centre[1]), turn * sides, 1
    for target in (*walls, 1):
        here = arrival(plane, middle, sides, wall, target)
        middle, sides, wall = (here.time, -here.velocity), turn * here.slope * sides, target
    return Image((middle[0], -middle[1]), turn * sides)


def arrival(plane: ModelPlane, middle: tuple[arb, arb], sides: arb_mat, wall: int, target: int) -> Arrival:
    """Return the arrivals of flights from `wall` with states middle + sides [−1, 1]² that first reach `target`."""
    distance, name = plane.beta * (target - wall), "a flight"
    time = _time(plane, middle, wall, target)
    bundle = FlightBundle(plane, middle, sides)
    at_middle = bundle.until(time)
    by_t0, by_w0 = _derivatives(at_middle, time)
    guess = abs(spread_of_sides(sides, by_t0[0], by_w0[0]) / at_middle.w1) + arb(1e-25)
    missed = bundle.height(time) - distance
    for _ in range(MOST_GROWN):
        guess = guess.upper() * GROWN
        late = arb(0, 1) * guess
        speed = bundle.all_until(time + late).w1
        if not (speed > 0 or speed < 0):
            raise NotProvedError(f"{name} is not proved to leave and reach its walls with speeds that are not 0")
        moved = -missed / speed
        if abs(moved) < guess:
            break
        guess = guess.max(abs(moved))
    else:
        raise NotProvedError(f"Newton's interval method does not enclose the time at which {name} ends")
    here = bundle.all_until(time + moved)
    bundle.require_clear(here, wall, target, name)
    (height_t0, speed_t0), (height_w0, speed_w0) = _derivatives(here, here.t1)
    pull = plane.force(*(2 * here.t1).sin_cos_pi()) - plane.delta * here.w1
    late_t0, late_w0 = -height_t0 / here.w1, -height_w0 / here.w1
    slope = arb_mat([[late_t0, late_w0], [speed_t0 + pull * late_t0, speed_w0 + pull * late_w0]])
    return Arrival(time, at_middle.w1, slope)


def spread_of_sides(sides: arb_mat, by_t0: arb, by_w0: arb) -> arb:
    """Return the largest |by_t0 dt₀ + by_w0 dw₀| for (dt₀, dw₀) in sides [−1, 1]²."""
    return sum((abs(by_t0 * sides[0, j] + by_w0 * sides[1, j]) for j in range(2)), arb(0))


@dataclass(frozen=True)
class FlightBundle:
    """Flights that leave a wall with times and velocities middle + sides [−1, 1]²."""

    plane: ModelPlane
    middle: tuple[arb, arb]
    sides: arb_mat

    @cached_property
    def hull(self) -> tuple[arb, arb]:
        """Balls that hold the departure times and velocities of all flights."""
        unit = arb(0, 1)
        t0, w0 = (self.middle[i] + unit * sum((abs(self.sides[i, j]) for j in range(2)), arb(0)) for i in range(2))
        return t0, w0

    def until(self, t: arb) -> FlightEnclosure:
        """Return the middle flight until the time t."""
        return _flight(self.plane, *self.middle, t)

    def all_until(self, t: arb) -> FlightEnclosure:
        """Return an enclosure of all flights until the time t."""
        return _flight(self.plane, *self.hull, t)

    def height(self, t: arb) -> arb:
        """Enclose Φ(t) − Φ(t₀) of all flights by the mean value theorem."""
        return self._at(t, 0)

    def speed(self, t: arb) -> arb:
        """Enclose Φ'(t) of all flights by the mean value theorem."""
        return self._at(t, 1)

    def _at(self, t: arb, which: int) -> arb:
        by_t0, by_w0 = _derivatives(self.all_until(t), t)
        return self.until(t).at(t)[which] + arb(0, 1) * spread_of_sides(self.sides, by_t0[which], by_w0[which])

    def require_clear(self, here: FlightEnclosure, wall: int, target: int, name: str) -> None:
        """Raise NotProvedError unless the flights meet no wall before they arrive.

        The proof uses the extrema of Φ. If these cannot be separated, the time is bisected: in each part Φ' keeps one
        sign, or Φ stays clear of the walls.

        Raises
        ------
        NotProvedError
            If the flights may meet a wall.
        """
        try:
            require_first(here, wall, target, name)
        except NotProvedError:
            if sign(here.w0) != -wall or sign(here.w1) != target or not here.t1 > here.t0:
                raise
        else:
            return
        above, below = here.plane.beta * (1 - wall), -here.plane.beta * (1 + wall)
        parts = [(here.t0.lower(), here.t1.upper())]
        for _ in range(MOST_PARTS):
            start, end = parts.pop()
            part = start.union(end)
            middle, slope = part.mid(), self.speed(part)
            if not (slope > 0 or slope < 0):
                height = self.height(middle) + slope * (part - middle)
                if not (height < above and height > below):
                    parts += [(start, middle), (middle, end)]
            if not parts:
                return
        raise NotProvedError(f"{name} is not proved clear of the walls before its end")


def _flight(plane: ModelPlane, t0: arb, w0: arb, t1: arb) -> FlightEnclosure:
    """Return the flight from time t0 with velocity w0 until t1, without its derivatives."""
    (sin0, cos0), sin1 = (2 * t0).sin_cos_pi(), (2 * t1).sin_pi()
    rest, decay, none = plane.drift - plane.swing * sin0 - w0, (-plane.delta * (t1 - t0)).exp(), arb.nan()
    w1 = plane.drift - plane.swing * sin1 - rest * decay
    return FlightEnclosure(plane, t0, t1, rest, cos0, w0, w1, decay, none, none, none, none)


def _derivatives(here: FlightEnclosure, t: arb) -> tuple[tuple[arb, arb], tuple[arb, arb]]:
    """Return the derivatives of Φ − Φ(t₀) and Φ' at the time t, by t₀ and by w₀."""
    plane, (sin0, _) = here.plane, (2 * here.t0).sin_cos_pi()
    kept = (-plane.delta * (t - here.t0)).exp()
    reach = (1 - kept) / plane.delta
    push = plane.delta * here.w0 - plane.force(sin0, here.cos0)
    return (reach * push - here.w0, kept * push), (reach, kept)


def _time(plane: ModelPlane, middle: tuple[arb, arb], wall: int, target: int) -> arb:
    """Return a small ball of the time at which the middle flight ends."""
    numbers = (float(each) for each in (*middle, plane.delta, plane.epsilon, plane.beta))
    t0, w0, delta, epsilon, beta = numbers
    status, length, met, _ = first_impact.first_impact(wall, float(law.folded(t0)), w0, delta, epsilon, beta, DRIFT)[:4]
    if status != first_impact.OK or met != target:
        raise NotProvedError("the motion from the centre of a set does not meet the expected walls")
    time, distance = (middle[0] + arb(float(length))).mid(), plane.beta * (target - wall)
    for _ in range(MOST_NEWTON):
        height, speed = _flight(plane, *middle, time).at(time)
        time = (time - (height - distance) / speed).mid()
    late = arb(0, NEAR)
    missed, speed = _flight(plane, *middle, time).at(time)[0] - distance, _flight(plane, *middle, time + late).w1
    if not (speed > 0 or speed < 0) or not abs(missed / speed) < NEAR:
        raise NotProvedError("the motion from the centre of a set may graze a wall")
    return time - missed / speed
