"""From a block of cells to the values of one variable."""

from collections.abc import Callable, Iterable

import numpy as np

import rattle
from workers.cells import Cells

SLOTS = 8
KINDS = ("none", "quiet", "periodic", "chaotic", "undecided")
STATUS = ("not_computed", "ok", "some_undecided", "failed")
OK, SOME_UNDECIDED, FAILED = 1, 2, 3

Found = tuple[rattle.Attractor, ...]
Evaluate = Callable[[Cells], np.ndarray]


def orbits(field: str) -> Evaluate:
    """Take a field of the orbits A to D: shape (4, …, n_epsilon, n_delta)."""
    return lambda cells: getattr(cells.period_one, field)


def grazing(field: str) -> Evaluate:
    """Take a field of the curves G1 and G2: shape (2, …, n_delta)."""
    return lambda cells: np.stack([getattr(curve, field) for curve in cells.grazing])


def slots(value: Callable[[rattle.Attractor], float], dtype: str, fill: float = 0) -> Evaluate:
    """Put `value` of the first attractors of each cell in its slots: shape (8, n_epsilon, n_delta)."""

    def evaluate(cells: Cells) -> np.ndarray:
        filled = np.full((SLOTS, *cells.shape), fill, dtype)
        for i, j, found in cells.each():
            filled[: len(found), i, j] = [value(attractor) for attractor in found[:SLOTS]]
        return filled

    return evaluate


def lyapunov(cells: Cells) -> np.ndarray:
    """Take both exponents of each slot: shape (8, 2, n_epsilon, n_delta)."""
    first = slots(lambda attractor: attractor.lyapunov[0], "float64", np.nan)
    second = slots(lambda attractor: attractor.lyapunov[1], "float64", np.nan)
    return np.stack([first(cells), second(cells)], axis=1)


def per_cell(value: Callable[[Found, float], float]) -> Evaluate:
    """Reduce the attractors of each cell, and its δ, to one number: shape (n_epsilon, n_delta)."""

    def evaluate(cells: Cells) -> np.ndarray:
        values = np.empty(cells.shape)
        for i, j, found in cells.each():
            values[i, j] = value(found, cells.delta[j])
        return values

    return evaluate


def fraction(kind: str) -> Evaluate:
    """Add the basin fractions of all attractors of a kind, those beyond the slots too."""
    return per_cell(lambda found, _: sum(attractor.fraction for attractor in found if attractor.kind == kind))


def fraction_error(cells: Cells) -> np.ndarray:
    """Half the width of the 95 % Wilson interval of the quiet fraction."""
    low, high = rattle.wilson_interval(np.rint(fraction("quiet")(cells) * cells.count), cells.count)
    return (high - low) / 2


def lyapunov_max(found: Found, _: float) -> float:
    """Return the largest first exponent."""
    return _largest(attractor.lyapunov[0] for attractor in found)


def sum_rule_error(found: Found, delta: float) -> float:
    """Return the largest |λ₁ + λ₂ + δ|."""
    return _largest(abs(sum(attractor.lyapunov) + delta) for attractor in found)


def _largest(values: Iterable[float]) -> float:
    """Return the largest value; quiet and undecided attractors have no exponents, NaN, which do not count."""
    return max((value for value in values if not np.isnan(value)), default=np.nan)


def status(cells: Cells) -> np.ndarray:
    """Tell cells with undecided samples; a cell that fails never comes here."""
    if not cells.count:
        return np.full(cells.shape, OK)
    return np.where(fraction("undecided")(cells) > 0, SOME_UNDECIDED, OK)
