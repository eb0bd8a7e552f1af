"""Populations of gears that differ within their tolerances."""

from rattle.populations.answers import row_means
from rattle.populations.distributions import Distribution, parse_distribution
from rattle.populations.gears import VERDICTS, ComputedGears, compute_gears
from rattle.populations.limit import SAFE_IF_SMALL
from rattle.populations.plan import JUDGED, MOST_COUNT, MOST_GEARS, MOST_SHARE, PAIRS, PopulationPlan
from rattle.populations.tolerances import DIMENSIONLESS, OF_MACHINE, Tolerances, is_machine, model_of_numbers

__all__ = [
    "DIMENSIONLESS",
    "JUDGED",
    "MOST_COUNT",
    "MOST_GEARS",
    "MOST_SHARE",
    "OF_MACHINE",
    "PAIRS",
    "SAFE_IF_SMALL",
    "VERDICTS",
    "ComputedGears",
    "Distribution",
    "PopulationPlan",
    "Tolerances",
    "compute_gears",
    "is_machine",
    "model_of_numbers",
    "parse_distribution",
    "row_means",
]
