"""Impacts that were measured: checked, read from a table, and the period with which they repeat."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.errors import real_array, require
from rattle.numerics.tables import read_columns

LEAST = 8  # impacts
SHORTEST = 1e-9  # forcing periods between the first and the last: they are not told apart at less
LONGEST = 512  # impacts of a period
REPEATS = 3  # of a period that are seen
CLOSER, SAME = 1.5, 1e-3  # times; of what is allowed, below which all repeat alike
COLUMNS = ("time", "speed", "wall")
Array = NDArray[np.float64]


class MeasuredImpacts(NamedTuple):
    """Impacts in their order, arrays (n,): times in forcing periods, which are revolutions.

    Speeds of arrival of the model, and walls, +1 where the driving side of the teeth meets, or −1, None where these
    were not measured.
    """

    time: Array
    speed: Array | None
    wall: NDArray[np.int64] | None

    @property
    def span(self) -> float:
        """Forcing periods from the first impact to the last."""
        return float(self.time[-1] - self.time[0])

    @property
    def impacts(self) -> float:
        """Impacts per forcing period."""
        return (self.time.size - 1) / self.span


def measured(time: ArrayLike, speed: ArrayLike | None = None, wall: ArrayLike | None = None) -> MeasuredImpacts:
    """Return measured impacts (n,) at rising times in forcing periods.

    Speeds ≥ 0, in the model's unit, and walls ±1 are given where they are known.

    Returns
    -------
    MeasuredImpacts
        The checked columns, for `rattle.compare`.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    times = real_array("time", time)
    require(times.ndim == 1, f"time must be a list of times, got an array of shape {times.shape}")
    require(times.size >= LEAST, f"there are {times.size} impacts: give {LEAST} at least")
    require(bool(np.isfinite(times).all() and (np.diff(times) > 0).all()), "times must be finite and rise")
    require(
        times[-1] - times[0] > SHORTEST,
        f"all impacts lie within {times[-1] - times[0]:g} forcing periods: in which unit are the times?",
    )
    speeds, walls = None, None
    if speed is not None:
        speeds = real_array("speed", speed)
        require(speeds.shape == times.shape, f"give a speed for each of the {times.size} impacts, or none")
        require(bool((np.isfinite(speeds) & (speeds >= 0)).all()), "speeds must be finite and at least 0")
    if wall is not None:
        given = real_array("wall", wall)
        require(given.shape == times.shape, f"give a wall for each of the {times.size} impacts, or none")
        require(bool((np.abs(given) == 1).all()), "walls must be 1 or -1")
        walls = given.astype(np.int64)
    return MeasuredImpacts(times, speeds, walls)


def read_csv(path: str | Path, time_unit: float = 1.0, speed_unit: float = 1.0) -> MeasuredImpacts:
    """Read impacts from a table with a header: a column `time`, and `speed` and `wall` if there are.

    Parameters
    ----------
    time_unit, speed_unit : float
        What a forcing period and a unit of speed of the model are in the table's units: `units.time` and
        `units.velocity` of a `Machine` for seconds and m/s.

    Returns
    -------
    MeasuredImpacts
        With times in forcing periods and speeds in the model's unit.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    RattleError
        If the file cannot be read.
    """
    found = read_columns(path, COLUMNS, needed="time")
    speed = found["speed"] / speed_unit if "speed" in found else None
    return measured(found["time"] / time_unit, speed, found.get("wall"))


def period_of(time: Array, wall: NDArray[np.int64], tolerance: float) -> tuple[int, int, int] | None:
    """Return the label (m, n₊, n₋) of impacts that repeat themselves; None if they do not.

    It is that of the shortest such period, unless longer ones, to which it may have doubled, repeat CLOSER.

    Parameters
    ----------
    tolerance : float
        Root mean square of how much earlier or later they are after m whole periods, over the mean time between
        impacts.

    Returns
    -------
    tuple[int, int, int] | None
        Forcing periods, impacts on Σ⁺ and impacts on Σ⁻ of one repetition.
    """
    allowed = tolerance * float(time[-1] - time[0]) / (time.size - 1)
    found = []
    for n in range(1, min(LONGEST, time.size // REPEATS) + 1):
        later = time[n:] - time[:-n]
        m = round(float(later.mean()))
        off = math.sqrt(float(np.mean((later - m) ** 2)))
        if m >= 1 and off <= allowed and np.array_equal(wall[n:], wall[:-n]):
            n_plus = int(np.count_nonzero(wall[:n] > 0))
            found.append((max(off, SAME * allowed), (m, n_plus, n - n_plus)))
    closest = min((off for off, _ in found), default=0.0)
    return next((label for off, label in found if off <= CLOSER * closest), None)
