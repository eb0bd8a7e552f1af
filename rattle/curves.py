"""Bifurcation curves of the period-one motions in the (δ, ε) plane, and the codimension-two points where they meet."""

from rattle.continuation.curve_continuation import QUIET_LIMIT, Curve, PieceEnd
from rattle.impacting.bifurcations.codimension_two import CodimensionTwo, codimension_two
from rattle.impacting.bifurcations.curve_tracing import bifurcation_curve, trace
from rattle.impacting.bifurcations.registry import CURVES, NAMES, curve_name_of_event, describe

__all__ = [
    "CURVES",
    "NAMES",
    "QUIET_LIMIT",
    "CodimensionTwo",
    "Curve",
    "PieceEnd",
    "bifurcation_curve",
    "codimension_two",
    "curve_name_of_event",
    "describe",
    "trace",
]
