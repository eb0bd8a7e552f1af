"""The impact law: the velocity after an impact, and the determinants and balances that follow from it.

The impacts of the paper's gear are elastic, w → −w. A gear with restitution r has w → −r w, and only functions of this
module differ between the two. No other module reflects a velocity, or has a determinant or balance of its own. Kernels
call the inline functions; other code uses the record `ELASTIC`. Elastic walls (the stiff gear) have no impact law,
because a contact is part of the flow (`rattle.stiff.map.flow`). A contact contracts areas as a flight does, so the
stiff gear's determinants also come from this module.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from rattle.numerics.compile import inline


@inline
def reflected_velocity(w):
    """Return the velocity after an elastic impact, −w. Callers multiply it by the coefficient of restitution r."""
    return -w


@inline
def velocity_before_reflection(w):
    """Return the velocity before an elastic impact, given the velocity after it."""
    return -w


@inline
def velocity_change_after_elastic_impact(change):
    """Return how the velocity after an elastic impact changes if the velocity before the impact changes by `change`."""
    return -change


@inline
def arrival_term_of_mismatch(w):
    """Return the term of `impact_mismatch` that contains the arrival velocity w; linear, so w may be a derivative."""
    return w


@inline
def impact_mismatch(before, after):
    """Return the departure velocity minus the velocity that the law requires after this arrival; 0 at a true impact."""
    return after + arrival_term_of_mismatch(before)


@inline
def impulse_of(speed):
    """Return the size of the jump of Φ' at an elastic impact: twice the speed of arrival."""
    return 2.0 * speed


@inline
def determinant_of_impact(determinant):
    """Return |det| in (t, w²/2) of a flight and its elastic impact, given |det| of the flight alone: both are equal."""
    return determinant


@inline
def log_determinant(delta, time, impacts):  # noqa: ARG001 - all impact laws have one signature
    """Return ln|det| of the tangent map in (t, w²/2) of a motion with this duration and number of impacts."""
    return -delta * time


@inline
def determinant(delta, time, impacts):
    """Return |det| of the tangent map in (t, w²/2) of a motion: e^(−δ time), which elastic impacts do not change."""
    return math.exp(log_determinant(delta, time, impacts))


@dataclass(frozen=True)
class ImpactLaw:
    """The impact law for code outside kernels: the record `ELASTIC` of elastic impacts, or a `RestitutionLaw`."""

    #: True if bounces under a pressing contact force end in lasting contact after a finite time. Elastic bounces never
    #: end but become lower and lower; their limit is quiet motion.
    chatter_completes: bool = False

    def determinant(self, delta: Any, time: Any, impacts: Any) -> Any:  # noqa: ARG002 - as the other law
        """Return the determinant e^(−δ time) of the tangent map of a motion, the product of its multipliers."""
        return np.exp(-delta * time)

    def lyapunov_exponent_sum(self, delta: Any, impacts_per_period: Any) -> Any:  # noqa: ARG002 - as the other law
        """Return the sum λ₁ + λ₂ of the Lyapunov exponents, per forcing period; −δ for elastic impacts."""
        return -delta

    def energy_change(self, w: Any, change: Any) -> Any:
        """Return how w²/2 after an impact changes, to first order, if the velocity w of arrival changes by `change`."""
        return change * w

    def energy_loss(self, speed: Any) -> Any:
        """Return the loss of w²/2 in an elastic impact: 0 for any arrival speed relative to the wall."""
        return 0.0 * speed


ELASTIC = ImpactLaw()


@dataclass(frozen=True)
class RestitutionLaw(ImpactLaw):
    """The law w → −r w. An impact multiplies the speed by r, and areas in (t, w²/2) by r²."""

    restitution: float = 1.0

    def determinant(self, delta: Any, time: Any, impacts: Any) -> Any:
        """Return the determinant e^(−δ time) r^(2 impacts) of the tangent map of a motion."""
        return np.exp(-delta * time) * self.restitution ** (2 * impacts)

    def lyapunov_exponent_sum(self, delta: Any, impacts_per_period: Any) -> Any:
        """Return the sum λ₁ + λ₂ of the Lyapunov exponents, per forcing period."""
        return 2.0 * math.log(self.restitution) * impacts_per_period - delta

    def energy_change(self, w: Any, change: Any) -> Any:
        """Return how w²/2 after an impact changes, to first order, if the velocity w of arrival changes by `change`."""
        return self.restitution**2 * (change * w)

    def energy_loss(self, speed: Any) -> Any:
        """Return the loss of w²/2 in an impact, (1 − r²) w²/2, with w the arrival speed relative to the wall."""
        return 0.5 * (1.0 - self.restitution**2) * speed * speed
