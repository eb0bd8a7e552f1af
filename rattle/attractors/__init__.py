"""Decide which attractor a state of any gear goes to; compute basins and measure how they intermingle."""

from rattle.attractors.basins import classify_plane_states
from rattle.attractors.classify import BUDGET, ENOUGH_SAMPLES, PERIODS, WATCH
from rattle.attractors.samples import Outcome
from rattle.attractors.speeds import (
    LARGEST_BUDGET,
    NATURAL,
    PAPER_SPEED,
    SampleSpec,
    SpeedLimit,
    are_in_paper_plane,
    highest_sampled_speed,
    highest_sampled_speeds,
    parse_speed_limit,
)
from rattle.attractors.table import attractors_of_cell

CHAOTIC, PERIODIC, QUIET, UNDECIDED = Outcome.CHAOTIC, Outcome.PERIODIC, Outcome.QUIET, Outcome.UNDECIDED

__all__ = [
    "BUDGET",
    "CHAOTIC",
    "ENOUGH_SAMPLES",
    "LARGEST_BUDGET",
    "NATURAL",
    "PAPER_SPEED",
    "PERIODIC",
    "PERIODS",
    "QUIET",
    "UNDECIDED",
    "WATCH",
    "Outcome",
    "SampleSpec",
    "SpeedLimit",
    "are_in_paper_plane",
    "attractors_of_cell",
    "classify_plane_states",
    "highest_sampled_speed",
    "highest_sampled_speeds",
    "parse_speed_limit",
]
