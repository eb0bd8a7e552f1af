"""Families of attractors of the stiff gear over a grid of its plane."""

from __future__ import annotations

from numpy.typing import ArrayLike

from rattle.attractors.classify import BUDGET
from rattle.attractors.speeds import SampleSpec, SpeedLimit
from rattle.families.family_table import Families
from rattle.families.join import compute_families
from rattle.stiff.attractors.classifier import StiffClassifier


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
    """Return the families of attractors over a grid, as `rattle.families_of` does. Raises ParameterError."""
    gear = {"beta": beta, "kappa": kappa}
    return compute_families(StiffClassifier, delta, epsilon, gear, SampleSpec(count, v_max, seed, budget))
