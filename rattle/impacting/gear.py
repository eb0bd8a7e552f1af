"""`Gear`: one parameter point of the impacting gear model, and its methods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.reached import SampledGear
from rattle.attractors.speeds import PAPER_SPEED, SpeedLimit
from rattle.errors import RattleError, require, require_finite, require_number
from rattle.flight import contact_phase, first_impact, forcing, law
from rattle.impacting.attractors.boundary_distance import BoundaryDistance, boundary_distances
from rattle.impacting.attractors.classifier import ImpactingClassifier
from rattle.impacting.map import impact_map
from rattle.impacting.map.departure import find_departure
from rattle.impacting.map.gamma import GammaPiece, gamma
from rattle.impacting.map.iterate import iterate
from rattle.impacting.map.quiet import capture_invariant_limit, capture_speed
from rattle.impacting.map.trajectory import trajectory
from rattle.impacting.orbits.limits import quiet_limit
from rattle.impacting.orbits.period_one import flip, orbits_at, regions, sn1
from rattle.impacting.orbits.periodic import PeriodicOrbit, period_one_orbit, periodic_orbit
from rattle.intensity.rattling import RattlingGear
from rattle.orbits.iterates import Impact, Iterates, Trajectory
from rattle.orbits.orbits_a_to_d import Orbit
from rattle.orbits.periodic_motions import PeriodicMotion


class FirstImpact(NamedTuple):
    """The first impact of a free flight.

    flight_time is in forcing periods, next_wall is +1 for Φ = β or −1 for Φ = −β, and impact_velocity is the velocity
    before reflection.
    """

    flight_time: float
    next_wall: int
    impact_velocity: float


def _raise_for_status(status: int) -> None:
    """Raise RattleError if a kernel's status code says that the motion rests on a wall or has no next impact."""
    if status in (contact_phase.IN_CONTACT, contact_phase.ENDLESS):
        raise RattleError(
            f"the motion comes to rest on a wall, or makes more than {contact_phase.MOST_BOUNCES:,} impacts on Σ⁻, "
            "before it meets Σ⁺ again"
        )
    if status == first_impact.NO_IMPACT:
        raise RattleError(
            f"the flight has no impact within {first_impact.LONGEST:g} forcing periods, or its numbers are "
            "beyond double precision"
        )


def is_elastic(restitution: Any, load: Any, harmonics: Any) -> bool:
    """Return whether these values describe the gear with elastic impacts, forcing by one cosine, and no load."""
    try:
        return float(restitution) == 1.0 and float(load) == 0.0 and len(harmonics) == 0
    except (TypeError, ValueError):
        return False


