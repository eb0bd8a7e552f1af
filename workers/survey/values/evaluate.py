"""Compute the values of a variable from a block of cells."""

from collections.abc import Callable

import numpy as np

import rattle
from gear_rattle.workers.survey.values.cells import Cells

KINDS = rattle.KINDS
STATUS = ("not_computed", "ok", "some_undecided", "failed")
OK, SOME_UNDECIDED, FAILED = 1, 2, 3

Evaluate = Callable[[Cells], np.ndarray]


def orbits(field: str) -> Evaluate:
    """Return the function that evaluates a field of the orbits A to D, shape (4, …, n_epsilon, n_delta)."""
    return lambda cells: getattr(cells.period_one, field)


def grazing_orbits(field: str) -> Evaluate:
    """Return the function that evaluates a field of the grazing curves G1 and G2, shape (2, …, n_delta)."""
    return lambda cells: np.stack([getattr(curve, field) for curve in cells.grazing])


def slots(field: str, dtype: str, fill: float = 0) -> Evaluate:
    """Return the function that evaluates a field of the listed attractors, shape (slots, n_epsilon, n_delta)."""

    def evaluate(cells: Cells) -> np.ndarray:
        return in_slots(cells, getattr(cells.attractors, field), fill, dtype)

    return evaluate


def in_slots(cells: Cells, values: np.ndarray, fill: float, dtype: str) -> np.ndarray:
    """Arrange values of attractors by slot and cell, shape (slots, n_epsilon, n_delta); empty slots get `fill`."""
    cell, slot = cells.attractors.cell, _slot(cells)
    filled = np.full((cells.slots, cells.delta.size * cells.epsilon.size), fill, dtype)
    shown = slot < cells.slots
    filled[slot[shown], cell[shown]] = values[shown]
    return filled.reshape(cells.slots, *cells.shape)


def _slot(cells: Cells) -> np.ndarray:
    """Return the slot of each attractor: its position among the attractors of its cell."""
    cell = cells.attractors.cell
    return np.arange(cell.size) - np.searchsorted(cell, cell)


def slot_fraction(cells: Cells) -> np.ndarray:
    """Return the basin fraction of each slot, shape (slots, n_epsilon, n_delta)."""
    return slots("samples", "float64")(cells) / cells.count


def slot_fraction_upper(cells: Cells) -> np.ndarray:
    """Return the upper end of the 95 % Wilson interval of `slot_fraction`, shape (slots, n_epsilon, n_delta)."""
    return in_slots(cells, rattle.wilson_interval(cells.attractors.samples, cells.count)[1], np.nan, "float64")


def unlisted_fraction(cells: Cells) -> np.ndarray:
    """Return for each cell the basin fraction of all attractors that are not listed, for lack of slots."""
    return _sum(cells, cells.attractors.samples * (_slot(cells) >= cells.slots)) / cells.count


def observed_periods(cells: Cells) -> np.ndarray:
    """Return each cell's shortest observation time of chaotic or undecided samples; NaN where every sample settled."""
    least = np.full(cells.delta.size * cells.epsilon.size, np.nan)
    np.fmin.at(least, cells.attractors.cell, cells.attractors.watched)
    return least.reshape(cells.shape)


def lyapunov(cells: Cells) -> np.ndarray:
    """Return both Lyapunov exponents of the attractor in each slot, shape (slots, 2, n_epsilon, n_delta)."""
    return np.stack([slots(field, "float64", np.nan)(cells) for field in ("first", "second")], axis=1)


def _sum(cells: Cells, weights: np.ndarray) -> np.ndarray:
    """Return the sum of `weights` over the attractors of each cell, shape (n_epsilon, n_delta)."""
    return np.bincount(cells.attractors.cell, weights, cells.delta.size * cells.epsilon.size).reshape(cells.shape)


def attractor_count(cells: Cells) -> np.ndarray:
    """Return the number of attractors of each cell, including attractors that are not listed for lack of slots."""
    return _sum(cells, np.ones(cells.attractors.cell.size))


def fraction(kind: str) -> Evaluate:
    """Return the function that evaluates each cell's basin fraction of all attractors of a kind, listed or not."""

    def evaluate(cells: Cells) -> np.ndarray:
        found = cells.attractors
        return _sum(cells, found.samples * (found.kind == KINDS.index(kind))) / cells.count

    return evaluate


def fraction_error(cells: Cells) -> np.ndarray:
    """Return half the width of the 95 % Wilson interval of each cell's quiet fraction."""
    low, high = rattle.wilson_interval(np.rint(fraction("quiet")(cells) * cells.count), cells.count)
    return (high - low) / 2


def lyapunov_max(cells: Cells) -> np.ndarray:
    """Return the largest Lyapunov exponent of the attractors of each cell; NaN if all of them are quiet."""
    return _largest(cells, cells.attractors.first)


def sum_rule_error(cells: Cells) -> np.ndarray:
    """Return the largest |λ₁ + λ₂ + δ| of the attractors of each cell, where λ₁ and λ₂ are the exponents."""
    found = cells.attractors
    delta = cells.delta[found.cell % cells.delta.size]
    return _largest(cells, np.abs(found.first + found.second + delta))


def impulse_balance_error(cells: Cells) -> np.ndarray:
    """Return the largest |(Σv₊ − Σv₋)/(2πδT) − 1| of the attractors of each cell (see `Model`)."""
    errors = cells.model.impulse_balance_errors(cells.delta, cells.epsilon[:, None], cells.attractors)
    return _largest(cells, errors)


def _largest(cells: Cells, values: np.ndarray) -> np.ndarray:
    """Return the largest of `values` over the attractors of each cell, ignoring NaN (attractors without exponents)."""
    largest = np.full(cells.delta.size * cells.epsilon.size, np.nan)
    np.fmax.at(largest, cells.attractors.cell, values)
    return largest.reshape(cells.shape)


def status(cells: Cells) -> np.ndarray:
    """Return the status of cells that did not fail: SOME_UNDECIDED if a sample is undecided, else OK."""
    if not cells.count:
        return np.full(cells.shape, OK)
    return np.where(fraction("undecided")(cells) > 0, SOME_UNDECIDED, OK)
