"""`InelasticGear`: one parameter point of the gear with restitution, load and harmonics, and its methods."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.reached import SampledGear
from rattle.errors import RattleError, require, require_finite, require_number
from rattle.flight.contact_phase import IN_CONTACT, MOST_BOUNCES
from rattle.flight.first_impact import LONGEST, OK
from rattle.flight.forcing import DRIFT
from rattle.flight.law import fold_phase
from rattle.inelastic.attractors.classifier import InelasticClassifier
from rattle.inelastic.given import Harmonics, check_harmonics, check_inelastic_parameters
from rattle.inelastic.map import bounce  # noqa: F401 registers the kernels of impacts and of their sums for this gear
from rattle.inelastic.map.cells import make_inelastic_point
from rattle.inelastic.map.flight import first_impact_of_forced_flight, prepare_forced_flight
from rattle.inelastic.map.impact_map import InelasticPoint, force_piece_number, step_with_tangent
from rattle.inelastic.map.iterate import iterate
from rattle.inelastic.map.quiet import quiet_limit
from rattle.inelastic.map.trajectory import trajectory
from rattle.inelastic.orbits.closed_form import epsilon_of_flip_of_c, epsilon_of_saddle_node, one_impact_motions
from rattle.inelastic.orbits.period_one import period_one
from rattle.inelastic.orbits.periodic import InelasticOrbit, inelastic_orbit
from rattle.intensity.rattling import RattlingGear
from rattle.orbits.iterates import Impact, Iterates, Trajectory
from rattle.orbits.orbits_a_to_d import Orbit, PeriodOne, classify_regions, existing_orbits
from rattle.parameters import Parameters


class FirstInelasticImpact(NamedTuple):
    """The first impact of a flight: flight time in forcing periods, wall (±1), and velocity Φ' before the impact."""

    flight_time: float
    next_wall: int
    impact_velocity: float


