"""Bifurcation curves of the period-one motions in the (δ, ε) plane, and the codimension-two points where they meet."""

from rattle.curves.codimension import CodimensionTwo, codimension_two
from rattle.curves.curve import Curve, End
from rattle.curves.registry import CURVES, NAMES, QUIET_LIMIT, describe, name_of
from rattle.curves.trace import bifurcation_curve, trace

__all__ = [
    "CURVES",
    "NAMES",
    "QUIET_LIMIT",
    "CodimensionTwo",
    "Curve",
    "End",
    "bifurcation_curve",
    "codimension_two",
    "describe",
    "name_of",
    "trace",
]
