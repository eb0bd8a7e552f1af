"""Populations of gears: how many run quietly, pass, how hard they rattle, and which tolerance makes the difference."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import ArrayLike

from rattle.attractors.classify import BUDGET
from rattle.populations.answers import Population
from rattle.populations.gears import computed
from rattle.populations.plan import JUDGED, PAIRS, Plan, Shock
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
    """Return a population of gears: what their tolerances make of them.

    Each gear is followed from `count` states of [0, 1) × (0, natural speed), or from what a shock makes of rest: few
    are enough for what is asked of all. For the yield, `judged` gears pass whose share of quiet runs is at least
    `share`, or that no impact up to the speed `margin` (m/s of a machine) takes out of quiet running. `pairs` of gears
    share numbers, for Sobol indices.

    The result is deterministic in all arguments; a gear depends on its number alone, and 40,000 of them are the first
    40,000 of more.

    Parameters
    ----------
    given : Mapping[str, Any]
        The numbers of a gear by name, one or more a distribution (`Normal`, `Uniform`, `Triangular`, `LogNormal`,
        `Measured`, or text as `distribution_of` reads it): delta, epsilon, beta and what a model adds, or those of a
        `Machine` with rpm.
    correlation : ArrayLike | None
        A matrix of those that vary, its rows in this order, of a machine inertia, drag, backlash, eccentricity, radius,
        rpm, stiffness.

    Returns
    -------
    Population
        Its methods give the yield, quantiles and indices.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    tolerances = Tolerances(given, correlation)
    plan = Plan(tolerances, gears, count, share, margin, shock, judged, pairs, seed, budget)
    return Population(plan, computed(plan, 0, plan.rows))
