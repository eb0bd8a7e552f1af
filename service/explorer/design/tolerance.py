"""Gears whose parameters vary around a point: the ellipse that holds 95 % of the gears, and their yield."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import rattle
from gear_rattle.service.explorer.common.point_state import PointTolerances
from rattle import Estimate, Machine, Normal
from rattle.errors import require
from rattle.models import AnyGear, model_of_gear
from rattle.parameters import Harmonic

SHARE_INSIDE = 0.95  # share of the gears inside the ellipse
RADIUS = math.sqrt(-2.0 * math.log(1.0 - SHARE_INSIDE))  # radius of the ellipse in standard deviations
SIDES = 96  # number of sides of the polygon that is drawn for the ellipse
# initial conditions of each gear; largest number of gears from which the share of passing gears is estimated
COUNT, MOST_JUDGED = 8, 256
# Fields of a machine that `numbers_with_tolerances` does not copy. `rattle.population` takes "rpm" in place of the
# speed, a distribution in place of the eccentricity, and "error_20" and the like in place of the errors; no machine of
# the page has driven_errors.
NOT_COPIED = ("speed", "eccentricity", "errors", "driven_errors")
LEAST_OF_MEAN = 0.1  # least speed and least damping of a gear, each relative to its mean


class PopulationYield(NamedTuple):
    """The yield of a population of `gears` gears.

    quiet: the probability that a random gear runs quietly from a random initial condition. passing: the share of the
    gears that run quietly with at least the required probability.
    """

    gears: int
    quiet: Estimate
    passing: Estimate


def tolerance_outline(
    delta: float, epsilon: float, machine: Machine | None, widths: PointTolerances
) -> NDArray[np.float64]:
    """Return points (k, 2) of the ellipse around a point (δ, ε) that holds 95 % of the gears with these tolerances.

    If a machine is given, its speed and eccentricity vary, else δ and ε.

    Returns
    -------
    NDArray[np.float64]
        Points (δ, ε) of a closed polygon; every δ is positive, and no ε is negative.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, SIDES + 1)
    first, second = widths.first * RADIUS * np.cos(angle), widths.second * RADIUS * np.sin(angle)
    if machine is None:
        x, y = delta + first, epsilon + second
    else:
        x = delta * machine.rpm / np.maximum(machine.rpm + first, LEAST_OF_MEAN * machine.rpm)
        y = epsilon + second / machine.units.length
    return np.column_stack([np.maximum(x, LEAST_OF_MEAN * delta), np.maximum(y, 0.0)])


def numbers_with_tolerances(gear: AnyGear, machine: Machine | None, widths: PointTolerances) -> dict[str, Any]:
    """Return the numbers of a gear, or of its machine, with two tolerances, in the form that `rattle.population` takes.

    The tolerances are those of δ and ε, or of a machine's speed and eccentricity.

    Returns
    -------
    dict[str, Any]
        Numbers by name; a number with a tolerance above 0 is a normal distribution.

    Raises
    ------
    ParameterError
        A harmonic has a phase other than 0.
    """
    if machine is None:
        others: dict[str, Any] = {
            **model_of_gear(gear).numbers,
            **_amplitudes_by_order("harmonic", gear.parameters.harmonics),
        }
        pair = {"delta": gear.delta, "epsilon": gear.epsilon}
    else:
        pair = {"rpm": machine.rpm, "eccentricity": machine.eccentricity}
        names = (each.name for each in fields(machine) if each.name not in NOT_COPIED)
        others = {name: getattr(machine, name) for name in names} | _amplitudes_by_order("error", machine.errors)
    for name, width, low in zip(pair, widths, (LEAST_OF_MEAN, 0.0), strict=False):
        pair[name] = _number_with_tolerance(pair[name], width, low)
    return {**others, **pair}


def _amplitudes_by_order(name: str, harmonics: Sequence[Harmonic]) -> dict[str, float]:
    """Return amplitudes by order as `rattle.population` takes them. Raises ParameterError if a phase is not 0."""
    for order, _, phase in harmonics:
        require(
            phase == 0.0,
            f"tolerances need harmonics of phase 0, but the harmonic of order {order} has phase {phase:g}: set it to 0",
        )
    return {f"{name}_{order}": size for order, size, _ in harmonics}


def _number_with_tolerance(mean: float, width: float, low: float) -> Any:
    """Return a normal distribution cut off below low · mean; only `mean` if the standard deviation `width` is 0."""
    return Normal(mean, width, low=low * mean) if width > 0.0 else mean


def compute_yield(gear: AnyGear, machine: Machine | None, widths: PointTolerances) -> PopulationYield:
    """Return the yield of gears that vary around a point. Raises ParameterError if a harmonic's phase is not 0."""
    gears = model_of_gear(gear).design_gears
    found = rattle.population(
        numbers_with_tolerances(gear, machine, widths),
        gears=gears,
        count=COUNT,
        share=widths.share,
        judged=min(MOST_JUDGED, gears),
        pairs=0,
    )
    assert found.passing is not None
    return PopulationYield(gears, found.quiet, found.passing)


def describe_yield(found: PopulationYield, share: float) -> str:
    """Return a yield in sentences. share: the required probability of quiet running."""
    quiet, passing = _percentage_and_interval_text(found.quiet), _percentage_and_interval_text(found.passing)
    return (
        f"Of {found.gears} gears with these tolerances {quiet} of all runs are quiet. {passing} of the gears pass: "
        f"they run quietly with a probability of at least {share:g}. The brackets hold 95 % intervals."
    )


def _percentage_and_interval_text(found: Estimate) -> str:
    return f"{100 * found.value:.1f} % [{100 * found.low:.1f}, {100 * found.high:.1f}]"
