"""Basins of attraction on a grid of the (τ, v) plane: by cell mapping, by every cell's own trajectory, or by both.

Whatever the method, attractors are told apart by the classifier of `rattle.attractors.table` alone. Cell mapping
replaces the map of states by a map of cells, Π^k of each centre, and finds its periodic groups in one pass; then one
member of each group is followed exactly, together with the sample of `Gear.attractors`. So a group that only the grid
has made gets the label of the attractor that it is in fact on the way to. Refinement follows more cells exactly, and
what these tell spreads over the grid in two ways: to neighbours, and to all cells that the map of cells sends there.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.cell_map import Box, cell_of, groups_of_map
from rattle.attractors.classify import BUDGET, WEAK, Classifier
from rattle.attractors.recurrence import SAME_POINT
from rattle.attractors.samples import Outcome
from rattle.attractors.speeds import SampleSpec
from rattle.attractors.table import Attractor, AttractorTable, attractor_columns, attractors_of_cell, tabulated
from rattle.errors import require_integer, require_number, require_one_of
from rattle.flight.law import speed_unit, wrapped
from rattle.notebook import Columns, Dataset, Tabular, dataset_of
from rattle.numerics.states import box_of
from rattle.parameters import Parameters

Array = NDArray[np.float64]

Range = tuple[float, float] | None

METHODS = ("cells", "direct", "refined")
FINEST = 4096  # cells a side: 16 million trajectories, some gigabytes
SAMPLE = 256  # initial conditions that look for the attractors besides the cells
LATTICE = 8  # refined: every so many cells along τ and v one is followed whatever the map of cells says
RETURNS = 8  # steps of the cell map that a state above v_max may take to come back before it is followed exactly
MOST_IMPACTS = 1000
MOST_IN_ALL, LEAST_BUDGET = 1 << 33, 1 << 13  # at weak damping: impacts of all states together, and of one


def budget_of(delta: float, states: int) -> int:
    """Return the largest number of impacts of each state: a survey's, and fewer if many states are weakly damped."""
    return BUDGET if delta >= WEAK else int(np.clip(MOST_IN_ALL // max(states, 1), LEAST_BUDGET, BUDGET))


@dataclass(frozen=True)
class StatePlane:
    """The states (τ, v) on Σ⁺ of a gear at one parameter point; arrays (k,).

    classifier: the gear's. parameters: arrays (1,).
    """

    classifier: type[Classifier]
    parameters: Parameters

    @property
    def delta(self) -> float:
        """Damping."""
        return float(self.parameters.delta[0])

    @property
    def unit(self) -> float:
        """Scale of speeds (`rattle.flight.law.speed_unit`)."""
        point = self.parameters.point()
        return float(speed_unit(point["delta"], point["epsilon"], point["beta"]))

    def classify(self, tau: Array, v: Array) -> Classifier:
        """Return the states as samples of one cell, each followed to its end."""
        budget = budget_of(self.delta, tau.size)
        return self.classifier.classify(self.parameters, tau[None].copy(), v[None].copy(), budget)

    def iterated(self, tau: Array, v: Array, returns: int) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return the states after `returns` returns, and whether they became quiet on the way."""
        return self.classifier.iterated(self.parameters, tau, v, returns)

    def cell_of(self, tau: Array, v: Array, n: int, box: Box) -> NDArray[np.int64]:
        """Return the cell of every state.

        Row-major (v, τ) of n × n of a box, n² if it is sure to become quiet, −1 outside.

        Returns
        -------
        NDArray[np.int64]
            Number of each state's cell.
        """
        cell, quiet = np.empty(tau.size, np.int64), self.classifier.quiet_invariant(self.parameters)
        point = self.parameters.point()
        cell_of(tau, v, n, box, point["delta"], point["epsilon"], quiet, cell)
        return cell

    def sample(self, count: int, v_max: float) -> tuple[Array, Array]:
        """Return τ and v (count,) of the initial conditions of a sample with speeds up to v_max."""
        tau, v = SampleSpec(count, v_max).states(self.parameters)
        return tau[0], v[0]


@dataclass(frozen=True, repr=False)
class Basins(Tabular):
    """Basins of attraction on n × n cells of a box of (τ, v).

    tau, v (n,): centres of the cells (phase in forcing periods, dimensionless speed). labels (n, n), row by row of v:
    index into attractors, which are sorted by falling fraction of the cells. steps (n, n): impacts on Σ⁺ until the
    trajectory was certain to converge, in whole steps of the cell map where one was used; −1 if chaotic or undecided.
    box: the ranges of τ and v, [0, 1) × (0, v_max) unless others were asked for.
    """

    tau: NDArray[np.float64]
    v: NDArray[np.float64]
    labels: NDArray[np.int64]
    attractors: tuple[Attractor, ...]
    steps: NDArray[np.int64]
    method: str
    box: Box

    @property
    def v_max(self) -> float:
        """The end of the box."""
        return self.box.v_high

    def _caption(self) -> str:
        size = f"{self.v.size} × {self.tau.size} cells of (τ, v) ∈ [0, 1) × (0, {self.v_max:g})"
        return f"basins of {len(self.attractors)} attractors on {size}, method {self.method!r}"

    def _columns(self) -> Columns:
        return attractor_columns(self.attractors)

    def to_xarray(self) -> Dataset:
        """Return labels and steps over (v, tau). Raises MissingExtraError without xarray."""
        names = [each.name for each in self.attractors]
        coded = {"flag_values": list(range(len(names))), "flag_meanings": " ".join(names), "long_name": "attractor"}
        return dataset_of(
            {"labels": (("v", "tau"), self.labels, coded), "steps": (("v", "tau"), self.steps)},
            {"v": self.v, "tau": self.tau},
            {"method": self.method, "v_max": self.v_max},
        )


def classified(plane: StatePlane, tau: Array, v: Array) -> tuple[AttractorTable, NDArray[np.int64], NDArray[np.int64]]:
    """Return the attractors that states (n,) go to, by the one classifier: the table, each state's row and impacts."""
    classifier = plane.classify(tau, v)
    table, rows = tabulated(classifier)
    return table, rows, classifier.samples.impacts


def _without_chaos(steps: NDArray[np.int64], table: AttractorTable, rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the steps to convergence, −1 where none is seen."""
    kind = table.kind[rows]
    return np.where((kind == Outcome.CHAOTIC) | (kind == Outcome.UNDECIDED), -1, steps)


def boundary(labels: NDArray[np.int64], all_phases: bool = True) -> NDArray[np.bool_]:
    """Return the cells (n_v, n_tau) of which one of the eight neighbours has another label.

    The last phase is a neighbour of the first if all phases are there; speeds have ends.

    Returns
    -------
    NDArray[np.bool_]
        (n_v, n_tau), True where labels differ.
    """
    wide = np.pad(labels, ((0, 0), (1, 1)), mode="wrap" if all_phases else "edge")
    wide = np.pad(wide, ((1, 1), (0, 0)), mode="edge")
    rows, columns = labels.shape
    found = np.zeros(labels.shape, np.bool_)
    for i in range(3):
        for j in range(3):
            found |= wide[i : i + rows, j : j + columns] != labels
    return found


def _images(plane: StatePlane, tau: Array, v: Array, n: int, box: Box, impacts: int) -> NDArray[np.int64]:
    """Return the map of cells (n² + 1,), the last the sink of quiet capture.

    A cell whose motion does not return to the box maps to itself: a group of its own, which is then followed exactly.

    Returns
    -------
    NDArray[np.int64]
        Number of the cell that the centre of each cell goes to.
    """
    sink = tau.size
    t, speed, rests = plane.iterated(tau, v, impacts)
    image = np.append(np.where(rests, sink, plane.cell_of(t, speed, n, box)), sink)
    image[:-1][plane.cell_of(tau, v, n, box) == sink] = sink
    outside = np.flatnonzero(image < 0)
    for _ in range(RETURNS):
        t[outside], speed[outside], rests = plane.iterated(t[outside], speed[outside], impacts)
        image[outside] = np.where(rests, sink, plane.cell_of(t[outside], speed[outside], n, box))
        outside = outside[image[outside] < 0]
    image[outside] = outside
    return image


class States:
    """States of one parameter point that are followed in several calls, with one table of their attractors."""

    def __init__(self, plane: StatePlane) -> None:
        self.plane = plane
        self.table = AttractorTable.empty()
        #: A state that goes to each of the attractors: followed again, it tells which one that is in a new call.
        self.tau, self.v = np.zeros((2, 0))

    def follow(self, tau: NDArray[np.float64], v: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return `classified` of states as rows of the common table, in which known attractors keep their rows."""
        known, tau, v = self.tau.size, np.append(self.tau, tau), np.append(self.v, v)
        table, rows, impacts = classified(self.plane, tau, v)
        row_of = self._known(table, rows[:known])
        fresh = np.flatnonzero(row_of < 0)
        row_of[fresh] = known + np.arange(fresh.size)
        self.table = AttractorTable.concat([self.table, table.take(fresh)])
        one = np.array([np.argmax(rows == row) for row in fresh], np.int64)
        self.tau, self.v = np.append(self.tau, tau[one]), np.append(self.v, v[one])
        return row_of[rows[known:]], impacts[known:]

    def _known(self, table: AttractorTable, reached: NDArray[np.int64]) -> NDArray[np.int64]:
        """Row here of each row of another table, −1 if it is new; reached: rows there of the states kept here."""
        here, there = self.table, table.take((slice(None), None))
        near = SAME_POINT * self.plane.unit
        same = (np.abs(wrapped(there.tau - here.tau)) < SAME_POINT) & (np.abs(there.v - here.v) < near)
        same[reached, np.arange(reached.size)] = True
        same |= (here.kind == Outcome.QUIET) | (here.kind == Outcome.UNDECIDED)
        for name in ("kind", "m", "n_plus", "n_minus"):
            same &= getattr(there, name) == getattr(here, name)
        row = np.full(table.kind.size, -1)
        one, other = np.nonzero(same)
        row[one[::-1]] = other[::-1]
        return row


def _by_cells(
    plane: StatePlane, tau: Array, v: Array, n: int, box: Box, impacts: int, refine: bool
) -> tuple[AttractorTable, NDArray[np.int64], NDArray[np.int64]]:
    """Return `classified` for the centres of all cells, by simple cell mapping.

    If refine, a lattice of cells by their own trajectories, and every cell with another label among its neighbours,
    until there is none left.

    Returns
    -------
    tuple[AttractorTable, NDArray[np.int64], NDArray[np.int64]]
        The attractors, the row of each cell, and its steps to convergence.
    """
    impacts = round(impacts * max(1.0, WEAK / plane.delta))  # a step moves states nearer to attractors than a cell is
    image = _images(plane, tau, v, n, box, impacts)
    group, steps, members = groups_of_map(image)
    sink, on_sink = tau.size, np.flatnonzero(image[:-1] == tau.size)[:1]
    chosen = np.concatenate([members[:-1], on_sink])  # the sink's group is the last, and may be empty
    if refine:
        each = np.arange(min(LATTICE, n) // 2, n, LATTICE)
        chosen = np.concatenate([chosen, np.setdiff1d(n * each[:, None] + each, chosen)])
    first, second = plane.sample(SAMPLE, box.v_high)
    states = States(plane)
    found, made = states.follow(np.append(first, tau[chosen]), np.append(second, v[chosen]))
    # what is known of a cell that has been followed, and of the sink: its row, and impacts until it is certain
    row, needed, known = np.zeros(sink + 1, np.int64), np.zeros(sink + 1, np.int64), np.zeros(sink + 1, np.bool_)
    row[chosen], needed[chosen], known[chosen] = found[SAMPLE:], made[SAMPLE:], True
    row[sink] = row[on_sink[0]] if on_sink.size else 0
    while refine:
        image[known] = np.flatnonzero(known)
        group, steps, members = groups_of_map(image)
        meet = boundary(row[members][group[:-1]].reshape(n, n), box.tau_high - box.tau_low == 1.0)
        edge = np.flatnonzero(meet.ravel() & ~known[:-1])
        if not edge.size:
            break
        row[edge], needed[edge] = states.follow(tau[edge], v[edge])
        known[edge] = True
    rows = row[members][group[:-1]]
    steps = steps[:-1] * impacts + needed[members][group[:-1]]
    return states.table, rows, _without_chaos(steps, states.table, rows)


def basins(
    plane: StatePlane, resolution: int, v_max: float, method: str, impacts: int, tau: Range = None, v: Range = None
) -> Basins:
    """Return the basins of `rattle.Gear.basins` for the states of this plane."""
    n = require_integer("resolution", resolution, 1, FINEST)
    v_max = require_number("v_max", v_max, positive=True)
    phases, speeds = box_of((0.0, 1.0) if tau is None else tau, (0.0, v_max) if v is None else v)
    box = Box(*phases, *speeds)
    impacts = require_integer("impacts", impacts, 1, MOST_IMPACTS)
    require_one_of("method", method, METHODS)
    centres = (np.arange(n) + 0.5) / n
    across, up = phases[0] + (phases[1] - phases[0]) * centres, speeds[0] + (speeds[1] - speeds[0]) * centres
    first, second = np.tile(across, n), np.repeat(up, n)
    if method == "direct":
        table, rows, steps = classified(plane, first, second)
        steps = _without_chaos(steps, table, rows)
    else:
        table, rows, steps = _by_cells(plane, first, second, n, box, impacts, method == "refined")
    count = np.bincount(rows, minlength=table.kind.size)
    order = np.argsort(-count, kind="stable")[: np.count_nonzero(count)]
    label = np.zeros(count.size, np.int64)
    label[order] = np.arange(order.size)
    found = attractors_of_cell(table.take(order), count[order])
    return Basins(across, up, label[rows].reshape(n, n), found, steps.reshape(n, n), method, box)
