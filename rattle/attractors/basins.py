"""Basins of attraction on a grid of the (τ, v) plane: by cell mapping, by following every cell, or by both.

With every method `rattle.attractors.classify` alone decides which attractors there are. Cell mapping replaces the map
of states by a map of cells (the image of each centre under Π^k) and finds its periodic groups in one pass. One member
of each group is then followed exactly, together with the sample of `Gear.attractors`. A group that is only an artefact
of the grid therefore gets the label of the true attractor. Refinement follows more cells exactly: a lattice of cells,
and then the cells at basin boundaries. The label of such a cell holds for all cells that the map sends to it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.cell_map import PhaseSpeedBox, find_cell_numbers, periodic_groups_of_cell_map
from rattle.attractors.classify import BUDGET, WEAK, Classifier
from rattle.attractors.recurrence import SAME_POINT
from rattle.attractors.samples import Outcome
from rattle.attractors.speeds import SampleSpec
from rattle.attractors.table import (
    Attractor,
    AttractorTable,
    attractor_columns,
    attractors_of_cell,
    tabulate_attractors,
)
from rattle.errors import require_integer, require_number, require_one_of
from rattle.flight.law import speed_unit, wrap_phase_difference
from rattle.notebook import Columns, Dataset, TabularResult, dataset_of
from rattle.numerics.states import parse_state_box
from rattle.parameters import Parameters

Array = NDArray[np.float64]

Range = tuple[float, float] | None

METHODS = ("cells", "direct", "refined")
MOST_CELLS_PER_AXIS = 4096  # 4096² cells need 16 million trajectories and some gigabytes of memory
SAMPLE_COUNT = 256  # number of initial conditions that are followed besides the cells, to find all attractors
LATTICE = 8  # method "refined": every 8th cell along τ and along v is followed exactly, and not by the cell map
MOST_MAP_STEPS = 8  # a state outside the box is followed exactly unless it returns within this many steps of the map
MOST_IMPACTS = 1000  # largest allowed number of impacts on Σ⁺ in one step of the cell map
# at weak damping MOST_IN_ALL impacts are divided among all states, but each state may make at least LEAST_BUDGET
MOST_IN_ALL, LEAST_BUDGET = 1 << 33, 1 << 13


def budget_per_state(delta: float, states: int) -> int:
    """Return the budget of each of `states` states, in impacts on Σ⁺.

    The budget is BUDGET, as in a survey. At damping below WEAK, where states take long to reach attractors, it is at
    most MOST_IN_ALL divided by the number of states, but at least LEAST_BUDGET.

    Returns
    -------
    int
        The budget.
    """
    return BUDGET if delta >= WEAK else int(np.clip(MOST_IN_ALL // max(states, 1), LEAST_BUDGET, BUDGET))


@dataclass(frozen=True)
class StatePlane:
    """The plane of states (τ, v) on Σ⁺ of a gear at one parameter point.

    `classifier` is the gear's classifier; `parameters` holds arrays (1,). States are arrays (k,).
    """

    classifier: type[Classifier]
    parameters: Parameters

    @property
    def delta(self) -> float:
        """The damping δ of the gear."""
        return float(self.parameters.delta[0])

    @property
    def speed_difference_unit(self) -> float:
        """The unit of speed differences (`rattle.flight.law.speed_unit`), which depends on δ, ε and β."""
        point = self.parameters.point()
        return float(speed_unit(point["delta"], point["epsilon"], point["beta"]))

    def classify(self, tau: Array, v: Array) -> Classifier:
        """Follow states to their attractors as samples of one cell, and return the classifier with the outcomes."""
        budget = budget_per_state(self.delta, tau.size)
        return self.classifier.classify(self.parameters, tau[None].copy(), v[None].copy(), budget)

    def states_after_returns(self, tau: Array, v: Array, returns: int) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return the states after a number of returns to Σ⁺, and flags of states that became quiet on the way."""
        return self.classifier.states_after_returns(self.parameters, tau, v, returns)

    def cell_numbers_of_states(self, tau: Array, v: Array, n: int, box: PhaseSpeedBox) -> NDArray[np.int64]:
        """Return the number of the cell that holds each state.

        Returns
        -------
        NDArray[np.int64]
            Row-major number (v, τ) among the n × n cells of the box; n² if the state is certain to become quiet; −1
            outside the box.
        """
        cell, quiet = np.empty(tau.size, np.int64), self.classifier.quiet_invariant(self.parameters)
        point = self.parameters.point()
        find_cell_numbers(tau, v, n, box, point["delta"], point["epsilon"], quiet, cell)
        return cell

    def draw_initial_conditions(self, count: int, v_max: float) -> tuple[Array, Array]:
        """Return τ and v (count,) of the initial conditions of a sample with speeds up to v_max."""
        tau, v = SampleSpec(count, v_max).draw_states(self.parameters)
        return tau[0], v[0]


