"""The time that samples take to get to their attractors, and the share that has got there by when."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.speeds import SpeedLimit
from rattle.attractors.table import Attractor
from rattle.errors import require, require_number
from rattle.flight.law import wrapped
from rattle.models import AnyGear
from rattle.numerics.sampling import wilson_interval
from rattle.resilience.accumulate import accumulated
from rattle.resilience.gears import States, sample_of, unit_of

Array = NDArray[np.float64]
RELAXATIONS = 300.0  # times 1/δ, for which samples are followed by default


@dataclass(frozen=True)
class Convergence:
    """The arrivals of samples (n,) at their attractors.

    attractors: by falling share. which (n,): index into them. time (n,): forcing periods until a departure from Σ⁺ is
    first nearer than `within` to a quiet or periodic one; NaN of others, and of those followed for too short a time.
    """

    attractors: tuple[Attractor, ...]
    which: NDArray[np.int64]
    time: Array
    within: float

    @property
    def median(self) -> Array:
        """Median time to each attractor; NaN where there is none."""
        return self._of(np.median)

    @property
    def largest(self) -> Array:
        """Largest time to each attractor that is known."""
        return self._of(np.max)

    def _of(self, function: object) -> Array:
        assert callable(function)
        times = (self.time[(self.which == i) & np.isfinite(self.time)] for i in range(len(self.attractors)))
        return np.array([float(function(x)) if x.size else np.nan for x in times])

    def stability(self, periods: ArrayLike) -> tuple[Array, Array, Array]:
        """Return the finite-time basin stability of each attractor.

        The share of all samples that are there by then, with the ends of its 95 % Wilson interval; each of shape
        (attractors, *periods).

        Returns
        -------
        tuple[Array, Array, Array]
            Share, lower and upper end.
        """
        at = np.asarray(periods, np.float64)
        there = self.which[:, None] == np.arange(len(self.attractors))
        by = np.nan_to_num(self.time, nan=np.inf) <= at[..., None]
        number = np.moveaxis(np.einsum("...k,kj->...j", by.astype(np.int64), there.astype(np.int64)), -1, 0)
        return number / self.time.size, *wilson_interval(number, self.time.size)


class _Arrival:
    """The first time at which samples are near points (k, 2) of their attractors, one list of points for each."""

    def __init__(self, which: NDArray[np.int64], points: list[Array | None], near: float, unit: float) -> None:
        self.which, self.points, self.near, self.unit = which, points, near, unit
        self.time = np.full(which.size, np.nan)

    def begin(self, tau: Array, v: Array) -> None:
        """Note the samples that set out near their attractors: they are there at once."""
        self.add(np.arange(tau.size), tau, v, np.zeros(tau.size))

    def add(self, sample: NDArray[np.int64], tau: Array, v: Array, time: Array) -> NDArray[np.bool_]:
        """Note who has arrived."""
        there = ~np.isnan(self.time[sample])
        for i, points in enumerate(self.points):
            mine = np.flatnonzero((self.which[sample] == i) & ~there)
            if points is None or not mine.size:
                there[mine] = points is None  # nothing to arrive at
                continue
            if not len(points):
                there[mine] = v[mine] < self.near * self.unit
            else:
                x = wrapped(tau[mine, None] - points[:, 0])
                y = (v[mine, None] - points[:, 1]) / self.unit
                there[mine] = (np.hypot(x, y) < self.near).any(axis=1)
            fresh = mine[there[mine]]
            self.time[sample[fresh]] = time[fresh]
        return there

    def values(self) -> Array:
        """Return the times."""
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
    """Return how long the sample of `Gear.attractors` takes to be nearer to its attractors than `within`.

    The distance is of phase, and of speed in its unit √(16πδβ)/4.2; quiet motion is v = 0.

    Parameters
    ----------
    periods : float | None
        Forcing periods for which samples are followed, by default 300/δ.
    states : States
        Own ones (τ, v) instead of the sample.

    Returns
    -------
    Convergence
        Times of all samples.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    within = require_number("within", within, positive=True)
    require(within < 0.5, f"within must be below 0.5, half a forcing period, got {within}")
    tau, v = sample_of(gear, count, v_max, seed, states)
    found = gear.reached(tau, v)
    points = [_points(gear, each) for each in found.attractors]
    arrival = _Arrival(found.which, points, within, unit_of(gear))
    time = accumulated(gear, tau, v, arrival, RELAXATIONS / gear.delta if periods is None else periods)
    return Convergence(found.attractors, found.which, time, within)


def _points(gear: AnyGear, attractor: Attractor) -> Array | None:
    """Departures (k, 2) of a periodic attractor, none of quiet motion, None where no distance is told."""
    if attractor.kind == "quiet":
        return np.zeros((0, 2))
    if attractor.kind != "periodic":
        return None
    orbit = gear.iterate(attractor.tau, attractor.v, np.arange(attractor.n_plus))
    return np.column_stack([orbit.tau, orbit.v])
