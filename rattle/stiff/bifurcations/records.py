"""A branch of periodic motions of the stiff gear, and what happens on it."""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from rattle.continuation.arclength import root_between
from rattle.continuation.conditions import Kind
from rattle.continuation.followed import FollowedBranch
from rattle.flight.law import wrapped
from rattle.numerics.complex_step import Array
from rattle.orbits.period_one import NAMES
from rattle.stiff.bifurcations.curves import FOLDS
from rattle.stiff.bifurcations.line import MotionsOnLine
from rattle.stiff.orbits.equations import StiffItinerary
from rattle.stiff.orbits.period_one import orbits_at
from rattle.stiff.orbits.periodic import StiffOrbit, orbit_of, softness

SAME_MOTION = 1e-6  # in τ and v


class StiffEvent(NamedTuple):
    """A saddle-node (SN), flip (PD) or graze (GR) on a branch.

    The motion there, and the number of the branch's point before it, at a saddle-node of the point that it is, at a
    graze of the last one.

    Nothing bifurcates at a graze: its motion, here without the contact that is gained or lost, goes on as `beyond`.
    """

    kind: Kind
    orbit: StiffOrbit
    point: int
    beyond: StiffOrbit | None = None

    @property
    def after(self) -> int:
        """The branch's point before it."""
        return self.point - (self.kind is Kind.SADDLE_NODE)

    @property
    def itinerary(self) -> StiffItinerary:
        """Return the walls of the event's motion in their order."""
        return self.orbit.itinerary

    @property
    def unknowns(self) -> Array:
        """Times, durations times √(2κ), δ, ε and κ^(−1/2)/√2 (2c + 3,)."""
        return unknowns_of(self.orbit)

    @property
    def parameters(self) -> Array:
        """δ, ε and κ^(−1/2)/√2 (3,)."""
        return self.unknowns[-3:]

    @property
    def admissible(self) -> bool:
        """True if the motion happens: always."""
        return True


def unknowns_of(orbit: StiffOrbit) -> Array:
    """Return times, durations times √(2κ), δ, ε and κ^(−1/2)/√2 (2c + 3,)."""
    return np.append(orbit.unknowns, softness(orbit.kappa))


@dataclass(frozen=True, repr=False)
class StiffBranch(FollowedBranch):
    """A branch of the stiff gear: see `FollowedBranch`.

    All its motions happen. A saddle-node is one of its points, which counts as stable if the motion is so on one side.

    itinerary: with the stiffness of the first point. unknowns (k, 2c + 3): times, durations times √(2κ), δ, ε and
    κ^(−1/2)/√2. events: saddle-nodes and flips. grazes: at which end its motion goes on with another label, and how.
    """

    itinerary: StiffItinerary
    events: tuple[StiffEvent, ...]
    grazes: tuple[StiffEvent, ...]

    @property
    def added(self) -> dict[str, Array]:
        """The stiffness (k,)."""
        return {"kappa": np.asarray(0.5 / self.unknowns[:, -1] ** 2)}

    @property
    def unfolded(self) -> Array:
        """Times and durations (k, 2c), which do not jump along the branch."""
        return self.unknowns[:, :-3]

    @property
    def departures(self) -> Array:
        """Return the times at which the motions leave the walls (k, c), in forcing periods."""
        c = len(self.walls)
        return self.unknowns[:, :c] + self.unknowns[:, -1:] * self.unknowns[:, c:-3]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """A, B, C or D for every point of a period-one branch, "" for those of any other.

        "" too of the P(1,1,0) that no impacting motion becomes: the letter of the stretch between folds that it is on
        (`rattle.stiff.orbits.families`).
        """
        folds = [event.point for event in self.events if event.kind is Kind.SADDLE_NODE]
        edges, names = [0, *folds, len(self)], list[str]()
        for i, j in pairwise(edges):
            names += [_letter(self.orbit((i + j) // 2)) if self.label[:2] == (1, 1) else ""] * (j - i)
        return tuple(names)

    def curve_of(self, event: StiffEvent) -> str | None:
        """Return the curve of `rattle.stiff.trace` that an event of the branch is on, None if it is on none of them."""
        k, letters, x = event.point, self.names, event.unknowns
        if self.label[:2] != (1, 1) or (len(self.walls) > 1 and x[1] - x[0] + 0.5 * x[-1] * (x[3] - x[2]) < 0.5):
            return None  # beyond the pole of the limit's P(1,1,1), at half a period from Σ⁺ to Σ⁻
        if event.kind is Kind.SADDLE_NODE and 0 < k < len(self) - 1:
            pair = "".join(sorted((letters[k - 1], letters[k + 1])))
            return next((name for name, meet in FOLDS.items() if meet == pair), None)
        if event.kind is not Kind.FLIP:
            return None
        if len(self.walls) == 1:
            return "PDC" if letters[k] == "C" else None
        return self._flip_of_d(event) if letters[k] == "D" else None

    def _flip_of_d(self, event: StiffEvent) -> str | None:
        """PD1 next to a fold; else PD2 if D becomes stable as ε grows along the branch."""
        i = next(i for i, each in enumerate(self.events) if each is event)
        if any(each.kind is Kind.SADDLE_NODE for each in self.events[max(i - 1, 0) : i + 2]):
            return "PD1"
        before, after = max(event.point - 1, 0), min(event.point + 1, len(self) - 1)
        gained = float(self.stable[after]) - float(self.stable[before])
        return "PD2" if gained * (self.epsilon[after] - self.epsilon[before]) > 0.0 else None

    def orbit(self, index: int) -> StiffOrbit:
        """Return the motion at one point."""
        x = self.unknowns[index]
        return orbit_of(replace(self.itinerary, softness=float(x[-1])), x[:-1])

    def crossings(self, index: int, value: float) -> list[tuple[int, Array]]:
        """Return the points at which the parameter number `index` of the branch has this value.

        Numbers −3, −2 and −1 are δ, ε and κ^(−1/2)/√2.

        Returns
        -------
        list[tuple[int, Array]]
            Number of the point before the crossing, and the unknowns (2c + 3,) there.
        """
        found, at = list[tuple[int, Array]](), self.unknowns[:, index] - value
        line = MotionsOnLine(self.walls, self.m, self.beta, self.unknowns[0, -3:], np.eye(3)[index])
        for k in range(len(self) - 1):
            if (at[k] < 0) != (at[k + 1] < 0):
                a, b = (line.parameter(x) for x in self.unknowns[k : k + 2])
                y = root_between(line.problem, a, b, lambda y: line.plane(y)[index] - value)
                if y is not None:
                    found.append((k, line.plane(y)))
        return found


def _letter(orbit: StiffOrbit) -> str:
    """Return the letter of a motion P(1,1,0) or P(1,1,1)."""
    for name, other in orbits_at(orbit.delta, orbit.epsilon, orbit.beta, orbit.kappa):
        if other.label == orbit.label and abs(wrapped(other.tau - orbit.tau)) + abs(other.v - orbit.v) < SAME_MOTION:
            return name if name in NAMES else ""
    return ""
