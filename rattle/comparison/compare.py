"""Compare measured impacts with the attractors of a gear."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.speeds import NATURAL
from rattle.attractors.table import Attractor
from rattle.comparison.measured import MeasuredImpacts, label_of_repeating_impacts
from rattle.comparison.walls import (
    FIT_MARGIN,
    FitProblem,
    WallFit,
    confidence_interval_of_offset,
    find_fits,
    fit_at_offset,
)
from rattle.errors import require_finite, require_integer, require_number
from rattle.flight.law import speed_unit
from rattle.intensity.intensity import Intensity
from rattle.models import AnyGear, model_of_gear

#: Default of the argument `tolerance` of `compare`.
TOLERANCE = 0.05
#: Number of forcing periods for which an attractor that is not periodic is followed.
CHAOS_PERIODS = 1000.0
MOST_BINS = 10_000
#: Distance, in forcing periods, that is added for each impact that only one of two motions has.
FARTHEST = 0.5
#: Number of phases at which the distribution functions of two sets of impacts are compared.
GRID = 720
Array = NDArray[np.float64]


class ComparedAttractor(NamedTuple):
    """An attractor of the gear, compared with the measured impacts.

    Attributes
    ----------
    attractor, intensity
        The attractor, and its intensity.
    histogram
        Impacts of the attractor (2, bins), as in `Comparison`.
    distance
        The sum of the phase shifts, in forcing periods, that move the attractor's impacts of one forcing period to the
        measured impacts, wall by wall. An impact too many or too few adds 1/2.
    """

    attractor: Attractor
    intensity: Intensity
    histogram: Array
    distance: float


@dataclass(frozen=True)
class Comparison:
    """Measured impacts, compared with the attractors of a gear.

    A false impact is a measured impact that does not belong to the motion.

    Attributes
    ----------
    impacts : float
        Number of impacts per forcing period, without false impacts.
    energy : float or None
        Σv²/2 per forcing period; None without measured speeds.
    label : tuple of int or None
        (m, n₊, n₋) if the impacts repeat, else None.
    wall : ndarray of int, (n,)
        The wall of each impact, as measured or as fits best; 0 for a false impact.
    offset : float
        The time of phase 0 in forcing periods, as given or as fits best.
    offset_interval : tuple of float
        The 95 % interval of `offset`; its width is 0 if the offset was given.
    other_offsets : tuple
        A pair (offset, its 95 % interval) for each other time of phase 0 that fits about as well.
    is_sure : ndarray of bool, (n,)
        True for an impact that has the same wall at both ends of `offset_interval` and at all `other_offsets`; False
        for a false impact.
    misfit : float
        Mean relative change of speed at an impact, from 0 to 1, with speeds computed from the times. It is 0 for
        motions of this gear and near 1/2 for random times; near 1/2, walls, label and offset mean nothing.
    histogram : ndarray, (2, bins)
        Impacts per forcing period on Σ⁺ and Σ⁻ in equal intervals of the phase.
    near : tuple of ComparedAttractor
        The attractors of the gear, the nearest first.
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
    near: tuple[ComparedAttractor, ...]


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
    """Compare measured impacts with the attractors of a gear.

    Parameters
    ----------
    measured : MeasuredImpacts
        The measured impacts, from `measured` or `read_csv`.
    gear : AnyGear
        The gear with whose attractors the impacts are compared.
    offset : float | None
        The time of phase 0 in forcing periods; at phase 0 the transmission error closes the gap at Σ⁺ most. None: the
        time that fits best.
    bins : int
        Number of intervals of the phase in histograms.
    tolerance : float
        Impacts count as periodic if the root mean square deviation of the durations of the repetitions from m forcing
        periods is at most `tolerance` times the mean time between impacts.
    count, seed : int
        Number and seed of the initial conditions that find the attractors, as in `Gear.attractors`.

    Returns
    -------
    Comparison
        The walls and the phase of the impacts, and the attractors by rising distance.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    RattleError
        If an attractor cannot be followed.
    """
    bins = require_integer("bins", bins, 1, MOST_BINS)
    tolerance = require_number("tolerance", tolerance, positive=True)
    offset = None if offset is None else require_finite("offset", offset)
    point = gear.delta, gear.epsilon, gear.beta
    fitting = FitProblem(measured, gear, float(speed_unit(*point)), model_of_gear(gear).contact_duration)
    attractors = gear.attractors(count, NATURAL, seed)
    followed = [_follow_attractor(each, gear, bins) for each in attractors if each.kind != "undecided"]
    if offset is not None:
        given = fit_at_offset(fitting, offset)
        return _compare_fit_with_attractors(measured, given, followed, bins, tolerance)
    found = [
        (_compare_fit_with_attractors(measured, each, followed, bins, tolerance), each) for each in find_fits(fitting)
    ]
    best, chosen = min(found, key=lambda each: _misfit_plus_distance(each[0]))
    most = _misfit_plus_distance(best) + FIT_MARGIN[1]
    near = [each for one, each in found if one is not best and _misfit_plus_distance(one) <= most]
    return _add_offset_intervals(fitting, best, [chosen, *near])


