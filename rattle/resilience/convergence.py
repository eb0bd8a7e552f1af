"""The time that samples take to reach their attractors, and the share that has reached them by a given time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.speeds import SpeedLimit
from rattle.attractors.table import Attractor
from rattle.errors import require, require_number
from rattle.flight.law import wrap_phase_difference
from rattle.models import AnyGear
from rattle.numerics.sampling import wilson_interval
from rattle.resilience.accumulate import accumulated
from rattle.resilience.gears import States, initial_states_of, speed_unit_of

Array = NDArray[np.float64]
#: Default observation time, in relaxation times 1/δ.
RELAXATIONS = 300.0


@dataclass(frozen=True)
class Convergence:
    """The times at which samples (n,) arrive at their attractors.

    attractors: the attractors, the largest basin fraction first. which (n,): the index of each sample's attractor.
    time (n,): forcing periods until the sample arrives at its quiet or periodic attractor. A sample arrives at its
    first departure from Σ⁺ whose distance from the attractor is below `within`. The time is NaN for chaotic and
    undecided samples, and for samples that did not arrive within the observation time.
    """

    attractors: tuple[Attractor, ...]
    which: NDArray[np.int64]
    time: Array
    within: float

    @property
    def median(self) -> Array:
        """The median time of arrival at each attractor, in forcing periods; NaN where no sample has arrived."""
        return self._statistic_of_times(np.median)

    @property
    def largest(self) -> Array:
        """The largest time of arrival at each attractor, in forcing periods; NaN where no sample has arrived."""
        return self._statistic_of_times(np.max)

    def _statistic_of_times(self, function: object) -> Array:
        """Apply a function to the times of arrival at each attractor; the result is NaN where no sample has arrived."""
        assert callable(function)
        times = (self.time[(self.which == i) & np.isfinite(self.time)] for i in range(len(self.attractors)))
        return np.array([float(function(x)) if x.size else np.nan for x in times])

    def stability(self, periods: ArrayLike) -> tuple[Array, Array, Array]:
        """Return the finite-time basin stability: the share of all samples that have reached each attractor by a time.

        Parameters
        ----------
        periods : ArrayLike
            Times in forcing periods, of any shape.

        Returns
        -------
        tuple[Array, Array, Array]
            The shares and the ends of their 95 % Wilson intervals, each of shape (attractors, *periods.shape).
        """
        at = np.asarray(periods, np.float64)
        there = self.which[:, None] == np.arange(len(self.attractors))
        by = np.nan_to_num(self.time, nan=np.inf) <= at[..., None]
        number = np.moveaxis(np.einsum("...k,kj->...j", by.astype(np.int64), there.astype(np.int64)), -1, 0)
        return number / self.time.size, *wilson_interval(number, self.time.size)


class _ArrivalAccumulator:
    """An `Accumulator` of the time of arrival of each sample: the first time at which it is near its attractor.

    which: the index of each sample's attractor. points: for each attractor its departures (τ, v) from Σ⁺ (k, 2); no
    rows for quiet motion, and None for chaotic and undecided motion, at which samples never arrive. arrival_distance:
    the distance below which a sample has arrived. speed_unit: the unit of speeds in this distance.
    """

    def __init__(self, which: NDArray[np.int64], points: list[Array | None], near: float, unit: float) -> None:
        self.which, self.points, self.arrival_distance, self.speed_unit = which, points, near, unit
        self.time = np.full(which.size, np.nan)

    def begin(self, tau: Array, v: Array) -> None:
        """Record the samples that start near their attractors, with time 0."""
        self.add(np.arange(tau.size), tau, v, np.zeros(tau.size))

    def add(self, sample: NDArray[np.int64], tau: Array, v: Array, time: Array) -> NDArray[np.bool_]:
        """Record the times of samples that have arrived. Return flags of samples that need no further observation."""
        there = ~np.isnan(self.time[sample])
        for i, points in enumerate(self.points):
            mine = np.flatnonzero((self.which[sample] == i) & ~there)
            if points is None or not mine.size:
                # chaotic and undecided samples (points is None) cannot arrive, so they need no further observation
                there[mine] = points is None
                continue
            if not len(points):
                there[mine] = v[mine] < self.arrival_distance * self.speed_unit
            else:
                x = wrap_phase_difference(tau[mine, None] - points[:, 0])
                y = (v[mine, None] - points[:, 1]) / self.speed_unit
                there[mine] = (np.hypot(x, y) < self.arrival_distance).any(axis=1)
            fresh = mine[there[mine]]
            self.time[sample[fresh]] = time[fresh]
        return there

    def values(self) -> Array:
        """Return the times of arrival (n,) in forcing periods; NaN for samples that have not arrived."""
        return self.time


def convergence(
    gear: AnyGear,
    count: int = 1024,
    v_max: SpeedLimit = None,
    seed: int = 0,
    within: float = 0.01,
    periods: float | None = None,
    states: States = None,
) -> Convergence:
    """Return the times that the samples of `Gear.attractors` take to reach their attractors.

    A sample has arrived when it departs from Σ⁺ nearer to its attractor than `within`. Distances are measured in the
    (τ, v) plane, with v in units of (1.5 √(16πδβ) + 2πε)/7. For quiet motion the distance is v in these units.

    Parameters
    ----------
    count, v_max, seed
        The samples, as in `Gear.attractors`.
    within : float
        A sample has arrived if its distance is less than this number, which is below 0.5.
    periods : float | None
        Observation time in forcing periods, by default 300/δ.
    states : States
        Initial states (τ, v), instead of drawn samples.

    Returns
    -------
    Convergence
        The attractors, and the times of all samples.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    within = require_number("within", within, positive=True)
    require(within < 0.5, f"within must be below 0.5, half a forcing period, got {within}")
    tau, v = initial_states_of(gear, count, v_max, seed, states)
    found = gear.reached(tau, v)
    points = [_departures_of_attractor(gear, each) for each in found.attractors]
    arrival = _ArrivalAccumulator(found.which, points, within, speed_unit_of(gear))
    time = accumulated(gear, tau, v, arrival, RELAXATIONS / gear.delta if periods is None else periods)
    return Convergence(found.attractors, found.which, time, within)


def _departures_of_attractor(gear: AnyGear, attractor: Attractor) -> Array | None:
    """Return the departures (k, 2) of a periodic attractor, no rows for quiet motion, and None for other attractors."""
    if attractor.kind == "quiet":
        return np.zeros((0, 2))
    if attractor.kind != "periodic":
        return None
    orbit = gear.iterate(attractor.tau, attractor.v, np.arange(attractor.n_plus))
    return np.column_stack([orbit.tau, orbit.v])