@dataclass(frozen=True, repr=False)
class Basins(TabularResult):
    """Basins of attraction on n × n cells of a box of (τ, v).

    Attributes
    ----------
    tau, v : ndarray, (n,)
        Centres of the cells: phase in forcing periods, and dimensionless speed.
    labels : ndarray of int, (n, n)
        For each cell the index of its attractor in `attractors`; rows are speeds.
    attractors : tuple of Attractor
        The attractors, ordered by falling fraction of the cells.
    steps : ndarray of int, (n, n)
        Impacts on Σ⁺ until the attractor was certain; −1 where the trajectory from the cell's centre is chaotic or
        undecided. With cell mapping, steps of the map lead from each cell to one that was followed exactly. The number
        is then the sum of the impacts of these steps and of the impacts for which the last cell was followed.
    method : str
        The method: one of `METHODS`.
    box : PhaseSpeedBox
        Ranges of τ and v, by default [0, 1) × (0, v_max).
    """

    tau: NDArray[np.float64]
    v: NDArray[np.float64]
    labels: NDArray[np.int64]
    attractors: tuple[Attractor, ...]
    steps: NDArray[np.int64]
    method: str
    box: PhaseSpeedBox

    @property
    def v_max(self) -> float:
        """The largest speed of the box."""
        return self.box.v_high

    def describe_grid(self) -> str:
        """Return the number of cells and the ranges of their box, such as "9 × 9 cells of (τ, v) ∈ [0, 1) × (0, 7)"."""
        box = f"[{self.box.tau_low:g}, {self.box.tau_high:g}) × ({self.box.v_low:g}, {self.box.v_high:g})"
        return f"{self.v.size} × {self.tau.size} cells of (τ, v) ∈ {box}"

    def _caption(self) -> str:
        return f"basins of {len(self.attractors)} attractors on {self.describe_grid()}, method {self.method!r}"

    def _columns(self) -> Columns:
        return attractor_columns(self.attractors)

    def to_xarray(self) -> Dataset:
        """Return labels and steps as a Dataset over (v, tau). Raises MissingExtraError without xarray."""
        names = [each.name for each in self.attractors]
        coded = {"flag_values": list(range(len(names))), "flag_meanings": " ".join(names), "long_name": "attractor"}
        return dataset_of(
            {"labels": (("v", "tau"), self.labels, coded), "steps": (("v", "tau"), self.steps)},
            {"v": self.v, "tau": self.tau},
            {"method": self.method, "v_max": self.v_max},
        )


def classify_plane_states(
    plane: StatePlane, tau: Array, v: Array
) -> tuple[AttractorTable, NDArray[np.int64], NDArray[np.int64]]:
    """Follow states (n,); return the table of the attractors that they reach, and the row and impacts of each state.

    Returns
    -------
    tuple[AttractorTable, NDArray[np.int64], NDArray[np.int64]]
        The table; for each state the row of its attractor, and the impacts on Σ⁺ for which the state was followed.
    """
    classifier = plane.classify(tau, v)
    table, rows = tabulate_attractors(classifier)
    return table, rows, classifier.samples.impacts


