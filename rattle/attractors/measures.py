"""Measures of basins: cells that differ, basin entropy, and the uncertainty exponent of the boundary."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.basins import Basins, StatePlane, classify_plane_states
from rattle.attractors.samples import Outcome
from rattle.attractors.table import KINDS
from rattle.errors import require, require_integer, require_number
from rattle.numerics.sampling import Z_95, wilson_interval

# largest distance between the states of a pair, with τ in forcing periods and v in units of v_max; number of distances,
# each half the previous one
LARGEST_SIZE, SIZES = 2.0**-6, 8
LEAST_UNCERTAIN_PAIRS = 5  # the fit leaves out distances with fewer uncertain pairs than this
MOST_PAIRS = 1 << 20
LONGEST_BOX = 4096


class BasinEntropy(NamedTuple):
    """Mean entropy per box in nats: over all boxes, and over the boxes at basin boundaries.

    `boxes` and `boundary_boxes` are the numbers of these boxes. The entropy over boundaries is NaN if there are no
    boundary boxes. Both entropies are NaN if some cell has no known basin, because the trajectory from its centre is
    undecided.
    Source: Daza et al., Scientific Reports 6 (2016) 31416.
    """

    entropy: float
    boundary_entropy: float
    boxes: int
    boundary_boxes: int


class Uncertainty(NamedTuple):
    """The exponent α of the fraction of uncertain pairs, f ∝ size^α, with its 95 % half-width.

    A pair of states at the distance `size` is uncertain if the states go to different attractors. α and its half-width
    are NaN if fewer than three sizes have enough uncertain pairs.

    Attributes
    ----------
    sizes : ndarray, (k,)
        Distances between the states of a pair, in units of the whole plane (1 in τ, v_max in v).
    fractions, low, high : ndarray, (k,)
        Fraction of uncertain pairs, and its 95 % Wilson interval.
    pairs : ndarray of int, (k,)
        Number of pairs at each distance in which both states reach an attractor or are chaotic.
    """

    exponent: float
    error: float
    sizes: NDArray[np.float64]
    fractions: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    pairs: NDArray[np.int64]


def differing_cells(a: Basins, b: Basins) -> NDArray[np.bool_]:
    """Return flags (n, n) of the cells of (τ, v) that two results on the same grid give to different attractors.

    Attractors of both results are paired if they have the same kind and label P(m, n₊, n₋). Where several attractors
    have the same kind and label, they are paired so that the fewest cells differ.

    Returns
    -------
    NDArray[np.bool_]
        (n, n), with the axes of `Basins.labels`.

    Raises
    ------
    ParameterError
        If the grids differ in their numbers of cells or in their box of (τ, v).
    """
    same_grid = a.labels.shape == b.labels.shape and a.box == b.box
    grids = " and ".join(each.describe_grid() for each in (a, b))
    require(same_grid, f"the basins have different grids, {grids}: compute both with the same resolution and box")
    from scipy.optimize import linear_sum_assignment  # imported here because it is slow to load

    shape = (len(a.attractors), len(b.attractors))
    both = np.bincount(a.labels.ravel() * shape[1] + b.labels.ravel(), minlength=shape[0] * shape[1]).reshape(shape)
    names = [[(x.kind, x.m, x.n_plus, x.n_minus) for x in each.attractors] for each in (a, b)]
    alike = np.array([[x == y for y in names[1]] for x in names[0]])
    pairs = linear_sum_assignment(np.where(alike, both, -1), maximize=True)
    agree = np.zeros(shape, np.bool_)
    agree[pairs] = alike[pairs]
    return ~agree[a.labels, b.labels]


def disagreement(a: Basins, b: Basins) -> float:
    """Return the fraction of the (τ, v) cells that two results on the same grid give to different attractors."""
    return float(differing_cells(a, b).mean())


def basin_entropy(basins: Basins, box: int = 5) -> BasinEntropy:
    """Return the basin entropy of boxes of box × box cells: −Σ p ln p over the labels in a box, averaged over boxes.

    Cells beyond the last whole box, at the upper ends of τ and v, are left out. The entropies are NaN if some cell is
    undecided.

    Returns
    -------
    BasinEntropy
        Entropies and numbers of boxes.

    Raises
    ------
    ParameterError
        If no box fits.
    """
    n = basins.labels.shape[0]
    box = require_integer("box", box, 1, min(n, LONGEST_BOX))
    side = n // box
    cut = basins.labels[: side * box, : side * box]
    boxes = cut.reshape(side, box, side, box).transpose(0, 2, 1, 3).reshape(side * side, box * box)
    entropy = np.zeros(side * side)
    for label in range(len(basins.attractors)):
        p = (boxes == label).mean(axis=1)
        entropy -= p * np.log(np.where(p > 0, p, 1.0))
    mixed = (boxes != boxes[:, :1]).any(axis=1)
    at_boundary = float(entropy[mixed].mean()) if mixed.any() else float("nan")
    if any(attractor.kind == KINDS[Outcome.UNDECIDED] for attractor in basins.attractors):
        return BasinEntropy(float("nan"), float("nan"), side * side, int(mixed.sum()))
    return BasinEntropy(float(entropy.mean()), at_boundary, side * side, int(mixed.sum()))


def _draw_pairs_of_states(
    sizes: NDArray[np.float64], pairs: int, v_max: float, seed: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return phases and speeds (k, 2, pairs) of pairs of states at k distances `sizes`.

    The first state of a pair is uniformly distributed in the plane, the second lies in a uniformly random direction. If
    the second state would leave the plane, the change of speed is reversed.

    Returns
    -------
    tuple[NDArray[np.float64], NDArray[np.float64]]
        Phases and speeds.
    """
    random = np.random.default_rng(seed)
    shape = (sizes.size, pairs)
    tau, v = random.random(shape), 1.0 - random.random(shape)
    angle = 2 * np.pi * random.random(shape)
    step_tau, step_v = sizes[:, None] * np.cos(angle), sizes[:, None] * np.sin(angle)
    # reverse the change of speed where the second state would leave the plane
    step_v = np.where((v + step_v > 0) & (v + step_v < 1), step_v, -step_v)
    other_tau = (tau + step_tau) % 1.0
    other_tau = np.where(other_tau < 1.0, other_tau, 0.0)
    return np.stack([tau, other_tau], axis=1), v_max * np.stack([v, v + step_v], axis=1)


