"""`rattle.population`: compute gears that differ within their tolerances."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import ArrayLike

from rattle.attractors.classify import BUDGET
from rattle.populations.answers import Population
from rattle.populations.gears import compute_gears
from rattle.populations.plan import JUDGED, PAIRS, PopulationPlan, Shock
from rattle.populations.tolerances import Tolerances


def population(
    given: Mapping[str, Any],
    correlation: ArrayLike | None = None,
    *,
    gears: int = 4096,
    count: int = 16,
    share: float | None = None,
    margin: float | None = None,
    shock: Shock | None = None,
    judged: int = JUDGED,
    pairs: int = PAIRS,
    seed: int = 0,
    budget: int = BUDGET,
) -> Population:
    """Compute a population of gears that differ within their tolerances.

    The same arguments give the same result. Each gear is drawn from its row number and the seed alone, so the first
    gears of a larger population are the same.

    Parameters
    ----------
    given : Mapping[str, Any]
        The numbers of a gear by name: delta, epsilon, beta and the parameters that a model adds, or the numbers of a
        `Machine` with rpm. At least one is a distribution: `Normal`, `Uniform`, `Triangular`, `LogNormal`, `Measured`,
        or text that `parse_distribution` reads.
    correlation : ArrayLike | None
        The correlation matrix of the varying numbers, by default the identity. Its rows are in the order delta,
        epsilon, beta, …; for a machine in the order inertia, drag, backlash, eccentricity, radius, rpm, stiffness, ….
    gears : int
        The number of gears.
    count : int
        The number of states in [0, 1) × (0, natural speed) from which each gear is followed. A few states are enough
        for answers about all gears.
    share, margin : float | None
        The requirement for the yield. Give only one: a gear passes if its share of quiet runs is at least `share`,
        or if no impact up to the speed `margin` ends its quiet running (in m/s for a machine). If both are None, there
        is no requirement.
    shock : Shock | None
        A shock that separates the teeth of each gear, from which the gear is followed. None: the gear is followed from
        random states.
    judged : int
        The number of gears that are tested for the requirement.
    pairs : int
        The number of gears on which Sobol indices are based. Each of them needs additional gears that have some numbers
        in common with it.
    seed : int
        The seed of all random numbers.
    budget : int
        Impacts on Σ⁺ after which a sample that reached no attractor is undecided.

    Returns
    -------
    Population
        The population; its methods return the yield, quantiles and indices.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    tolerances = Tolerances(given, correlation)
    plan = PopulationPlan(tolerances, gears, count, share, margin, shock, judged, pairs, seed, budget)
    return Population(plan, compute_gears(plan, 0, plan.rows))
