"""One-parameter bifurcation diagrams along any segment of parameters, of either model.

Branches, their events, and the attractors that sweeps forward and backward see (paper, Figures 5 and 9).

    branches = A to D, and what they lead to at flips and grazes
    table = the attractors of a sample at every step
    repeat, while something new is found:
        sweep all attractors that are known, forward and backward
        look for a branch near every periodic attractor, where it appears and every CHECKED steps
        add the stable parts of branches that no sweep has met to what is known: basins may be small
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
from rattle.continuation.motions import Motion, Motions, Segment, runs
from rattle.continuation.search import Search
from rattle.continuation.sweeps import KnownAttractor, SweepPoints, Sweeps
from rattle.errors import require, require_integer, require_number, require_pair
from rattle.flight.law import wrapped
from rattle.notebook import (
    Columns,
    Dataset,
    Figure,
    Tabular,
    dataset_of,
    figure_of,
)
from rattle.notebook import motion_label as label_of
from rattle.parameters import Parameters

LEAST_LENGTH = 1e-6  # of the scale of the plane
MOST_STEPS = 20_000
LARGEST_PERIOD, MOST_BRANCHES = 64, 1000
CHAOTIC_POINTS = 200
CHECKED = 10  # one in so many steps of an attractor that seems to stay on its branch
JUMP = 0.05  # in phase, or speed in its unit, between steps
SAME_ORBIT = 1e-6
ROUNDS = 3  # of branches that lead to attractors and back
Array = NDArray[np.float64]


class HasParameters(Protocol):
    """Object at a parameter point on a segment."""

    @property
    def parameters(self) -> Array:
        """Return the parameters (…, d), in the order of the segment's."""


class IsEvent(HasParameters, Protocol):
    """Event at a parameter point on a segment."""

    @property
    def kind(self) -> Any:
        """Saddle-node, flip or graze."""


class HasEvents(HasParameters, Protocol):
    """A branch."""

    @property
    def events(self) -> tuple[Any, ...]:
        """Events on it."""

    def curve_of(self, event: Any) -> str | None:
        """Return the name of the curve of the plane that one of them is on."""


AnyBranch = TypeVar("AnyBranch", bound=HasEvents)
AnyEvent = TypeVar("AnyEvent", bound=IsEvent)


@dataclass(frozen=True)
class BranchPiece:
    """A stable part of branch number `branch`, between positions low and high."""

    branch: int
    low: float
    high: float


