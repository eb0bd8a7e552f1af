"""Find the wall of each measured impact, and the time of phase 0, from the times of the impacts.

A flight from wall a at t₀ to wall b at t₁ has velocities w₀ and w₁ in closed form (`rattle.flight.between`). For the
right walls w₀ points away from a and w₁ points towards b, and an elastic impact gives the next flight w₀ = −w₁. The
walls that fit best are found by dynamic programming (Viterbi), for many offsets at once. An offset is the time of phase
0. Up to MOST_FALSE impacts in a row may be false: they do not belong to the motion. The cost of a choice of walls is
the sum of squared errors, in units of the speed tolerance, and of penalties. The errors are w₀ + w₁ at each impact, and
the difference between |w₁| and the measured speed; penalties are for false impacts and for velocities of wrong sign.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.comparison.measured import MeasuredImpacts
from rattle.flight.between import flight_between
from rattle.flight.forcing import sine_cosine_of_complex_time
from rattle.flight.law import speed_unit, wrap_phase_difference
from rattle.models import AnyGear
from rattle.numerics.compile import inline, kernel

#: Number of offsets that are tried in the first search. Each search keeps at most MOST_REFINED offsets, of least cost.
PHASES = 96
MOST_REFINED = 8
#: The second search tries FINER_PHASES offsets, with the speed tolerance of the first search divided by FINER.
FINER, FINER_PHASES = 16.0, 384
#: SCAN_OFFSETS offsets are tried with the walls of each of the MOST_SCANNED best fits, because the same walls may fit
#: at several offsets: impacts of A and C, for example, meet the walls in the same order.
SCAN_OFFSETS, MOST_SCANNED = 1024, 3
#: Impacts with a larger misfit than this are probably not impacts of this gear. The walls of such a poor fit are not
#: tried with SCAN_OFFSETS offsets.
POOR = 0.25
#: Largest difference, in forcing periods, between two offsets that count as the same.
SAME_OFFSET = 1e-4
#: Number of intervals in each refinement of an offset, and number of refinements.
REFINEMENT_INTERVALS, REFINEMENTS = 16, 4
#: Accuracy of an offset in forcing periods.
RESOLUTION = (2.0 / REFINEMENT_INTERVALS) ** REFINEMENTS / PHASES
#: Number of impacts, counted from the first, that the search for offsets uses.
FIRST_IMPACTS = 256
#: (factor, summand): fits are kept if their misfit is at most factor · least misfit + summand. ROUGH_MARGIN is used
#: before the speed tolerance is reduced, FIT_MARGIN afterwards.
ROUGH_MARGIN = 3.0, 0.1
FIT_MARGIN = 3.0, 0.02
#: The speed tolerance is reduced SHARPENINGS times, each time at most by the factor SHARPER, and not below FINEST times
#: the model's speed scale (`speed_unit`).
SHARPENINGS, SHARPER, FINEST = 5, 4.0, 1e-3
#: The reduced speed tolerance is at least SCATTER times the median of |w₀ + w₁|, the error of the speed at an impact.
SCATTER = 4.0
#: Largest cost of an error of a speed. It is also the cost of each end of a flight at which the velocity has the wrong
#: direction.
LARGEST_COST = 4.0
#: Cost of a false impact, and largest number of false impacts in a row.
FALSE_COST, MOST_FALSE = 6.0, 2
#: Value of a false impact in the mean `WallFit.misfit`, in which a true impact has a value from 0 to 1.
FALSE_MISFIT = 0.5
#: The ends of an offset's interval are searched in STEPS steps, at most FARTHEST forcing periods from the offset.
FARTHEST, STEPS = 0.25, 128
#: A standard error is computed from sums of costs over this number of successive impacts, because one wrong time
#: changes the costs of neighbouring impacts.
CORRELATED_IMPACTS = 4
#: Pairs of walls, ±1, at which a flight may begin and end.
ENDS = np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)])
Array = NDArray[np.float64]
Walls = NDArray[np.int64]


class WallFit(NamedTuple):
    """The walls and the offset with which impacts fit a gear.

    Attributes
    ----------
    wall
        The wall of each impact (n,); 0 for a false impact.
    offset
        The time of phase 0, in [0, 1).
    misfit
        The mean over the impacts of |w₀ + w₁|/(|w₀| + |w₁|), where w₁ and w₀ are the velocities before and after an
        impact. A false impact has the value 1/2; the first and the last true impact are left out. The misfit is 0 for
        motions of the gear.
    speed_tolerance
        The speed tolerance, by which errors of speeds are divided.
    """

    wall: Walls
    offset: float
    misfit: float
    speed_tolerance: float


class FitProblem(NamedTuple):
    """Measured impacts, and the gear to which they are fitted.

    speed_tolerance: the speed tolerance, by which errors of speeds are divided.
    contact_duration: the duration of a contact in forcing periods; 0 for a gear with rigid teeth.
    """

    measured: MeasuredImpacts
    gear: AnyGear
    speed_tolerance: float
    contact_duration: float

    @property
    def limited_to_first_impacts(self) -> FitProblem:
        """The same problem with the first FIRST_IMPACTS impacts only; searches for offsets use only these."""
        time, speed, wall = self.measured
        some = None if speed is None else speed[:FIRST_IMPACTS]
        return self._replace(
            measured=MeasuredImpacts(time[:FIRST_IMPACTS], some, None if wall is None else wall[:FIRST_IMPACTS])
        )


def find_fits(fitting: FitProblem) -> list[WallFit]:
    """Return the fits of impacts to a gear. There may be several: impacts of A and C, for example, are equally spaced.

    Returns
    -------
    list[WallFit]
        The fits to all impacts, ordered by rising misfit of their first FIRST_IMPACTS impacts.
    """
    few = fitting.limited_to_first_impacts
    rough = []
    for unit, phases in ((few.speed_tolerance, PHASES), (few.speed_tolerance / FINER, FINER_PHASES)):
        sharper = few._replace(speed_tolerance=unit)
        lowest = _indices_of_lowest_minima(_find_best_walls(sharper, np.arange(phases) / phases)[0])
        rough += _fits_within_margin(
            [fit_at_offset(sharper, _refine_offset(sharper, i / phases, 1.0 / phases)) for i in lowest], ROUGH_MARGIN
        )
    sharp = _fits_within_margin(
        [_fit_with_smaller_tolerance(few._replace(speed_tolerance=each.speed_tolerance), each) for each in rough],
        FIT_MARGIN,
    )
    offsets = [each.offset for each in sharp]
    for each in [found for found in sharp if found.misfit < POOR][:MOST_SCANNED]:
        costs = _impact_costs(few, each.wall, np.arange(SCAN_OFFSETS) / SCAN_OFFSETS).sum(axis=1)
        for offset in _indices_of_lowest_minima(costs) / SCAN_OFFSETS:
            if all(abs(wrap_phase_difference(offset - other)) > 2.0 / SCAN_OFFSETS for other in offsets):
                offsets.append(float(offset))
                sharp.append(
                    _fit_with_smaller_tolerance(
                        few._replace(speed_tolerance=each.speed_tolerance), each._replace(offset=float(offset))
                    )
                )
    found: list[WallFit] = []
    for each in _fits_within_margin(sharp, FIT_MARGIN):
        if all(abs(wrap_phase_difference(each.offset - other.offset)) > SAME_OFFSET for other in found):
            found.append(fit_at_offset(fitting._replace(speed_tolerance=each.speed_tolerance), each.offset))
    return found


def _indices_of_lowest_minima(costs: Array) -> NDArray[np.int64]:
    """Return the indices of at most MOST_REFINED local minima of costs around a circle, the lowest minimum first."""
    found = np.flatnonzero((costs <= np.roll(costs, 1)) & (costs <= np.roll(costs, -1)))
    return found[np.argsort(costs[found], kind="stable")][:MOST_REFINED]


def _fits_within_margin(fits: list[WallFit], margin: tuple[float, float]) -> list[WallFit]:
    """Return the fits whose misfit is at most factor · (least misfit of all fits) + summand.

    margin: (factor, summand).

    Returns
    -------
    list[WallFit]
        The fits by rising misfit.
    """
    fits = sorted(fits, key=lambda each: each.misfit)
    times, more = margin
    return [each for each in fits if each.misfit <= times * fits[0].misfit + more]


def _fit_with_smaller_tolerance(fitting: FitProblem, fit: WallFit) -> WallFit:
    """Repeat a fit with smaller and smaller speed tolerances, down to the scatter of the speeds.

    With a small tolerance it costs much to take a false impact for a true one.

    fitting: the first measured impacts, and the tolerance from which the reduction starts. fit: the fit with this
    tolerance; each repetition starts from the fit before.

    Returns
    -------
    WallFit
        The fit with the smallest tolerance.
    """
    finest = min(
        fitting.speed_tolerance, FINEST * float(speed_unit(fitting.gear.delta, fitting.gear.epsilon, fitting.gear.beta))
    )
    for _ in range(SHARPENINGS):
        leaves, arrives = _velocities_at_impacts(fitting, fit.wall, np.array([fit.offset]))
        scatter = SCATTER * float(np.median(np.abs(leaves + arrives))) if leaves.size else fitting.speed_tolerance
        fitting = fitting._replace(
            speed_tolerance=min(max(fitting.speed_tolerance / SHARPER, scatter, finest), fitting.speed_tolerance)
        )
        fit = fit_at_offset(fitting, _refine_offset(fitting, fit.offset))
    return fit


def _refine_offset(fitting: FitProblem, offset: float, width: float = 1.0 / PHASES) -> float:
    """Return the offset of least cost within `width` forcing periods of the given offset, by repeated grid search.

    The cost of an offset is that of its best walls.

    Returns
    -------
    float
        The offset, accurate to RESOLUTION if `width` is 1/PHASES.
    """
    for _ in range(REFINEMENTS):
        near = offset + width * np.linspace(-1.0, 1.0, REFINEMENT_INTERVALS + 1)
        offset = float(near[np.argmin(_find_best_walls(fitting, near)[0])])
        width *= 2.0 / REFINEMENT_INTERVALS
    return offset


def fit_at_offset(fitting: FitProblem, offset: float) -> WallFit:
    """Return the fit of impacts to a gear with phase 0 at the time `offset` and the walls of least cost."""
    wall = _find_best_walls(fitting, np.array([offset]))[1]
    leaves, arrives = _velocities_at_impacts(fitting, wall, np.array([offset]))
    off = np.abs(leaves + arrives) / (np.abs(leaves) + np.abs(arrives))
    false = wall.size - np.count_nonzero(wall)
    misfit = (float(off.sum()) + FALSE_MISFIT * false) / (off.size + false)
    return WallFit(wall, offset % 1.0, misfit, fitting.speed_tolerance)


def confidence_interval_of_offset(fitting: FitProblem, fit: WallFit) -> tuple[float, float]:
    """Return the 95 % interval of the offset of a fit.

    The interval ends where the cost exceeds the cost of the fit by more than the standard error of this excess, but at
    most FARTHEST from the offset. The standard error follows from the scatter of the excess over the impacts. If the
    cost is a parabola of the offset, the distance from the offset to each end is two standard errors of the offset.

    Returns
    -------
    tuple[float, float]
        Both ends of the interval.
    """
    few, offset = fitting.limited_to_first_impacts._replace(speed_tolerance=fit.speed_tolerance), fit.offset
    steps = np.geomspace(RESOLUTION, FARTHEST, STEPS)
    ends = []
    for side in (-1.0, 1.0):
        costs = _impact_costs(few, fit.wall[:FIRST_IMPACTS], offset + side * np.append(0.0, steps))
        higher = costs[1:] - costs[0]
        blocks = np.add.reduceat(higher, np.arange(0, higher.shape[1], CORRELATED_IMPACTS), axis=1)
        beyond = blocks.sum(axis=1) > np.sqrt((blocks**2).sum(axis=1))
        ends.append(offset + side * float(steps[np.argmax(beyond)] if beyond.any() else FARTHEST))
    return ends[0], ends[1]


def _impact_costs(fitting: FitProblem, wall: Walls, offsets: Array) -> Array:
    """Return the cost of each impact except the first and the last, if phase 0 is at the times `offsets` (k,).

    wall: the wall of each impact, 0 for a false impact.

    Returns
    -------
    Array
        Costs (k, n − 2), where n is the number of impacts that are not false.
    """
    leaves, arrives = _velocities_at_impacts(fitting, wall, offsets)
    costs = np.minimum(((leaves + arrives) / fitting.speed_tolerance) ** 2, LARGEST_COST)
    if fitting.measured.speed is not None:
        speed = fitting.measured.speed[wall != 0][1:-1]
        costs += np.minimum(((np.abs(arrives) - speed) / fitting.speed_tolerance) ** 2, LARGEST_COST)
    return costs


def _velocities_at_impacts(fitting: FitProblem, wall: Walls, offsets: Array) -> tuple[Array, Array]:
    """Return the velocities after and before each impact except the first and the last.

    offsets (k,): times of phase 0. wall: the wall of each impact, 0 for a false impact.

    Returns
    -------
    tuple[Array, Array]
        Velocities (k, n − 2) after and before the impacts, where n is the number of impacts that are not false.
    """
    gear, time = fitting.gear, fitting.measured.time[wall != 0]
    gaps = gear.beta * np.diff(wall[wall != 0]).astype(np.float64)
    w0, w1 = (np.empty((offsets.size, gaps.size)) for _ in range(2))
    _write_flight_velocities(time, gaps, offsets, fitting.contact_duration, gear.delta, gear.epsilon, w0, w1)
    return w0[:, 1:], w1[:, :-1]


def _find_best_walls(fitting: FitProblem, offsets: Array) -> tuple[Array, Walls]:
    """Return the cost of the best walls at each offset (k,), and the best walls (n,) at the last offset."""
    (time, speed, wall), gear = fitting.measured, fitting.gear
    n, cost, point = time.size, np.empty(offsets.size), (gear.delta, gear.epsilon, gear.beta)
    before, last = np.empty((n, MOST_FALSE + 1, len(ENDS)), np.int64), np.empty(2, np.int64)
    known = np.zeros(n, np.int64) if wall is None else wall
    speeds = np.full(n, np.nan) if speed is None else speed
    _write_least_costs(
        time, speeds, known, offsets, fitting.contact_duration, *point, fitting.speed_tolerance, cost, before, last
    )
    found, (arrival, choice) = np.zeros(n, np.int64), last.tolist()
    while choice >= 0:
        skipped, ends = divmod(choice, len(ENDS))
        departure = arrival - 1 - skipped
        found[departure], found[arrival] = ENDS[ends]
        arrival, choice = departure, int(before[arrival, skipped, ends])
    return cost, found


@inline
def _times_and_phases_of_flight(t0, t1, contact_duration):
    """Return the times at which the flight between impacts at t0 and t1 begins and ends, with the phases there.

    The flight begins where the contact after the first impact ends: at t0 + `contact_duration`, but at most half way to
    t1. It ends at t1.

    Returns
    -------
    tuple
        Both times as complex numbers; then (sine, cosine) of the phase at the first time, and at the second time.
    """
    a = complex(min(t0 + contact_duration, 0.5 * (t0 + t1)))  # the contact must end before t1
    b = complex(t1)
    return a, b, sine_cosine_of_complex_time(a), sine_cosine_of_complex_time(b)


@kernel
def _write_flight_velocities(time, gaps, offsets, contact_duration, delta, epsilon, w0, w1):
    """Write to w0 and w1 (k, n) the velocities at the beginning and at the end of each of n flights.

    time (n + 1,): the times of the impacts. gaps (n,): the distances that the flights cover. offsets (k,): the times of
    phase 0. contact_duration: the duration of a contact.
    """
    for j in range(offsets.size):
        for i in range(gaps.size):
            t0, t1 = time[i] - offsets[j], time[i + 1] - offsets[j]
            a, b, turn0, turn1 = _times_and_phases_of_flight(t0, t1, contact_duration)
            found = flight_between(a, b, turn0, turn1, gaps[i], complex(delta), complex(epsilon))
            w0[j, i], w1[j, i] = found[0].real, found[1].real


@inline
def _capped_square(error):
    """Return the smaller of error² and LARGEST_COST. error: the error of a speed divided by the speed tolerance."""
    cost = error * error
    return cost if cost < LARGEST_COST else LARGEST_COST  # an error that is not finite costs LARGEST_COST too


@kernel
def _write_least_costs(time, speed, known, offsets, contact_duration, delta, epsilon, beta, unit, cost, before, last):
    """Write the least cost of walls at each offset (k,), by dynamic programming.

    For the flight that arrives at impact i there are (MOST_FALSE + 1) × 4 choices: the number of false impacts that the
    flight skips, and the index of its two walls in ENDS.

    cost (k,): the least costs. For the last offset two more results are written:
    before (n, MOST_FALSE + 1, 4): for each choice at each impact the best choice of the preceding flight, −1 if none.
    last (2,): the impact at which the last flight of the best walls ends, and the choice of this flight.
    speed (n,): measured speeds, NaN where not known. known (n,): measured walls, 0 where not known.
    """
    n, ways = time.size, before.shape[1] * before.shape[2]
    total, arrives = np.empty(before.shape), np.empty(before.shape)
    for j in range(offsets.size):
        cost[j] = np.inf
        for i in range(1, n):
            for skipped in range(before.shape[1]):
                k = max(i - 1 - skipped, 0)
                a, b, turn0, turn1 = _times_and_phases_of_flight(
                    time[k] - offsets[j], time[i] - offsets[j], contact_duration
                )
                for ends in range(before.shape[2]):
                    total[i, skipped, ends] = np.inf
                    begin, end = ENDS[ends]
                    if i <= skipped or begin * known[k] < 0 or end * known[i] < 0:
                        continue
                    gap = beta * (end - begin)
                    found = flight_between(a, b, turn0, turn1, gap, complex(delta), complex(epsilon))
                    w0, w1 = found[0].real, found[1].real
                    alone = FALSE_COST * skipped + LARGEST_COST * ((begin * w0 >= 0.0) + (end * w1 <= 0.0))
                    if not math.isnan(speed[i]):
                        alone += _capped_square((abs(w1) - speed[i]) / unit)
                    least, which = np.inf, -1
                    if k <= MOST_FALSE:
                        # without a preceding flight, the k impacts before this flight are false
                        least = FALSE_COST * k
                    for way in range(ways):
                        step, other = way // before.shape[2], way % before.shape[2]
                        if k > 0 and ENDS[other, 1] == begin:
                            joined = total[k, step, other] + _capped_square((arrives[k, step, other] + w0) / unit)
                            if joined < least:
                                least, which = joined, way
                    total[i, skipped, ends], arrives[i, skipped, ends] = least + alone, w1
                    before[i, skipped, ends] = which
                    whole = total[i, skipped, ends] + FALSE_COST * (n - 1 - i)
                    if i >= n - 1 - MOST_FALSE and whole < cost[j]:
                        cost[j] = whole
                        last[0], last[1] = i, skipped * before.shape[2] + ends
