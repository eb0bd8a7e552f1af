"""Find the families of attractors of the impacting gear over a grid of the (δ, ε) plane."""

from __future__ import annotations

from numpy.typing import ArrayLike

from rattle.attractors.classify import BUDGET
from rattle.attractors.speeds import SampleSpec, SpeedLimit
from rattle.families.family_table import Families
from rattle.families.join import compute_families
from rattle.impacting.attractors.classifier import ImpactingClassifier


def families_of(
    delta: ArrayLike,
    epsilon: ArrayLike,
    beta: float = 0.6,
    count: int = 64,
    v_max: SpeedLimit = None,
    seed: int = 0,
    budget: int = BUDGET,
) -> Families:
    """Return the attractors of the cells of a grid, epsilon (m,) × delta (n,), joined into numbered families.

    Every stable periodic orbit is continued into the four neighbours of its cell, and from each neighbour into the next
    cells. So a cell also gets orbits that its samples missed. Chaotic attractors of neighbouring cells are joined if
    they visit the same states. docs/families.md defines families.

    Parameters
    ----------
    count, v_max, seed, budget
        The samples of each cell, as in `attractors_of`.

    Returns
    -------
    Families
        Arrays (rows,) of the cells' attractors, each with the number of its family.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    return compute_families(ImpactingClassifier, delta, epsilon, {"beta": beta}, SampleSpec(count, v_max, seed, budget))
