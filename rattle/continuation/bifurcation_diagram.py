"""One-parameter bifurcation diagrams along a segment of parameters, for any model (paper, Figures 5 and 9).

A diagram has branches, their events, and the attractors that forward and backward sweeps find:

    branches = A to D, and the branches that they lead to at flips and grazes
    known = the attractors that samples of initial conditions reach at every step
    repeat at most ROUNDS times, while something new is found:
        sweep all known attractors forward and backward
        search for a branch near every periodic attractor, where it first appears and at every CHECKED-th step
        add to the known attractors the stable parts of branches that no sweep has met: their basins may be small
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.samples import Outcome
from rattle.attractors.speeds import PAPER_SPEED, SampleSpec
from rattle.attractors.table import KINDS, AttractorTable
from rattle.continuation.arclength import plane_scale
from rattle.continuation.motions import Motion, MotionsOnSegment, ParameterSegment, split_into_consecutive_runs
from rattle.continuation.search import BranchSearch
from rattle.continuation.sweeps import KnownAttractor, SweepPoints, Sweeps
from rattle.errors import require, require_integer, require_number, require_pair
from rattle.flight.law import wrap_phase_difference
from rattle.notebook import (
    Columns,
    Dataset,
    Figure,
    TabularResult,
    dataset_of,
    figure_of,
)
from rattle.notebook import motion_label as label_of
from rattle.parameters import Parameters

#: Least allowed length of a segment, in units of `plane_scale`.
LEAST_LENGTH = 1e-6
#: Largest allowed number of steps of a diagram.
MOST_STEPS = 20_000
#: Largest allowed values of the arguments `impacts` (impacts per period of a motion) and `most` (number of branches).
LARGEST_PERIOD, MOST_BRANCHES = 64, 1000
#: Number of impacts by which a chaotic attractor is shown at one step.
CHAOTIC_POINTS = 200
#: A branch is searched for near a periodic attractor at the step where the attractor first appears, and again after
#: every CHECKED further steps.
CHECKED = 10
#: An attractor counts as the same at the next step if its state changes by at most this number: in phase, and in speed
#: relative to the unit of speed.
JUMP = 0.05
#: Largest distance between states that count as the same state of an orbit.
SAME_ORBIT = 1e-6
#: Largest number of repetitions of sweeps and search.
ROUNDS = 3
Array = NDArray[np.float64]


class PointsWithParameters(Protocol):
    """An object that has one or more parameter points on a segment, such as a branch or an event."""

    @property
    def parameters(self) -> Array:
        """The d parameters (…, d) of each point, in the same order as at the ends of the segment."""


class BranchEvent(PointsWithParameters, Protocol):
    """An event of a branch, such as a flip, at a parameter point on a segment."""

    @property
    def kind(self) -> Any:
        """The kind of the event: saddle-node, flip or graze."""


class BranchWithEvents(PointsWithParameters, Protocol):
    """A branch of periodic motions with its events."""

    @property
    def events(self) -> tuple[Any, ...]:
        """The events on the branch."""

    def curve_of(self, event: Any) -> str | None:
        """Return the name of the bifurcation curve that an event is on, or None."""


AnyBranch = TypeVar("AnyBranch", bound=BranchWithEvents)
AnyEvent = TypeVar("AnyEvent", bound=BranchEvent)


@dataclass(frozen=True)
class BranchPiece:
    """A stable part of branch number `branch` of a diagram, between the positions `low` and `high` on the segment."""

    branch: int
    low: float
    high: float


@dataclass(frozen=True, repr=False)
class Diagram(TabularResult, Generic[AnyBranch, AnyEvent]):
    """A bifurcation diagram along a segment of parameters, at half-backlash beta; all numbers are dimensionless.

    segment: the segment with its ends.
    position, delta, epsilon (n,): the position of each step, from 0 (start) to 1 (end), and its δ and ε.
    added: the other parameters (n,) of the model, by name.
    branches: A to D and all other P(m, n₊, n₋) that were found, each once.
    events: all admissible events on the branches, each once, in order of position.
    points: the impacts of the attractors that sweeps followed forward and backward.
    sampled: the table of the attractors, quiet motion included, that a sample of initial conditions reaches at each
    step; its column `cell` is the number of the step.
    small: the stable parts of branches that no sample found, because their basins are small or they lie between two
    steps.
    left_out: the labels of motions that were found but are not followed, because they exceed the limits.
    """

    segment: ParameterSegment
    beta: float
    position: Array
    delta: Array
    epsilon: Array
    added: Mapping[str, Array]
    branches: tuple[AnyBranch, ...]
    events: tuple[AnyEvent, ...]
    points: SweepPoints
    sampled: AttractorTable
    small: tuple[BranchPiece, ...]
    left_out: tuple[tuple[int, int, int], ...]

    def _caption(self) -> str:
        ends = " to ".join(f"({delta:g}, {epsilon:g})" for delta, epsilon in (self.start, self.end))
        return (
            f"diagram from (δ, ε) = {ends}, {self.position.size} steps: {len(self.branches)} branches, "
            f"{len(self.events)} events, {self.points.step.size} points of attractors"
        )

    def _columns(self) -> Columns:
        events = [(event, float(self.positions(event))) for event in self.events]
        return {
            "event": [str(event.kind) for event, _ in events],
            "motion": [_motion_label(event) for event, _ in events],
            "curve": [self.curve_of(event) or "" for event, _ in events],
            "position": [position for _, position in events],
            "delta": [event.parameters[0] for event, _ in events],
            "epsilon": [event.parameters[1] for event, _ in events],
        }

    def plot(self) -> Figure:
        """Draw speed and phase of the impacts on Σ⁺ against the parameter, as the paper's Figures 5 and 9.

        Returns
        -------
        Figure
            A matplotlib figure.

        Raises
        ------
        MissingExtraError
            If matplotlib is not installed.
        """
        return figure_of(self, "diagram_figure")

    def to_xarray(self) -> Dataset:
        """Return a data set of the impacts on Σ⁺ of the swept attractors and of the steps of the diagram.

        The impacts are along the dimension `impact`, the parameters of the steps along `number`. Branches are not
        contained: each has its own `to_xarray`.

        Returns
        -------
        Dataset
            The data set.

        Raises
        ------
        MissingExtraError
            If xarray is not installed.
        """
        points = {name: ("impact", values) for name, values in self.points._asdict().items()}
        values = {"delta": self.delta, "epsilon": self.epsilon, **self.added}
        steps = {name: ("number", each) for name, each in values.items()}
        return dataset_of(points, {**steps, "beta": self.beta}, {"kinds": list(KINDS)})

    def curve_of(self, event: AnyEvent) -> str | None:
        """Return the name of the bifurcation curve in the (δ, ε) plane that an event is on, or None."""
        on = (branch for branch in self.branches if any(each is event for each in branch.events))
        return next((branch.curve_of(event) for branch in on), None)

    @property
    def start(self) -> tuple[float, float]:
        """The parameters (δ, ε) at the start of the segment."""
        return float(self.segment.start[0]), float(self.segment.start[1])

    @property
    def end(self) -> tuple[float, float]:
        """The parameters (δ, ε) at the end of the segment."""
        return float(self.segment.end[0]), float(self.segment.end[1])

    def positions(self, of: AnyBranch | AnyEvent) -> Array:
        """Return the position of an event, or the positions (k,) of a branch's points, from 0 (start) to 1 (end)."""
        return self.segment.position(of.parameters)


