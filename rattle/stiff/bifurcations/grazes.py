"""Find where a motion of the stiff gear gains or loses a contact and continues with another label.

The vector field is continuous. A contact is lost when its duration falls to 0, and gained when a flight touches a wall.
Two contacts with the same wall become one when the duration of the flight between them falls to 0, and one contact
becomes two when its depth falls to 0 in between. In each case the equations of the motion with one contact more are
regular if the duration that falls to 0 is prescribed, so this motion is started with a small duration. Its branch may
turn back in the parameter at once, within about 1/κ², as C and B do near G1.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rattle.continuation.arclength import newton_on_curve, tangent_at
from rattle.numerics.complex_step import Array
from rattle.orbits.periodic import unknowns_from_impact
from rattle.stiff.bifurcations.line import MotionsOnLine
from rattle.stiff.orbits.periodic import Failure, first_failure

LIGHT = 1e-5  # duration, in units of p, below which a contact or a flight counts as vanished
BEGUN = 0.04  # duration of a contact (σ/p) or flight (time/p²) that is started; the fold of C and B lies at 2.1
# distances from a graze, in the unknowns, at which the motion without the contact is tried
NEAREST = 10.0 ** np.arange(-9, -3)


class Graze(NamedTuple):
    """A graze: `here` is the motion without the contact that is lost or gained, `beyond` the motion on the other side.

    Each is given as a line and the unknowns y on it. beyond is None if it was not found.
    """

    here: tuple[MotionsOnLine, Array]
    beyond: tuple[MotionsOnLine, Array] | None


def graze(line: MotionsOnLine, y: Array, tangent: Array) -> Graze | None:
    """Return the graze at the last point y of a branch, whose outward tangent is given; None if there is no graze."""
    c, p = len(line.walls), line.itinerary(y).softness
    flights = np.append(y[1:c], y[0] + line.m) - y[:c] - p * y[c : 2 * c]
    same = np.array(line.walls) == np.roll(line.walls, -1)
    shortest, nearest = int(np.argmin(y[c : 2 * c])), int(np.argmin(np.where(same, flights, np.inf)))
    if c > 1 and y[c + shortest] < LIGHT:
        fewer = _without(line, y, shortest)
    elif c > 1 and same.any() and flights[nearest] < LIGHT * p:
        fewer = _merged(line, y, nearest)
    else:
        found = _with_one_more(line, y, tangent)
        return None if found is None else Graze(_on_plus(line, y), _on_plus(*found))
    here = _on_plus(*fewer)
    return Graze(here, _happening(*here))


def _on_plus(line: MotionsOnLine, y: Array) -> tuple[MotionsOnLine, Array]:
    """Return the same motion, begun at its first contact with Σ⁺; unchanged if it has no contact with Σ⁺."""
    first = line.walls.index(1) if 1 in line.walls else 0
    itinerary = line.itinerary(y)
    return replace(line, walls=itinerary.with_first_impact(first).walls), unknowns_from_impact(itinerary, y, first)


def _without(line: MotionsOnLine, y: Array, contact: int) -> tuple[MotionsOnLine, Array]:
    fewer = replace(line, walls=line.itinerary(y).without_impact(contact).walls)
    return fewer, np.delete(y, [contact, len(line.walls) + contact])


def _merged(line: MotionsOnLine, y: Array, contact: int) -> tuple[MotionsOnLine, Array]:
    """Return the motion in which a contact and the next contact are merged into one."""
    itinerary, c = line.itinerary(y), len(line.walls)
    y, walls = unknowns_from_impact(itinerary, y, contact), itinerary.with_first_impact(contact).walls
    y[c] = (y[1] - y[0]) / itinerary.softness + y[c + 1]
    return _without(replace(line, walls=walls), y, 1)


def _happening(line: MotionsOnLine, y: Array) -> tuple[MotionsOnLine, Array] | None:
    """Return the admissible motion of this itinerary that is closest to the graze y; None if there is none near."""
    rising = np.zeros(y.size)
    rising[-1] = 1.0
    tangent = tangent_at(line.problem, y, rising)
    for reach in NEAREST:
        for side in (reach, -reach):
            found = newton_on_curve(line.problem, y + side * tangent, tangent)
            if found is not None and line.is_admissible(found[0]):
                return line, found[0]
    return None


def _with_one_more(line: MotionsOnLine, y: Array, tangent: Array) -> tuple[MotionsOnLine, Array] | None:
    """Return the motion with one contact more that continues a branch beyond its end y; None if it is not found."""
    for reach in NEAREST:
        there = newton_on_curve(line.problem, y + reach * tangent, tangent)
        failure = None if there is None else first_failure(line.itinerary(there[0]), line.plane(there[0])[:-1])
        if failure is not None and failure.wall != 0:
            more, guess, constraint = (_split if failure.contact else _touching)(line, y, failure)
            found = newton_on_curve(more.problem, guess, constraint)
            if found is not None and more.is_admissible(found[0]):
                return more, found[0]
    return None


def _inserted(
    line: MotionsOnLine, y: Array, after: int, wall: int, time: float, duration: float
) -> tuple[MotionsOnLine, Array]:
    c = len(line.walls)
    more = replace(line, walls=line.itinerary(y).with_impact(after + 1, wall).walls)
    return more, np.insert(y, [after + 1, c + after + 1], [time, duration])


def _touching(line: MotionsOnLine, y: Array, failure: Failure) -> tuple[MotionsOnLine, Array, Array]:
    """Return the motion with a light contact of fixed duration where a flight touches a wall."""
    p = line.itinerary(y).softness
    duration = BEGUN * p
    more, guess = _inserted(line, y, failure.piece, failure.wall, failure.time - 0.5 * p * duration, duration)
    constraint = np.zeros(guess.size)
    constraint[len(more.walls) + failure.piece + 1] = 1.0
    return more, guess, constraint


def _split(line: MotionsOnLine, y: Array, failure: Failure) -> tuple[MotionsOnLine, Array, Array]:
    """Return the motion with a short flight of fixed duration where the depth of a contact falls to 0."""
    i, c, p = failure.piece, len(line.walls), line.itinerary(y).softness
    gap = BEGUN * p * p
    ends = y[i] + p * y[c + i]
    more, guess = _inserted(line, y, i, failure.wall, failure.time + 0.5 * gap, (ends - failure.time - 0.5 * gap) / p)
    guess[c + 1 + i] = (failure.time - 0.5 * gap - y[i]) / p
    constraint = np.zeros(guess.size)
    constraint[[i + 1, i, c + 1 + i]] = 1.0, -1.0, -p
    return more, guess, constraint
