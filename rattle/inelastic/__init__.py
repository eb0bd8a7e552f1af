"""The gear with a coefficient of restitution, a load, and a forcing of several harmonics (docs/real-gears.md).

`rattle.Gear(delta, epsilon, beta, restitution=0.9, load=0.0, harmonics=[(20, 0.0033, 0.0)])` is one parameter point.
"""

from rattle.inelastic.attractors.classifier import attractors_of
from rattle.inelastic.functions import NAMES, describe, diagram, period_one, rests_late, stretch, trace
from rattle.inelastic.gear import FirstInelasticImpact, InelasticGear
from rattle.inelastic.map.iterate import iterate, iterate_tangent
from rattle.inelastic.map.quiet import quiet_limit
from rattle.inelastic.orbits.closed_form import flip_of_c, saddle_node
from rattle.inelastic.orbits.periodic import InelasticOrbit

__all__ = [
    "NAMES",
    "FirstInelasticImpact",
    "InelasticGear",
    "InelasticOrbit",
    "attractors_of",
    "describe",
    "diagram",
    "flip_of_c",
    "iterate",
    "iterate_tangent",
    "period_one",
    "quiet_limit",
    "rests_late",
    "saddle_node",
    "stretch",
    "trace",
]