@dataclass(frozen=True)
class InelasticGear(SampledGear, RattlingGear):
    """The gear with a coefficient of restitution, a load and a forcing of several harmonics, at one parameter point.

    Between the walls Φ = ±β

        Φ'' + δΦ' = δq + e'' + δe',    q = 4π(1 + load),

    and Φ' → −r Φ' at a wall; time is in forcing periods. `rattle.Gear` returns an InelasticGear if it is given a
    restitution below 1, a load or harmonics.

    Parameters
    ----------
    delta, epsilon, beta : float
        Damping > 0, eccentricity ≥ 0 and half-backlash > 0.
    restitution : float
        r, from 0 (excluded) to 1 (elastic impacts).
    load : float
        Load torque divided by the drag torque, ≥ 0.
    harmonics : sequence of (int, float, float)
        Order k ≥ 2, amplitude α relative to the first harmonic, and phase φ in turns, of each further harmonic:
        e = ε [cos 2πt + Σ α cos 2π(k t + φ)]. If (1, 0, 0) is in the sequence, the first harmonic is absent, and ε only
        scales the amplitudes.

    Raises
    ------
    ParameterError
        If a number is outside its domain; the message says what is allowed.
    """

    delta: float
    epsilon: float
    beta: float = 0.6
    restitution: float = 1.0
    load: float = 0.0
    harmonics: Harmonics = ()

    _classifier = InelasticClassifier
    _resolution, _pairs = 400, 2048

    def __post_init__(self) -> None:
        """Check and convert all numbers."""
        object.__setattr__(self, "harmonics", check_harmonics(self.harmonics))
        for name in ("delta", "epsilon", "beta", "restitution", "load"):
            value = require_number(name, getattr(self, name), positive=name not in ("epsilon", "load"))
            object.__setattr__(self, name, value)
        _ = self.parameters  # building the parameters checks, for example, that the restitution is at most 1

    @property
    def parameters(self) -> Parameters:
        """The checked parameters of this gear, as arrays (1,)."""
        numbers = ([self.delta], [self.epsilon], [self.beta], [self.restitution], [self.load])
        return check_inelastic_parameters(*numbers, check_harmonics(self.harmonics))

    @cached_property
    def _point(self) -> InelasticPoint:
        return make_inelastic_point(self.delta, self.epsilon, self.beta, self.restitution, self.load, self.harmonics)

    @property
    def quiet_limit(self) -> float:
        """Eccentricity above which the contact force changes sign, so that permanent contact is impossible."""
        return quiet_limit(self.delta, DRIFT * (1.0 + self.load), self.harmonics)

    @property
    def contact_force_zeros(self) -> NDArray[np.float64]:
        """Phases at which the contact force changes sign, and contact with a wall ends; empty below the quiet limit."""
        return self._point.zeros.copy()

    @property
    def sn1(self) -> float | None:
        """Eccentricity of SN1, at which A and C are born; None if the gear has `harmonics`."""
        return None if self.harmonics else epsilon_of_saddle_node(self.delta, self.restitution, self._point.drift)

    @property
    def flip(self) -> float | None:
        """Eccentricity of the flip of C, at which C may be virtual; None if the gear has `harmonics`."""
        return None if self.harmonics else epsilon_of_flip_of_c(self.delta, self.restitution, self._point.drift)

    def first_impact(self, wall: int, phase: float, velocity: float) -> FirstInelasticImpact:
        """Return the first impact of a flight that leaves a wall (+1: Φ = β, −1: Φ = −β) at this phase and velocity.

        Returns
        -------
        FirstInelasticImpact
            Flight time, wall, and velocity before the impact.

        Raises
        ------
        ParameterError
            If wall is not ±1, a number is not finite, or the velocity is zero or points out of the gap.
        RattleError
            If there is no impact within 1000 forcing periods, or a number leaves double precision.
        """
        require(require_finite("wall", wall) in (1, -1), f"wall must be +1 or -1, got {wall!r}")
        speed = -wall * require_finite("velocity", velocity)
        require(speed > 0, f"velocity must point into the gap (below 0 at wall +1, above 0 at wall -1), got {velocity}")
        point, tau = self._point, _fold_finite_phase(phase)
        departure = np.empty((2, point.harmonics.shape[1]))
        flight = prepare_forced_flight(tau, float(velocity), self.delta, point.drift, point.harmonics, departure)
        piece = force_piece_number(tau, point.zeros)
        status, time, target, w1, *_ = first_impact_of_forced_flight(
            np.int64(wall), tau, flight, piece, point, departure
        )
        _raise_for_status(status)
        return FirstInelasticImpact(time, int(target), w1)

    def impact(self, tau: float, v: float) -> Impact:
        """Return the next state on Σ⁺ after a state (τ, v), v > 0, with the tangent matrix: see `rattle.Gear.impact`.

        A chatter that completes and its contact phase are one step of the map, whose tangent matrix is 0.

        Returns
        -------
        Impact
            The next state on Σ⁺, impacts on Σ⁻ before it, tangent matrix, and time.

        Raises
        ------
        ParameterError
            If the state is outside its domain.
        RattleError
            If the motion becomes quiet, or its next impact on Σ⁺ cannot be computed; the message names possible causes.
        """
        v = require_number("v", v, positive=True)
        step = step_with_tangent(_fold_finite_phase(tau), v, self._point)
        status, tau1, v1, time, n_minus, *tangent, _det, _plus, _minus = step
        _raise_for_status(status)
        return Impact(tau1, v1, n_minus, np.array(tangent).reshape(2, 2), time)

    def iterate(self, tau: ArrayLike, v: ArrayLike, n: ArrayLike) -> Iterates:
        """Apply the impact map n times to states (τ, v), as `rattle.inelastic.iterate` does. Raises ParameterError."""
        others = self.beta, self.restitution, self.load, self.harmonics
        return iterate(self.delta, self.epsilon, tau, v, n, *others)

    def trajectory(self, tau: float, v: float, periods: float = 10.0, points: int = 2000) -> Trajectory:
        """Return Φ and Φ' of the motion that leaves Σ⁺ at phase τ with velocity −v, at `points` equally spaced times.

        See `rattle.Gear.trajectory`; impact_speed is the speed before an impact. Raises ParameterError and RattleError.

        Returns
        -------
        Trajectory
            Times, Φ and Φ' (points,), and all impacts during this time.
        """
        return trajectory(self._point, _fold_finite_phase(tau), v, periods, points)

    def orbits(self) -> tuple[Orbit, ...]:
        """Return the admissible motions A to D; if the forcing has harmonics, instead all P(1,1,0), named "P"."""
        at = self.delta, self.epsilon, self.beta
        added = {"restitution": self.restitution, "load": self.load}
        if self.harmonics:
            found = one_impact_motions(self._point)
            return tuple(
                Orbit("P", 1, 1, 0, each.tau, each.v, each.multipliers, abs(each.multipliers[0]) < 1.0, *at, added)
                for each in found
            )
        return existing_orbits(self._period_one(), *at, added)

    def _period_one(self) -> PeriodOne:
        """Return existence, states and multipliers of A to D for this gear, under forcing by one cosine."""
        return period_one(self.delta, self.epsilon, self.beta, self.restitution, self.load)

    def orbit(self, tau: float, v: float, n_plus: int = 1) -> InelasticOrbit:
        """Return the periodic motion near a state (τ, v) that repeats after n_plus impacts on Σ⁺.

        If the state is on a motion with contact phases, n_plus is ignored. Raises ParameterError and RattleError.

        Returns
        -------
        InelasticOrbit
            The label, fastest impact and multipliers of the motion.
        """
        return inelastic_orbit(self._point, _fold_finite_phase(tau), v, n_plus)

    def saddle(self, orbit: Orbit) -> NoReturn:
        """Raise RattleError: manifolds need the inverse map, which does not exist after contact phases."""
        raise RattleError(f"manifolds of {orbit.name} are not computed for the inelastic gear: use the impacting gear")

    def departure(self, phase: float, position: float, velocity: float) -> NoReturn:  # noqa: ARG002
        """Raise RattleError, because motions that begin inside the gap are not followed for this gear."""
        raise RattleError(
            "motions that begin between the walls are not followed for the inelastic gear: give tau and v, a departure "
            "from Σ⁺"
        )

    def region(self) -> int:
        """Return the region of this point: the set of the motions A to D that exist under forcing by one cosine.

        Returns
        -------
        int
            Number in `rattle.REGIONS`.

        Raises
        ------
        RattleError
            If the forcing has harmonics, for which A to D are unknown.
        """
        if self.harmonics:
            raise RattleError("regions are defined for a forcing of one cosine only: leave out the harmonics")
        return int(classify_regions(self._period_one()))

    def _repr_html_(self) -> str:
        return repr(self)


def _fold_finite_phase(phase: float) -> float:
    """Return a phase modulo 1, in [0, 1). Raises ParameterError unless it is a finite number."""
    return float(fold_phase(require_finite("phase", phase)))


def _raise_for_status(status: int) -> None:
    """Raise RattleError with the meaning of a status code of the impact map, unless the code is OK."""
    if status == IN_CONTACT:
        raise RattleError("the motion has no next impact, because it becomes quiet: its contact with Σ⁺ never ends")
    if status != OK:
        raise RattleError(
            f"the motion has no impact within {LONGEST:g} forcing periods, makes more than {MOST_BOUNCES:,} impacts on "
            "Σ⁻ between two on Σ⁺, or its numbers are beyond double precision"
        )
