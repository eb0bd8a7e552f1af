"""Families of attractors of the impacting gear over a grid of its plane."""

import numpy as np
from numpy.typing import ArrayLike

from rattle.attractors.classify import BUDGET
from rattle.attractors.speeds import SpeedLimit
from rattle.errors import parameters, require_number
from rattle.families.join import axis, joined
from rattle.families.table import Families
from rattle.impacting.attractors.classifier import attractors_of, cells_of


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
    columns = (np.array(x, order="C").ravel() for x in parameters(delta, epsilon[:, None], beta))
    return joined(delta, epsilon, table, cells_of(*columns))
