"""Tables of gears that were measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rattle.errors import require
from rattle.numerics.tables import read_columns
from rattle.populations.distributions import Measured
from rattle.populations.normal import ndtri
from rattle.populations.tolerances import DIMENSIONLESS, OF_MACHINE

LEAST = 3  # gears


def read_gears(path: str | Path) -> tuple[dict[str, Measured], NDArray[np.float64]]:
    """Read the numbers of measured gears.

    The table has a header that names them (eccentricity, …; SI units) and a row for each gear.

    Returns
    -------
    tuple[dict[str, Measured], NDArray[np.float64]]
        Their distributions, and their correlation as `population` takes it.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    RattleError
        If the file cannot be read.
    """
    names = *DIMENSIONLESS, *OF_MACHINE
    found = read_columns(path, names)
    columns = {name: found[name] for name in names if name in found}
    gears = len(next(iter(columns.values())))
    require(gears >= LEAST, f"{path} has {gears} gears: measure {LEAST} at least")
    scores = np.stack([_scores(values) for values in columns.values()])
    return {name: Measured(tuple(values)) for name, values in columns.items()}, np.atleast_2d(np.corrcoef(scores))


def _scores(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the normal numbers of ranks; equal values share theirs."""
    order = np.sort(values)
    ranks = 0.5 * (np.searchsorted(order, values, "left") + np.searchsorted(order, values, "right"))
    return np.asarray(ndtri(ranks / values.size))
