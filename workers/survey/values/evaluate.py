"""Compute the values of stored variables from a rectangle of cells."""

from collections.abc import Callable

import numpy as np

import rattle
from gear_rattle.workers.survey.values.cells import Cells

KINDS = rattle.KINDS
STATUS = ("not_computed", "ok", "some_undecided", "failed")  # meanings of the codes of the stored variable `status`
OK, SOME_UNDECIDED, FAILED = 1, 2, 3

Evaluate = Callable[[Cells], np.ndarray]


def orbit_evaluator(field: str) -> Evaluate:
    """Return the function that evaluates a field of the orbits A to D, shape (4, …, n_epsilon, n_delta)."""
    return lambda cells: getattr(cells.period_one_orbits, field)


def grazing_evaluator(field: str) -> Evaluate:
    """Return the function that evaluates a field of the grazing curves G1 and G2, shape (2, …, n_delta)."""
    return lambda cells: np.stack([getattr(curve, field) for curve in cells.grazing_points])


def slot_evaluator(field: str, dtype: str, fill: float = 0) -> Evaluate:
    """Return the function that evaluates a field of the attractors in slots, shape (slots, n_epsilon, n_delta)."""

    def evaluate(cells: Cells) -> np.ndarray:
        return arrange_in_slots(cells, getattr(cells.attractors, field), fill, dtype)

    return evaluate


def arrange_in_slots(cells: Cells, values: np.ndarray, fill: float, dtype: str) -> np.ndarray:
    """Arrange values of attractors by slot and cell, shape (slots, n_epsilon, n_delta); empty slots get `fill`."""
    cell, slot = cells.attractors.cell, _slot_of_each_attractor(cells)
    filled = np.full((cells.slots, cells.delta.size * cells.epsilon.size), fill, dtype)
    shown = slot < cells.slots
    filled[slot[shown], cell[shown]] = values[shown]
    return filled.reshape(cells.slots, *cells.shape)


def _slot_of_each_attractor(cells: Cells) -> np.ndarray:
    """Return the slot of each attractor: its position among the attractors of its cell."""
    cell = cells.attractors.cell
    return np.arange(cell.size) - np.searchsorted(cell, cell)


def basin_fraction_of_slots(cells: Cells) -> np.ndarray:
    """Return the basin fraction of each slot, shape (slots, n_epsilon, n_delta)."""
    return slot_evaluator("samples", "float64")(cells) / cells.sample_count


def upper_fraction_limits_of_slots(cells: Cells) -> np.ndarray:
    """Return the upper 95 % Wilson limits of `basin_fraction_of_slots`, shape (slots, n_epsilon, n_delta)."""
    return arrange_in_slots(
        cells, rattle.wilson_interval(cells.attractors.samples, cells.sample_count)[1], np.nan, "float64"
    )


def unlisted_fraction(cells: Cells) -> np.ndarray:
    """Return for each cell the basin fraction of all attractors that no slot lists, because the slots are full."""
    return (
        _sum_over_attractors(cells, cells.attractors.samples * (_slot_of_each_attractor(cells) >= cells.slots))
        / cells.sample_count
    )


def shortest_observation_times(cells: Cells) -> np.ndarray:
    """Return each cell's shortest observation time of chaotic or undecided samples, in forcing periods.

    Returns
    -------
    np.ndarray
        Shape (n_epsilon, n_delta); NaN where every sample reached a quiet or periodic attractor.
    """
    least = np.full(cells.delta.size * cells.epsilon.size, np.nan)
    np.fmin.at(least, cells.attractors.cell, cells.attractors.watched)
    return least.reshape(cells.shape)


def slot_lyapunov_exponents(cells: Cells) -> np.ndarray:
    """Return both Lyapunov exponents of the attractor in each slot, shape (slots, 2, n_epsilon, n_delta)."""
    return np.stack([slot_evaluator(field, "float64", np.nan)(cells) for field in ("first", "second")], axis=1)


def _sum_over_attractors(cells: Cells, weights: np.ndarray) -> np.ndarray:
    """Return the sum of `weights` over the attractors of each cell, shape (n_epsilon, n_delta)."""
    return np.bincount(cells.attractors.cell, weights, cells.delta.size * cells.epsilon.size).reshape(cells.shape)


def attractor_count(cells: Cells) -> np.ndarray:
    """Return each cell's number of attractors, with or without a slot; undecided samples count as one attractor."""
    return _sum_over_attractors(cells, np.ones(cells.attractors.cell.size))


def kind_fraction_evaluator(kind: str) -> Evaluate:
    """Return the function that evaluates each cell's basin fraction of all attractors of a kind, listed or not."""

    def evaluate(cells: Cells) -> np.ndarray:
        found = cells.attractors
        return _sum_over_attractors(cells, found.samples * (found.kind == KINDS.index(kind))) / cells.sample_count

    return evaluate


def fraction_error(cells: Cells) -> np.ndarray:
    """Return half the width of the 95 % Wilson interval of each cell's quiet fraction."""
    low, high = rattle.wilson_interval(
        np.rint(kind_fraction_evaluator("quiet")(cells) * cells.sample_count), cells.sample_count
    )
    return (high - low) / 2


def lyapunov_max(cells: Cells) -> np.ndarray:
    """Return the largest Lyapunov exponent of the attractors of each cell; NaN if none of them has an exponent."""
    return _largest_over_attractors(cells, cells.attractors.first)


def sum_rule_error(cells: Cells) -> np.ndarray:
    """Return the largest |λ₁ + λ₂ + δ| of the attractors of each cell, where λ₁ and λ₂ are their Lyapunov exponents."""
    found = cells.attractors
    delta = cells.delta[found.cell % cells.delta.size]
    return _largest_over_attractors(cells, np.abs(found.first + found.second + delta))


def impulse_balance_error(cells: Cells) -> np.ndarray:
    """Return the largest error of the impulse balance, |(Σv₊ − Σv₋)/(2πδT) − 1|, of the attractors of each cell.

    v₊ and v₋ are the impact speeds on Σ⁺ and Σ⁻ in T forcing periods.

    Returns
    -------
    np.ndarray
        Shape (n_epsilon, n_delta); NaN if all attractors are quiet.
    """
    errors = cells.model.impulse_balance_errors(cells.delta, cells.epsilon[:, None], cells.attractors)
    return _largest_over_attractors(cells, errors)


def _largest_over_attractors(cells: Cells, values: np.ndarray) -> np.ndarray:
    """Return the largest of `values` over the attractors of each cell, ignoring NaN; NaN if all values are NaN."""
    largest = np.full(cells.delta.size * cells.epsilon.size, np.nan)
    np.fmax.at(largest, cells.attractors.cell, values)
    return largest.reshape(cells.shape)


def status(cells: Cells) -> np.ndarray:
    """Return the status of cells that did not fail: SOME_UNDECIDED if a sample of the cell is undecided, else OK."""
    if not cells.sample_count:
        return np.full(cells.shape, OK)
    return np.where(kind_fraction_evaluator("undecided")(cells) > 0, SOME_UNDECIDED, OK)
