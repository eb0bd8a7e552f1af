"""The finder of periodic motions: from a computed motion to a theorem about the exact one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import reduce
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rattle._version import __version__
from rattle.errors import NotProvedError
from rattle.orbits.periodic import Periodic
from rattle.proof import impacting, stiff
from rattle.proof.balls import BITS, VERSIONS, arb, around, ball, ends, exactly, nearest, precision
from rattle.proof.certificate import Certificate, Ends, Verdict
from rattle.proof.flights import ModelPlane
from rattle.proof.krawczyk import MOST_MOVED, Evaluated, enclosed

ROOM = 10**4  # margin of a published enclosure, in widths of the ball, so that programs with other rounding confirm it
# unit to which the ends of a published enclosure are rounded outwards, for numbers of order 1
FINEST = Fraction(1, 10**12)
PLACES = 25  # decimals of published speeds
SAME_TRACE = 1e-6
LONG = 16  # more impacts need 256 bits, because the product of their derivatives may exceed 128 bits


class MotionSystem(Evaluated, Protocol):
    """A periodic motion whose times are known in balls."""

    @property
    def speeds(self) -> list[arb]:
        """Speeds at the event times."""

    @property
    def trace(self) -> arb:
        """Trace of the tangent map over the period."""

    def require_admissible(self) -> None:
        """Raise NotProvedError unless every piece ends at the first event that it can reach."""


def certified(orbit: Periodic, parameters: dict[str, Fraction]) -> Certificate:
    """Prove a computed motion at exact parameters and return the theorem. Raises NotProvedError."""
    with precision(BITS if len(orbit.walls) <= LONG else 2 * BITS):
        motions, start = motions_of(orbit, parameters)
        found = enclosed(motions, start)
        motion = motions(found.zero)
        motion.require_admissible()
        require_least_period(found.zero, orbit.walls, orbit.m)
        speeds = [nearest(each, PLACES) for each in motion.speeds]
        box = motions([around(each, found.radius) for each in found.centre])
        trace, determinant = motion.trace, (-ball(parameters["delta"]) * orbit.m).exp()
        require_same(orbit, speeds, trace)
        return Certificate(
            model=stiff.MODEL if stiff.ADDED in parameters else impacting.MODEL,
            parameters=parameters,
            m=int(orbit.m),
            walls=tuple(int(wall) for wall in orbit.walls),
            times=tuple(found.centre),
            speeds=tuple(speeds),
            time_radius=found.radius,
            speed_radius=radius_of(box.speeds, speeds),
            trace=published(trace),
            determinant=published(determinant),
            multipliers=multipliers(trace, determinant),
            verdict=verdict_of(trace, determinant),
            versions={"gear-rattle": __version__, **VERSIONS},
        )


def motions_of(
    orbit: Periodic, parameters: dict[str, Fraction]
) -> tuple[Callable[[Sequence[arb]], MotionSystem], NDArray[np.float64]]:
    """Return the system of all motions with the itinerary of a computed one, and the unknowns of the computed one."""
    plane = ModelPlane(*(ball(parameters[name]) for name in ("delta", "epsilon", "beta")))
    if stiff.ADDED not in parameters:
        return impacting.ImpactingSystem(plane, orbit.walls, orbit.m), orbit.departures
    times = np.stack([orbit.times, orbit.departures], axis=-1)
    return stiff.StiffSystem(stiff.Walls(plane, ball(parameters[stiff.ADDED])), orbit.walls, orbit.m), times.ravel()


def require_same(orbit: Periodic, speeds: Sequence[Fraction], trace: arb) -> None:
    """Raise NotProvedError unless the computed speeds and multipliers equal the proved ones but for rounding."""
    each = len(speeds) // len(orbit.walls)
    departures = [float(speed) for speed in speeds[each - 1 :: each]]
    moved = max(abs(said - speed) for said, speed in zip(orbit.speeds, departures, strict=True))
    if not moved < MOST_MOVED * max(1.0, *departures):
        raise NotProvedError(
            f"the computed speeds differ from the proved ones by {moved:.1e}, which is more than rounding"
        )
    said = sum(orbit.multipliers).real
    if not abs(said - float(trace)) < SAME_TRACE * max(1.0, abs(float(trace))):
        raise NotProvedError(f"the computed multipliers are wrong: the proved sum of both is {float(trace):.6g}")


def require_least_period(times: Sequence[arb], walls: Sequence[int], m: int) -> None:
    """Raise NotProvedError if the motion may repeat in fewer than m forcing periods (lemma 7)."""
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
            raise NotProvedError(f"the motion may already repeat after {m // parts} of its {m} forcing periods")


def verdict_of(trace: arb, determinant: arb) -> Verdict:
    """Return the stability from the roots of λ² − trace λ + determinant with 0 < determinant < 1 (lemma 8).

    Both roots lie inside the unit circle if and only if |trace| < 1 + determinant. One lies outside if |trace| is
    larger.

    Returns
    -------
    Verdict
        UNDECIDED if the enclosures overlap.
    """
    if abs(trace) < 1 + determinant:
        return Verdict.ATTRACTING
    return Verdict.SADDLE if abs(trace) > 1 + determinant else Verdict.UNDECIDED


def multipliers(trace: arb, determinant: arb) -> tuple[Ends, Ends, Ends, Ends]:
    """Enclose both multipliers: real and imaginary part of each, in turn."""
    zero, half, square = (Fraction(0), Fraction(0)), trace / 2, trace * trace / 4 - determinant
    if square > 0:
        return published(half + square.sqrt()), zero, published(half - square.sqrt()), zero
    if square < 0:
        root = (-square).sqrt()
        return published(half), published(root), published(half), published(-root)
    spread = arb(0, 1) * square.abs_upper().sqrt()  # both multipliers are equal, or almost
    both = published(half + spread), published(spread)
    return both + both


def published(x: arb) -> Ends:
    """Return the ends of an enclosure in few digits, with a margin around the ball."""
    if not x.is_finite():
        raise NotProvedError(
            "the multipliers are not enclosed, because derivatives along the motion grow too fast for the precision"
        )
    low, high = ends(x)
    least, unit = max(ROOM * (high - low), FINEST * abs(high)), FINEST
    while unit < least:
        unit *= 10
    return (low // unit - 1) * unit, (-(-high // unit) + 1) * unit


def radius_of(box: Sequence[arb], centres: Sequence[Fraction]) -> Fraction:
    """Return an upper bound, in two digits, of the distance between the enclosed speeds and their centres."""
    apart = (abs(each - ball(centre)) for each, centre in zip(box, centres, strict=True))
    widest = exactly(reduce(arb.max, apart).upper())
    unit = Fraction(1, 10**30)
    while 100 * unit < widest:
        unit *= 10
    return -(-widest // unit) * unit
