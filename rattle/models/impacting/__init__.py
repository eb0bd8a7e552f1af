"""The impacting model: rigid walls (paper 2.3, 2.4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from rattle import curves, impacting
from rattle.curves import CodimensionTwo
from rattle.impacting.attractors.classifier import ImpactingClassifier
from rattle.impacting.gear import Gear
from rattle.impacting.orbits.period_one import missing_limits
from rattle.models.model import AnalyticLimits, Capability, GearFunctions, Model


@dataclass(frozen=True)
class Impacting(Model):
    """The impacting model at half-backlash beta > 0."""

    name = "impacting"
    title = "impacting"
    has = frozenset(Capability) - {Capability.CONTACT_PHASES}
    functions: ClassVar[GearFunctions] = impacting
    classifier = ImpactingClassifier
    curve_names = impacting.NAMES
    # eccentricities of three cells at δ = β = 0.6: the first has quiet and periodic motions, the second also chaotic
    # motions, the third chaotic motions only
    precompilation_epsilons = 0.089, 0.1, 0.25

    def gear(self, delta: float, epsilon: float) -> Gear:
        """Return the gear at one point."""
        return Gear(delta, epsilon, self.beta)

    def limits(self, delta: float) -> AnalyticLimits:
        """Return the eccentricities of SN1, of the flip of C and of the quiet limit, at one damping."""
        gear = self.gear(delta, 0.0)
        return AnalyticLimits(gear.sn1, gear.flip, gear.quiet_limit, missing_limits(gear.delta, gear.beta))

    def codimension_two(self) -> Sequence[CodimensionTwo]:
        """Return the codimension-two points, where curves meet."""
        return curves.codimension_two(self.beta)
