"""`StiffGear`: one parameter point of the gear model with stiff contact, and its methods."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.reached import SampledGear
from rattle.errors import RattleError, require, require_finite, require_number
from rattle.flight import law
from rattle.flight.first_impact import OK, SIGMA_MINUS, SIGMA_PLUS
from rattle.intensity.rattling import RattlingGear
from rattle.orbits.iterates import Impact, Iterates, Trajectory
from rattle.orbits.orbits_a_to_d import Orbit
from rattle.stiff.attractors.classifier import StiffClassifier
from rattle.stiff.map import quiet, return_map
from rattle.stiff.map.departure import CANNOT_FOLLOW, find_departure
from rattle.stiff.map.flow import GAP, QUIET, flow
from rattle.stiff.map.iterate import iterate
from rattle.stiff.map.trajectory import trajectory
from rattle.stiff.orbits import period_one, periodic

LONGEST_RUN = 1e5  # longest time that one call follows, in forcing periods


class MotionState(NamedTuple):
    """The state that `StiffGear.flight` reaches after a given time, through flights and contacts.

    position, velocity: Φ and Φ' at the end. n_plus, n_minus: the numbers of contacts with Σ⁺ and Σ⁻ since the start.
    tangent (2, 2): the tangent map ∂(Φ, Φ')/∂(Φ₀, Φ'₀) at fixed times, whose determinant is e^(−δ time).
    """

    position: float
    velocity: float
    n_plus: int
    n_minus: int
    tangent: NDArray[np.float64]


@dataclass(frozen=True)
class StiffGear(SampledGear, RattlingGear):
    """The stiff gear model at one parameter point.

        Φ'' + δΦ' + 2κB(Φ) = 4πδ − 4π²ε cos 2πt − 2πδε sin 2πt,

    where B(Φ) is the signed depth of Φ beyond ±β, 0 between the walls; time is in forcing periods. A state is (Φ, Φ')
    at a time, or (τ, v): a departure from Σ⁺ (Φ = β) at phase τ ∈ [0, 1) with velocity −v, as in the impacting model
    `rattle.Gear`, which is the limit κ → ∞.

    Parameters
    ----------
    delta, epsilon, beta, kappa : float
        Damping > 0, eccentricity ≥ 0, half-backlash > 0 and stiffness > 0, dimensionless.

    Raises
    ------
    ParameterError
        If a parameter is outside its domain.

    References
    ----------
    Mason and Piiroinen, SIAM J. Appl. Dyn. Syst. 8 (2009) 1694–1711, equations (2.1), (2.2); docs/stiff.md.
    """

    delta: float
    epsilon: float
    beta: float = 0.6
    kappa: float = 1e4

    _classifier = StiffClassifier
    _resolution, _pairs = 400, 2048

    @property
    def quiet_limit(self) -> float:
        """Eccentricity above which permanent contact with Σ⁺ is lost."""
        return float(quiet.quiet_limit(self.delta, self.kappa))

    @property
    def sn1(self) -> float:
        """Eccentricity of SN1, at which A and C are born at this damping. Raises RattleError if SN1 does not exist."""
        return period_one.saddle_node_1(self.delta, self.kappa, self.beta).epsilon

    def flight(self, position: float, velocity: float, phase: float = 0.0, time: float = 1.0) -> MotionState:
        """Follow the motion from (Φ, Φ') at this phase for `time` forcing periods; return its last state.

        For a whole number of periods this is the stroboscopic map.

        Returns
        -------
        MotionState
            Φ and Φ' after this time, the numbers of contacts that began, and the tangent map.

        Raises
        ------
        ParameterError
            If an argument is outside its domain.
        RattleError
            If the motion cannot be followed; the message names possible causes.
        """
        position, velocity = require_finite("position", position), require_finite("velocity", velocity)
        time, tau = require_number("time", time), _fold_finite_phase(phase)
        require(time <= LONGEST_RUN, f"time must be at most {LONGEST_RUN:g} forcing periods, got {time}")
        wall = GAP
        if abs(position) >= self.beta:
            wall = SIGMA_PLUS if position > 0.0 else SIGMA_MINUS
        start = abs(position) - self.beta if wall != GAP else position
        status, end, x, w, n_plus, n_minus, *tangent = flow(
            wall, tau, start, velocity, time, self.delta, self.epsilon, self.beta, self.kappa
        )
        if status != OK or not (math.isfinite(x) and math.isfinite(w)):
            raise RattleError(CANNOT_FOLLOW)
        whole = x if end == GAP else end * (self.beta + x)
        return MotionState(float(whole), float(w), n_plus, n_minus, np.array(tangent).reshape(2, 2))

    def impact(self, tau: float, v: float) -> Impact:
        """Return the next departure (τ', v') from Σ⁺ after a departure (τ, v), v > 0, with its tangent matrix (2, 2).

        The matrix is ∂(τ', v')/∂(τ, v). Converted to the coordinates (t, v²/2), it has the determinant e^(−δ time).

        Returns
        -------
        Impact
            State at the next departure, with its tangent.

        Raises
        ------
        ParameterError
            If an argument is outside its domain.
        RattleError
            If contact with Σ⁺ never ends (quiet motion), or the motion cannot be followed.
        """
        v = require_number("v", v, positive=True)
        status, tau1, v1, time, n_minus, *tangent, _ = return_map.step_with_tangent(
            _fold_finite_phase(tau), v, self._point
        )
        if status == QUIET:
            raise RattleError("the motion becomes quiet: its contact with Σ⁺ never ends")
        if status != OK or not math.isfinite(time):
            raise RattleError(CANNOT_FOLLOW)
        return Impact(tau1, v1, n_minus, np.array(tangent).reshape(2, 2), time)

    def departure(self, phase: float, position: float, velocity: float) -> tuple[float, float]:
        """Return the first departure from Σ⁺, (τ, v), of the motion with this phase, position Φ and velocity Φ'.

        The motion may be in the gap or in contact.

        Returns
        -------
        tuple[float, float]
            Phase τ in [0, 1) and speed v; v is 0 if contact with Σ⁺ never ends.

        Raises
        ------
        ParameterError
            If an argument is outside its domain.
        RattleError
            If the motion cannot be followed; the message names possible causes.
        """
        position, velocity = require_finite("position", position), require_finite("velocity", velocity)
        return find_departure(*self._point, _fold_finite_phase(phase), position, velocity)

    def iterate(self, tau: ArrayLike, v: ArrayLike, n: ArrayLike) -> Iterates:
        """Apply the return map n times to states (τ, v), as `rattle.stiff.iterate` does. Raises ParameterError."""
        return iterate(self.delta, self.epsilon, tau, v, n, self.beta, self.kappa)

    def trajectory(self, tau: float, v: float, periods: float = 10.0, points: int = 2000) -> Trajectory:
        """Return Φ and Φ' of the motion that leaves Σ⁺ at phase τ with velocity −v, over a number of forcing periods.

        The result is like that of `Gear.trajectory`, with the beginnings of contacts in place of impacts.

        Returns
        -------
        Trajectory
            Times, Φ and Φ' (points,), and the contacts.

        Raises
        ------
        ParameterError
            If an argument is outside its domain.
        RattleError
            If the motion cannot be followed; the message names possible causes.
        """
        return trajectory(*self._point, _fold_finite_phase(tau), v, periods, points)

    def orbits(self) -> tuple[Orbit, ...]:
        """Return the admissible counterparts of A to D, each named by its letter, and all other P(1,1,0), named "P"."""
        added = {"kappa": self.kappa}
        return tuple(
            Orbit(name, *found.label, found.tau, found.v, found.multipliers, found.stable, *self._point[:3], added)
            for name, found in period_one.orbits_at(*self._point)
        )

    def orbit(self, tau: float, v: float, n_plus: int = 1) -> periodic.StiffOrbit:
        """Return the periodic motion near a departure (τ, v) that repeats after n_plus contacts with Σ⁺.

        If the motion repeats after fewer contacts, it is returned with its shortest period; see `stiff_orbit`.

        Returns
        -------
        periodic.StiffOrbit
            The motion, with its contacts, multipliers and stability.
        """
        return periodic.stiff_orbit(self.delta, self.epsilon, self.kappa, tau, v, n_plus, self.beta)

    def saddle(self, orbit: Orbit) -> periodic.StiffOrbit:
        """Return an `Orbit` of this gear as a `StiffOrbit`, whose manifolds `rattle.orbits.manifolds` computes."""
        return self.orbit(orbit.tau, orbit.v)

    def region(self) -> int:
        """Return the number in `rattle.REGIONS` of the region: the set of A to D whose counterparts exist here."""
        return int(period_one.regions(*self._point))

    @property
    def _point(self) -> return_map.StiffPoint:
        return return_map.StiffPoint(self.delta, self.epsilon, self.beta, self.kappa)

    @property
    def _stiffness(self) -> float:
        return self.kappa


def _fold_finite_phase(phase: float) -> float:
    """Return a phase modulo 1, in [0, 1). Raises ParameterError unless it is a finite number."""
    return float(law.fold_phase(require_finite("phase", phase)))
