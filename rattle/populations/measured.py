"""Read tables of measured gears."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rattle.errors import require
from rattle.numerics.tables import read_columns
from rattle.populations.distributions import Measured
from rattle.populations.normal import ndtri
from rattle.populations.tolerances import DIMENSIONLESS, OF_MACHINE

#: Least number of gears in a table of measured gears.
LEAST_GEARS = 3


def read_gears(path: str | Path) -> tuple[dict[str, Measured], NDArray[np.float64]]:
    """Read a table of measured gears.

    The first line names the columns: numbers of a machine (eccentricity, …, in SI units) or dimensionless numbers
    (delta, …). Each further line is one gear.

    Returns
    -------
    tuple[dict[str, Measured], NDArray[np.float64]]
        The distribution of each number, by its name, and the correlation matrix of the numbers; `rattle.population`
        takes both.

    Raises
    ------
    ParameterError
        If a number is outside its domain, or there are too few gears.
    RattleError
        If the file cannot be read.
    """
    names = *DIMENSIONLESS, *OF_MACHINE
    found = read_columns(path, names)
    columns = {name: found[name] for name in names if name in found}
    gears = len(next(iter(columns.values())))
    require(gears >= LEAST_GEARS, f"{path} has {gears} gears: give a table of at least {LEAST_GEARS} gears")
    scores = np.stack([_normal_scores(values) for values in columns.values()])
    return {name: Measured(tuple(values)) for name, values in columns.items()}, np.atleast_2d(np.corrcoef(scores))


def _normal_scores(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the standard normal quantile that belongs to the rank of each value; equal values have equal quantiles."""
    order = np.sort(values)
    ranks = 0.5 * (np.searchsorted(order, values, "left") + np.searchsorted(order, values, "right"))
    return np.asarray(ndtri(ranks / values.size))
