"""A branch of periodic motions of the stiff gear, and its events."""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from rattle.continuation.arclength import find_root_between
from rattle.continuation.conditions import EventKind
from rattle.continuation.followed import FollowedBranch
from rattle.flight.law import wrap_phase_difference
from rattle.numerics.complex_step import Array
from rattle.orbits.orbits_a_to_d import NAMES
from rattle.stiff.bifurcations.curves import FOLDS
from rattle.stiff.bifurcations.line import MotionsOnLine
from rattle.stiff.orbits.equations import StiffItinerary
from rattle.stiff.orbits.period_one import orbits_at
from rattle.stiff.orbits.periodic import StiffOrbit, orbit_of, softness

SAME_MOTION = 1e-6  # motions are equal if their differences in τ and v add up to less than this


class StiffEvent(NamedTuple):
    """A saddle-node (SN), flip (PD) or graze (GR) on a branch.

    orbit: the motion at the event; at a graze, without the contact that is gained or lost.
    point: the index of a point of the branch. A saddle-node is this point itself. A flip comes after this point, and
    before the next one. A graze, or a flip that ends the branch, is at this point, the end point of the branch.
    beyond: for a graze, a motion of the branch with another label that continues from the graze, or None if no such
    motion was found; for a saddle-node or flip, None.
    """

    kind: EventKind
    orbit: StiffOrbit
    point: int
    beyond: StiffOrbit | None = None

    @property
    def after(self) -> int:
        """Index of the last point of the branch before the event: `point`, or for a saddle-node `point` − 1."""
        return self.point - (self.kind is EventKind.SADDLE_NODE)

    @property
    def itinerary(self) -> StiffItinerary:
        """The itinerary of the event's motion."""
        return self.orbit.itinerary

    @property
    def unknowns(self) -> Array:
        """The unknowns (2c + 3,) of the event's motion, which has c contacts: times, durations/p, δ, ε, p = 1/√(2κ)."""
        return unknowns_of_stiff_orbit(self.orbit)

    @property
    def parameters(self) -> Array:
        """The parameters (3,) of the motion at the event: δ, ε and p = 1/√(2κ)."""
        return self.unknowns[-3:]

    @property
    def admissible(self) -> bool:
        """True, because events are computed for admissible motions only."""
        return True


def unknowns_of_stiff_orbit(orbit: StiffOrbit) -> Array:
    """Return the unknowns (2c + 3,) of a motion with c contacts: times, durations/p, δ, ε and p = 1/√(2κ)."""
    return np.append(orbit.unknowns, softness(orbit.kappa))