def _misfit_plus_distance(comparison: Comparison) -> float:
    """Return a measure of how bad a comparison is: its misfit plus the distance of the nearest attractor, if any."""
    return comparison.misfit + (comparison.near[0].distance if comparison.near else 0.0)


def _add_offset_intervals(fitting: FitProblem, comparison: Comparison, fits: list[WallFit]) -> Comparison:
    """Return a comparison with the interval of its offset, other possible offsets, and flags of the sure impacts.

    fits: the fit from which the comparison was made, followed by the other fits that are about as good.

    Returns
    -------
    Comparison
        A copy in which `offset_interval`, `other_offsets` and `is_sure` are set.
    """
    own, *others = (confidence_interval_of_offset(fitting, each) for each in fits)
    sharp = fitting._replace(speed_tolerance=fits[0].speed_tolerance)
    walls = [fit_at_offset(sharp, end).wall for end in own] + [each.wall for each in fits]
    return replace(
        comparison,
        offset_interval=own,
        other_offsets=tuple((each.offset, ends) for each, ends in zip(fits[1:], others, strict=True)),
        is_sure=(comparison.wall != 0) & np.all([comparison.wall == wall for wall in walls], axis=0),
    )


class _AttractorImpacts(NamedTuple):
    """An attractor with the sorted phases of its impacts on Σ⁺ and Σ⁻.

    rate: the weight of each phase, in impacts per forcing period: 1/n if the attractor was followed for n periods.
    histogram: as in `ComparedAttractor`.
    """

    attractor: Attractor
    intensity: Intensity
    phases: list[Array]
    rate: float
    histogram: Array


def _follow_attractor(attractor: Attractor, gear: AnyGear, bins: int) -> _AttractorImpacts:
    """Compute the intensity of an attractor, and its impacts in one period; in CHAOS_PERIODS if it is not periodic."""
    periods = None if attractor.kind == "periodic" else CHAOS_PERIODS
    impacts, rate = gear.impacts(attractor, periods), 1.0 / (attractor.m if periods is None else periods)
    phases = _phases_by_wall(impacts.time, impacts.wall)
    return _AttractorImpacts(attractor, gear.intensity(attractor), phases, rate, _phase_histograms(phases, rate, bins))


def _compare_fit_with_attractors(
    measured: MeasuredImpacts, fit: WallFit, attractors: list[_AttractorImpacts], bins: int, tolerance: float
) -> Comparison:
    """Compare measured impacts, which have the walls and the offset of a fit, with the attractors of the gear."""
    true = fit.wall != 0
    time, wall, number = measured.time[true], fit.wall[true], int(np.count_nonzero(true))
    label = label_of_repeating_impacts(time, wall, tolerance)
    impacts = (number - 1) / float(time[-1] - time[0]) if label is None else (label[1] + label[2]) / label[0]
    here, rate = _phases_by_wall(time - fit.offset, wall), impacts / number
    near = [
        ComparedAttractor(
            each.attractor,
            each.intensity,
            each.histogram,
            sum(_earth_mover_distance_of_phases(a, rate, b, each.rate) for a, b in zip(here, each.phases, strict=True)),
        )
        for each in attractors
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
        histogram=_phase_histograms(here, rate, bins),
        near=tuple(sorted(near, key=lambda each: each.distance)),
    )


def _phases_by_wall(time: ArrayLike, wall: NDArray[np.int64]) -> list[Array]:
    """Return two arrays: the sorted phases of the impacts on Σ⁺, and the sorted phases of the impacts on Σ⁻."""
    phase = np.asarray(time, np.float64) % 1.0
    return [np.sort(phase[wall == side]) for side in (1, -1)]


def _phase_histograms(phases: list[Array], rate: float, bins: int) -> Array:
    """Return the number of impacts per forcing period on each wall, in equal intervals of the phase.

    phases: the phases of the impacts on Σ⁺, and on Σ⁻. rate: the weight of each phase, in impacts per forcing period.

    Returns
    -------
    Array
        Numbers (2, bins) for Σ⁺ and Σ⁻.
    """
    return np.array([rate * np.histogram(each, bins, (0.0, 1.0))[0] for each in phases])


def _earth_mover_distance_of_phases(a: Array, rate_a: float, b: Array, rate_b: float) -> float:
    """Return how far the impacts of one forcing period must be shifted to turn the phases `a` into the phases `b`.

    a, b: phases in rising order. rate_a, rate_b: the weight of each phase, in impacts per forcing period.

    This is the earth mover's distance on the circle: with the distribution functions F of a and G of b, the mean shift
    of an impact is the mean of |F − G − median(F − G)|.

    Returns
    -------
    float
        The sum of the shifts in forcing periods, plus FARTHEST for each impact that only one of `a` and `b` has.
    """
    here, there = rate_a * a.size, rate_b * b.size
    unmatched = FARTHEST * abs(here - there)
    if not a.size or not b.size:
        return unmatched
    at = (np.arange(GRID) + 0.5) / GRID
    apart = np.searchsorted(a, at) / a.size - np.searchsorted(b, at) / b.size
    return unmatched + min(here, there) * float(np.mean(np.abs(apart - np.median(apart))))