def compute_diagram(
    model: MotionsOnSegment, beta: float, steps: int, impacts: int, most: int, sample: SampleSpec
) -> Diagram[Any, Any]:
    """Return the diagram of a model along its segment; the other arguments are those of `rattle.diagram`."""
    segment = model.segment
    length = float(np.linalg.norm(segment.direction))
    least = LEAST_LENGTH * plane_scale(segment.start[0])
    require(length > least, f"start and end must be farther apart than {least:g}, but their distance is {length:g}")
    steps = require_integer("steps", steps, 1, MOST_STEPS)
    impacts = require_integer("impacts", impacts, 1, LARGEST_PERIOD)
    most = require_integer("most", most, 1, MOST_BRANCHES)
    position = np.linspace(0.0, 1.0, steps + 1)
    parameters = model.parameters_of_steps(position)
    unit = float(replace(sample, v_max=None).highest_speeds(parameters).max()) / PAPER_SPEED
    sampled = model.sample_attractors(parameters, sample)
    sweeps, search = Sweeps(model, parameters, sampled), BranchSearch(model, impacts, most)
    for motion in model.period_one_motions(parameters):
        search.add_connected_branches(motion)
    small: list[BranchPiece] = []
    for _ in range(ROUNDS):
        sweeps.run()
        for motion in _motions_of_attractors(sweeps, parameters, search, unit):
            search.add_connected_branches(motion)
        small, new = _find_unsampled_pieces(sweeps, search, position, unit)
        if not new:
            break
    branches = [found for found in search.branches if found.admissible.any()]
    number = {id(found): i for i, found in enumerate(branches)}
    small = [BranchPiece(number[id(search.branches[at.branch])], at.low, at.high) for at in small]
    return Diagram(
        segment,
        beta,
        position,
        parameters.delta,
        parameters.epsilon,
        parameters.added,
        tuple(branches),
        tuple(sorted(search.events, key=lambda event: float(segment.position(event.parameters)))),
        sweeps.impacts_on_attractors(position, CHAOTIC_POINTS),
        sampled,
        tuple(small),
        tuple(sorted(search.left_out)),
    )


def _motion_label(event: Any) -> str:
    """Return the label of an event's motion as text, such as "P(1,1,0)"."""
    return label_of(*event.itinerary.label)


def require_segment_end(name: str, value: ArrayLike) -> Array:
    """Return (δ, ε) of an end of a segment after checking them. Raises ParameterError if they are not allowed."""
    delta, epsilon = require_pair(name, value)
    return np.array([require_number(f"δ of {name}", delta, positive=True), require_number(f"ε of {name}", epsilon)])