def _mask_chaotic_and_undecided_steps(
    steps: NDArray[np.int64], table: AttractorTable, rows: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return `steps` with −1 for chaotic and undecided states.

    steps: for each state the number of impacts until its attractor was certain.
    rows: for each state the row of its attractor in the table.

    Returns
    -------
    NDArray[np.int64]
        Impacts, or −1, of each state.
    """
    kind = table.kind[rows]
    return np.where((kind == Outcome.CHAOTIC) | (kind == Outcome.UNDECIDED), -1, steps)


def flag_boundary_cells(labels: NDArray[np.int64], all_phases: bool = True) -> NDArray[np.bool_]:
    """Return flags (n_v, n_tau) of the cells that differ in their label from one of the eight cells around them.

    If the grid covers all phases, the last phase is a neighbour of the first. Speeds are not periodic.

    Returns
    -------
    NDArray[np.bool_]
        (n_v, n_tau), True at a basin boundary.
    """
    wide = np.pad(labels, ((0, 0), (1, 1)), mode="wrap" if all_phases else "edge")
    wide = np.pad(wide, ((1, 1), (0, 0)), mode="edge")
    rows, columns = labels.shape
    found = np.zeros(labels.shape, np.bool_)
    for i in range(3):
        for j in range(3):
            found |= wide[i : i + rows, j : j + columns] != labels
    return found


def _induced_cell_map(
    plane: StatePlane, tau: Array, v: Array, n: int, box: PhaseSpeedBox, impacts: int
) -> NDArray[np.int64]:
    """Return the map of cells (n² + 1,), induced by Π^impacts. The last cell is the sink of states that become quiet.

    A cell maps to itself if the trajectory from its centre leaves the box and does not return within MOST_MAP_STEPS
    further steps of the map. Such a cell is a group of its own, which is followed exactly.

    Returns
    -------
    NDArray[np.int64]
        For each cell the number of the cell to which its centre is mapped.
    """
    sink = tau.size
    t, speed, rests = plane.states_after_returns(tau, v, impacts)
    image = np.append(np.where(rests, sink, plane.cell_numbers_of_states(t, speed, n, box)), sink)
    image[:-1][plane.cell_numbers_of_states(tau, v, n, box) == sink] = sink
    outside = np.flatnonzero(image < 0)
    for _ in range(MOST_MAP_STEPS):
        t[outside], speed[outside], rests = plane.states_after_returns(t[outside], speed[outside], impacts)
        image[outside] = np.where(rests, sink, plane.cell_numbers_of_states(t[outside], speed[outside], n, box))
        outside = outside[image[outside] < 0]
    image[outside] = outside
    return image


class GrowingClassification:
    """The attractors of states of one parameter point, found in several calls and kept in one common table."""

    def __init__(self, plane: StatePlane) -> None:
        self.plane = plane
        self.table = AttractorTable.empty()
        #: One state for each attractor of the table. Each call of `classify_more_states` follows these states again, to
        #: find the rows of the known attractors in the table of that call.
        self.tau, self.v = np.zeros((2, 0))

    def classify_more_states(
        self, tau: NDArray[np.float64], v: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Classify states. Return for each state the row of its attractor in the common table, and the state's impacts.

        Attractors that are in the table already keep their rows; new ones are appended.

        Returns
        -------
        tuple[NDArray[np.int64], NDArray[np.int64]]
            For each state the row, and the impacts on Σ⁺ for which the state was followed.
        """
        known, tau, v = self.tau.size, np.append(self.tau, tau), np.append(self.v, v)
        table, rows, impacts = classify_plane_states(self.plane, tau, v)
        row_of = self._rows_in_common_table(table, rows[:known])
        fresh = np.flatnonzero(row_of < 0)
        row_of[fresh] = known + np.arange(fresh.size)
        self.table = AttractorTable.concat([self.table, table.take(fresh)])
        one = np.array([np.argmax(rows == row) for row in fresh], np.int64)
        self.tau, self.v = np.append(self.tau, tau[one]), np.append(self.v, v[one])
        return row_of[rows[known:]], impacts[known:]

    def _rows_in_common_table(self, table: AttractorTable, reached: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return for each row of `table` the row of the same attractor in the common table, `self.table`.

        reached (k,): for each attractor of the common table, the row of `table` that its stored state reached when it
        was followed again.

        Returns
        -------
        NDArray[np.int64]
            Rows of the common table; −1 for an attractor that is not in it.
        """
        here, there = self.table, table.take((slice(None), None))
        near = SAME_POINT * self.plane.speed_difference_unit
        same = (np.abs(wrap_phase_difference(there.tau - here.tau)) < SAME_POINT) & (np.abs(there.v - here.v) < near)
        same[reached, np.arange(reached.size)] = True
        same |= (here.kind == Outcome.QUIET) | (here.kind == Outcome.UNDECIDED)
        for name in ("kind", "m", "n_plus", "n_minus"):
            same &= getattr(there, name) == getattr(here, name)
        row = np.full(table.kind.size, -1)
        one, other = np.nonzero(same)
        row[one[::-1]] = other[::-1]
        return row


def _classify_by_cell_map(
    plane: StatePlane, tau: Array, v: Array, n: int, box: PhaseSpeedBox, impacts: int, refine: bool
) -> tuple[AttractorTable, NDArray[np.int64], NDArray[np.int64]]:
    """Classify the centres of all cells by simple cell mapping.

    refine: whether a lattice of cells is also followed exactly, and then cells at basin boundaries, until every cell at
    a boundary has been followed exactly.

    Returns
    -------
    tuple[AttractorTable, NDArray[np.int64], NDArray[np.int64]]
        The attractors; for each cell the row of its attractor, and the impacts until this attractor was certain.
    """
    # at weak damping a step of the cell map needs more impacts to move a state by more than a cell
    impacts = round(impacts * max(1.0, WEAK / plane.delta))
    image = _induced_cell_map(plane, tau, v, n, box, impacts)
    group, steps, members = periodic_groups_of_cell_map(image)
    sink, on_sink = tau.size, np.flatnonzero(image[:-1] == tau.size)[:1]
    # These cells are followed exactly: one cell of each group except the last one, which is the sink of quiet states,
    # and one cell that maps to the sink, if there is such a cell.
    chosen = np.concatenate([members[:-1], on_sink])
    if refine:
        each = np.arange(min(LATTICE, n) // 2, n, LATTICE)
        chosen = np.concatenate([chosen, np.setdiff1d(n * each[:, None] + each, chosen)])
    first, second = plane.draw_initial_conditions(SAMPLE_COUNT, box.v_high)
    states = GrowingClassification(plane)
    found, made = states.classify_more_states(np.append(first, tau[chosen]), np.append(second, v[chosen]))
    # for each cell that was followed exactly, and for the sink: row of its attractor, and impacts until it was certain
    row, needed, known = np.zeros(sink + 1, np.int64), np.zeros(sink + 1, np.int64), np.zeros(sink + 1, np.bool_)
    row[chosen], needed[chosen], known[chosen] = found[SAMPLE_COUNT:], made[SAMPLE_COUNT:], True
    row[sink] = row[on_sink[0]] if on_sink.size else 0
    while refine:
        image[known] = np.flatnonzero(known)
        group, steps, members = periodic_groups_of_cell_map(image)
        meet = flag_boundary_cells(row[members][group[:-1]].reshape(n, n), box.tau_high - box.tau_low == 1.0)
        edge = np.flatnonzero(meet.ravel() & ~known[:-1])
        if not edge.size:
            break
        row[edge], needed[edge] = states.classify_more_states(tau[edge], v[edge])
        known[edge] = True
    rows = row[members][group[:-1]]
    steps = steps[:-1] * impacts + needed[members][group[:-1]]
    return states.table, rows, _mask_chaotic_and_undecided_steps(steps, states.table, rows)


def compute_basins(
    plane: StatePlane, resolution: int, v_max: float, method: str, impacts: int, tau: Range = None, v: Range = None
) -> Basins:
    """Return the basins of attraction on a grid of states (τ, v); `rattle.Gear.basins` explains the arguments."""
    n = require_integer("resolution", resolution, 1, MOST_CELLS_PER_AXIS)
    v_max = require_number("v_max", v_max, positive=True)
    phases, speeds = parse_state_box((0.0, 1.0) if tau is None else tau, (0.0, v_max) if v is None else v)
    box = PhaseSpeedBox(*phases, *speeds)
    impacts = require_integer("impacts", impacts, 1, MOST_IMPACTS)
    require_one_of("method", method, METHODS)
    centres = (np.arange(n) + 0.5) / n
    across, up = phases[0] + (phases[1] - phases[0]) * centres, speeds[0] + (speeds[1] - speeds[0]) * centres
    first, second = np.tile(across, n), np.repeat(up, n)
    if method == "direct":
        table, rows, steps = classify_plane_states(plane, first, second)
        steps = _mask_chaotic_and_undecided_steps(steps, table, rows)
    else:
        table, rows, steps = _classify_by_cell_map(plane, first, second, n, box, impacts, method == "refined")
    count = np.bincount(rows, minlength=table.kind.size)
    order = np.argsort(-count, kind="stable")[: np.count_nonzero(count)]
    label = np.zeros(count.size, np.int64)
    label[order] = np.arange(order.size)
    found = attractors_of_cell(table.take(order), count[order])
    return Basins(across, up, label[rows].reshape(n, n), found, steps.reshape(n, n), method, box)
