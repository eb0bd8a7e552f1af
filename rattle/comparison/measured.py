"""Check measured impacts, read them from a table, and find the period with which the impacts repeat."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.errors import require, require_real_array
from rattle.numerics.tables import read_columns

#: Least number of measured impacts.
LEAST_IMPACTS = 8
#: Least time between the first and the last impact, in forcing periods.
SHORTEST_SPAN = 1e-9
#: Most impacts in one period of a repeating motion.
MOST_REPEATED = 512
#: A period is accepted only if the data contain at least this number of its repetitions.
LEAST_REPETITIONS = 3
#: The chosen period is the shortest possible period whose scatter is at most CLOSER times the least scatter. All
#: scatters below EQUAL_SHARE times the allowed scatter count as equal.
CLOSER, EQUAL_SHARE = 1.5, 1e-3
COLUMNS = ("time", "speed", "wall")
Array = NDArray[np.float64]


class MeasuredImpacts(NamedTuple):
    """Measured impacts in their order, as arrays (n,).

    Attributes
    ----------
    time
        Times in forcing periods.
    speed
        Speeds before the impacts in the model's unit; None if they were not measured.
    wall
        1 for an impact on the driving flank of the teeth (Σ⁺), −1 for one on the other flank (Σ⁻); None if the walls
        were not measured.
    """

    time: Array
    speed: Array | None
    wall: NDArray[np.int64] | None

    @property
    def span(self) -> float:
        """The time from the first to the last impact in forcing periods."""
        return float(self.time[-1] - self.time[0])

    @property
    def impact_rate(self) -> float:
        """The number of impacts per forcing period."""
        return (self.time.size - 1) / self.span


def measured(time: ArrayLike, speed: ArrayLike | None = None, wall: ArrayLike | None = None) -> MeasuredImpacts:
    """Check the times, speeds and walls of measured impacts, all (n,).

    Parameters
    ----------
    time : ArrayLike
        Times of the impacts in forcing periods, strictly increasing.
    speed : ArrayLike | None
        Speeds ≥ 0 before the impacts, in the model's unit, if they are known.
    wall : ArrayLike | None
        The walls, 1 for Σ⁺ and −1 for Σ⁻, if they are known.

    Returns
    -------
    MeasuredImpacts
        The checked columns, for `rattle.comparison.compare`.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    times = require_real_array("time", time)
    require(times.ndim == 1, f"time must be a list of times, got an array of shape {times.shape}")
    require(times.size >= LEAST_IMPACTS, f"{times.size} impacts are too few: give at least {LEAST_IMPACTS}")
    require(
        bool(np.isfinite(times).all() and (np.diff(times) > 0).all()),
        "time must be finite and rise from each impact to the next: sort the impacts by time, or leave out impacts "
        "without a time or at the time of another",
    )
    require(
        times[-1] - times[0] > SHORTEST_SPAN,
        f"all impacts are within {times[-1] - times[0]:g} forcing periods: give time in forcing periods",
    )
    speeds, walls = None, None
    if speed is not None:
        speeds = require_real_array("speed", speed)
        require(speeds.shape == times.shape, f"give a speed for each of the {times.size} impacts, or none")
        require(
            bool((np.isfinite(speeds) & (speeds >= 0)).all()),
            "speed must be finite and at least 0: give the size of each velocity",
        )
    if wall is not None:
        given = require_real_array("wall", wall)
        require(given.shape == times.shape, f"give a wall for each of the {times.size} impacts, or none")
        require(bool((np.abs(given) == 1).all()), "wall must be 1 (Σ⁺) or -1 (Σ⁻) for each impact")
        walls = given.astype(np.int64)
    return MeasuredImpacts(times, speeds, walls)


def read_csv(path: str | Path, time_unit: float = 1.0, speed_unit: float = 1.0) -> MeasuredImpacts:
    """Read measured impacts from a CSV table with a header: a column `time`, and optional columns `speed` and `wall`.

    Parameters
    ----------
    time_unit, speed_unit : float
        The sizes of a forcing period and of the model's unit of speed in the units of the table. For a table in seconds
        and m/s they are `units.time` and `units.velocity` of a `Machine`.

    Returns
    -------
    MeasuredImpacts
        The impacts, with times in forcing periods and speeds in the model's unit.

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


def label_of_repeating_impacts(time: Array, wall: NDArray[np.int64], tolerance: float) -> tuple[int, int, int] | None:
    """Return the label (m, n₊, n₋) of impacts that repeat, or None if they do not.

    Several periods may fit: after a period doubling, for example, half the period fits roughly. The label is that of
    the shortest period whose scatter is at most CLOSER times the least scatter.

    Parameters
    ----------
    tolerance : float
        Largest allowed scatter. The scatter of a period is the root mean square difference between the durations of its
        repetitions and m forcing periods, divided by the mean time between impacts.

    Returns
    -------
    tuple[int, int, int] | None
        Forcing periods, impacts on Σ⁺ and impacts on Σ⁻ of one repetition.
    """
    allowed = tolerance * float(time[-1] - time[0]) / (time.size - 1)
    found = []
    for n in range(1, min(MOST_REPEATED, time.size // LEAST_REPETITIONS) + 1):
        later = time[n:] - time[:-n]
        m = round(float(later.mean()))
        off = math.sqrt(float(np.mean((later - m) ** 2)))
        if m >= 1 and off <= allowed and np.array_equal(wall[n:], wall[:-n]):
            n_plus = int(np.count_nonzero(wall[:n] > 0))
            found.append((max(off, EQUAL_SHARE * allowed), (m, n_plus, n - n_plus)))
    closest = min((off for off, _ in found), default=0.0)
    return next((label for off, label in found if off <= CLOSER * closest), None)