def fit_power_law(
    sizes: NDArray[np.float64], uncertain: NDArray[np.int64], pairs: NDArray[np.int64]
) -> tuple[float, float]:
    """Return α of uncertain/pairs ∝ size^α and its 95 % half-width, by weighted least squares of logarithms.

    The weights follow from the binomial variance of each count. If the points scatter more than counting explains, the
    half-width grows accordingly.

    Returns
    -------
    tuple[float, float]
        α and its half-width, both NaN where fewer than three sizes have enough uncertain pairs.
    """
    enough = uncertain >= LEAST_UNCERTAIN_PAIRS
    if enough.sum() < 3:
        return float("nan"), float("nan")
    x, f = np.log(sizes[enough]), uncertain[enough] / pairs[enough]
    # 1 / variance of ln f, with f the fraction of uncertain pairs
    weight = uncertain[enough] / np.maximum(1.0 - f, 0.5 / pairs[enough])
    middle = np.average(x, weights=weight)
    spread = float((weight * (x - middle) ** 2).sum())
    y = np.log(f)
    slope = float((weight * (x - middle) * y).sum()) / spread
    rest = y - np.average(y, weights=weight) - slope * (x - middle)
    scatter = float((weight * rest**2).sum()) / (x.size - 2)
    return slope, float(Z_95 * np.sqrt(max(scatter, 1.0) / spread))


def compute_uncertainty_exponent(plane: StatePlane, pairs: int, v_max: float, seed: int) -> Uncertainty:
    """Return the uncertainty exponent of this plane's basin boundary; see `rattle.Gear.uncertainty`."""
    pairs = require_integer("pairs", pairs, 1, MOST_PAIRS // 16)
    v_max = require_number("v_max", v_max, positive=True)
    seed = require_integer("seed", seed, 0, (1 << 128) - 1)
    sizes = np.asarray(LARGEST_SIZE / 2.0 ** np.arange(SIZES), np.float64)
    tau, v = _draw_pairs_of_states(sizes, pairs, v_max, seed)
    table, rows, _impacts = classify_plane_states(plane, tau.ravel(), v.ravel())
    one, other = np.moveaxis(rows.reshape(tau.shape), 1, 0)
    decided = (table.kind[one] != Outcome.UNDECIDED) & (table.kind[other] != Outcome.UNDECIDED)
    uncertain, count = ((one != other) & decided).sum(axis=1), decided.sum(axis=1)
    exponent, error = fit_power_law(sizes, uncertain, count)
    low, high = wilson_interval(uncertain, np.maximum(count, 1))
    return Uncertainty(exponent, error, sizes, uncertain / np.maximum(count, 1), low, high, count)
