"""The finder: from a computed periodic motion it proves the theorem about the exact motion near it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import reduce
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rattle._version import __version__
from rattle.errors import NotProvedError
from rattle.orbits.periodic_motions import PeriodicMotion
from rattle.proof import impacting, stiff
from rattle.proof.balls import (
    BITS,
    VERSIONS,
    arb,
    ball,
    exact_ends,
    exact_midpoint,
    interval_ball,
    precision,
    rounded_midpoint,
)
from rattle.proof.certificate import Certificate, Ends, StabilityVerdict
from rattle.proof.flights import ModelPoint
from rattle.proof.krawczyk import MOST_MOVED, EvaluatedEquations, enclose_zero

#: A published enclosure is wider than its ball by this multiple of the ball's width, because other programs
#: round differently.
WIDENING = 10**4
#: Least unit to which the ends of a published enclosure are rounded; the unit is larger for wide or large enclosures.
LEAST_UNIT = Fraction(1, 10**12)
#: Decimals of published speeds.
PLACES = 25
#: Largest relative difference between the stated and the proved trace that rounding can explain.
SAME_TRACE = 1e-6
#: Most impacts of a motion that is proved with the precision BITS; longer motions are proved with twice as many bits.
MOST_IMPACTS_AT_BITS = 16


class MotionEnclosures(EvaluatedEquations, Protocol):
    """Enclosures of the flights of a periodic motion, and of its contacts in the stiff gear, between given times.

    Both `ImpactEnclosures` and `StiffEnclosures` have these methods.
    """

    @property
    def speeds(self) -> list[arb]:
        """The speeds after the impacts; in the stiff gear the speeds at the beginning and the end of each contact."""

    @property
    def trace(self) -> arb:
        """The trace of the tangent map over the period."""

    def require_admissible(self) -> None:
        """Raise NotProvedError unless every flight and contact is proved not to end before its stated time."""


def prove_motion(orbit: PeriodicMotion, parameters: dict[str, Fraction]) -> Certificate:
    """Return the certificate of a computed motion at exact parameters. Raises NotProvedError."""
    with precision(BITS if len(orbit.walls) <= MOST_IMPACTS_AT_BITS else 2 * BITS):
        motions, start = equations_and_guess(orbit, parameters)
        found = enclose_zero(motions, start)
        motion = motions(found.zero)
        motion.require_admissible()
        require_least_period(found.zero, orbit.walls, orbit.m)
        speeds = [rounded_midpoint(each, PLACES) for each in motion.speeds]
        box = motions([interval_ball(each, found.radius) for each in found.centre])
        trace, determinant = motion.trace, (-ball(parameters["delta"]) * orbit.m).exp()
        require_same_speeds_and_trace(orbit, speeds, trace)
        return Certificate(
            model=stiff.MODEL if stiff.ADDED in parameters else impacting.MODEL,
            parameters=parameters,
            m=int(orbit.m),
            walls=tuple(int(wall) for wall in orbit.walls),
            times=tuple(found.centre),
            speeds=tuple(speeds),
            time_radius=found.radius,
            speed_radius=radius_upper_bound(box.speeds, speeds),
            trace=widened_ends(trace),
            determinant=widened_ends(determinant),
            multipliers=multiplier_enclosures(trace, determinant),
            verdict=prove_stability_verdict(trace, determinant),
            versions={"gear-rattle": __version__, **VERSIONS},
        )


def equations_and_guess(
    orbit: PeriodicMotion, parameters: dict[str, Fraction]
) -> tuple[Callable[[Sequence[arb]], MotionEnclosures], NDArray[np.float64]]:
    """Return the equations of periodic motions that meet the same walls in the same order as a computed motion.

    Returns
    -------
    tuple
        A function that encloses these equations at given times, and the times of the computed motion as a first guess.
    """
    point = ModelPoint(*(ball(parameters[name]) for name in ("delta", "epsilon", "beta")))
    if stiff.ADDED not in parameters:
        return impacting.ImpactingSystem(point, orbit.walls, orbit.m), orbit.departures
    times = np.stack([orbit.times, orbit.departures], axis=-1)
    return stiff.StiffSystem(
        stiff.StiffParameters(point, ball(parameters[stiff.ADDED])), orbit.walls, orbit.m
    ), times.ravel()


def require_same_speeds_and_trace(orbit: PeriodicMotion, speeds: Sequence[Fraction], trace: arb) -> None:
    """Raise NotProvedError unless a computed motion has the speeds and the multipliers of the proved motion.

    orbit: the computed motion. speeds, trace: the speeds, and the sum of both multipliers, of the proved motion.

    Raises
    ------
    NotProvedError
        If speeds or multipliers differ by more than rounding explains.
    """
    each = len(speeds) // len(orbit.walls)
    departures = [float(speed) for speed in speeds[each - 1 :: each]]
    moved = max(abs(stated - speed) for stated, speed in zip(orbit.speeds, departures, strict=True))
    if not moved < MOST_MOVED * max(1.0, *departures):
        raise NotProvedError(
            f"the stated speeds of the motion differ from the proved speeds by {moved:.1e}: compute the motion again"
        )
    stated = sum(orbit.multipliers).real
    if not abs(stated - float(trace)) < SAME_TRACE * max(1.0, abs(float(trace))):
        raise NotProvedError(
            f"the stated multipliers have the sum {stated:.6g}, but the proved multipliers have {float(trace):.6g}: "
            "compute the motion again"
        )


def require_least_period(times: Sequence[arb], walls: Sequence[int], m: int) -> None:
    """Raise NotProvedError unless m forcing periods are proved to be the least period: Lemma 7 of docs/proofs.md."""
    n, order = len(walls), tuple(walls)
    each = len(times) // n
    for parts in range(2, m + 1):
        if m % parts or n % parts:
            continue
        shift = n // parts
        if order[shift:] + order[:shift] != order:
            continue
        later = [*times, *(time + m for time in times)][shift * each :]
        if not any(abs(b - a - m // parts) > 0 for a, b in zip(times, later, strict=False)):
            raise NotProvedError(f"{m} is not proved to be the least period of the motion, which may be {m // parts}")


def prove_stability_verdict(trace: arb, determinant: arb) -> StabilityVerdict:
    """Return the stability that the trace and the determinant of the tangent map prove (Lemma 8 of docs/proofs.md).

    The multipliers are the roots of λ² − trace λ + determinant, with 0 < determinant < 1. Both are inside the unit
    circle if and only if |trace| < 1 + determinant, and one is outside if |trace| > 1 + determinant.

    Returns
    -------
    StabilityVerdict
        UNDECIDED where the enclosures prove neither.
    """
    if abs(trace) < 1 + determinant:
        return StabilityVerdict.ATTRACTING
    return StabilityVerdict.SADDLE if abs(trace) > 1 + determinant else StabilityVerdict.UNDECIDED


def multiplier_enclosures(trace: arb, determinant: arb) -> tuple[Ends, Ends, Ends, Ends]:
    """Return enclosures of the real and the imaginary part of the first multiplier, then of the second."""
    zero, half, square = (Fraction(0), Fraction(0)), trace / 2, trace * trace / 4 - determinant
    if square > 0:
        return widened_ends(half + square.sqrt()), zero, widened_ends(half - square.sqrt()), zero
    if square < 0:
        root = (-square).sqrt()
        return widened_ends(half), widened_ends(root), widened_ends(half), widened_ends(-root)
    spread = arb(0, 1) * square.abs_upper().sqrt()  # the multipliers are equal, or too close to be separated
    both = widened_ends(half + spread), widened_ends(spread)
    return both + both


def widened_ends(x: arb) -> Ends:
    """Return the ends, in few digits, of an interval wider than the ball x. Raises NotProvedError if x is infinite."""
    if not x.is_finite():
        raise NotProvedError(
            "the multipliers are not enclosed: the motion is too long or too unstable for the precision"
        )
    low, high = exact_ends(x)
    least, unit = max(WIDENING * (high - low), LEAST_UNIT * abs(high)), LEAST_UNIT
    while unit < least:
        unit *= 10
    return (low // unit - 1) * unit, (-(-high // unit) + 1) * unit


def radius_upper_bound(box: Sequence[arb], centres: Sequence[Fraction]) -> Fraction:
    """Return a radius r, rounded up to two digits: for each i the ball box[i] lies within centres[i] ± r."""
    apart = (abs(each - ball(centre)) for each, centre in zip(box, centres, strict=True))
    widest = exact_midpoint(reduce(arb.max, apart).upper())
    unit = Fraction(1, 10**30)
    while 100 * unit < widest:
        unit *= 10
    return -(-widest // unit) * unit
