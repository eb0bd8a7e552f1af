"""Functions of the impacting gear (paper, equations 2.3 and 2.4). `rattle.stiff` has functions of the same names."""

from rattle.impacting.attractors.stretch import stretch
from rattle.impacting.bifurcations.curve_tracing import trace
from rattle.impacting.bifurcations.diagram import diagram
from rattle.impacting.bifurcations.registry import NAMES, describe
from rattle.impacting.map.iterate import iterate_tangent
from rattle.impacting.map.quiet import becomes_quiet_late
from rattle.impacting.orbits.period_one import period_one

__all__ = ["NAMES", "becomes_quiet_late", "describe", "diagram", "iterate_tangent", "period_one", "stretch", "trace"]