@dataclass(frozen=True, repr=False)
class StiffBranch(FollowedBranch):
    """A branch of the stiff gear: see `FollowedBranch`. All its motions are admissible.

    Each saddle-node of the branch is one of its points. This point counts as stable if the motions on one side of it
    are stable.

    Attributes
    ----------
    itinerary
        The walls that the motions meet, with the stiffness of the first point.
    unknowns : ndarray, (k, 2c + 3)
        In each row: the times of the c contacts; their c durations, divided by p; then δ, ε and p, where p = 1/√(2κ).
    events
        Saddle-nodes and flips.
    grazes
        The grazes at the ends, where the motion continues with another label.
    """

    itinerary: StiffItinerary
    events: tuple[StiffEvent, ...]
    grazes: tuple[StiffEvent, ...]

    @property
    def added(self) -> dict[str, Array]:
        """The parameters of the k points besides δ, ε and β: the dictionary {"kappa": stiffness (k,)}."""
        return {"kappa": np.asarray(0.5 / self.unknowns[:, -1] ** 2)}

    @property
    def unwrapped_times(self) -> Array:
        """The times and durations/p (k, 2c) of the c contacts, without jumps by whole periods along the branch."""
        return self.unknowns[:, :-3]

    @property
    def departures(self) -> Array:
        """The times (k, c) at which the motions leave the walls, in forcing periods."""
        c = len(self.walls)
        return self.unknowns[:, :c] + self.unknowns[:, -1:] * self.unknowns[:, c:-3]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """A, B, C or D for each point of a period-one branch, "" for the points of other branches.

        The letter belongs to the part of the branch between folds (`rattle.stiff.orbits.families`). A P(1,1,0)
        without a counterpart in the impacting model has the name "".
        """
        folds = [event.point for event in self.events if event.kind is EventKind.SADDLE_NODE]
        edges, names = [0, *folds, len(self)], list[str]()
        for i, j in pairwise(edges):
            names += [_letter_of_orbit(self.orbit((i + j) // 2)) if self.label[:2] == (1, 1) else ""] * (j - i)
        return tuple(names)

    def curve_of(self, event: StiffEvent) -> str | None:
        """Return the name of the curve of `rattle.stiff.trace` on which an event lies; None if it lies on no curve."""
        k, letters, x = event.point, self.names, event.unknowns
        if self.label[:2] != (1, 1) or (len(self.walls) > 1 and x[1] - x[0] + 0.5 * x[-1] * (x[3] - x[2]) < 0.5):
            # on every curve Σ⁻ is met more than half a period after Σ⁺, counted between the middles of both contacts
            return None
        if event.kind is EventKind.SADDLE_NODE and 0 < k < len(self) - 1:
            pair = "".join(sorted((letters[k - 1], letters[k + 1])))
            return next((name for name, meet in FOLDS.items() if meet == pair), None)
        if event.kind is not EventKind.FLIP:
            return None
        if len(self.walls) == 1:
            return "PDC" if letters[k] == "C" else None
        return self._curve_of_flip_of_d(event) if letters[k] == "D" else None

    def _curve_of_flip_of_d(self, event: StiffEvent) -> str | None:
        """Return the name of the curve on which a flip of D lies.

        Returns
        -------
        str or None
            "PD1" if the branch's previous or next event is a saddle-node; otherwise "PD2" if D gains stability as ε
            grows, and None if D loses stability.
        """
        i = next(i for i, each in enumerate(self.events) if each is event)
        if any(each.kind is EventKind.SADDLE_NODE for each in self.events[max(i - 1, 0) : i + 2]):
            return "PD1"
        before, after = max(event.point - 1, 0), min(event.point + 1, len(self) - 1)
        gained = float(self.stable[after]) - float(self.stable[before])
        return "PD2" if gained * (self.epsilon[after] - self.epsilon[before]) > 0.0 else None

    def orbit(self, index: int) -> StiffOrbit:
        """Return the motion at the branch's point number `index`."""
        x = self.unknowns[index]
        return orbit_of(replace(self.itinerary, softness=float(x[-1])), x[:-1])

    def crossings(self, index: int, value: float) -> list[tuple[int, Array]]:
        """Return the points at which parameter number `index` of the branch has this value.

        Numbers −3, −2 and −1 are δ, ε and p = 1/√(2κ).

        Returns
        -------
        list[tuple[int, Array]]
            For each crossing, the number of the point before it, and the unknowns (2c + 3,) at the crossing.
        """
        found, at = list[tuple[int, Array]](), self.unknowns[:, index] - value
        line = MotionsOnLine(self.walls, self.m, self.beta, self.unknowns[0, -3:], np.eye(3)[index])
        for k in range(len(self) - 1):
            if (at[k] < 0) != (at[k + 1] < 0):
                a, b = (line.line_unknowns(x) for x in self.unknowns[k : k + 2])
                y = find_root_between(line.problem, a, b, lambda y: line.full_unknowns(y)[index] - value)
                if y is not None:
                    found.append((k, line.full_unknowns(y)))
        return found


def _letter_of_orbit(orbit: StiffOrbit) -> str:
    """Return the letter A to D of a motion P(1,1,0) or P(1,1,1); "" for a motion without a letter."""
    for name, other in orbits_at(orbit.delta, orbit.epsilon, orbit.beta, orbit.kappa):
        if (
            other.label == orbit.label
            and abs(wrap_phase_difference(other.tau - orbit.tau)) + abs(other.v - orbit.v) < SAME_MOTION
        ):
            return name if name in NAMES else ""
    return ""
