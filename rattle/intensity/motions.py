"""Kind and label of the motions whose impacts are computed, and checks that a motion moves as its label says."""

import math
from typing import Any, Protocol

import numpy as np

from rattle.attractors.chaos import BATCHES
from rattle.errors import RattleError, require, require_number
from rattle.flight.first_impact import OK
from rattle.flight.law import wrap_phase_difference
from rattle.orbits.iterates import MOST_IMPACTS

# A motion closes if the states at the two ends of its period differ by at most CLOSED in τ, and by at most CLOSED times
# the motion's largest speed in v.
CLOSED = 1e-6
BATCH, RELAXATIONS = 1000.0, 10.0  # a batch lasts BATCH forcing periods, or RELAXATIONS/δ if this is more
ENDLESS = 1 << 62  # number of returns that stands for no limit
ROUNDING = 1e-9  # rounding error, in forcing periods, of the time of the impact that ends a period


class Motion(Protocol):
    """A motion with a state and a label: an `Attractor`, an `Orbit`, or a periodic motion of any gear.

    A motion may also have an attribute `kind`, as attractors have; without it the motion is periodic. It may have an
    attribute `contacts`, the number of contact phases in a period; without it the number is 0.
    """

    @property
    def tau(self) -> float:
        """Phase of a departure from Σ⁺."""

    @property
    def v(self) -> float:
        """Speed at the departure from Σ⁺."""

    @property
    def m(self) -> int:
        """Forcing periods in a period of the motion."""

    @property
    def n_plus(self) -> int:
        """Impacts on Σ⁺ in a period of the motion."""


def checked_motion_kind(motion: Motion) -> str:
    """Return the kind of a motion: quiet, periodic, chaotic or undecided.

    Returns
    -------
    str
        The attribute `kind` of the motion, "periodic" if the motion has none.

    Raises
    ------
    ParameterError
        If the attribute is none of these four words, or if a motion that is not quiet leaves Σ⁺ with a speed v ≤ 0,
        which shows that it is virtual.
    """
    kind = getattr(motion, "kind", "periodic")
    require(
        kind in ("quiet", "periodic", "chaotic", "undecided"),
        f"a motion must be quiet, periodic, chaotic or undecided, got {kind!r}",
    )
    if kind != "quiet":
        require(
            motion.v > 0.0,
            f"the motion must leave Σ⁺ with a speed v above 0, got {motion.v}: give an admissible motion",
        )
    return str(kind)


def one_period_limits(m: Any, n_plus: Any, contacts: Any) -> tuple[Any, Any]:
    """Return two limits, a number of returns and a time in forcing periods, which end motions after one period.

    A motion without contact phases has completed its period after n_plus returns. A motion with contact phases
    may make more returns, because its label counts a run of impacts that ends in contact as one impact. Its limit is
    therefore the time m − ROUNDING. The last impact of the period reaches this limit, even if rounding makes the impact
    a little early. The impact before the last one does not, because the last flight, which ends in the fastest impact
    on Σ⁺, takes longer than ROUNDING.

    Parameters
    ----------
    m, n_plus, contacts : int or ndarray
        Labels of the motions, of one shape.

    Returns
    -------
    returns, periods : int and float, or ndarray
        The limits. Only one of them applies to a motion: the other is infinite, or ENDLESS for returns.
    """
    held = np.asarray(contacts) > 0
    return np.where(held, ENDLESS, n_plus)[()], np.where(held, np.asarray(m) - ROUNDING, math.inf)[()]


def one_period_limits_of_motion(motion: Motion) -> tuple[int, float]:
    """Return the limits of returns and of forcing periods that end one period of a motion; one of them is infinite."""
    returns, periods = one_period_limits(motion.m, motion.n_plus, contact_phases_per_period(motion))
    return int(returns), float(periods)


def contact_phases_per_period(motion: Motion) -> int:
    """Return the number of contact phases of a motion in a period."""
    return int(getattr(motion, "contacts", 0))


def observation_periods(delta: float, periods: float | None) -> float:
    """Return the number of forcing periods for which a chaotic motion is followed.

    Returns
    -------
    float
        `periods` if it is given. Otherwise a number for which each of the BATCHES batches is long compared with the
        time in which the motion forgets its initial state.
    """
    if periods is None:
        return BATCHES * max(BATCH, RELAXATIONS / delta)
    return require_number("periods", periods, positive=True)


def require_closed_orbit(motion: Motion, status: int, tau: float, v: float, fastest: float) -> None:
    """Check that a motion is back at its first state after one period.

    status, tau, v: the status and the state at the end of the period. fastest: the largest speed in the period; the
    difference in v is divided by it.

    Raises
    ------
    RattleError
        If the status is not OK, or a difference is larger than CLOSED.
    """
    closed = abs(wrap_phase_difference(tau - motion.tau)) <= CLOSED and abs(v - motion.v) <= CLOSED * fastest
    if status != OK or not closed:
        raise RattleError(
            f"the motion from tau = {motion.tau}, v = {motion.v} does not return to this state after {motion.m} "
            f"forcing periods and {motion.n_plus} impacts on Σ⁺: give a periodic motion of this gear, with unrounded "
            "tau and v"
        )


def require_full_observation(status: int, time: float, periods: float) -> None:
    """Check that a motion was followed for `periods` forcing periods.

    status: the status with which `sum_impacts` or `write_impacts_of_motion` ended. time: the number of forcing periods
    that it followed the motion.

    Raises
    ------
    RattleError
        If the motion came to rest earlier, could not be followed so long, or made too many impacts.
    """
    if status != OK:
        raise RattleError(
            f"the motion comes to rest, or cannot be followed, after {time:g} forcing periods: choose fewer periods"
        )
    if time < periods:
        raise RattleError(f"the motion makes more than {MOST_IMPACTS} impacts: choose fewer than {time:g} periods")
