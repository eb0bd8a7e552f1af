"""The stiff model: elastic walls (paper 2.1, 2.2). Its curves G1 and G2 are saddle-nodes, not grazes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from rattle import stiff
from rattle.flight.forcing import TWO_PI
from rattle.models.model import AnalyticLimits, Capability, GearFunctions, Model
from rattle.orbits.orbits_a_to_d import MissingLimit
from rattle.parameters import read_declared_parameters
from rattle.stiff.attractors.classifier import StiffClassifier


def _kappa_of_machine(stiffness: Any, pair: Any) -> Any:
    """Return κ from a mesh stiffness in N/m and the machine's pair of gears (docs/decisions/0025-machine.md)."""
    turned = TWO_PI * pair.radius / pair.speed
    return stiffness * turned * turned / (pair.phi_per_angle * pair.inertia)


(KAPPA,) = read_declared_parameters(__file__)


@dataclass(frozen=True)
class Stiff(Model):
    """The model with walls of stiffness kappa > 0, at half-backlash beta > 0."""

    kappa: float = KAPPA.example

    name = "stiff"
    title = "stiff walls"
    added = (replace(KAPPA, of_machine=_kappa_of_machine),)
    has = frozenset(
        {
            Capability.PERIOD_ONE,
            Capability.BALANCE,
            Capability.INTENSITY,
            Capability.PROOFS,
            Capability.SUM_RULE,
            Capability.MANIFOLDS,
            Capability.DIAGRAMS,
            Capability.DEPARTURES,
        }
    )
    functions: ClassVar[GearFunctions] = stiff
    classifier = StiffClassifier
    curve_names = stiff.NAMES
    tile_samples = 4096  # computing a return takes a hundred times as long as for the impacting gear
    cell_milliseconds = 100.0
    design_gears = 256
    diagram_steps = 24  # in chaos each takes a second
    # precompilation computes one cell only: a second cell would take longer than the compilation that it saves
    precompilation_epsilons = (0.1,)

    @property
    def contact_duration(self) -> float:
        """The duration of the contact of a fast impact, in forcing periods: half a period of free oscillation."""
        return math.pi / math.sqrt(2.0 * self.kappa)

    def gear(self, delta: float, epsilon: float) -> stiff.StiffGear:
        """Return the gear at one point."""
        return stiff.StiffGear(delta, epsilon, self.beta, self.kappa)

    def limits(self, delta: float) -> AnalyticLimits:
        """Return the eccentricities of SN1 and of the quiet limit, at one damping; the flip of C is not computed."""
        found = super().limits(delta)
        flip = MissingLimit("flip", "not computed at one damping for stiff walls; the curve PDC has it", None)
        return found._replace(missing=(*found.missing[:-1], flip))
