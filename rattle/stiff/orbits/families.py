"""The one-parameter families in ε of the stiff gear's motions P(1,1,0) and P(1,1,1), and the counterparts of A to D.

A family is a connected curve of solutions at fixed δ, β and κ. It is followed as a whole, also where its motions are
virtual. Families of P(1,1,0) are sought at many durations of the contact; for a given duration the equations are linear
in ε cos 2πt and ε sin 2πt. Families of P(1,1,1) are sought with Newton's method from two kinds of guesses: motions of
the impacting gear, which are explicit too, at many times from Σ⁺ to Σ⁻; and every graze of a P(1,1,0). All these
guesses hold for a forcing of one cosine.

A letter belongs to a part of a curve between folds. In order: A, SN1, C, fold at G1, B, SN2, D, fold at G2, A. C begins
to touch Σ⁻ a little before the fold at G1, and A ceases to touch it a little after the fold at G2. At these two grazes
the family of P(1,1,0) and a family of P(1,1,1) meet; the letters C and A hold on both sides.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.continuation.arclength import plane_scale
from rattle.errors import RattleError
from rattle.flight.impact_law import ELASTIC
from rattle.numerics.complex_step import Array
from rattle.stiff.orbits.closure import (
    LEAST_CONTACT,
    ContactCycle,
    departure_after_first_contact,
    is_admissible,
    softness,
    tangent_map_trace,
    time_at_sigma_minus,
)
from rattle.stiff.orbits.equations import StiffItinerary
from rattle.stiff.orbits.family_continuation import (
    BROKEN,
    CLOSED,
    LOST,
    MOST_POINTS,
    correct_in_hyperplane,
    find_folds,
    follow_family,
    index_on_family,
    locate_solution_between,
    reason_out_of_range,
    solve_family_above_chord,
)

NO_LETTER = "P"  # name of a P(1,1,0) that is neither A nor C: the impacting model has no such orbit
PLUS, PLUS_MINUS = np.array([1]), np.array([1, -1])  # walls of P(1,1,0) and of P(1,1,1)
DURATIONS = 600  # number of contact durations in each of the grids of durations at which P(1,1,0) is sought
# P(1,1,1) is sought at this many values of the time from Σ⁺ to Σ⁻ below half a period, and at as many values above it
TIMES = 40
LEAST_SPAN = 1.0  # least range of ε in which families are followed, in units of `plane_scale`
# A family of P(1,1,1) that begins at a graze is followed from the member whose contact with Σ⁻ has this duration, in
# units of 1/√(2κ).
SHORT_CONTACT = 10.0 * LEAST_CONTACT
BISECTIONS = 45  # halvings of the interval in which a graze is located


class FamilyMember(NamedTuple):
    """A motion of a `StiffFamily`.

    name: the letter A to D of the part of the family on which the motion lies, or "P". cycle: the walls and parameters.
    y (2c + 1,): the motion's unknowns, as in `rattle.stiff.orbits.closure`.
    """

    name: str
    cycle: ContactCycle
    y: Array


@dataclass(frozen=True)
class StiffFamily:
    """A family of motions at one δ, β and κ: a connected curve of periodic motions along which ε changes.

    points (k, 2c + 1): the unknowns of k motions with c contacts each, in order along the curve. folds: the numbers of
    the points at which ε turns back. ends: the reasons why the family ends at its first and last point (codes of
    `family_continuation`). letters: the letter of each part of the family between folds.
    """

    cycle: ContactCycle
    points: Array
    folds: NDArray[np.int64]
    ends: tuple[int, int]
    letters: tuple[str, ...] = ()

    @property
    def saddle_flags(self) -> list[bool]:
        """A flag for each part of the family between folds: True if the part consists of saddles (multiplier > 1)."""
        edges, found = [0, *self.folds.tolist(), len(self.points) - 1], []
        for i, j in pairwise(edges):
            y = self.points[(i + j) // 2] if j > i + 1 else 0.5 * (self.points[i] + self.points[j])
            found.append(
                tangent_map_trace(y, self.cycle) > 1.0 + ELASTIC.determinant(self.cycle.delta, self.cycle.m, 1)
            )
        return found

    @property
    def motions_at_breaks(self) -> list[Array]:
        """Admissible motions that show that the family is incomplete; an empty list if it is complete.

        If the continuation failed at one end, the list has this end if it is admissible. If it failed at both ends, or
        if a fold could not be located, the list has all admissible points of the family.
        """
        ends = [i for i, why in zip((0, -1), self.ends, strict=True) if why == BROKEN]
        return [y for y in (self.points if len(ends) == 2 else self.points[ends]) if is_admissible(y, self.cycle)]

    def motions_at(self, epsilon: float) -> list[FamilyMember]:
        """Return the admissible motions at this eccentricity. Raises RattleError if one of them cannot be computed."""
        found, y = [], np.empty(self.points.shape[1])
        for k in indices_of_sign_changes(self.points[:, -1] - epsilon):
            ends = self.points[k : k + 2]
            if locate_solution_between(*ends, y.size - 1, epsilon, self.cycle, y):
                y[-1] = epsilon
                if is_admissible(y, self.cycle):
                    name = self.letters[int(np.searchsorted(self.folds, k, side="right"))]
                    found.append(FamilyMember(name, self.cycle, y.copy()))
            elif any(is_admissible(end, self.cycle) for end in ends):
                refusal = family_lost_error(self.cycle, epsilon)
                raise refusal
        return found


def indices_of_sign_changes(values: Array) -> list[int]:
    """Return the indices k for which values[k] and values[k + 1] have different signs."""
    return np.flatnonzero((values[:-1] < 0) != (values[1:] < 0)).tolist()


def family_lost_error(cycle: ContactCycle, epsilon: float) -> RattleError:
    """Return the error for a family that cannot be followed, so that admissible motions of it may be missed."""
    return RattleError(
        f"a family of motions cannot be followed at delta = {cycle.delta:g}, epsilon = {epsilon:g}, "
        f"beta = {cycle.beta:g}, kappa = {cycle.kappa:g}: choose another point"
    )


def highest_followed_epsilon(delta: float, epsilon: float) -> float:
    """Return the ε up to which families are followed for a point (δ, ε).

    This ε is the larger of two numbers: LEAST_SPAN · `plane_scale`(δ), and the smallest power of 2 ≥ 1.5 ε.

    Returns
    -------
    float
        The largest ε of the families.
    """
    least = LEAST_SPAN * plane_scale(delta)
    return max(least, float(2.0 ** np.ceil(np.log2(1.5 * epsilon)))) if epsilon > 0.0 else least


def follow_family_through(y: Array, cycle: ContactCycle, span: float) -> StiffFamily:
    """Return the family through a solution y, followed in both directions to its ends, with `letters` empty."""
    direction, room = np.zeros(y.size), np.empty((MOST_POINTS, y.size))
    direction[y.size // 2] = 1.0
    k, on = follow_family(y, direction, cycle, span, room)
    points, back = room[:k].copy(), on
    if on != CLOSED:
        k, back = follow_family(y, -direction, cycle, span, room)
        points = np.concatenate([room[k - 1 : 0 : -1], points])
    before = np.empty(len(points), np.int64)
    folds, all_located = find_folds(points, cycle, before)
    ends = (back, on) if all_located else (BROKEN, BROKEN)
    before = before[: len(folds)]
    return StiffFamily(cycle, np.insert(points, before + 1, folds, axis=0), before + 1 + np.arange(before.size), ends)


def explicit_solutions(cycle: ContactCycle, offset: Array, duration: Array) -> Array:
    """Return the motions whose contacts begin at times `offset` and last `duration` · p, both (k, c), with p = 1/√(2κ).

    The times `offset` are relative to the beginning of the first contact. For given offsets and durations all equations
    are linear in ε cos 2πt and ε sin 2πt, where t is this beginning. The solution is exact for c = 1; for c = 2 it is a
    least-squares solution.

    Returns
    -------
    Array
        Unknowns (k, 2c + 1).
    """
    itinerary = StiffItinerary(tuple(cycle.walls.tolist()), cycle.m, cycle.beta, softness(cycle.kappa))
    plane = np.full((len(offset), 1), cycle.delta)

    def residual(time: float, epsilon: float) -> NDArray:
        return itinerary.residual(np.concatenate([time + offset, duration, plane, 0.0 * plane + epsilon], axis=-1))

    rest = residual(0.0, 0.0)
    columns = [residual(time, 1.0) - rest for time in (0.0, 0.25)]
    (a, b), (_b, c) = (([np.sum(x * y, axis=-1) for x in columns]) for y in columns)
    f, g = (-np.sum(x * rest, axis=-1) for x in columns)
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = (c * f - b * g) / (a * c - b * b), (a * g - b * f) / (a * c - b * b)
    time = np.arctan2(y, x)[:, None] / (2 * np.pi)
    return np.concatenate([time + offset, duration, np.hypot(x, y)[:, None]], axis=-1)


def _guess_sn1(cycle: ContactCycle) -> Array | None:
    """Return unknowns close to SN1, at which ε is least among P(1,1,0) with similar durations of the contact.

    If ε has several such minima, the function takes the minimum whose contact duration σ is nearest to π.

    Returns
    -------
    Array or None
        Unknowns (3,); None if ε has no minimum at a P(1,1,0) that leaves Σ⁺ with a speed v > 0.
    """
    p = softness(cycle.kappa)
    # distances from π of the durations σ at which SN1 is sought; at SN1 itself the distance is about
    # 2p · (contact force)/(impact speed)
    hard = p * np.geomspace(1e-2, 1e4, DURATIONS)
    duration = np.concatenate([np.linspace(0.0, 4 * np.pi, DURATIONS), np.pi - hard, np.pi + hard])
    duration = np.unique(duration[(duration > 0.0) & (duration < 0.999 / p)])
    found = explicit_solutions(cycle, np.zeros((duration.size, 1)), duration[:, None])
    size = found[:, -1]
    least = np.flatnonzero((size[1:-1] < size[:-2]) & (size[1:-1] <= size[2:])) + 1
    folds = [found[i] for i in least if departure_after_first_contact(found[i], cycle)[1] > 0.0]
    return min(folds, key=lambda y: abs(float(y[1]) - np.pi), default=None)


def family_of_a_and_c(cycle: ContactCycle, span: float) -> list[StiffFamily]:
    """Return the family of A and C as a list of one item; an empty list if there is no such family."""
    guess = _guess_sn1(cycle)
    if (
        guess is None
        or not correct_in_hyperplane(guess, np.array([0.0, 1.0, 0.0]), cycle)
        or reason_out_of_range(guess, cycle, span)[0] >= 0
    ):
        return []
    family = follow_family_through(guess, cycle, span)
    if not family.folds.size:
        return []
    sn1 = int(np.argmin(np.abs(family.points[family.folds] - guess).max(axis=1)))
    letters = [NO_LETTER] * (family.folds.size + 1)
    for i, saddle in enumerate(family.saddle_flags[sn1 : sn1 + 2]):
        letters[sn1 + i] = "A" if saddle else "C"
    return [replace(family, letters=tuple(letters))]


def families_without_letter(cycle: ContactCycle, span: float) -> list[StiffFamily]:
    """Return the families of P(1,1,0) that do not contain A and C, sought at many durations of the contact."""
    longest = 0.999 / softness(cycle.kappa)
    dense = np.linspace(0.0, min(4 * np.pi, longest), DURATIONS)[1:]
    duration = np.concatenate([dense, np.linspace(dense[-1], longest, DURATIONS)])
    known, found = family_of_a_and_c(cycle, span), list[StiffFamily]()
    for guess in explicit_solutions(cycle, np.zeros((duration.size, 1)), duration[:, None]):
        if not (is_admissible(guess, cycle) and reason_out_of_range(guess, cycle, span)[0] < 0):
            continue
        if correct_in_hyperplane(guess, np.array([0.0, 1.0, 0.0]), cycle) and not is_on_any_family(
            guess, (*known, *found)
        ):
            family = follow_family_through(guess, cycle, span)
            # A family that breaks off is left out. Families break off where contact lasts almost a period, because the
            # equations are almost singular there.
            if not family.motions_at_breaks:
                found.append(replace(family, letters=(NO_LETTER,) * (family.folds.size + 1)))
    return found


def families_on_both_walls(cycle: ContactCycle, span: float, plus: Sequence[StiffFamily]) -> list[StiffFamily]:
    """Return the families of P(1,1,1), with their letters. plus: the families of P(1,1,0)."""
    found: list[StiffFamily] = []
    for guess, constraint in _guesses_on_both_walls(cycle, plus):
        y = guess.copy()
        if (
            correct_in_hyperplane(y, constraint, cycle)
            and reason_out_of_range(y, cycle, span)[0] < 0
            and not is_on_any_family(y, found)
        ):
            found.append(follow_family_through(y, cycle, span))
    return [replace(family, letters=_letters_of_parts(family, plus)) for family in found]


def _guesses_on_both_walls(cycle: ContactCycle, plus: Sequence[StiffFamily]) -> Iterator[tuple[Array, Array]]:
    """Yield guesses of P(1,1,1), each with a row that completes Newton's equations.

    plus: the families of P(1,1,0), at whose grazes with Σ⁻ some of the guesses lie.

    Yields
    ------
    tuple[Array, Array]
        The guess (5,), and the row (5,), which keeps one quantity of the guess: the duration of the contact with Σ⁻,
        the flight time from Σ⁺ to Σ⁻, or ε.
    """
    p = softness(cycle.kappa)
    for family in plus:
        for y in guesses_at_grazes(family):
            yield y, np.array([0.0, 0.0, 0.0, 1.0, 0.0])
    beside = np.geomspace(1e-3, 0.49, TIMES)
    times = np.concatenate([0.5 - beside, 0.5 + beside])
    offset = np.stack([0.0 * times, times + p * np.pi], axis=-1)
    for y in explicit_solutions(cycle, offset, np.full((times.size, 2), np.pi)):
        yield y, np.array([-1.0, 1.0, -p, 0.0, 0.0])
        yield y, np.array([0.0, 0.0, 0.0, 0.0, 1.0])


def guesses_at_grazes(family: StiffFamily) -> list[Array]:
    """Return guesses of P(1,1,1) with a short contact with Σ⁻, one for each graze of a family of P(1,1,0)."""
    cycle, found = family.cycle, []
    meets = np.array([not np.isnan(time_at_sigma_minus(y, cycle)) for y in family.points])
    for i in np.flatnonzero(meets[:-1] != meets[1:]).tolist():
        hit, miss = family.points[i : i + 2] if meets[i] else family.points[i : i + 2][::-1]
        y = np.empty(3)
        for _ in range(BISECTIONS):
            if not solve_family_above_chord(hit, miss, 0.5, cycle, y):
                break
            hit, miss = (hit, y.copy()) if np.isnan(time_at_sigma_minus(y, cycle)) else (y.copy(), miss)
        found.append(np.array([hit[0], time_at_sigma_minus(hit, cycle), hit[1], SHORT_CONTACT, hit[2]]))
    return found


def _letters_of_parts(family: StiffFamily, plus: Sequence[StiffFamily]) -> tuple[str, ...]:
    """Return the letters A to D of the parts of a family of P(1,1,1).

    A part is B if its motions are saddles with a multiplier above 1, else D. The first and the last part may have other
    letters: if the family ends in such a part because the contact with Σ⁻ is lost, the motion continues as a P(1,1,0),
    and the part has the letter A or C of this P(1,1,0). A part that continues as C but does not fold back to B
    remains D (docs/stiff.md).

    Returns
    -------
    tuple[str, ...]
        One letter, A to D, for each part between folds.
    """
    saddles = family.saddle_flags
    names = ["B" if saddle else "D" for saddle in saddles]
    ends = [_letter_of_continuation(family, i, plus) for i in (0, -1)]
    for at, beside, other in ((0, 1, -1), (-1, -2, 0)):
        if ends[at] == "A" and saddles[at]:
            names[at] = "A"
        elif ends[at] == "C" and not saddles[at] and len(names) > 1:
            back = saddles[beside] and not (len(names) == 2 and ends[other] == "A")
            names[at] = "C" if back else "D"
    return tuple(names)


def _letter_of_continuation(family: StiffFamily, end: int, plus: Sequence[StiffFamily]) -> str:
    """Return the letter of the P(1,1,0) that continues a family of P(1,1,1) at one end; "" if none does.

    end: 0 for the first point of the family, −1 for its last point.

    Returns
    -------
    str
        The letter, A or C, or "P" if the P(1,1,0) has no letter; "" if the family does not continue.
    """
    y = family.points[end]
    if family.ends[end] != LOST or y[3] > 2.0 * LEAST_CONTACT:
        return ""
    for other in plus:
        k = index_on_family(other.points, y[[0, 2, 4]], other.cycle)
        if k >= 0:
            return other.letters[int(np.searchsorted(other.folds, k, side="right"))]
    return ""


def is_on_any_family(y: Array, families: Sequence[StiffFamily]) -> bool:
    """Return whether a solution lies on one of these families."""
    return any(index_on_family(family.points, y, family.cycle) >= 0 for family in families)


@lru_cache(maxsize=256)
def families_of_a_to_d(delta: float, beta: float, kappa: float, span: float) -> tuple[StiffFamily, ...]:
    """Return the families that contain the counterparts of A to D, for ε from 0 to `span`.

    Returns
    -------
    tuple[StiffFamily, ...]
        The families, with those of P(1,1,0) first.

    Raises
    ------
    RattleError
        If a family breaks off at an admissible motion.
    """
    plus = family_of_a_and_c(ContactCycle(PLUS, 1, delta, beta, kappa), span)
    found = *plus, *families_on_both_walls(ContactCycle(PLUS_MINUS, 1, delta, beta, kappa), span, plus)
    for family in found:
        for y in family.motions_at_breaks:
            refusal = family_lost_error(family.cycle, float(y[-1]))
            raise refusal
    return found


def find_family_members(delta: float, epsilon: float, beta: float, kappa: float) -> list[FamilyMember]:
    """Return the admissible counterparts of A to D at one parameter point, and other motions of the same families.

    Returns
    -------
    list[FamilyMember]
        The motions, sorted by letter; P(1,1,0) before P(1,1,1); longer times from Σ⁺ to Σ⁻ first.

    Raises
    ------
    RattleError
        If the continuation of a family fails, or a motion at this point cannot be computed.
    """
    span = highest_followed_epsilon(delta, epsilon)
    found = [member for family in families_of_a_to_d(delta, beta, kappa, span) for member in family.motions_at(epsilon)]
    return sorted(found, key=lambda member: (member.name, member.y.size, float(member.y[0] - member.y[1])))