@dataclass(frozen=True, init=False)
class Gear(SampledGear, RattlingGear):
    """The impacting gear model at one parameter point.

    Between the walls Φ = ±β

        Φ'' + δΦ' = 4πδ − 4π²ε cos 2πt − 2πδε sin 2πt,

    with elastic impacts; time is in forcing periods. A state (τ, v) is a departure from Σ⁺ (Φ = β) at phase τ ∈ [0, 1)
    with velocity −v. With a coefficient of restitution below 1, a load or harmonics the result is an `InelasticGear`.
    An inelastic gear has the same methods except those that need closed forms: `rattle.Gear(0.6, 0.1, 0.6,
    restitution=0.9)`.

    Parameters
    ----------
    delta, epsilon, beta : float
        Damping > 0, eccentricity ≥ 0 and half-backlash > 0, dimensionless.

    Raises
    ------
    ParameterError
        If a parameter is outside its domain.

    References
    ----------
    Mason and Piiroinen, SIAM J. Appl. Dyn. Syst. 8 (2009) 1694–1711, equations (2.3), (2.4).
    """

    delta: float
    epsilon: float
    beta: float = 0.6

    _classifier = ImpactingClassifier
    _resolution, _pairs = 1000, 8192

    def __new__(cls, *point: Any, restitution: Any = 1.0, load: Any = 0.0, harmonics: Any = (), **named: Any) -> Any:
        """Return an `InelasticGear` if restitution, load or harmonics differ from their defaults, else a `Gear`."""
        if is_elastic(restitution, load, harmonics):
            return super().__new__(cls)
        # imported here, because `rattle.inelastic` imports this module
        other = import_module("rattle.inelastic.gear").InelasticGear
        return other(*point, **named, restitution=restitution, load=load, harmonics=harmonics)

    def __init__(
        self,
        delta: float,
        epsilon: float,
        beta: float = 0.6,
        *,
        restitution: float = 1.0,  # noqa: ARG002 - for `__new__`
        load: float = 0.0,  # noqa: ARG002 - for `__new__`
        harmonics: Sequence[Sequence[float]] = (),  # noqa: ARG002 - for `__new__`
    ) -> None:
        """Set the parameters. `__new__` has already handled restitution, load and harmonics."""
        for name, value in (("delta", delta), ("epsilon", epsilon), ("beta", beta)):
            object.__setattr__(self, name, value)
        self.__post_init__()

    @property
    def sn1(self) -> float | None:
        """Eccentricity of SN1, where A and C are born at this damping (paper, equation 4.1).

        It is None if A and C are not born at SN1 (`rattle.sn1`).
        """
        return _none_if_nan(sn1(self.delta, self.beta))

    @property
    def flip(self) -> float | None:
        """Eccentricity of the flip PDC, where C loses stability at this damping (not in the paper).

        It is None if C grazes (G1) and so ends while it is still stable, or if C does not exist (`rattle.flip`).
        """
        return _none_if_nan(flip(self.delta, self.beta))

    @property
    def quiet_limit(self) -> float:
        """Eccentricity above which permanent contact is impossible at this damping."""
        return float(quiet_limit(self.delta))

    @property
    def capture_speed(self) -> float:
        """Impact speed below which a bouncing motion is certain to become quiet; 0 at and above the quiet limit."""
        return capture_speed(self.delta, self.epsilon, self.beta)

    def first_impact(self, wall: int, phase: float, velocity: float) -> FirstImpact:
        """Return the first impact of a flight that leaves a wall at this phase with this velocity.

        Parameters
        ----------
        wall : int
            +1 for Φ = β, −1 for Φ = −β.
        phase, velocity : float
            Phase of the departure, and its velocity, which must point into the gap.

        Returns
        -------
        FirstImpact
            (flight_time, next_wall, impact_velocity): the time in forcing periods, and the velocity before reflection.

        Raises
        ------
        ParameterError
            If wall is not ±1, a number is not finite, or the velocity is zero or points out of the gap.
        RattleError
            If the flight has no impact that can be computed.
        """
        require(require_finite("wall", wall) in (1, -1), f"wall must be +1 or -1, got {wall!r}")
        tau = _fold_finite_phase(phase)
        speed = -wall * require_finite("velocity", velocity)
        require(speed > 0, f"velocity must point into the gap (below 0 at wall +1, above 0 at wall -1), got {velocity}")
        status, time, next_wall, w1, *_ = first_impact.first_impact(
            int(wall), tau, -wall * speed, self.delta, self.epsilon, self.beta, forcing.DRIFT
        )
        _raise_for_status(status)
        return FirstImpact(time, next_wall, w1)

    def impact(self, tau: float, v: float) -> Impact:
        """Return the impact map Π of (τ, v), v > 0, with its tangent matrix (2, 2) (paper, equation 3.16).

        The tangent is infinite at a graze.

        Returns
        -------
        Impact
            State after the next impact on Σ⁺, with its tangent.

        Raises
        ------
        ParameterError
            If an argument is outside its domain.
        RattleError
            If there is no next impact.
        """
        v = require_number("v", v, positive=True)
        found = impact_map.apply_impact_map_with_tangent(
            _fold_finite_phase(tau), v, self.delta, self.epsilon, self.beta, forcing.DRIFT, False
        )
        status, tau1, v1, time, n_minus, j00, j01, j10, j11, _ = found
        _raise_for_status(status)
        return Impact(tau1, v1, n_minus, np.array([[j00, j01], [j10, j11]]), time)

    def inverse_impact(self, tau: float, v: float) -> Impact:
        """Return the preimage of (τ, v) under Π, with the tangent matrix of Π⁻¹. Errors are those of `impact`.

        Returns
        -------
        Impact
            τ, v and tangent of the preimage; `time` is the positive time from the preimage to (τ, v).
        """
        v = require_number("v", v, positive=True)
        status, tau0, v0, time, n_minus = impact_map.apply_inverse_impact_map(
            _fold_finite_phase(tau), v, self.delta, self.epsilon, self.beta
        )
        _raise_for_status(status)
        forward = self.impact(tau0, v0)
        tangent = np.asarray(np.linalg.inv(forward.tangent), np.float64)
        return Impact(tau0, v0, n_minus, tangent, time)

    def departure(self, phase: float, position: float, velocity: float) -> tuple[float, float]:
        """Return the first departure from Σ⁺, (τ, v), of the motion with this phase, position Φ and velocity Φ'.

        The speed is 0 if the motion comes to rest before it departs. If the position is on a wall, the velocity may be
        the velocity before or after the impact.

        Returns
        -------
        tuple[float, float]
            Phase τ in [0, 1) and speed v ≥ 0.

        Raises
        ------
        ParameterError
            If an argument is outside its domain.
        RattleError
            If a flight before the departure has no impact that can be computed.
        """
        position, velocity = require_finite("position", position), require_finite("velocity", velocity)
        return find_departure(self.delta, self.epsilon, self.beta, _fold_finite_phase(phase), position, velocity)

    def iterate(self, tau: ArrayLike, v: ArrayLike, n: ArrayLike) -> Iterates:
        """Return Π^n of arrays of states; tau, v > 0 and n ≥ 0 broadcast.

        A trajectory that comes to rest keeps its last state and has n_plus < n.

        Returns
        -------
        Iterates
            States and numbers of impacts.

        Raises
        ------
        ParameterError
            If an argument is outside its domain.
        """
        return iterate(self.delta, self.epsilon, tau, v, n, self.beta)

    def trajectory(self, tau: float, v: float, periods: float = 10.0, points: int = 2000) -> Trajectory:
        """Return Φ and Φ' of the motion that leaves Σ⁺ at phase τ with velocity −v, over a number of forcing periods.

        Φ and Φ' are computed in closed form at `points` equally spaced times.

        Returns
        -------
        Trajectory
            (time, phi, velocity, impact_time, impact_wall, impact_speed, rest).

        Raises
        ------
        ParameterError
            If an argument is outside its domain.
        RattleError
            If the motion makes too many impacts, or cannot be followed.
        """
        tau = _fold_finite_phase(tau)
        return trajectory(self.delta, self.epsilon, self.beta, tau, v, periods, points, self.capture_speed)

    def orbits(self) -> tuple[Orbit, ...]:
        """Return the admissible period-one orbits among A, B, C, D, in that order, with multipliers and stability."""
        return orbits_at(self.delta, self.epsilon, self.beta)

    def orbit(self, tau: float, v: float, n_plus: int = 1) -> PeriodicOrbit:
        """Return the periodic motion near a departure (τ, v) that repeats after n_plus impacts on Σ⁺.

        The motion is returned with its least period, so it may have fewer impacts on Σ⁺. Errors are those of
        `periodic_orbit`.

        Returns
        -------
        PeriodicOrbit
            The motion with its impacts, multipliers and stability.
        """
        return periodic_orbit(self.delta, self.epsilon, tau, v, n_plus, self.beta)

    def saddle(self, orbit: Orbit) -> PeriodicMotion:
        """Return an orbit A to D of `orbits` as the periodic motion that `rattle.orbits.manifolds.manifold` takes.

        Returns
        -------
        PeriodicMotion
            The motion with its impacts, multipliers and stability.

        Raises
        ------
        RattleError
            If the orbit of this letter does not exist at the gear's parameters.
        """
        return period_one_orbit(orbit.name, self.delta, self.epsilon, self.beta)

    def region(self) -> int:
        """Return the region's number, an index in `rattle.REGIONS`; 1 to 5 are I to V of the paper's Figure 7."""
        return int(regions(self.delta, self.epsilon, self.beta))

    def boundary_distance(self, v_max: SpeedLimit = None) -> BoundaryDistance:
        """Return the least speed v < v_max of an impact, at any phase, that takes quiet motion to another attractor.

        Returns
        -------
        BoundaryDistance
            (v, tau, undecided), dimensionless, τ in forcing periods. v is inf if every followed state becomes quiet,
            and 0 from the quiet limit on. v is NaN if all states that do not become quiet are undecided. v is also NaN
            if becoming quiet takes more than 2048 impacts (below δ = 0.3 more, in proportion to 1/δ), which happens
            within a few per cent of the quiet limit (docs/weak-damping.md). tau is the phase of the impact. undecided
            is the least speed of an undecided state, inf if there is none; undecided states do not count as states of
            another basin.

        Raises
        ------
        ParameterError
            If an argument is outside its domain.

        Notes
        -----
        The speed is an upper bound, because a state with this speed does leave quiet motion. At a smooth
        boundary it is exact to 1e-5. For thin or fractal basins it was compared with the least speed on a grid of 1000
        phases and 15 speeds per octave, at 56 points with β from 0.3 to 1.2: it exceeded the least speed on the grid by
        at most 4 % at 55 points, and by 38 % at one point, where one state in 3000 leaves quiet motion. A basin with
        less than a thousandth of the plane may be missed. Among long chaotic transients the last bit of a state decides
        its fate; there a state within 1e-12 of the given one leaves quiet motion.
        """
        found = boundary_distances(self.delta, self.epsilon, self.beta, v_max)
        return BoundaryDistance(*(float(x) for x in found))

    @property
    def _point(self) -> impact_map.ImpactingPoint:
        captured = capture_invariant_limit(self.delta, self.epsilon, self.beta)
        return impact_map.ImpactingPoint(self.delta, self.epsilon, self.beta, captured)

    def gamma(self, spacing: float = 0.02) -> tuple[GammaPiece, ...]:
        """Return the grazing curve Γ: all states (τ, v) whose flight touches Σ⁻ with speed 0, accurate to 1e-10.

        Neighbouring points of a piece are at most `spacing` (at least 1e-4) apart in (τ, v). Outside the paper's plane
        distances in v are measured in sevenths of the natural speed 1.5 √(16πδβ) + 2πε.

        Returns
        -------
        tuple[GammaPiece, ...]
            Arrays (n,) of τ, v and the time of touch for each piece.

        Raises
        ------
        ParameterError
            If an argument is outside its domain.
        """
        return gamma(self.delta, self.epsilon, self.beta, spacing, self._highest_speed(None) / PAPER_SPEED)


def _fold_finite_phase(phase: float) -> float:
    """Return a phase shifted by whole periods into [0, 1). Raises ParameterError if the phase is not finite."""
    return float(law.fold_phase(require_finite("phase", phase)))


def _none_if_nan(limit: NDArray[np.float64]) -> float | None:
    return None if np.isnan(limit) else float(limit)
