"""The finder: from a computed motion to a theorem about the one that is there."""

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

ROOM = 10**4  # times the width of a ball that a published enclosure is wider: others round in other ways
FINEST = Fraction(1, 10**12)  # unit of a published enclosure, of numbers of order 1
PLACES = 25  # of speeds
SAME_TRACE = 1e-6
LONG = 16  # impacts; derivatives along more of them multiply to what 128 bits may not enclose


class MotionSystem(Evaluated, Protocol):
    """A periodic motion whose times are known in balls."""

    @property
    def speeds(self) -> list[arb]:
        """Speeds at these times."""

    @property
    def trace(self) -> arb:
        """The trace of the tangent map over the period."""

    def require_admissible(self) -> None:
        """Raise NotProvedError unless every piece ends where it first can."""


def certified(orbit: Periodic, parameters: dict[str, Fraction]) -> Certificate:
    """Return the theorem about a computed motion at exact parameters. Raises NotProvedError."""
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
    """Return the motions of a computed one's itinerary by their times, and its own."""
    plane = ModelPlane(*(ball(parameters[name]) for name in ("delta", "epsilon", "beta")))
    if stiff.ADDED not in parameters:
        return impacting.ImpactingSystem(plane, orbit.walls, orbit.m), orbit.departures
    times = np.stack([orbit.times, orbit.departures], axis=-1)
    return stiff.StiffSystem(stiff.Walls(plane, ball(parameters[stiff.ADDED])), orbit.walls, orbit.m), times.ravel()


def require_same(orbit: Periodic, speeds: Sequence[Fraction], trace: arb) -> None:
    """Raise NotProvedError unless what the computed motion says of itself is what is proved, but for rounding."""
    each = len(speeds) // len(orbit.walls)
    departures = [float(speed) for speed in speeds[each - 1 :: each]]
    moved = max(abs(said - speed) for said, speed in zip(orbit.speeds, departures, strict=True))
    if not moved < MOST_MOVED * max(1.0, *departures):
        raise NotProvedError(f"its speeds are not those that it gives: they differ by {moved:.1e}")
    said = sum(orbit.multipliers).real
    if not abs(said - float(trace)) < SAME_TRACE * max(1.0, abs(float(trace))):
        raise NotProvedError(f"its multipliers are not those that it gives: their sum is {float(trace):.6g}")


def require_least_period(times: Sequence[arb], walls: Sequence[int], m: int) -> None:
    """Raise NotProvedError if the motion may repeat before m forcing periods are over."""
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
            raise NotProvedError(f"it may repeat after {m // parts} of {m} forcing periods")


def verdict_of(trace: arb, determinant: arb) -> Verdict:
    """Return the verdict by λ² − trace λ + determinant with 0 < determinant < 1.

    Both roots are inside the unit circle if and only if |trace| < 1 + determinant, and one is outside if |trace| is
    more.

    Returns
    -------
    Verdict
        UNDECIDED where the enclosures do not tell.
    """
    if abs(trace) < 1 + determinant:
        return Verdict.ATTRACTING
    return Verdict.SADDLE if abs(trace) > 1 + determinant else Verdict.UNDECIDED


def multipliers(trace: arb, determinant: arb) -> tuple[Ends, Ends, Ends, Ends]:
    """Enclosures of both multipliers: of real and imaginary part in turn."""
    zero, half, square = (Fraction(0), Fraction(0)), trace / 2, trace * trace / 4 - determinant
    if square > 0:
        return published(half + square.sqrt()), zero, published(half - square.sqrt()), zero
    if square < 0:
        root = (-square).sqrt()
        return published(half), published(root), published(half), published(-root)
    spread = arb(0, 1) * square.abs_upper().sqrt()  # equal, or almost
    both = published(half + spread), published(spread)
    return both + both


def published(x: arb) -> Ends:
    """Return the ends of an enclosure in few digits, wider than the ball."""
    if not x.is_finite():
        raise NotProvedError("its multipliers are not enclosed: its derivatives grow too fast on the way")
    low, high = ends(x)
    least, unit = max(ROOM * (high - low), FINEST * abs(high)), FINEST
    while unit < least:
        unit *= 10
    return (low // unit - 1) * unit, (-(-high // unit) + 1) * unit


def radius_of(box: Sequence[arb], centres: Sequence[Fraction]) -> Fraction:
    """Return a bound of the distance of the box's speeds from their centres, in two digits."""
    apart = (abs(each - ball(centre)) for each, centre in zip(box, centres, strict=True))
    widest = exactly(reduce(arb.max, apart).upper())
    unit = Fraction(1, 10**30)
    while 100 * unit < widest:
        unit *= 10
    return -(-widest // unit) * unit