def _motions_of_attractors(
    sweeps: Sweeps, parameters: Parameters, search: BranchSearch, unit: float
) -> Iterator[Motion]:
    """Yield motions near the periodic attractors of the sweeps.

    For an attractor that is known at many successive steps, a motion is yielded at the first of them, and then at every
    CHECKED-th one.

    Yields
    ------
    Motion
        The motion, at the parameters of the step.
    """
    last: dict[tuple[int, int, int], list[tuple[int, KnownAttractor]]] = {}
    for step, here in enumerate(sweeps.known):
        now: dict[tuple[int, int, int], list[tuple[int, KnownAttractor]]] = {}
        for known in here:
            if known.kind != Outcome.PERIODIC:
                continue
            m, n_plus, n_minus = known.label
            if n_plus + n_minus > search.impacts:
                search.left_out.add((m, n_plus, n_minus))
                continue
            near = [age for age, before in last.get(known.label, []) if _are_close_attractors(known, before, unit)]
            age = near[0] + 1 if near else 0
            now.setdefault(known.label, []).append((age, known))
            if age % CHECKED == 0:
                found = search.model.find_motion_near(parameters.point(step), known.tau, known.v, n_plus)
                if found is not None:
                    yield found
        last = now


def _are_close_attractors(one: KnownAttractor, other: KnownAttractor, unit: float) -> bool:
    """Return whether the states of two attractors differ by less than JUMP, in τ and in v/unit."""
    return abs(wrap_phase_difference(one.tau - other.tau)) < JUMP and abs(one.v - other.v) < JUMP * unit


def _find_unsampled_pieces(
    sweeps: Sweeps, search: BranchSearch, position: Array, unit: float
) -> tuple[list[BranchPiece], bool]:
    """Return the stable parts of branches whose motions no sample reached at any step.

    The function also adds motions to `sweeps.known`: at each step of each stable part, the motion of this part, unless
    it is already known at this step.

    Returns
    -------
    tuple[list[BranchPiece], bool]
        The parts, and whether a motion was added to `sweeps.known`.
    """
    small, new = [], False
    for piece, inside, tau, v in _stable_pieces(search, position):
        sampled = False
        for step, phases, speeds in zip(inside, tau, v, strict=True):
            label = search.branches[piece.branch].label
            match = _find_known_attractor(sweeps.known[step], label, phases, speeds, JUMP, unit)
            if match is None:
                orbit = search.find_stable_motion(piece.branch, float(position[step]))
                if orbit is None:
                    continue
                upper = np.array(orbit.walls) > 0
                there = orbit.departures[upper], orbit.speeds[upper]
                match = _find_known_attractor(sweeps.known[step], label, *there, SAME_ORBIT, unit)
                if match is None:
                    sweeps.known[step].append(
                        KnownAttractor(Outcome.PERIODIC, label, orbit.tau, orbit.v, sampled=False)
                    )
                    new = True
            sampled |= match is not None and match.sampled
        if not sampled:
            small.append(piece)
    return small, new


def _stable_pieces(
    search: BranchSearch, position: Array
) -> Iterator[tuple[BranchPiece, NDArray[np.int64], Array, Array]]:
    """Yield each stable part of the branches, with its phases and speeds on Σ⁺ at the steps of the diagram.

    The phases and speeds are interpolated between the points of the branch. position: the positions of all steps.

    Yields
    ------
    tuple[BranchPiece, NDArray[np.int64], Array, Array]
        The part, the numbers (k,) of the steps that it contains, and τ and v (k, n_plus) at these steps.
    """
    for i, found in enumerate(search.branches):
        upper, at = np.flatnonzero(np.array(found.itinerary.walls) > 0), search.paths[i][:, -1]
        events = {event.after: float(search.model.segment.position(event.parameters)) for event in found.events}
        for run in split_into_consecutive_runs(np.flatnonzero(found.stable)):
            low, high = sorted((events.get(int(run[0]) - 1, float(at[run[0]])), events.get(int(run[-1]), at[run[-1]])))
            inside = np.flatnonzero((position >= low) & (position <= high))
            order = np.argsort(at[run])
            tau, v = (
                np.array([np.interp(position[inside], at[run][order], x[order, j]) for j in upper]).T
                for x in (np.unwrap(found.departures[run], period=1.0, axis=0), found.speeds[run])
            )
            yield BranchPiece(i, float(low), float(high)), inside, tau, v


def _find_known_attractor(
    known: list[KnownAttractor], label: tuple[int, int, int], tau: Array, v: Array, within: float, unit: float
) -> KnownAttractor | None:
    """Return the known attractor with this label whose state is closer than `within` to a state of an orbit.

    tau, v (n_plus,): the states of the orbit after its impacts on Σ⁺. unit: the unit of speed in distances.

    Returns
    -------
    KnownAttractor | None
        The attractor; None if there is none.
    """
    for each in known:
        near = np.abs(wrap_phase_difference(tau - each.tau)) + np.abs(v - each.v) / unit
        if each.kind == Outcome.PERIODIC and each.label == label and near.min() < within:
            return each
    return None
