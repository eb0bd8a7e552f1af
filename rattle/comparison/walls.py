"""Find the wall of each of a series of impacts, and phase 0, from their times alone.

A flight from wall a at t₀ to wall b at t₁ has its velocities w₀, w₁ in closed form (`rattle.flight.between`). Those of
the walls that were met point into the gap and back out of it, and an elastic impact turns w₁ of one flight into −w₀ of
the next. The walls that fit best are found by dynamic programming (Viterbi), for many phases at once; up to MOST_FALSE
impacts in a row may be false, that is none of the motion.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.comparison.measured import MeasuredImpacts
from rattle.flight.between import flight_between
from rattle.flight.forcing import analytic_phase
from rattle.flight.law import speed_unit, wrapped
from rattle.models import AnyGear
from rattle.numerics.compile import inline, kernel

PHASES = 96  # that are tried; then about each of the FEW best, MORE, and so on
FINER, FINER_PHASES, FEW = 16.0, 384, 8  # tried too: more phases, with a unit so many times smaller
TWINS, MOST_TWINNED = 1024, 3  # phases at which the walls of so many fits are tried: A and C have the same
POOR = 0.25  # a misfit from which impacts are none of this gear
SAME_OFFSET = 1e-4
MORE, ROUNDS = 16, 4
RESOLUTION = (2.0 / MORE) ** ROUNDS / PHASES  # of the phase that is found, in forcing periods
LISTENED = 256  # impacts from which phase 0 is found
HOPEFUL = 3.0, 0.1  # a misfit of so many times the least and so much more may become the least
AS_GOOD = 3.0, 0.02  # a misfit of so many times the least and so much more is as good
SHARPENINGS, SHARPER, FINEST = 5, 4.0, 1e-3  # times that the unit is made smaller, by how much, and to what at least
SCATTER = 4.0  # medians of what speeds are off by, which are the unit then
WORST = 4.0  # cost at most of an impact, and of a flight that goes the wrong way
FALSE, MOST_FALSE = 6.0, 2  # cost of an impact that is none of the motion, and how many of them there may be in a row
AT_RANDOM = 0.5  # misfit of such an impact
FARTHEST, STEPS = 0.25, 128  # forcing periods from the phase found, and steps, in which its interval is sought
TOGETHER = 4  # impacts whose errors may depend on each other: one that is late moves its neighbours' misfits too
ENDS = np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)])  # the walls at which a flight begins and ends
Array = NDArray[np.float64]
Walls = NDArray[np.int64]


class Fit(NamedTuple):
    """wall (n,) of each impact, 0 of one that is none of the motion.

    Offset: the time of phase 0, in [0, 1); misfit: mean of |w₀ + w₁|/(|w₀| + |w₁|) over the impacts, 0 for motions of
    the gear, with 1/2 for each false impact; unit: of what speeds are off by.
    """

    wall: Walls
    offset: float
    misfit: float
    unit: float


class Fitting(NamedTuple):
    """Measured impacts, and the gear that they are fitted to.

    unit: of what speeds are off by; dwell: how long contacts last, in forcing periods.
    """

    measured: MeasuredImpacts
    gear: AnyGear
    unit: float
    dwell: float

    @property
    def listened(self) -> Fitting:
        """The impacts from which phase 0 is found."""
        time, speed, wall = self.measured
        some = None if speed is None else speed[:LISTENED]
        return self._replace(measured=MeasuredImpacts(time[:LISTENED], some, None if wall is None else wall[:LISTENED]))


def fits(fitting: Fitting) -> list[Fit]:
    """Return the walls, and phases 0, with which impacts fit a gear, the best first.

    The same times may be those of several motions, such as A and C.

    Returns
    -------
    list[Fit]
        By rising misfit.
    """
    few = fitting.listened
    rough = []
    for unit, phases in ((few.unit, PHASES), (few.unit / FINER, FINER_PHASES)):
        sharper = few._replace(unit=unit)
        lowest = _lowest(_followed(sharper, np.arange(phases) / phases)[0])
        rough += _good([fit(sharper, _refined(sharper, i / phases, 1.0 / phases)) for i in lowest], HOPEFUL)
    sharp = _good([_sharpened(few._replace(unit=each.unit), each) for each in rough], AS_GOOD)
    offsets = [each.offset for each in sharp]
    for each in [found for found in sharp if found.misfit < POOR][:MOST_TWINNED]:
        costs = _costs(few, each.wall, np.arange(TWINS) / TWINS).sum(axis=1)
        for offset in _lowest(costs) / TWINS:
            if all(abs(wrapped(offset - other)) > 2.0 / TWINS for other in offsets):
                offsets.append(float(offset))
                sharp.append(_sharpened(few._replace(unit=each.unit), each._replace(offset=float(offset))))
    found: list[Fit] = []
    for each in _good(sharp, AS_GOOD):
        if all(abs(wrapped(each.offset - other.offset)) > SAME_OFFSET for other in found):
            found.append(fit(fitting._replace(unit=each.unit), each.offset))
    return found


def _lowest(costs: Array) -> NDArray[np.int64]:
    """Return where costs around a circle are least, the FEW lowest of these places."""
    found = np.flatnonzero((costs <= np.roll(costs, 1)) & (costs <= np.roll(costs, -1)))
    return found[np.argsort(costs[found], kind="stable")][:FEW]


def _good(found: list[Fit], margin: tuple[float, float]) -> list[Fit]:
    """Return the fits whose misfit is not above the least by more than a margin, the best first."""
    found = sorted(found, key=lambda each: each.misfit)
    times, more = margin
    return [each for each in found if each.misfit <= times * found[0].misfit + more]


def _sharpened(few: Fitting, found: Fit) -> Fit:
    """Fit again with a smaller unit, which is how much speeds are off: then false impacts are told from true ones."""
    finest = min(few.unit, FINEST * float(speed_unit(few.gear.delta, few.gear.epsilon, few.gear.beta)))
    for _ in range(SHARPENINGS):
        leaves, arrives = _velocities(few, found.wall, np.array([found.offset]))
        scatter = SCATTER * float(np.median(np.abs(leaves + arrives))) if leaves.size else few.unit
        few = few._replace(unit=min(max(few.unit / SHARPER, scatter, finest), few.unit))
        found = fit(few, _refined(few, found.offset))
    return found


def _refined(few: Fitting, offset: float, width: float = 1.0 / PHASES) -> float:
    """Return the offset of least cost within a width of this one."""
    for _ in range(ROUNDS):
        near = offset + width * np.linspace(-1.0, 1.0, MORE + 1)
        offset = float(near[np.argmin(_followed(few, near)[0])])
        width *= 2.0 / MORE
    return offset


def fit(fitting: Fitting, offset: float) -> Fit:
    """Return the walls with which impacts fit a gear best if phase 0 is at this time."""
    wall = _followed(fitting, np.array([offset]))[1]
    leaves, arrives = _velocities(fitting, wall, np.array([offset]))
    off = np.abs(leaves + arrives) / (np.abs(leaves) + np.abs(arrives))
    false = wall.size - np.count_nonzero(wall)
    misfit = (float(off.sum()) + AT_RANDOM * false) / (off.size + false)
    return Fit(wall, offset % 1.0, misfit, fitting.unit)


def interval(fitting: Fitting, found: Fit) -> tuple[float, float]:
    """Return the 95 % interval of the time of phase 0 of a fit, about its offset.

    It holds the offsets around it whose cost is not higher by more than its own standard error, from the scatter of
    the impacts: where the cost is a parabola these are two standard errors of the offset.

    Returns
    -------
    tuple[float, float]
        Both ends of the interval.
    """
    few, offset = fitting.listened._replace(unit=found.unit), found.offset
    steps = np.geomspace(RESOLUTION, FARTHEST, STEPS)
    ends = []
    for side in (-1.0, 1.0):
        costs = _costs(few, found.wall[:LISTENED], offset + side * np.append(0.0, steps))
        higher = costs[1:] - costs[0]
        blocks = np.add.reduceat(higher, np.arange(0, higher.shape[1], TOGETHER), axis=1)
        beyond = blocks.sum(axis=1) > np.sqrt((blocks**2).sum(axis=1))
        ends.append(offset + side * float(steps[np.argmax(beyond)] if beyond.any() else FARTHEST))
    return ends[0], ends[1]


def _costs(fitting: Fitting, wall: Walls, offsets: Array) -> Array:
    """Cost (k, ·) of every impact of a motion between two others, with these walls (n,), at offsets (k,)."""
    leaves, arrives = _velocities(fitting, wall, offsets)
    costs = np.minimum(((leaves + arrives) / fitting.unit) ** 2, WORST)
    if fitting.measured.speed is not None:
        speed = fitting.measured.speed[wall != 0][1:-1]
        costs += np.minimum(((np.abs(arrives) - speed) / fitting.unit) ** 2, WORST)
    return costs


def _velocities(fitting: Fitting, wall: Walls, offsets: Array) -> tuple[Array, Array]:
    """w₀ after and w₁ before every impact on these walls (n,) but the first and the last, at offsets (k,)."""
    gear, time = fitting.gear, fitting.measured.time[wall != 0]
    gaps = gear.beta * np.diff(wall[wall != 0]).astype(np.float64)
    w0, w1 = (np.empty((offsets.size, gaps.size)) for _ in range(2))
    _between(time, gaps, offsets, fitting.dwell, gear.delta, gear.epsilon, w0, w1)
    return w0[:, 1:], w1[:, :-1]


def _followed(fitting: Fitting, offsets: Array) -> tuple[Array, Walls]:
    """Cost of the best walls at each offset (k,), and these walls (n,) at the last."""
    (time, speed, wall), gear = fitting.measured, fitting.gear
    n, cost, point = time.size, np.empty(offsets.size), (gear.delta, gear.epsilon, gear.beta)
    before, last = np.empty((n, MOST_FALSE + 1, len(ENDS)), np.int64), np.empty(2, np.int64)
    known = np.zeros(n, np.int64) if wall is None else wall
    speeds = np.full(n, np.nan) if speed is None else speed
    _best(time, speeds, known, offsets, fitting.dwell, *point, fitting.unit, cost, before, last)
    found, (arrival, choice) = np.zeros(n, np.int64), last.tolist()
    while choice >= 0:
        skipped, ends = divmod(choice, len(ENDS))
        departure = arrival - 1 - skipped
        found[departure], found[arrival] = ENDS[ends]
        arrival, choice = departure, int(before[arrival, skipped, ends])
    return cost, found


@inline
def _ends(t0, t1, dwell):
    """Return the times at which a flight between impacts at t0 and t1 begins and ends, and sine and cosine there."""
    a = complex(min(t0 + dwell, 0.5 * (t0 + t1)))  # a contact that cannot last so long
    b = complex(t1)
    return a, b, analytic_phase(a), analytic_phase(b)


@kernel
def _between(time, gaps, offsets, dwell, delta, epsilon, w0, w1):
    """Fill the velocities (k, n) of flights between impacts at times (n + 1,) over distances (n,), at offsets (k,)."""
    for j in range(offsets.size):
        for i in range(gaps.size):
            t0, t1 = time[i] - offsets[j], time[i + 1] - offsets[j]
            a, b, turn0, turn1 = _ends(t0, t1, dwell)
            found = flight_between(a, b, turn0, turn1, gaps[i], complex(delta), complex(epsilon))
            w0[j, i], w1[j, i] = found[0].real, found[1].real


@inline
def _square(off):
    """Return the cost of an error of so many units."""
    cost = off * off
    return cost if cost < WORST else WORST  # of what is not finite too


@kernel
def _best(time, speed, known, offsets, dwell, delta, epsilon, beta, unit, cost, before, last):
    """Fill the least cost of walls at each offset (k,).

    A flight that arrives at impact i is one of skipped + 1 impacts, and of ENDS. For the last offset `before`
    (n, MOST_FALSE + 1, 4) has the flight before each, −1 where there is none, and `last` where the best one ends, and
    which one that is. speed: NaN if not known; known: walls, 0 if not known.
    """
    n, ways = time.size, before.shape[1] * before.shape[2]
    total, arrives = np.empty(before.shape), np.empty(before.shape)
    for j in range(offsets.size):
        cost[j] = np.inf
        for i in range(1, n):
            for skipped in range(before.shape[1]):
                k = max(i - 1 - skipped, 0)
                a, b, turn0, turn1 = _ends(time[k] - offsets[j], time[i] - offsets[j], dwell)
                for ends in range(before.shape[2]):
                    total[i, skipped, ends] = np.inf
                    begin, end = ENDS[ends]
                    if i <= skipped or begin * known[k] < 0 or end * known[i] < 0:
                        continue
                    gap = beta * (end - begin)
                    found = flight_between(a, b, turn0, turn1, gap, complex(delta), complex(epsilon))
                    w0, w1 = found[0].real, found[1].real
                    alone = FALSE * skipped + WORST * ((begin * w0 >= 0.0) + (end * w1 <= 0.0))
                    if not math.isnan(speed[i]):
                        alone += _square((abs(w1) - speed[i]) / unit)
                    least, which = np.inf, -1
                    if k <= MOST_FALSE:
                        least = FALSE * k  # the motion begins with this flight
                    for way in range(ways):
                        step, other = way // before.shape[2], way % before.shape[2]
                        if k > 0 and ENDS[other, 1] == begin:
                            joined = total[k, step, other] + _square((arrives[k, step, other] + w0) / unit)
                            if joined < least:
                                least, which = joined, way
                    total[i, skipped, ends], arrives[i, skipped, ends] = least + alone, w1
                    before[i, skipped, ends] = which
                    whole = total[i, skipped, ends] + FALSE * (n - 1 - i)
                    if i >= n - 1 - MOST_FALSE and whole < cost[j]:
                        cost[j] = whole
                        last[0], last[1] = i, skipped * before.shape[2] + ends
