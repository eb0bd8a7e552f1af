"""The bifurcation diagram of the stiff gear along a segment of (δ, ε, κ)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rattle.attractors.speeds import SampleSpec, SpeedLimit
from rattle.continuation.arclength import ContinuationProblem
from rattle.continuation.bifurcation_diagram import Diagram, compute_diagram, require_segment_end
from rattle.continuation.conditions import EventKind
from rattle.continuation.motions import POINTS_ACROSS, Motion, MotionsOnSegment, ParameterSegment
from rattle.errors import RattleError, require_number, require_pair
from rattle.numerics.complex_step import Array
from rattle.parameters import Parameters
from rattle.stiff.attractors.classifier import StiffClassifier
from rattle.stiff.bifurcations.branches import period_doubled_branch, stiff_branch_on_line
from rattle.stiff.bifurcations.line import MotionsOnLine
from rattle.stiff.bifurcations.records import StiffBranch, StiffEvent, unknowns_of_stiff_orbit
from rattle.stiff.orbits.closure import softness
from rattle.stiff.orbits.equations import StiffItinerary
from rattle.stiff.orbits.period_one import orbits_at
from rattle.stiff.orbits.periodic import StiffOrbit, stiff_orbit

LETTER_STEPS = 5  # number of steps of the segment at which A to D are computed


@dataclass(frozen=True)
class StiffMotions(MotionsOnSegment):
    """The stiff gear along a segment of (δ, ε, p), p = 1/√(2κ): see `rattle.continuation.motions.MotionsOnSegment`."""

    classifier = StiffClassifier

    def parameters_of_steps(self, position: Array) -> Parameters:
        """Return the parameters of the stiff gear at positions on the segment, from 0 at its start to 1 at its end."""
        delta, epsilon, p = np.ascontiguousarray(self.segment.parameters_at(position).T)
        beta = np.full_like(delta, self.beta)
        return Parameters(self.classifier.model, delta, epsilon, beta, {"kappa": 0.5 / p**2})

    def period_one_motions(self, steps: Parameters) -> Iterator[Motion]:
        """Yield A to D and all other P(1,1,0) at LETTER_STEPS evenly spaced points of `steps`.

        A point at which these motions cannot be computed is left out.

        Yields
        ------
        Motion
            Itinerary and unknowns of each motion.
        """
        for k in np.unique(np.linspace(0, steps.size - 1, LETTER_STEPS).astype(int)):
            try:
                for _name, orbit in orbits_at(**steps.point(k)):
                    yield self._motion_of(orbit)
            except RattleError:  # motions missed at this step may be found from other steps or from attractors
                continue

    def find_motion_near(self, step: Mapping[str, float], tau: float, v: float, n_plus: int) -> Motion | None:
        """Return the periodic motion near a state, or None if none is found (`MotionsOnSegment.find_motion_near`)."""
        try:
            return self._motion_of(stiff_orbit(**step, tau=tau, v=v, n_plus=n_plus))
        except RattleError:
            return None

    def equations_along_segment(self, itinerary: StiffItinerary) -> ContinuationProblem:
        """Return the contact equations along the segment (`MotionsOnSegment.equations_along_segment`)."""
        return self._motions_on_line(itinerary).problem

    def solve_motion(self, itinerary: StiffItinerary, y: Array) -> StiffOrbit | None:
        """Return the orbit near a guess y of the contact equations, or None if none is found."""
        line = self._motions_on_line(itinerary)
        found = line.corrected_solution(y)
        return None if found is None else line.orbit(found)

    def follow_branch(self, motion: Motion, span: tuple[float, float]) -> StiffBranch:
        """Return the branch through a motion. span: (low, high) of positions on the segment, 0 at the motion."""
        itinerary, x = motion
        line = MotionsOnLine(itinerary.walls, itinerary.m, self.beta, x[-3:], self.segment.direction)
        return stiff_branch_on_line(line, np.append(x[:-3], 0.0), span, POINTS_ACROSS)

    def follow_doubled_branch(self, event: StiffEvent, span: tuple[float, float]) -> StiffBranch:
        """Return the branch of doubled period that leaves a flip (`MotionsOnSegment.follow_doubled_branch`)."""
        return period_doubled_branch(event, self.segment.direction, span, POINTS_ACROSS)

    def events_of(self, found: StiffBranch) -> tuple[StiffEvent, ...]:
        """Return the saddle-nodes and flips of a branch, and the grazes at which its label changes."""
        return *found.events, *found.grazes

    def motions_at_event(self, event: StiffEvent) -> Iterator[Motion]:
        """Yield the motion at a flip, or the motion beyond a graze, whose label differs; nothing at a saddle-node.

        Yields
        ------
        Motion
            At most one. If a branch of doubled period ends at the flip, the motion has half the period of the branch.
        """
        if event.kind is EventKind.FLIP:
            yield event.itinerary, event.unknowns
        elif event.beyond is not None:
            yield self._motion_of(event.beyond)

    def _motions_on_line(self, itinerary: StiffItinerary) -> MotionsOnLine:
        return MotionsOnLine(itinerary.walls, itinerary.m, self.beta, self.segment.start, self.segment.direction)

    def _motion_of(self, orbit: StiffOrbit) -> Motion:
        return orbit.itinerary, unknowns_of_stiff_orbit(orbit)


def diagram(
    start: ArrayLike,
    end: ArrayLike,
    beta: float = 0.6,
    kappa: float | tuple[float, float] = 1e4,
    steps: int = 400,
    count: int = 64,
    v_max: SpeedLimit = None,
    impacts: int = 8,
    most: int = 100,
    seed: int = 0,
) -> Diagram[StiffBranch, StiffEvent]:
    """Return the bifurcation diagram of the stiff gear from start to end, both (δ, ε), at stiffness κ.

    All motions of a branch have the same label. At a graze (GR), which is no bifurcation in this gear, the motion
    continues as another branch.

    Parameters
    ----------
    kappa : float or tuple[float, float]
        The stiffness; or its values at start and end, between which κ^(−1/2) changes linearly. Start and end may then
        be the same point.
    start, end, beta, steps, count, v_max, impacts, most, seed
        As in `rattle.diagram`.

    Returns
    -------
    Diagram[StiffBranch, StiffEvent]
        Sweeps, branches and events, and the labels of motions beyond the limits on impacts and branches.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    beta = require_number("beta", beta, positive=True)
    at_ends = require_pair("kappa", (kappa, kappa) if np.ndim(kappa) == 0 else kappa)
    ends = [
        np.append(require_segment_end(name, value), softness(require_number("kappa", each, positive=True)))
        for name, value, each in zip(("start", "end"), (start, end), at_ends, strict=True)
    ]
    return compute_diagram(
        StiffMotions(ParameterSegment(*ends), beta), beta, steps, impacts, most, SampleSpec(count, v_max, seed)
    )
