"""Basins of attraction on a grid of the (τ, v) plane: by cell mapping, by every cell's own trajectory, or by both.

Whatever the method, attractors are told apart by the classifier of `rattle.attractors` alone. Cell mapping replaces the
map of states by a map of cells, Π^k of each centre, and finds its periodic groups in one pass; then one member of each
group is followed exactly, together with the sample of `Gear.attractors`. So a group that only the grid has made gets
the label of the attractor that it is in fact on the way to.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rattle.attractors import CHAOTIC, UNDECIDED, Attractor, Attractors, listed, tabulated
from rattle.cell_map import groups_of_map, locate
from rattle.errors import require, require_integer, require_number
from rattle.iterate import iterate
from rattle.quiet import capture_invariant
from rattle.sampling import initial_conditions
from rattle.survey import followed

METHODS = ("cells", "direct", "refined")
FINEST = 4096  # cells a side: 16 million trajectories, some gigabytes
SAMPLE = 256  # initial conditions that look for the attractors besides the cells
RETURNS = 8  # steps of the cell map that a state above v_max may take to come back before it is followed exactly
MOST_IMPACTS = 1000

Parameters = tuple[float, float, float]


@dataclass(frozen=True)
class Basins:
    """Basins of attraction on n × n cells of (τ, v) ∈ [0, 1) × (0, v_max).

    tau, v (n,): centres of the cells (phase in forcing periods, dimensionless speed). labels (n, n), row by row of v:
    index into attractors, which are sorted by falling fraction of the cells. steps (n, n): impacts on Σ⁺ until the
    trajectory was certain to converge, in whole steps of the cell map where one was used; −1 if chaotic or undecided.
    """

    tau: NDArray[np.float64]
    v: NDArray[np.float64]
    labels: NDArray[np.int64]
    attractors: tuple[Attractor, ...]
    steps: NDArray[np.int64]
    method: str


def classified(
    parameters: Parameters, tau: NDArray[np.float64], v: NDArray[np.float64]
) -> tuple[Attractors, NDArray[np.int64], NDArray[np.int64]]:
    """The attractors that states (n,) go to, by the one classifier: the table, each state's row and impacts."""
    delta, epsilon, beta = (np.array([x]) for x in parameters)
    survey = followed(delta, epsilon, beta, tau[None].copy(), v[None].copy())
    table, rows = tabulated(survey)
    return table, rows, survey.samples.impacts


def _without_chaos(steps: NDArray[np.int64], table: Attractors, rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Steps to convergence, −1 where none is seen."""
    kind = table.kind[rows]
    return np.where((kind == CHAOTIC) | (kind == UNDECIDED), -1, steps)


def boundary(labels: NDArray[np.int64]) -> NDArray[np.bool_]:
    """The cells (n_v, n_tau) with another label among their eight neighbours; phases are periodic, speeds are not."""
    wide = np.pad(np.pad(labels, ((0, 0), (1, 1)), mode="wrap"), ((1, 1), (0, 0)), mode="edge")
    rows, columns = labels.shape
    found = np.zeros(labels.shape, np.bool_)
    for i in range(3):
        for j in range(3):
            found |= wide[i : i + rows, j : j + columns] != labels
    return found


def _images(
    parameters: Parameters, tau: NDArray[np.float64], v: NDArray[np.float64], n: int, v_max: float, impacts: int
) -> NDArray[np.int64]:
    """The map of cells (n² + 1,), the last the sink of quiet capture. A cell whose motion does not return below v_max
    maps to itself: a group of its own, which is then followed exactly.
    """
    sink, (delta, epsilon, beta) = tau.size, parameters
    capture = capture_invariant(delta, epsilon, beta)

    def cells_of(t: NDArray[np.float64], speed: NDArray[np.float64]) -> NDArray[np.int64]:
        cell = np.empty(t.size, np.int64)
        locate(t, speed, n, v_max, delta, epsilon, capture, cell)
        return cell

    t, speed, *_ = iterate(delta, epsilon, tau, v, impacts, beta)
    image = np.append(cells_of(t, speed), sink)
    image[:-1][cells_of(tau, v) == sink] = sink
    outside = np.flatnonzero(image < 0)
    for _ in range(RETURNS):
        t[outside], speed[outside], *_ = iterate(delta, epsilon, t[outside], speed[outside], impacts, beta)
        image[outside] = cells_of(t[outside], speed[outside])
        outside = outside[image[outside] < 0]
    image[outside] = outside
    return image


def _by_cells(
    parameters: Parameters,
    tau: NDArray[np.float64],
    v: NDArray[np.float64],
    n: int,
    v_max: float,
    impacts: int,
    refine: bool,
) -> tuple[Attractors, NDArray[np.int64], NDArray[np.int64]]:
    """As `classified` for the centres of all cells, by simple cell mapping; if refine, boundary cells by their own."""
    image = _images(parameters, tau, v, n, v_max, impacts)
    group, steps, members = groups_of_map(image)
    on_sink = np.flatnonzero(image[:-1] == tau.size)[:1]
    chosen = np.concatenate([members[:-1], on_sink])  # the sink's group is the last, and may be empty
    delta, epsilon, beta = (np.array([x]) for x in parameters)
    first, second = initial_conditions(delta, epsilon, beta, SAMPLE, v_max, 0)
    states = np.concatenate([first[0], tau[chosen]]), np.concatenate([second[0], v[chosen]])
    table, found, made = classified(parameters, *states)
    edge, member = np.zeros(0, np.int64), SAMPLE + group[:-1]
    if refine:
        edge = np.flatnonzero(boundary(found[member].reshape(n, n)))
        states = np.concatenate([states[0], tau[edge]]), np.concatenate([states[1], v[edge]])
        table, found, made = classified(parameters, *states)
    made[SAMPLE + members.size - 1 : SAMPLE + chosen.size] = 0  # nothing is left to do in the sink
    rows, steps = found[member], steps[:-1] * impacts + made[member]
    rows[edge], steps[edge] = found[states[0].size - edge.size :], made[states[0].size - edge.size :]
    return table, rows, _without_chaos(steps, table, rows)


def basins(
    delta: float, epsilon: float, beta: float, resolution: int, v_max: float, method: str, impacts: int
) -> Basins:
    """See `rattle.Gear.basins`."""
    n = require_integer("resolution", resolution, 1, FINEST)
    v_max = require_number("v_max", v_max, positive=True)
    impacts = require_integer("impacts", impacts, 1, MOST_IMPACTS)
    require(
        isinstance(method, str) and method in METHODS, f"method must be one of {', '.join(METHODS)}, got {method!r}"
    )
    centres = (np.arange(n) + 0.5) / n
    tau, v = np.tile(centres, n), np.repeat(v_max * centres, n)
    parameters = (delta, epsilon, beta)
    if method == "direct":
        table, rows, steps = classified(parameters, tau, v)
        steps = _without_chaos(steps, table, rows)
    else:
        table, rows, steps = _by_cells(parameters, tau, v, n, v_max, impacts, method == "refined")
    count = np.bincount(rows, minlength=table.kind.size)
    order = np.argsort(-count, kind="stable")[: np.count_nonzero(count)]
    label = np.zeros(count.size, np.int64)
    label[order] = np.arange(order.size)
    found = listed(Attractors._make(x[order] for x in table), count[order])
    return Basins(centres, v_max * centres, label[rows].reshape(n, n), found, steps.reshape(n, n), method)
