"""The impact law: what a wall makes of the velocity that arrives, and what follows for determinants and balances.

The gear's impacts are elastic, w → −w. A gear with restitution r has w → −r w: its law differs from this one in the
functions here, and nothing outside takes a velocity, a determinant or a balance by a sign of its own. Kernels ask the
inline functions, Python the record `ELASTIC`. Walls that give way have no impact law: a contact is a part of the flow
(`rattle.stiff.map.flow`), but contracts areas likewise, so determinants come from here too.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from rattle.numerics.compile import inline


@inline
def reflected(w):
    """Return the velocity after an impact, from that before."""
    return -w


@inline
def before_reflection(w):
    """Return the velocity before an impact, from that after."""
    return -w


@inline
def reflected_change(change):
    """Return a change of the velocity after an impact, from that of the velocity before: the derivative times it."""
    return -change


@inline
def arrival_part(w):
    """Return the share of a velocity of arrival, or of a derivative of it, in the mismatch."""
    return w


@inline
def impact_mismatch(before, after):
    """Return by how much a velocity of departure differs from what the law makes of the arrival: 0 at an impact."""
    return after + arrival_part(before)


@inline
def impulse_of(speed):
    """Return by how much an impact turns Φ' away from the wall, from the speed of arrival."""
    return 2.0 * speed


@inline
def determinant_of_impact(determinant):
    """Return the size of the determinant of a flight and its impact in (t, w²/2), from that of the flight."""
    return determinant


@inline
def log_determinant(delta, time, impacts):  # noqa: ARG001
    """Return ln|det| in (t, w²/2) of a motion that takes this time and makes so many impacts."""
    return -delta * time


@inline
def determinant(delta, time, impacts):
    """|det| likewise, e^(−δ time) if impacts are elastic."""
    return math.exp(log_determinant(delta, time, impacts))


@dataclass(frozen=True)
class ImpactLaw:
    """The law as Python asks it: `ELASTIC`, or `Restitution`."""

    #: Whether bounces on a wall that the contact force presses on end in finite time, in contact that lasts. With
    #: elastic impacts they go on for ever, ever lower: the limit is quiet motion, which has no impact.
    chatter_completes: bool = False

    def determinant(self, delta: Any, time: Any, impacts: Any) -> Any:  # noqa: ARG002
        """Return the determinant e^(−δ time) of the tangent map of a motion that makes this number of elastic impacts.

        It is the product of the motion's multipliers.

        Returns
        -------
        Any
            float or array, of the broadcast shape.
        """
        return np.exp(-delta * time)

    def exponent_sum(self, delta: Any, impacts_per_period: Any) -> Any:  # noqa: ARG002
        """Return λ₁ + λ₂ per forcing period, −δ if impacts are elastic."""
        return -delta

    def energy_change(self, w: Any, change: Any) -> Any:
        """Return the change of w²/2 after an impact, from a velocity of arrival and its change."""
        return change * w

    def energy_lost(self, speed: Any) -> Any:
        """Return the energy that an impact takes from the motion relative to the wall: 0 if it is elastic."""
        return 0.0 * speed


ELASTIC = ImpactLaw()


@dataclass(frozen=True)
class Restitution(ImpactLaw):
    """The law w → −r w: an impact leaves the share r of the speed, and r² of areas in (t, w²/2)."""

    restitution: float = 1.0

    def determinant(self, delta: Any, time: Any, impacts: Any) -> Any:
        """Return the determinant e^(−δ time) r^(2 impacts) of a motion."""
        return np.exp(-delta * time) * self.restitution ** (2 * impacts)

    def exponent_sum(self, delta: Any, impacts_per_period: Any) -> Any:
        """Return λ₁ + λ₂ per forcing period."""
        return 2.0 * math.log(self.restitution) * impacts_per_period - delta

    def energy_change(self, w: Any, change: Any) -> Any:
        """Return the change of w²/2 after an impact, from a velocity of arrival and its change."""
        return self.restitution**2 * (change * w)

    def energy_lost(self, speed: Any) -> Any:
        """Return the energy that an impact takes from the motion relative to the wall."""
        return 0.5 * (1.0 - self.restitution**2) * speed * speed
