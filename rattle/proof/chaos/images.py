"""The impact map Π of a small set of departures from Σ⁺, in balls: t the time of an impact, v the speed after it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from rattle.errors import NotProvedError
from rattle.flight import first_impact, law
from rattle.proof.balls import arb, arb_mat
from rattle.proof.flights import Flight, Plane, require_first

GROWN = 1.25  # by which the guess of a ball of arrival times is widened, each time that it is refused
MOST_GROWN = 6
MOST_NEWTON = 3
NEAR = 1e-15  # what is left of the middle's time of arrival


class Image(NamedTuple):
    """Where the middle of a set goes, and the derivatives of Π on all of it: Π(x) lies in middle + slope (x − c)."""

    middle: tuple[arb, arb]
    slope: arb_mat


@dataclass(frozen=True)
class Arrival:
    """The ends (time, velocity) of flights from a set of departures: of its middle, and their derivatives (2, 2)."""

    time: arb
    velocity: arb
    slope: arb_mat


def image(plane: Plane, centre: tuple[arb, arb], radius: tuple[arb, arb], walls: Sequence[int]) -> Image:
    """Π of all (t, v) in centre ± radius, whose motions meet these walls between two impacts on Σ⁺.

    Raises NotProvedError unless that is proved of all of them.
    """
    (t, v), (rt, rv) = centre, radius
    middle, spread = (t, -v), arb_mat(2, 1, [arb(0, 1) * rt, arb(0, 1) * rv])
    slope, wall = arb_mat([[1, 0], [0, -1]]), 1
    for target in (*walls, 1):
        wide = slope * spread
        here = arrival(plane, middle, (wide[0, 0], wide[1, 0]), wall, target)
        middle, wall = (here.time, -here.velocity), target
        slope = arb_mat([[1, 0], [0, -1]]) * here.slope * slope
    return Image((middle[0], -middle[1]), arb_mat([[1, 0], [0, -1]]) * slope)


def arrival(plane: Plane, middle: tuple[arb, arb], wide: tuple[arb, arb], wall: int, target: int) -> Arrival:
    """The flights from a wall at times and with velocities middle + wide, which end first at the wall `target`."""
    distance, name = plane.beta * (target - wall), "a flight"
    time = _time(plane, middle, wall, target)
    at_middle = _flight(plane, *middle, time)
    t0, w0 = middle[0] + wide[0], middle[1] + wide[1]
    by_t0, by_w0 = _derivatives(_flight(plane, *middle, time), time)
    guess = abs(by_t0[0] / at_middle.w1) * wide[0].rad() + abs(by_w0[0] / at_middle.w1) * wide[1].rad() + arb(1e-25)
    here = _flight(plane, t0, w0, time)
    (height_t0, _), (height_w0, _) = _derivatives(here, time)
    # Φ at the middle's time of arrival, less the wall, by the mean value theorem
    missed = at_middle.at(time)[0] - distance + height_t0 * wide[0] + height_w0 * wide[1]
    for _ in range(MOST_GROWN):
        guess = guess * GROWN
        late = arb(0, 1) * guess
        speed = _flight(plane, t0, w0, time + late).w1
        if not (speed > 0 or speed < 0):
            raise NotProvedError(f"{name} may graze")
        moved = -missed / speed
        if abs(moved) < guess.lower():
            break
    else:
        raise NotProvedError(f"the time at which {name} ends is not enclosed")
    here = _flight(plane, t0, w0, time + moved)
    require_first(here, wall, target, name)
    (height_t0, speed_t0), (height_w0, speed_w0) = _derivatives(here, here.t1)
    pull = plane.force(*(2 * here.t1).sin_cos_pi()) - plane.delta * here.w1
    rows = [[-height_t0 / here.w1, -height_w0 / here.w1], []]
    rows[1] = [speed_t0 + pull * rows[0][0], speed_w0 + pull * rows[0][1]]
    return Arrival(time, at_middle.w1, arb_mat(rows))


def _flight(plane: Plane, t0: arb, w0: arb, t1: arb) -> Flight:
    """The flight with this begin until t1; not the one between two places, so its own derivatives are left out."""
    (sin0, cos0), sin1 = (2 * t0).sin_cos_pi(), (2 * t1).sin_pi()
    rest, decay, none = plane.drift - plane.swing * sin0 - w0, (-plane.delta * (t1 - t0)).exp(), arb.nan()
    w1 = plane.drift - plane.swing * sin1 - rest * decay
    return Flight(plane, t0, t1, rest, cos0, w0, w1, decay, none, none, none, none)


def _derivatives(here: Flight, t: arb) -> tuple[tuple[arb, arb], tuple[arb, arb]]:
    """Of Φ − Φ(t₀) and Φ' at a given time t, by t₀ and by w₀."""
    plane, (sin0, _) = here.plane, (2 * here.t0).sin_cos_pi()
    kept = (-plane.delta * (t - here.t0)).exp()
    reach = (1 - kept) / plane.delta
    push = plane.delta * here.w0 - plane.force(sin0, here.cos0)
    return (reach * push - here.w0, kept * push), (reach, kept)


def _time(plane: Plane, middle: tuple[arb, arb], wall: int, target: int) -> arb:
    """When the flight of the middle ends, in a small ball."""
    numbers = (float(each) for each in (*middle, plane.delta, plane.epsilon, plane.beta))
    t0, w0, delta, epsilon, beta = numbers
    status, length, met, _ = first_impact.first_impact(
        wall, float(law.folded(t0)), w0, delta, epsilon, beta, law.DRIFT
    )[:4]
    if status != first_impact.OK or met != target:
        raise NotProvedError("the middle of a set meets other walls")
    time, distance = (middle[0] + arb(float(length))).mid(), plane.beta * (target - wall)
    for _ in range(MOST_NEWTON):
        height, speed = _flight(plane, *middle, time).at(time)
        time = (time - (height - distance) / speed).mid()
    late = arb(0, NEAR)
    missed, speed = _flight(plane, *middle, time).at(time)[0] - distance, _flight(plane, *middle, time + late).w1
    if not (speed > 0 or speed < 0) or not abs(missed / speed) < NEAR:
        raise NotProvedError("the middle of a set may graze")
    return time - missed / speed
