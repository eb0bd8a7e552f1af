"""rattle: the impacting gear model of Mason and Piiroinen (2009), exact and fast.

`Gear(delta, epsilon, beta)` is one parameter point. `regions`, `period_one`, `grazing`, `sn1`, `flip` and `quiet_limit`
take whole arrays. `periodic_orbit` solves for any periodic motion. `branch`, `doubled`, `beyond` and `cascade` follow
a periodic motion in one parameter, and `diagram` follows all motions along a segment. `curves` has the bifurcation
curves of the (δ, ε) plane. `rattle.stiff` is the gear with a mesh stiffness, which becomes this gear as the stiffness
grows. `certify` proves periodic motions of both gears. `Machine` is a pair of gears in SI units. `rattle.comparison`
compares measured impacts with the model.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rattle import curves
from rattle._version import __version__
from rattle.attractors.basins import Basins
from rattle.attractors.measures import BasinEntropy, Uncertainty, basin_entropy, differing_cells, disagreement
from rattle.attractors.reached import ReachedAttractors
from rattle.attractors.table import KINDS, Attractor, Attractors, AttractorTable
from rattle.continuation.bifurcation_diagram import Diagram
from rattle.errors import MissingExtraError, NotProvedError, ParameterError, RattleError
from rattle.families.family_table import Families, FamilyTable
from rattle.impacting.attractors.boundary_distance import BoundaryDistance, boundary_distances
from rattle.impacting.attractors.classifier import attractors_of
from rattle.impacting.attractors.families import families_of
from rattle.impacting.bifurcations.branches import Branch, beyond, branch, continue_to, doubled
from rattle.impacting.bifurcations.cascade import cascade
from rattle.impacting.bifurcations.codimension_two import robust_chaos_interval
from rattle.impacting.bifurcations.diagram import diagram
from rattle.impacting.bifurcations.events import Event
from rattle.impacting.crisis.side import CRISIS_SIDES, crisis_side
from rattle.impacting.gear import FirstImpact, Gear
from rattle.impacting.map.gamma import GammaPiece
from rattle.impacting.map.iterate import iterate, iterate_tangent
from rattle.impacting.orbits.limits import quiet_limit
from rattle.impacting.orbits.period_one import GrazingPoints, flip, grazing, period_one, regions, sn1
from rattle.impacting.orbits.periodic import PeriodicOrbit, periodic_orbit
from rattle.intensity.intensity import Intensity
from rattle.intensity.spectrum import SpectralDensity, SpectralLines
from rattle.intensity.visit import Impacts
from rattle.machine import Machine, MachineVerdict, TransmissionError, read_transmission_error, transmission_error
from rattle.numerics.compile import source_hash, toolchain
from rattle.numerics.sampling import wilson_interval
from rattle.numerics.states import sampled_states
from rattle.orbits.iterates import Impact, Iterates, IteratesWithExponents, Trajectory
from rattle.orbits.orbits_a_to_d import REGIONS, Orbit, PeriodOne, classify_regions
from rattle.populations.answers import Estimate, Population, SobolIndex
from rattle.populations.distributions import LogNormal, Measured, Normal, Triangular, Uniform
from rattle.populations.limit import Limit, design_limit, design_limits
from rattle.populations.measured import read_gears
from rattle.populations.plan import Shock
from rattle.populations.population import population
from rattle.precompile import precompile
from rattle.proof.certificate import Certificate
from rattle.proof.certify import certify

if TYPE_CHECKING:
    from rattle.resilience.accumulate import Accumulator, accumulated
    from rattle.resilience.convergence import Convergence, convergence
    from rattle.resilience.edges import EdgeState, edge_state
    from rattle.resilience.path import FamilyChange, GlobalContinuation, global_continuation
    from rattle.resilience.shocks import LeastShock, smallest_shock
    from rattle.resilience.tipping import Tipping, tipping

#: {name that is loaded on first use: its module}. These modules import the gears of all models;
#: with them `import rattle` would take 1.5 times as long.
_MODULES_OF_LAZY_NAMES = {
    "Accumulator": "rattle.resilience.accumulate",
    "accumulated": "rattle.resilience.accumulate",
    "Convergence": "rattle.resilience.convergence",
    "convergence": "rattle.resilience.convergence",
    "EdgeState": "rattle.resilience.edges",
    "edge_state": "rattle.resilience.edges",
    "FamilyChange": "rattle.resilience.path",
    "GlobalContinuation": "rattle.resilience.path",
    "global_continuation": "rattle.resilience.path",
    "LeastShock": "rattle.resilience.shocks",
    "smallest_shock": "rattle.resilience.shocks",
    "Tipping": "rattle.resilience.tipping",
    "tipping": "rattle.resilience.tipping",
}

__all__ = [
    "CRISIS_SIDES",
    "KINDS",
    "REGIONS",
    "Accumulator",
    "Attractor",
    "AttractorTable",
    "Attractors",
    "BasinEntropy",
    "Basins",
    "BoundaryDistance",
    "Branch",
    "Certificate",
    "Convergence",
    "Diagram",
    "EdgeState",
    "Estimate",
    "Event",
    "Families",
    "FamilyChange",
    "FamilyTable",
    "FirstImpact",
    "GammaPiece",
    "Gear",
    "GlobalContinuation",
    "GrazingPoints",
    "Impact",
    "Impacts",
    "Intensity",
    "Iterates",
    "IteratesWithExponents",
    "LeastShock",
    "Limit",
    "LogNormal",
    "Machine",
    "MachineVerdict",
    "Measured",
    "MissingExtraError",
    "Normal",
    "NotProvedError",
    "Orbit",
    "ParameterError",
    "PeriodOne",
    "PeriodicOrbit",
    "Population",
    "RattleError",
    "ReachedAttractors",
    "Shock",
    "SobolIndex",
    "SpectralDensity",
    "SpectralLines",
    "Tipping",
    "Trajectory",
    "TransmissionError",
    "Triangular",
    "Uncertainty",
    "Uniform",
    "__version__",
    "accumulated",
    "attractors_of",
    "basin_entropy",
    "beyond",
    "boundary_distances",
    "branch",
    "cascade",
    "certify",
    "classify_regions",
    "continue_to",
    "convergence",
    "crisis_side",
    "curves",
    "design_limit",
    "design_limits",
    "diagram",
    "differing_cells",
    "disagreement",
    "doubled",
    "edge_state",
    "families_of",
    "flip",
    "global_continuation",
    "grazing",
    "iterate",
    "iterate_tangent",
    "period_one",
    "periodic_orbit",
    "population",
    "precompile",
    "quiet_limit",
    "read_gears",
    "read_transmission_error",
    "regions",
    "robust_chaos_interval",
    "sampled_states",
    "smallest_shock",
    "sn1",
    "source_hash",
    "tipping",
    "toolchain",
    "transmission_error",
    "wilson_interval",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULES_OF_LAZY_NAMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES_OF_LAZY_NAMES[name]), name)
