"""Regions I–V of the (δ, ε) plane (paper, Figure 7), from the orbits that exist and the stability of D."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.orbits import PeriodOne, period_one

OTHER, REGION_I, REGION_II, REGION_III, REGION_IV, REGION_V = range(6)


def classify(orbits: PeriodOne) -> NDArray[np.int8]:
    """Region of each parameter point from its period-one orbits; 0 where the combination is none of the five.

    I: none of A–D. II: A and C. III: all four, D stable. IV: all four, D unstable. V: A and D.
    """
    a, b, c, d = orbits.exists
    stable = orbits.stable[3]
    region = np.full(a.shape, OTHER, np.int8)
    region[~(a | b | c | d)] = REGION_I
    region[a & c & ~b & ~d] = REGION_II
    region[a & b & c & d & stable] = REGION_III
    region[a & b & c & d & ~stable] = REGION_IV
    region[a & d & ~b & ~c] = REGION_V
    return region


def regions(delta: ArrayLike, epsilon: ArrayLike, beta: ArrayLike = 0.6) -> NDArray[np.int8]:
    """Region 1…5 (I…V) of every element of the broadcast parameters, int8; 0: another combination of orbits.

    δ > 0, ε ≥ 0, β > 0, dimensionless. Raises ParameterError. Source: paper, section 5.2 and Figure 7.
    """
    return classify(period_one(delta, epsilon, beta))
