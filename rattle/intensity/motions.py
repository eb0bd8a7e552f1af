"""Motions whose impacts are asked for: what they say of themselves, and whether they go on as they say."""

import math
from typing import Any, Protocol

import numpy as np

from rattle.attractors.chaos import BATCHES
from rattle.errors import RattleError, require, require_number
from rattle.flight.first_impact import OK
from rattle.flight.law import wrapped
from rattle.orbits.iterates import MOST_IMPACTS

CLOSED = 1e-6  # a motion comes back to where it began, speeds over its largest, to this
BATCH, RELAXATIONS = 1000.0, 10.0  # forcing periods, and times 1/δ, of a batch at least
ENDLESS = 1 << 62  # returns
ROUNDING = 1e-9  # forcing periods by which the impact that ends a period may seem to be too early or too late


class Motion(Protocol):
    """Motion that has a state and a label: an `Attractor`, an `Orbit`, a periodic motion of either gear.

    It may have the kind of an attractor, without which it is periodic, and a number of contact phases, by default 0.
    """

    @property
    def tau(self) -> float:
        """Phase of a departure from Σ⁺."""

    @property
    def v(self) -> float:
        """Return the motion's speed at the departure from Σ⁺."""

    @property
    def m(self) -> int:
        """Forcing periods of a period."""

    @property
    def n_plus(self) -> int:
        """Impacts on Σ⁺ in it."""


def kind_of(motion: Motion) -> str:
    """Quiet, periodic, chaotic or undecided. Raises ParameterError."""
    kind = getattr(motion, "kind", "periodic")
    require(kind in ("quiet", "periodic", "chaotic", "undecided"), f"there is no motion of kind {kind!r}")
    if kind != "quiet":
        require(motion.v > 0.0, f"the motion must leave Σ⁺ with a speed above 0, got {motion.v}: it is a virtual one")
    return str(kind)


def period_limits(m: Any, n_plus: Any, contacts: Any) -> tuple[Any, Any]:
    """Return the limits of returns and forcing periods that end one period of periodic motions.

    Impacts on Σ⁺ end it where there is no contact. Labels count a run of impacts that ends in contact once, so time
    ends it there; the state of such a motion is its fastest impact on Σ⁺, before which there is no impact for longer
    than rounding.

    Parameters
    ----------
    m, n_plus, contacts : int or ndarray
        Their labels, of one shape.

    Returns
    -------
    returns, periods : int and float, or ndarray
        The limits, of which one is without bound.
    """
    held = np.asarray(contacts) > 0
    return np.where(held, ENDLESS, n_plus)[()], np.where(held, np.asarray(m) - ROUNDING, math.inf)[()]


def limits_of(motion: Motion) -> tuple[int, float]:
    """Return what `period_limits` does for one motion."""
    returns, periods = period_limits(motion.m, motion.n_plus, contacts_of(motion))
    return int(returns), float(periods)


def contacts_of(motion: Motion) -> int:
    """Return the contact phases of a motion in a period."""
    return int(getattr(motion, "contacts", 0))


def watched_periods(delta: float, periods: float | None) -> float:
    """Return the forcing periods of an observation.

    The default is so long that batches are long against the time in which motions forget.

    Returns
    -------
    float
        Forcing periods, the argument if it is one.
    """
    if periods is None:
        return BATCHES * max(BATCH, RELAXATIONS / delta)
    return require_number("periods", periods, positive=True)


def require_closed(motion: Motion, status: int, tau: float, v: float, fastest: float) -> None:
    """Raise RattleError unless a motion is back where it began after all its impacts on Σ⁺."""
    closed = abs(wrapped(tau - motion.tau)) <= CLOSED and abs(v - motion.v) <= CLOSED * fastest
    if status != OK or not closed:
        raise RattleError(
            f"the motion does not come back to tau = {motion.tau}, v = {motion.v} after {motion.n_plus} impacts on Σ⁺: "
            "give a periodic motion of this very gear, with all its digits"
        )


def require_lasting(status: int, time: float, periods: float) -> None:
    """Raise RattleError unless a motion could be followed for so many forcing periods."""
    if status != OK:
        raise RattleError(f"the motion comes to rest, or cannot be followed, after {time:g} forcing periods")
    if time < periods:
        raise RattleError(f"the motion makes more than {MOST_IMPACTS} impacts: ask for fewer than {time:g} periods")
