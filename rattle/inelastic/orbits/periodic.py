"""Find any admissible periodic motion of the inelastic gear by Newton's method on its return map."""

from __future__ import annotations

import math
from typing import NamedTuple

from rattle.errors import RattleError, require_integer, require_number
from rattle.flight.first_impact import OK
from rattle.inelastic.map.impact_map import InelasticPoint
from rattle.inelastic.map.runs import count_contacts_and_merged_impacts, count_returns_of_contact_motion
from rattle.orbits.orbits_a_to_d import multipliers_from_trace
from rattle.orbits.return_map import apply_return_map_power, fastest_departure, find_fixed_point, least_return_period

MOST_RETURNS = 4096  # largest number of impacts on Σ⁺ per period of a sought motion
# a motion with contact is back at its first state if τ differs by less than this, and v by less than this share of v
SAME_STATE = 1e-6


class InelasticOrbit(NamedTuple):
    """An admissible periodic motion P(m, n_plus, n_minus) of the inelastic gear.

    n_plus and n_minus count a run of impacts that ends in contact as one impact. contacts: the number of contact phases
    in m forcing periods. tau, v: phase and speed after the fastest impact on Σ⁺. multipliers: the Floquet multipliers
    over m periods, the larger modulus first. Their product is e^(−δm) r^(2(n_plus + n_minus)); both are 0 if there is a
    contact phase.
    """

    m: int
    n_plus: int
    n_minus: int
    contacts: int
    tau: float
    v: float
    multipliers: tuple[complex, complex]

    @property
    def stable(self) -> bool:
        """True if the motion attracts."""
        return abs(self.multipliers[0]) < 1.0


def inelastic_orbit(point: InelasticPoint, tau: float, v: float, n_plus: int = 1) -> InelasticOrbit:
    """Return the periodic motion near a state (τ, v) that repeats after n_plus impacts on Σ⁺.

    If the state is on a motion with contact phases, n_plus is ignored, and the motion is followed until it repeats.

    Returns
    -------
    InelasticOrbit
        The label, fastest impact and multipliers of the motion.

    Raises
    ------
    ParameterError
        If a number is outside its domain.
    RattleError
        If Newton's method on the return map finds no such motion, a flight of the motion is too long, or a number
        leaves double precision.
    """
    v, k = require_number("v", v, positive=True), require_integer("n_plus", n_plus, 1, MOST_RETURNS)
    k = count_returns_of_contact_motion(tau, v, MOST_RETURNS, SAME_STATE, point) or k
    found, tau1, v1 = find_fixed_point(tau, v, k, point)
    if not found:
        raise RattleError(
            f"no periodic motion with {k} impacts on Σ⁺ was found near tau = {tau:g}, v = {v:g}: give tau and v closer "
            "to a periodic motion"
        )
    k = least_return_period(tau1, v1, k, point)
    tau1, v1 = fastest_departure(tau1, v1, k, point)
    status, _t, _v, time, n_minus, a00, _a, _b, a11, log_det = apply_return_map_power(tau1, v1, k, point)
    if status != OK:
        raise RattleError(
            f"the periodic motion near tau = {tau:g}, v = {v:g} cannot be followed: a flight is too long, or a number "
            "is beyond double precision"
        )
    contacts, merged = count_contacts_and_merged_impacts(tau1, v1, k, point)
    if log_det == -math.inf:
        multipliers = (0j, 0j)
    else:
        large, small = multipliers_from_trace(a00 + a11, math.exp(log_det))
        multipliers = complex(large), complex(small)
    return InelasticOrbit(round(time), k - merged, n_minus, contacts, tau1, v1, multipliers)