@dataclass(frozen=True, repr=False)
class Diagram(Tabular, Generic[AnyBranch, AnyEvent]):
    """A bifurcation diagram along a segment of parameters, at half-backlash beta (dimensionless).

    segment: its ends, δ and ε first. position, delta, epsilon (n,): the steps, position as the fraction of the way;
    added: the other parameters (n,) of the model, by name. branches: A to D and all other P(m, n₊, n₋) that were
    found, each once, with stable and admissible parts flagged; events: all that happen on them, each once. points:
    the attractors followed forward and backward. sampled: what a sample of initial conditions finds at each step,
    quiet motion too (cell is the step). small: stable parts that no sample found, for their basins are small or they
    fit between two steps. left_out: labels met but not followed as branches, beyond the limits.
    """

    segment: Segment
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
            "motion": [_motion_at(event) for event, _ in events],
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
            Without matplotlib.
        """
        return figure_of(self, "diagram_figure")

    def to_xarray(self) -> Dataset:
        """Return the impacts on Σ⁺ of the attractors that were followed, along a dimension impact, and the steps.

        A branch has its own `to_xarray`.

        Returns
        -------
        Dataset
            The data set.

        Raises
        ------
        MissingExtraError
            Without xarray.
        """
        points = {name: ("impact", values) for name, values in self.points._asdict().items()}
        values = {"delta": self.delta, "epsilon": self.epsilon, **self.added}
        steps = {name: ("number", each) for name, each in values.items()}
        return dataset_of(points, {**steps, "beta": self.beta}, {"kinds": list(KINDS)})

    def curve_of(self, event: AnyEvent) -> str | None:
        """Return the name of the curve of the (δ, ε) plane that an event is on, None if it is on none that has one."""
        on = (branch for branch in self.branches if any(each is event for each in branch.events))
        return next((branch.curve_of(event) for branch in on), None)

    @property
    def start(self) -> tuple[float, float]:
        """(δ, ε) at the start."""
        return float(self.segment.start[0]), float(self.segment.start[1])

    @property
    def end(self) -> tuple[float, float]:
        """(δ, ε) at the end."""
        return float(self.segment.end[0]), float(self.segment.end[1])

    def positions(self, of: AnyBranch | AnyEvent) -> Array:
        """Return the positions of a branch's points (k,), or an event's (), on the way from start to end."""
        return self.segment.position(of.parameters)


def diagram_of(
    model: Motions, beta: float, steps: int, impacts: int, most: int, sample: SampleSpec
) -> Diagram[Any, Any]:
    """Return the diagram of a model along its segment; the other arguments as those of `diagram`."""
    segment = model.segment
    length = float(np.linalg.norm(segment.direction))
    least = LEAST_LENGTH * plane_scale(segment.start[0])
    require(length > least, f"start and end must be further apart than {least:g}, they are {length:g}")
    steps = require_integer("steps", steps, 1, MOST_STEPS)
    impacts = require_integer("impacts", impacts, 1, LARGEST_PERIOD)
    most = require_integer("most", most, 1, MOST_BRANCHES)
    position = np.linspace(0.0, 1.0, steps + 1)
    parameters = model.steps(position)
    unit = float(replace(sample, v_max=None).highest(parameters).max()) / PAPER_SPEED
    sampled = model.sampled(parameters, sample)
    sweeps, search = Sweeps(model, parameters, sampled), Search(model, impacts, most)
    for motion in model.period_one(parameters):
        search.add(motion)
    small: list[BranchPiece] = []
    for _ in range(ROUNDS):
        sweeps.run()
        for motion in _seen(sweeps, parameters, search, unit):
            search.add(motion)
        small, new = _unseen(sweeps, search, position, unit)
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
        sweeps.points(position, CHAOTIC_POINTS),
        sampled,
        tuple(small),
        tuple(sorted(search.left_out)),
    )


def _motion_at(event: Any) -> str:
    """Return the label of the motion that an event is of."""
    return label_of(*event.itinerary.label)


def require_end(name: str, value: ArrayLike) -> Array:
    """(δ, ε) of an end of a segment. Raises ParameterError."""
    delta, epsilon = require_pair(name, value)
    return np.array([require_number(f"δ of {name}", delta, positive=True), require_number(f"ε of {name}", epsilon)])


def _seen(sweeps: Sweeps, parameters: Parameters, search: Search, unit: float) -> Iterator[Motion]:
    """Periodic attractors of the sweeps: all that are short enough, some where they go on from step to step."""
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
            near = [age for age, before in last.get(known.label, []) if _close(known, before, unit)]
            age = near[0] + 1 if near else 0
            now.setdefault(known.label, []).append((age, known))
            if age % CHECKED == 0:
                found = search.model.near(parameters.point(step), known.tau, known.v, n_plus)
                if found is not None:
                    yield found
        last = now


def _close(one: KnownAttractor, other: KnownAttractor, unit: float) -> bool:
    return abs(wrapped(one.tau - other.tau)) < JUMP and abs(one.v - other.v) < JUMP * unit


def _unseen(sweeps: Sweeps, search: Search, position: Array, unit: float) -> tuple[list[BranchPiece], bool]:
    """Return the stable parts of branches that no sample found, and whether the sweeps missed one of their motions.

    The sweeps know these motions from here on.

    Returns
    -------
    tuple[list[BranchPiece], bool]
        The parts, and True if a sweep missed one at a step.
    """
    small, new = [], False
    for piece, inside, tau, v in _stable_pieces(search, position):
        sampled = False
        for step, phases, speeds in zip(inside, tau, v, strict=True):
            label = search.branches[piece.branch].label
            match = _nearest(sweeps.known[step], label, phases, speeds, JUMP, unit)
            if match is None:
                orbit = search.stable_orbit(piece.branch, float(position[step]))
                if orbit is None:
                    continue
                upper = np.array(orbit.walls) > 0
                there = orbit.departures[upper], orbit.speeds[upper]
                match = _nearest(sweeps.known[step], label, *there, SAME_ORBIT, unit)
                if match is None:
                    sweeps.known[step].append(
                        KnownAttractor(Outcome.PERIODIC, label, orbit.tau, orbit.v, sampled=False)
                    )
                    new = True
            sampled |= match is not None and match.sampled
        if not sampled:
            small.append(piece)
    return small, new


def _stable_pieces(search: Search, position: Array) -> Iterator[tuple[BranchPiece, NDArray[np.int64], Array, Array]]:
    """Stable parts of branches with the steps inside, and about where their impacts on Σ⁺ are there (steps, n_plus)."""
    for i, found in enumerate(search.branches):
        upper, at = np.flatnonzero(np.array(found.itinerary.walls) > 0), search.paths[i][:, -1]
        events = {event.after: float(search.model.segment.position(event.parameters)) for event in found.events}
        for run in runs(np.flatnonzero(found.stable)):
            low, high = sorted((events.get(int(run[0]) - 1, float(at[run[0]])), events.get(int(run[-1]), at[run[-1]])))
            inside = np.flatnonzero((position >= low) & (position <= high))
            order = np.argsort(at[run])
            tau, v = (
                np.array([np.interp(position[inside], at[run][order], x[order, j]) for j in upper]).T
                for x in (np.unwrap(found.departures[run], period=1.0, axis=0), found.speeds[run])
            )
            yield BranchPiece(i, float(low), float(high)), inside, tau, v


def _nearest(
    known: list[KnownAttractor], label: tuple[int, int, int], tau: Array, v: Array, within: float, unit: float
) -> KnownAttractor | None:
    """Return the attractor with this label that has a state near one of the impacts (n_plus,), speeds in their unit."""
    for each in known:
        near = np.abs(wrapped(tau - each.tau)) + np.abs(v - each.v) / unit
        if each.kind == Outcome.PERIODIC and each.label == label and near.min() < within:
            return each
    return None
