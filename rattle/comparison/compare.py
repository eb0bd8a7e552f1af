"""Measured impacts beside the attractors of a gear."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.speeds import NATURAL
from rattle.attractors.table import Attractor
from rattle.comparison.measured import MeasuredImpacts, period_of
from rattle.comparison.walls import AS_GOOD, Fit, Fitting, fit, fits, interval
from rattle.errors import require_finite, require_integer, require_number
from rattle.flight.law import speed_unit
from rattle.intensity.intensity import Intensity
from rattle.models import AnyGear, model_at

TOLERANCE = 0.05
WATCHED = 1000.0  # forcing periods of a chaotic attractor
MOST_BINS = 10_000
FARTHEST = 0.5  # revolutions, for which an impact counts that only one of two motions has
GRID = 720  # phases at which distributions are compared
Array = NDArray[np.float64]


class Near(NamedTuple):
    """An attractor of the gear beside what was measured.

    distance: by how many revolutions its impacts would have to be moved in phase, wall by wall, summed over those of
    one forcing period; an impact too many or too few counts 1/2. histogram (2, bins): see `Comparison`.
    """

    attractor: Attractor
    intensity: Intensity
    histogram: Array
    distance: float


@dataclass(frozen=True)
class Comparison:
    """Measured impacts beside the attractors of a gear, the nearest first.

    impacts per forcing period, without false ones; energy: Σv²/2 per forcing period, None without speeds. label:
    (m, n₊, n₋) if they repeat themselves, else None. wall (n,): as measured, or as fits best, 0 of a false impact, one
    that is none of the motion. offset: the time of phase 0 in forcing periods, given or such that the impacts fit best;
    offset_interval: its 95 % interval, of no width where it was given; other_offsets: phases that fit about as well,
    with their intervals. is_sure (n,): False of impacts that have another wall at an end of the interval, or at one of
    the other offsets, and of false ones. misfit: how much of their speeds, which follow from the times, impacts
    change, 0 for motions of this gear, 1 at most; near 1/2 for times at random: walls, label and offset mean nothing
    then. histogram (2, bins): impacts per forcing period on Σ⁺ and Σ⁻ in equal parts of the phase.
    """

    impacts: float
    energy: float | None
    label: tuple[int, int, int] | None
    wall: NDArray[np.int64]
    offset: float
    offset_interval: tuple[float, float]
    other_offsets: tuple[tuple[float, tuple[float, float]], ...]
    is_sure: NDArray[np.bool_]
    misfit: float
    histogram: Array
    near: tuple[Near, ...]


def compare(
    measured: MeasuredImpacts,
    gear: AnyGear,
    offset: float | None = None,
    *,
    bins: int = 24,
    tolerance: float = TOLERANCE,
    count: int = 64,
    seed: int = 0,
) -> Comparison:
    """Compare measured impacts with the attractors that `count` samples of this gear find.

    Raises ParameterError, and RattleError where an attractor cannot be followed.

    Parameters
    ----------
    offset : float | None
        The time of phase 0, at which the transmission error closes the gap at Σ⁺ most, in forcing periods; None: as
        fits best.
    tolerance : float
        Of the times between repeated impacts, over the mean time between impacts.

    Returns
    -------
    Comparison
        The attractors by rising distance.
    """
    bins = require_integer("bins", bins, 1, MOST_BINS)
    tolerance = require_number("tolerance", tolerance, positive=True)
    offset = None if offset is None else require_finite("offset", offset)
    point = gear.delta, gear.epsilon, gear.beta
    fitting = Fitting(measured, gear, float(speed_unit(*point)), model_at(gear).dwell)
    attractors = gear.attractors(count, NATURAL, seed)
    known = [_known(each, gear, bins) for each in attractors if each.kind != "undecided"]
    if offset is not None:
        given = fit(fitting, offset)
        return _compared(measured, given, known, bins, tolerance)
    found = [(_compared(measured, each, known, bins, tolerance), each) for each in fits(fitting)]
    best, chosen = min(found, key=lambda each: _badness(each[0]))
    near = [each for one, each in found if one is not best and _badness(one) <= _badness(best) + AS_GOOD[1]]
    return _with_errors(fitting, best, [chosen, *near])


def _badness(found: Comparison) -> float:
    """Return how badly a choice of the phase fits: the gear, and the nearest of its attractors."""
    return found.misfit + (found.near[0].distance if found.near else 0.0)


def _with_errors(fitting: Fitting, found: Comparison, near: list[Fit]) -> Comparison:
    """Return a comparison with the intervals of its own fit, the first, and of others about as good, and sure walls."""
    own, *others = (interval(fitting, each) for each in near)
    sharp = fitting._replace(unit=near[0].unit)
    walls = [fit(sharp, end).wall for end in own] + [each.wall for each in near]
    return replace(
        found,
        offset_interval=own,
        other_offsets=tuple((each.offset, ends) for each, ends in zip(near[1:], others, strict=True)),
        is_sure=(found.wall != 0) & np.all([found.wall == wall for wall in walls], axis=0),
    )


class _Known(NamedTuple):
    """Sorted phases of an attractor's impacts on either wall, each of which stands for this rate."""

    attractor: Attractor
    intensity: Intensity
    phases: list[Array]
    rate: float
    histogram: Array


