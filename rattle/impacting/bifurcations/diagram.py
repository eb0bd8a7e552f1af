"""The bifurcation diagram of the impacting gear."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rattle.attractors.speeds import SampleSpec, SpeedLimit
from rattle.continuation.arclength import ContinuationProblem
from rattle.continuation.bifurcation_diagram import Diagram, compute_diagram, require_segment_end
from rattle.continuation.motions import (
    POINTS_ACROSS,
    Motion,
    MotionsOnSegment,
    ParameterSegment,
    split_into_consecutive_runs,
)
from rattle.errors import RattleError, require_number
from rattle.impacting.attractors.classifier import ImpactingClassifier
from rattle.impacting.bifurcations.branches import Branch, branch_through, doubled
from rattle.impacting.bifurcations.events import Event
from rattle.impacting.orbits.equations import Itinerary, equations_on_line
from rattle.impacting.orbits.period_one import period_one
from rattle.impacting.orbits.periodic import PeriodicOrbit, follow_impacts, orbit_of
from rattle.numerics.complex_step import Array
from rattle.orbits.periodic_motions import solve_at_parameters
from rattle.parameters import Parameters


@dataclass(frozen=True)
class ImpactingMotions(MotionsOnSegment):
    """The periodic motions of the impacting gear along the segment of a diagram (`MotionsOnSegment`)."""

    classifier = ImpactingClassifier

    def parameters_of_steps(self, position: Array) -> Parameters:
        """Return the impacting gear's parameters at positions (n,) on the segment, from 0 (start) to 1 (end)."""
        delta, epsilon = np.ascontiguousarray(self.segment.parameters_at(position).T)
        return Parameters(self.classifier.model, delta, epsilon, np.full_like(delta, self.beta))

    def period_one_motions(self, steps: Parameters) -> Iterator[Motion]:
        """Yield each of the orbits A to D at the middle of each range of parameter points on which it exists."""
        orbits = period_one(steps.delta, steps.epsilon, steps.beta)
        for exists, tau, v in zip(orbits.exists, orbits.tau, orbits.v, strict=True):
            for run in split_into_consecutive_runs(np.flatnonzero(exists)):
                k = int(run[run.size // 2])
                found = self.find_motion_near(steps.point(k), float(tau[k]), float(v[k]), 1)
                if found is not None:
                    yield found

    def find_motion_near(self, step: Mapping[str, float], tau: float, v: float, n_plus: int) -> Motion | None:
        """Return the motion with n_plus impacts on Σ⁺ near (τ, v), at the parameters `step`; None if none is found."""
        try:
            itinerary, x = follow_impacts(step["delta"], step["epsilon"], step["beta"], tau, v, n_plus)
        except RattleError:
            return None
        solved = solve_at_parameters(itinerary, x)
        return None if solved is None else (itinerary, orbit_of(itinerary, solved).unknowns)

    def equations_along_segment(self, itinerary: Itinerary) -> ContinuationProblem:
        """Return the impact equations of motions with this itinerary along the segment of the diagram."""
        return equations_on_line(itinerary, self.segment.start, self.segment.direction)

    def solve_motion(self, itinerary: Itinerary, y: Array) -> PeriodicOrbit | None:
        """Return the orbit with times near y[:-1] at position y[-1] on the segment; None if Newton's method fails."""
        found = solve_at_parameters(itinerary, np.append(y[:-1], self.segment.parameters_at(y[-1])))
        return None if found is None else orbit_of(itinerary, found)

    def follow_branch(self, motion: Motion, span: tuple[float, float]) -> Branch:
        """Return the branch of a motion. span: range of positions on the segment, relative to the motion's position."""
        return branch_through(*motion, self._direction, span, POINTS_ACROSS)

    def follow_doubled_branch(self, event: Event, span: tuple[float, float]) -> Branch:
        """Return the branch of doubled period from a flip. span: range of positions relative to the flip's position."""
        return doubled(event, self._direction, span, POINTS_ACROSS)

    def events_of(self, found: Branch) -> tuple[Event, ...]:
        """Return the saddle-nodes, flips and grazes of a branch, in order."""
        return found.events

    def motions_at_event(self, event: Event) -> Iterator[Motion]:
        """Yield the motion at an event and, if it is a graze, the same motion without the grazing impact."""
        yield event.itinerary, event.unknowns
        if event.impact is not None:
            yield event.itinerary.without_impact(event.impact), np.delete(event.unknowns, event.impact)

    @property
    def _direction(self) -> tuple[float, float]:
        """The difference of δ and of ε between the ends of the segment."""
        delta, epsilon = self.segment.direction
        return float(delta), float(epsilon)


def diagram(
    start: ArrayLike,
    end: ArrayLike,
    beta: float = 0.6,
    steps: int = 400,
    count: int = 64,
    v_max: SpeedLimit = None,
    impacts: int = 8,
    most: int = 100,
    seed: int = 0,
) -> Diagram[Branch, Event]:
    """Return the bifurcation diagram along the segment from start to end, both (δ, ε) with δ > 0 and ε ≥ 0.

    The result depends on the arguments only.

    Parameters
    ----------
    start, end : tuple[float, float]
        Ends of the segment.
    beta : float
        Half-backlash.
    steps : int
        Number of intervals between the parameter values of the sweeps.
    count, v_max, seed
        The samples at each value, as in `Gear.attractors`.
    impacts : int
        Largest number of impacts per period, on both walls together, of a branch that is followed.
    most : int
        Largest number of branches. `left_out` names the branches that exceed one of these two limits.

    Returns
    -------
    Diagram[Branch, Event]
        Sweeps, branches and events, and the names of the branches that were left out.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    beta = require_number("beta", beta, positive=True)
    segment = ParameterSegment(require_segment_end("start", start), require_segment_end("end", end))
    return compute_diagram(ImpactingMotions(segment, beta), beta, steps, impacts, most, SampleSpec(count, v_max, seed))
