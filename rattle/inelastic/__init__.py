"""The gear with a coefficient of restitution, a load, and a forcing of several harmonics (docs/restitution.md).

`rattle.Gear(delta, epsilon, beta, restitution=0.9, load=0.0, harmonics=[(20, 0.0033, 0.0)])` is one parameter point.
"""

from rattle.inelastic.attractors.classifier import attractors_of
from rattle.inelastic.bifurcations.codimension_two import (
    CodimensionTwoCurve,
    codimension_two_points_at,
    follow_codimension_two,
)
from rattle.inelastic.bifurcations.curves import trace
from rattle.inelastic.bifurcations.registry import NAMES, describe
from rattle.inelastic.functions import becomes_quiet_late, diagram, stretch
from rattle.inelastic.gear import FirstInelasticImpact, InelasticGear
from rattle.inelastic.map.iterate import iterate, iterate_tangent
from rattle.inelastic.map.quiet import quiet_limit
from rattle.inelastic.orbits.closed_form import epsilon_of_flip_of_c, epsilon_of_saddle_node
from rattle.inelastic.orbits.period_one import period_one, regions
from rattle.inelastic.orbits.periodic import InelasticOrbit

__all__ = [
    "NAMES",
    "CodimensionTwoCurve",
    "FirstInelasticImpact",
    "InelasticGear",
    "InelasticOrbit",
    "attractors_of",
    "becomes_quiet_late",
    "codimension_two_points_at",
    "describe",
    "diagram",
    "epsilon_of_flip_of_c",
    "epsilon_of_saddle_node",
    "follow_codimension_two",
    "iterate",
    "iterate_tangent",
    "period_one",
    "quiet_limit",
    "regions",
    "stretch",
    "trace",
]
