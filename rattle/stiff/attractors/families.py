"""Families of attractors of the stiff gear over a grid of its plane."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.classify import BUDGET
from rattle.attractors.speeds import SpeedLimit
from rattle.errors import parameters, require_number
from rattle.families.join import axis, joined
from rattle.families.table import Families
from rattle.stiff.attractors.classifier import attractors_of, cells_of


def families_of(
    delta: ArrayLike,
    epsilon: ArrayLike,
    beta: float,
    kappa: float,
    count: int = 64,
    v_max: SpeedLimit = None,
    seed: int = 0,
    budget: int = BUDGET,
) -> Families:
    """As `rattle.families_of`. Raises ParameterError."""
    delta, epsilon = axis("delta", delta), axis("epsilon", epsilon)
    beta, kappa = (require_number(name, x, positive=True) for name, x in (("beta", beta), ("kappa", kappa)))
    table = attractors_of(delta, epsilon[:, None], beta, kappa, count, v_max, seed, budget)
    return joined(delta, epsilon, count, table, plane(delta, epsilon, beta, kappa))


def plane(delta: NDArray[np.float64], epsilon: NDArray[np.float64], beta: float, kappa: float) -> Any:
    """The cells epsilon (m,) × delta (n,) as kernels take them, row by row."""
    return cells_of(*(np.array(x, order="C").ravel() for x in parameters(delta, epsilon[:, None], beta, kappa=kappa)))
