"""The gear model with stiff contact, whose limit of infinite stiffness is the impacting model (docs/stiff.md).

Source: Mason and Piiroinen (2009), equations (2.1), (2.2).
"""

from rattle.intensity.table import follow_motions_one_by_one as stretch
from rattle.stiff.attractors.classifier import attractors_of
from rattle.stiff.attractors.families import families_of
from rattle.stiff.bifurcations.branches import StiffBranch, StiffEvent, stiff_branch, stiff_curve
from rattle.stiff.bifurcations.curves import NAMES, describe, trace
from rattle.stiff.bifurcations.diagram import diagram
from rattle.stiff.gear import MotionState, StiffGear
from rattle.stiff.map.iterate import iterate, iterate_tangent
from rattle.stiff.map.quiet import becomes_quiet_late, quiet_depth, quiet_limit
from rattle.stiff.orbits.period_one import period_one, regions, saddle_node_1
from rattle.stiff.orbits.periodic import StiffOrbit, continue_from_limit, stiff_orbit

__all__ = [
    "NAMES",
    "MotionState",
    "StiffBranch",
    "StiffEvent",
    "StiffGear",
    "StiffOrbit",
    "attractors_of",
    "becomes_quiet_late",
    "continue_from_limit",
    "describe",
    "diagram",
    "families_of",
    "iterate",
    "iterate_tangent",
    "period_one",
    "quiet_depth",
    "quiet_limit",
    "regions",
    "saddle_node_1",
    "stiff_branch",
    "stiff_curve",
    "stiff_orbit",
    "stretch",
    "trace",
]
