"""Families of attractors of the impacting gear over a grid of its plane."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.classify import BUDGET
from rattle.attractors.speeds import SpeedLimit
from rattle.errors import parameters, require_number
from rattle.families.join import axis, joined
from rattle.families.table import Families
from rattle.impacting.attractors.classifier import attractors_of, cells_of
from rattle.impacting.attractors.settle import Cells


def families_of(
    delta: ArrayLike,
    epsilon: ArrayLike,
    beta: float = 0.6,
    count: int = 64,
    v_max: SpeedLimit = None,
    seed: int = 0,
    budget: int = BUDGET,
) -> Families:
    """The attractors of the cells epsilon (m,) × delta (n,), joined to families that have one number each.

    Every stable periodic orbit is continued into the four neighbours of its cell, and from there on, so that cells also
    have the orbits that their samples missed; chaotic attractors of neighbours are one where they visit the same
    states. count, v_max, seed and budget: of the samples, as in `attractors_of`. docs/families.md has what is meant.
    Raises ParameterError.
    """
    delta, epsilon = axis("delta", delta), axis("epsilon", epsilon)
    beta = require_number("beta", beta, positive=True)
    table = attractors_of(delta, epsilon[:, None], beta, count, v_max, seed, budget)
    return joined(delta, epsilon, count, table, plane(delta, epsilon, beta))


def plane(delta: NDArray[np.float64], epsilon: NDArray[np.float64], beta: float, rests: bool = True) -> Any:
    """The cells epsilon (m,) × delta (n,) as kernels take them, row by row; without rests nothing is taken to be quiet,
    as of periodic orbits nothing is.
    """
    d, e, b = (np.array(x, order="C").ravel() for x in parameters(delta, epsilon[:, None], beta))
    return cells_of(d, e, b) if rests else Cells(d, e, b, np.zeros(d.size))
