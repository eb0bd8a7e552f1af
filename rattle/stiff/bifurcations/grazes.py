"""Find where a motion of the stiff gear gains or loses a contact and continues with another label.

The vector field is continuous. A contact is lost when its duration falls to 0, and gained when a flight touches a wall.
Two contacts with the same wall become one when the duration of the flight between them falls to 0, and one contact
becomes two when its depth falls to 0 in between. In each case one contact or flight has a duration that vanishes at the
graze. The equations of the motion with one contact more are regular there if this duration is prescribed, so this
motion is solved for at a small duration. Its branch may turn back in the parameter within about 1/κ² of the graze: near
G1 it turns from C to B.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rattle.continuation.arclength import solve_on_curve, tangent_at
from rattle.numerics.complex_step import Array
from rattle.orbits.periodic_motions import unknowns_counted_from_impact
from rattle.stiff.bifurcations.line import MotionsOnLine
from rattle.stiff.orbits.periodic import FailingPiece, first_failing_piece

VANISHING = 1e-5  # duration, in units of p = 1/√(2κ), below which a contact or a flight counts as vanished
# duration, in units of p² = 1/(2κ), of a new contact or flight next to a graze; where C and B meet, the new contact of
# C lasts 2.1 of these units
STARTING_DURATION = 0.04
# distances from a graze, in the unknowns, at which an admissible motion is sought
DISTANCES_TO_TRY = 10.0 ** np.arange(-9, -3)


class Graze(NamedTuple):
    """A graze, at which a motion gains or loses a contact.

    motion_at_graze: the motion at the graze, without the contact that is gained or lost. continuing_motion: a motion of
    the branch with another label that continues from the graze; None if no such motion was found. Each motion is given
    as a line of parameters and the motion's unknowns y on this line.
    """

    motion_at_graze: tuple[MotionsOnLine, Array]
    continuing_motion: tuple[MotionsOnLine, Array] | None


def find_graze_at_branch_end(line: MotionsOnLine, y: Array, tangent: Array) -> Graze | None:
    """Return the graze at which a branch ends, from its last point y and its outward tangent; None if there is none."""
    c, p = len(line.walls), line.itinerary(y).softness
    flights = np.append(y[1:c], y[0] + line.m) - y[:c] - p * y[c : 2 * c]
    same = np.array(line.walls) == np.roll(line.walls, -1)
    shortest, nearest = int(np.argmin(y[c : 2 * c])), int(np.argmin(np.where(same, flights, np.inf)))
    if c > 1 and y[c + shortest] < VANISHING:
        fewer = _remove_contact(line, y, shortest)
    elif c > 1 and same.any() and flights[nearest] < VANISHING * p:
        fewer = _merge_contacts(line, y, nearest)
    else:
        found = _motion_with_one_more_contact(line, y, tangent)
        return None if found is None else Graze(_renumber_from_sigma_plus(line, y), _renumber_from_sigma_plus(*found))
    here = _renumber_from_sigma_plus(*fewer)
    return Graze(here, _admissible_motion_near(*here))


def _renumber_from_sigma_plus(line: MotionsOnLine, y: Array) -> tuple[MotionsOnLine, Array]:
    """Return the line and the unknowns of the motion y, renumbered so that contact 0 is the first with Σ⁺, if any."""
    first = line.walls.index(1) if 1 in line.walls else 0
    itinerary = line.itinerary(y)
    return replace(line, walls=itinerary.with_first_impact(first).walls), unknowns_counted_from_impact(
        itinerary, y, first
    )


def _remove_contact(line: MotionsOnLine, y: Array, contact: int) -> tuple[MotionsOnLine, Array]:
    """Return the line and the unknowns of the motion y without contact number `contact`."""
    fewer = replace(line, walls=line.itinerary(y).without_impact(contact).walls)
    return fewer, np.delete(y, [contact, len(line.walls) + contact])


def _merge_contacts(line: MotionsOnLine, y: Array, contact: int) -> tuple[MotionsOnLine, Array]:
    """Return the line and the unknowns of the motion y with contact number `contact` and the next one merged."""
    itinerary, c = line.itinerary(y), len(line.walls)
    y, walls = unknowns_counted_from_impact(itinerary, y, contact), itinerary.with_first_impact(contact).walls
    y[c] = (y[1] - y[0]) / itinerary.softness + y[c + 1]
    return _remove_contact(replace(line, walls=walls), y, 1)


def _admissible_motion_near(line: MotionsOnLine, y: Array) -> tuple[MotionsOnLine, Array] | None:
    """Return an admissible motion next to a graze y on a line; None if there is none.

    Returns
    -------
    tuple or None
        The line and the motion's unknowns. The motion is sought on both sides of y, at each of DISTANCES_TO_TRY.
    """
    rising = np.zeros(y.size)
    rising[-1] = 1.0
    tangent = tangent_at(line.problem, y, rising)
    for reach in DISTANCES_TO_TRY:
        for side in (reach, -reach):
            found = solve_on_curve(line.problem, y + side * tangent, tangent)
            if found is not None and line.is_admissible(found[0]):
                return line, found[0]
    return None


def _motion_with_one_more_contact(line: MotionsOnLine, y: Array, tangent: Array) -> tuple[MotionsOnLine, Array] | None:
    """Return a motion with one more contact, which continues a branch beyond its end.

    y, tangent: the last motion of the branch, and the branch's outward tangent there.

    Returns
    -------
    tuple or None
        The line and the unknowns of the new motion; None if it is not found.
    """
    for reach in DISTANCES_TO_TRY:
        there = solve_on_curve(line.problem, y + reach * tangent, tangent)
        failure = (
            None if there is None else first_failing_piece(line.itinerary(there[0]), line.full_unknowns(there[0])[:-1])
        )
        if failure is not None and failure.wall != 0:
            more, guess, constraint = (_guess_with_split_contact if failure.is_contact else _guess_with_short_contact)(
                line, y, failure
            )
            found = solve_on_curve(more.problem, guess, constraint)
            if found is not None and more.is_admissible(found[0]):
                return more, found[0]
    return None


def _insert_contact(
    line: MotionsOnLine, y: Array, after: int, wall: int, time: float, duration: float
) -> tuple[MotionsOnLine, Array]:
    """Return the line and the unknowns of y with a new contact after contact `after`; duration: in units of 1/√(2κ)."""
    c = len(line.walls)
    more = replace(line, walls=line.itinerary(y).with_added_impact(after + 1, wall).walls)
    return more, np.insert(y, [after + 1, c + after + 1], [time, duration])


def _guess_with_short_contact(
    line: MotionsOnLine, y: Array, failure: FailingPiece
) -> tuple[MotionsOnLine, Array, Array]:
    """Return a guess of the motion with a short contact where a flight touches a wall, and a constraint for Newton.

    failure: the flight that ends too early, at the touched wall. The constraint is a further row of the linear system
    of Newton's method. It keeps the duration of the new contact constant.

    Returns
    -------
    tuple[MotionsOnLine, Array, Array]
        The line with the new walls, the guess on it, and the row of the constraint.
    """
    p = line.itinerary(y).softness
    duration = STARTING_DURATION * p
    more, guess = _insert_contact(line, y, failure.piece, failure.wall, failure.time - 0.5 * p * duration, duration)
    constraint = np.zeros(guess.size)
    constraint[len(more.walls) + failure.piece + 1] = 1.0
    return more, guess, constraint


def _guess_with_split_contact(
    line: MotionsOnLine, y: Array, failure: FailingPiece
) -> tuple[MotionsOnLine, Array, Array]:
    """Return a guess of the motion with a short flight where a contact's depth falls to 0, and a row of equations.

    failure: the contact that ends too early. The row completes the linear system of Newton's method, so that the
    duration of the new flight does not change.

    Returns
    -------
    tuple[MotionsOnLine, Array, Array]
        The line with the new walls, the guess on it, and the row.
    """
    i, c, p = failure.piece, len(line.walls), line.itinerary(y).softness
    gap = STARTING_DURATION * p * p
    ends = y[i] + p * y[c + i]
    more, guess = _insert_contact(
        line, y, i, failure.wall, failure.time + 0.5 * gap, (ends - failure.time - 0.5 * gap) / p
    )
    guess[c + 1 + i] = (failure.time - 0.5 * gap - y[i]) / p
    constraint = np.zeros(guess.size)
    constraint[[i + 1, i, c + 1 + i]] = 1.0, -1.0, -p
    return more, guess, constraint