def _known(attractor: Attractor, gear: AnyGear, bins: int) -> _Known:
    periods = None if attractor.kind == "periodic" else WATCHED
    impacts, rate = gear.impacts(attractor, periods), 1.0 / (attractor.m if periods is None else periods)
    phases = _phases(impacts.time, impacts.wall)
    return _Known(attractor, gear.intensity(attractor), phases, rate, _histogram(phases, rate, bins))


def _compared(measured: MeasuredImpacts, fit: Fit, known: list[_Known], bins: int, tolerance: float) -> Comparison:
    true = fit.wall != 0
    time, wall, number = measured.time[true], fit.wall[true], int(np.count_nonzero(true))
    label = period_of(time, wall, tolerance)
    impacts = (number - 1) / float(time[-1] - time[0]) if label is None else (label[1] + label[2]) / label[0]
    here, rate = _phases(time - fit.offset, wall), impacts / number
    near = [
        Near(
            each.attractor,
            each.intensity,
            each.histogram,
            sum(_distance(a, rate, b, each.rate) for a, b in zip(here, each.phases, strict=True)),
        )
        for each in known
    ]
    return Comparison(
        impacts=impacts,
        energy=None if measured.speed is None else float(0.5 * np.mean(measured.speed[true] ** 2)) * impacts,
        label=label,
        wall=fit.wall,
        offset=fit.offset,
        offset_interval=(fit.offset, fit.offset),
        other_offsets=(),
        is_sure=true,
        misfit=fit.misfit,
        histogram=_histogram(here, rate, bins),
        near=tuple(sorted(near, key=lambda each: each.distance)),
    )


def _phases(time: ArrayLike, wall: NDArray[np.int64]) -> list[Array]:
    """Sorted phases of the impacts on Σ⁺, then on Σ⁻."""
    phase = np.asarray(time, np.float64) % 1.0
    return [np.sort(phase[wall == side]) for side in (1, -1)]


def _histogram(phases: list[Array], rate: float, bins: int) -> Array:
    return np.array([rate * np.histogram(each, bins, (0.0, 1.0))[0] for each in phases])


def _distance(a: Array, rate_a: float, b: Array, rate_b: float) -> float:
    """Return the distance of two distributions of phases, which stand for rate_a and rate_b impacts per period.

    Around a circle the earth mover's distance is the mean of |F − G − its median| of the distribution functions.

    Returns
    -------
    float
        Dimensionless; impacts that only one of the two has count FARTHEST each.
    """
    here, there = rate_a * a.size, rate_b * b.size
    unmatched = FARTHEST * abs(here - there)
    if not a.size or not b.size:
        return unmatched
    at = (np.arange(GRID) + 0.5) / GRID
    apart = np.searchsorted(a, at) / a.size - np.searchsorted(b, at) / b.size
    return unmatched + min(here, there) * float(np.mean(np.abs(apart - np.median(apart))))
