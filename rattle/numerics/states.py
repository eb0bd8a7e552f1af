"""Samples of states that a user defines: uniform in a box, or with a density."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.errors import RattleError, require, require_integer, require_pair
from rattle.numerics.sampling import sobol_points

MOST_STATES = 1 << 20
DENSITY_STEPS = 512  # a density counts as constant in each of DENSITY_STEPS × DENSITY_STEPS rectangles of (τ, v)
Array = NDArray[np.float64]
Density = Callable[[Array, Array], ArrayLike]


def parse_state_box(tau: ArrayLike, v: ArrayLike) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the ranges (low, high) of τ and v. Raises ParameterError unless 0 ≤ low < high, and high ≤ 1 for τ."""
    phases, speeds = require_pair("tau", tau), require_pair("v", v)
    require(0.0 <= phases[0] < phases[1] <= 1.0, f"tau must be (low, high) within [0, 1], got {phases}")
    require(0.0 <= speeds[0] < speeds[1], f"v must be (low, high) with 0 <= low < high, got {speeds}")
    return phases, speeds


def sampled_states(
    count: int, v: ArrayLike, tau: ArrayLike = (0.0, 1.0), density: Density | None = None, seed: int = 0
) -> tuple[Array, Array]:
    """Return `count` low-discrepancy states (τ, v) of the box whose sides are the ranges tau and v.

    Parameters
    ----------
    count : int
        Number of states.
    v, tau : tuple[float, float]
        Ranges (low, high) of speed and phase.
    density : Density | None
        A function of arrays τ and v, not negative, with any scale. It counts as constant in each of 512 × 512
        rectangles of the box, with its value at the middle. Without a density the states are uniform.
    seed : int
        Seed of the random shift of the states.

    Returns
    -------
    tuple[Array, Array]
        τ and v, each (count,).

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    RattleError
        If the density function fails for arrays that broadcast.
    """
    count = require_integer("count", count, 1, MOST_STATES)
    seed = require_integer("seed", seed, 0, (1 << 128) - 1)
    (t0, t1), (v0, v1) = parse_state_box(tau, v)
    points = (sobol_points(count) + np.random.default_rng(seed).random(2)) % 1.0
    x, y = points.T if density is None else _transform_to_density(points, density, (t0, t1), (v0, v1))
    speeds = v0 + (v1 - v0) * y
    return np.minimum(t0 + (t1 - t0) * x, np.nextafter(1.0, 0.0)), np.maximum(speeds, np.spacing(v1))


def _transform_to_density(
    points: Array, density: Density, tau: tuple[float, float], v: tuple[float, float]
) -> tuple[Array, Array]:
    """Map uniform points (n, 2) of the unit square to positions in [0, 1] along τ and v that follow the density."""
    centres = (np.arange(DENSITY_STEPS) + 0.5) / DENSITY_STEPS
    phases, speeds = (low + (high - low) * centres for low, high in (tau, v))
    try:
        weight = np.broadcast_to(
            np.asarray(density(phases[:, None], speeds), np.float64), (DENSITY_STEPS, DENSITY_STEPS)
        )
    except (TypeError, ValueError) as error:
        raise RattleError(
            f"density must take arrays of τ and v that broadcast, and return a number for each state: {error}"
        ) from error
    good = bool(np.isfinite(weight).all() and (weight >= 0.0).all() and weight.sum() > 0.0)
    require(good, "density must be finite, nowhere negative and somewhere above 0 in the box")
    x, column = _inverse_distribution(weight.sum(axis=1)[None], np.zeros(len(points), np.int64), points[:, 0])
    y, _ = _inverse_distribution(weight, column, points[:, 1])
    return x, y


def _inverse_distribution(weight: Array, row: NDArray[np.int64], share: Array) -> tuple[Array, NDArray[np.int64]]:
    """Return the positions in [0, 1] at which distribution functions reach given shares (n,) of their largest value.

    weight (rows, k): in each row the density on k equal intervals of [0, 1]. row (n,): for each share, the number of
    the density whose distribution function is used.

    Returns
    -------
    tuple[Array, NDArray[np.int64]]
        Positions (n,), and the number (n,) of the interval in which each lies.
    """
    total = np.cumsum(weight, axis=1)
    ends = np.hstack([np.zeros((len(weight), 1)), total])
    want = share * total[row, -1]
    # concatenate the distribution functions to one increasing function, so that one search serves all rows
    offset = np.concatenate([[0.0], np.cumsum(ends[:, -1])])[:-1]
    line = (ends[:, 1:] + offset[:, None]).ravel()
    cell = np.searchsorted(line, want + offset[row], "right") - row * weight.shape[1]
    cell = np.clip(cell, 0, weight.shape[1] - 1)
    inside = weight[row, cell]
    part = np.where(inside > 0.0, (want - ends[row, cell]) / np.where(inside > 0.0, inside, 1.0), 0.5)
    return np.minimum((cell + np.clip(part, 0.0, 1.0)) / weight.shape[1], np.nextafter(1.0, 0.0)), cell
