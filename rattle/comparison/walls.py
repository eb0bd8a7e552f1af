"""Which wall each of a series of impacts is on, and where phase 0 lies, from their times alone.

A flight from wall a at t₀ to wall b at t₁ has its velocities w₀, w₁ in closed form (`rattle.flight.between`). Those of
the walls that were met point into the gap and back out of it, and an elastic impact turns w₁ of one flight into −w₀ of
the next. The walls that fit best are found by dynamic programming (Viterbi), for many phases at once.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.comparison.measured import Measured
from rattle.flight.between import flight_between, turn
from rattle.flight.law import TWO_PI
from rattle.models import AnyGear
from rattle.numerics.compile import kernel

PHASES = 96  # that are tried; then about each of the best, MORE, and so on
MORE, ROUNDS = 16, 4
LISTENED = 256  # impacts from which phase 0 is found
AS_GOOD = 3.0, 0.02  # a misfit of so many times the least and so much more is as good
WORST = 4.0  # cost at most of an impact, and of a flight that goes the wrong way
ENDS = np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)])  # the walls at which a flight begins and ends
Array = NDArray[np.float64]


class Fit(NamedTuple):
    """wall (n,) of each impact; offset: the time of phase 0, in [0, 1); misfit: mean of |w₀ + w₁|/(|w₀| + |w₁|) over
    the impacts, 0 for motions of the gear.
    """

    wall: NDArray[np.int64]
    offset: float
    misfit: float


def fits(measured: Measured, gear: AnyGear, unit: float, dwell: float) -> list[Fit]:
    """The walls, and phases 0, with which impacts fit a gear best, the best first: the same times may be those of
    several motions, such as A and C.

    unit: of speeds; dwell: how long contacts last, in forcing periods.
    """
    time, speed, wall = measured
    some = None if speed is None else speed[:LISTENED]
    few = Measured(time[:LISTENED], some, None if wall is None else wall[:LISTENED])

    def cost(offsets: Array) -> Array:
        return _followed(few, gear, unit, dwell, offsets)[0]

    tried = np.arange(PHASES) / PHASES
    costs = cost(tried)
    lowest = tried[(costs <= np.roll(costs, 1)) & (costs <= np.roll(costs, -1))]
    found = [fit(few, gear, unit, dwell, _refined(cost, float(offset))) for offset in lowest]
    found.sort(key=lambda each: each.misfit)
    times, more = AS_GOOD
    good = [each.offset for each in found if each.misfit <= times * found[0].misfit + more]
    return [fit(measured, gear, unit, dwell, offset) for offset in good]


def _refined(cost: Callable[[Array], Array], offset: float) -> float:
    """The offset of least cost near this one of PHASES."""
    width = 1.0 / PHASES
    for _ in range(ROUNDS):
        near = offset + width * np.linspace(-1.0, 1.0, MORE + 1)
        offset = float(near[np.argmin(cost(near))])
        width *= 2.0 / MORE
    return offset


def fit(measured: Measured, gear: AnyGear, unit: float, dwell: float, offset: float) -> Fit:
    """The walls with which impacts fit a gear best if phase 0 is at this time."""
    _cost, wall, leaves, arrives = _followed(measured, gear, unit, dwell, np.array([offset]))
    misfit = np.abs(leaves + arrives) / (np.abs(leaves) + np.abs(arrives))
    return Fit(wall, offset % 1.0, float(misfit.mean()))


def _followed(
    measured: Measured, gear: AnyGear, unit: float, dwell: float, offsets: Array
) -> tuple[Array, NDArray[np.int64], Array, Array]:
    """Cost of the best walls at each offset (k,); of the first offset also these (n,), and w₀ after and w₁ before every
    impact but the first and the last (n − 2,).
    """
    w0, w1 = _velocities(measured, gear, dwell, offsets)
    cost, before = _best(measured, w0, w1, unit)
    last = np.argmin(cost[0])
    flights = [int(last)]
    for choice in before[::-1]:
        flights.append(int(choice[flights[-1]]))
    flights.reverse()
    number = np.arange(len(flights))
    wall = np.append(ENDS[flights, 0], ENDS[last, 1])
    leaves, arrives = w0[0, flights, number], w1[0, flights, number]
    return cost.min(axis=1), wall, leaves[1:], arrives[:-1]


def _velocities(measured: Measured, gear: AnyGear, dwell: float, offsets: Array) -> tuple[Array, Array]:
    """w₀ and w₁ (k, 4, n − 1) of every flight between every two walls, at offsets (k,)."""
    time = measured.time - offsets[:, None, None]
    t1 = time[..., 1:]
    t0 = np.minimum(time[..., :-1] + dwell, 0.5 * (time[..., :-1] + t1))  # a contact that cannot last so long
    gaps = gear.beta * (ENDS[:, 1] - ENDS[:, 0]).astype(np.float64)
    t0, t1 = (np.ascontiguousarray(t[:, 0]) for t in (t0, t1))
    w0, w1 = (np.empty((len(t0), gaps.size, t0.shape[1])) for _ in range(2))
    _between(t0, t1, gaps, gear.delta, gear.epsilon, w0, w1)
    return w0, w1


@kernel
def _between(t0, t1, gaps, delta, epsilon, w0, w1):
    """Fill the velocities (k, d, n) of flights between times (k, n) over each distance (d,)."""
    for j in range(t0.shape[0]):
        for i in range(t0.shape[1]):
            a, b = complex(t0[j, i]), complex(t1[j, i])
            turn0, turn1 = turn(TWO_PI * a), turn(TWO_PI * b)
            for k in range(gaps.size):
                found = flight_between(a, b, turn0, turn1, gaps[k], complex(delta), complex(epsilon))
                w0[j, k, i], w1[j, k, i] = found[0].real, found[1].real


def _best(measured: Measured, w0: Array, w1: Array, unit: float) -> tuple[Array, NDArray[np.int64]]:
    """Least cost (k, 4) of walls whose last flight is each of ENDS, and of the first offset the flight before each one
    (n − 2, 4).
    """
    begin, end = ENDS[:, 0, None], ENDS[:, 1, None]
    alone = WORST * ((begin * w0 >= 0.0).astype(np.float64) + (end * w1 <= 0.0))
    if measured.speed is not None:
        alone = alone + np.minimum(((np.abs(w1) - measured.speed[1:]) / unit) ** 2, WORST)
    if measured.wall is not None:
        alone = alone + np.where((begin == measured.wall[:-1]) & (end == measured.wall[1:]), 0.0, np.inf)
    cost, before = alone[..., 0], np.empty((w0.shape[-1] - 1, 4), np.int64)
    apart = np.where(ENDS[:, 1, None] == ENDS[None, :, 0], 0.0, np.inf)  # flights that do not follow on each other
    for i in range(1, w0.shape[-1]):
        off = (w1[:, :, None, i - 1] + w0[:, None, :, i]) / unit
        joined = cost[:, :, None] + apart + np.minimum(off * off, WORST)
        before[i - 1] = np.argmin(joined[0], axis=0)
        cost = joined.min(axis=1) + alone[..., i]
    return cost, before
