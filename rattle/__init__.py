"""rattle: the impacting gear model of Mason and Piiroinen (2009), exact and fast.

`Gear(delta, epsilon, beta)` is one parameter point; `regions`, `period_one`, `grazing`, `sn1`, `flip` and
`quiet_limit` work on whole arrays. `periodic_orbit` solves for any periodic motion; `branch`, `doubled`, `beyond` and
`cascade` follow it in one parameter, and `diagram` follows everything along a segment; `curves` has the bifurcation
curves of the (δ, ε) plane; `rattle.stiff` is the gear with stiff contact, of which this is the limit; `certify` proves
periodic motions of both. `Machine` is a pair of gears in SI units; `rattle.comparison` sets measured impacts beside the
model's.
"""

from rattle import curves
from rattle._version import __version__
from rattle.attractors.basins import Basins
from rattle.attractors.measures import BasinEntropy, Uncertainty, basin_entropy, differing, disagreement
from rattle.attractors.table import KINDS, Attractor, Attractors
from rattle.continuation.diagram import Diagram
from rattle.errors import MissingExtraError, NotProvedError, ParameterError, RattleError
from rattle.families.table import Families, FamilyTable
from rattle.impacting.attractors.boundary_distance import BoundaryDistance, boundary_distances
from rattle.impacting.attractors.classifier import attractors_of
from rattle.impacting.attractors.families import families_of
from rattle.impacting.bifurcations.branches import Branch, beyond, branch, doubled, fate
from rattle.impacting.bifurcations.cascade import cascade
from rattle.impacting.bifurcations.codimension_two import robust_chaos_interval
from rattle.impacting.bifurcations.diagram import diagram
from rattle.impacting.bifurcations.events import Event
from rattle.impacting.crisis.side import CRISIS_SIDES, crisis_side
from rattle.impacting.gear import FirstImpact, Gear
from rattle.impacting.map.gamma import GammaPiece
from rattle.impacting.map.iterate import iterate, iterate_tangent
from rattle.impacting.orbits.limits import flip, quiet_limit, sn1
from rattle.impacting.orbits.period_one import Grazing, grazing, period_one, regions
from rattle.impacting.orbits.periodic import PeriodicOrbit, periodic_orbit
from rattle.intensity.intensity import Intensity
from rattle.intensity.spectrum import Density, Lines
from rattle.intensity.visit import Impacts
from rattle.machine import Machine
from rattle.numerics.compile import source_hash, toolchain
from rattle.numerics.sampling import wilson_interval
from rattle.orbits.iterates import Impact, Iterates, Stretched, Trajectory
from rattle.orbits.period_one import REGIONS, Orbit, PeriodOne
from rattle.orbits.period_one import classify as classify_regions
from rattle.proof.certificate import Certificate
from rattle.proof.certify import certify
from rattle.warm import warm_up

__all__ = [
    "CRISIS_SIDES",
    "KINDS",
    "REGIONS",
    "Attractor",
    "Attractors",
    "BasinEntropy",
    "Basins",
    "BoundaryDistance",
    "Branch",
    "Certificate",
    "Density",
    "Diagram",
    "Event",
    "Families",
    "FamilyTable",
    "FirstImpact",
    "GammaPiece",
    "Gear",
    "Grazing",
    "Impact",
    "Impacts",
    "Intensity",
    "Iterates",
    "Lines",
    "Machine",
    "MissingExtraError",
    "NotProvedError",
    "Orbit",
    "ParameterError",
    "PeriodOne",
    "PeriodicOrbit",
    "RattleError",
    "Stretched",
    "Trajectory",
    "Uncertainty",
    "__version__",
    "attractors_of",
    "basin_entropy",
    "beyond",
    "boundary_distances",
    "branch",
    "cascade",
    "certify",
    "classify_regions",
    "crisis_side",
    "curves",
    "diagram",
    "differing",
    "disagreement",
    "doubled",
    "families_of",
    "fate",
    "flip",
    "grazing",
    "iterate",
    "iterate_tangent",
    "period_one",
    "periodic_orbit",
    "quiet_limit",
    "regions",
    "robust_chaos_interval",
    "sn1",
    "source_hash",
    "toolchain",
    "warm_up",
    "wilson_interval",
]
