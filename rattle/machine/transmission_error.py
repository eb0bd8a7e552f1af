"""A measured transmission error: read from a table of angle and error, checked, and taken apart into orders."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.errors import real_array, require, require_integer
from rattle.numerics.tables import read_columns
from rattle.parameters import HIGHEST_ORDER, MOST_HARMONICS

#: Columns of a table and their units: revolutions, metres.
ANGLES = {"angle_deg": 1.0 / 360.0, "angle_rad": 1.0 / (2.0 * np.pi), "angle_rev": 1.0}
ERRORS = {"error_um": 1e-6, "error_mm": 1e-3, "error_m": 1.0}
BARE = ("angle", "error")  # columns that do not say their unit
WHOLE = 0.01  # of a revolution: how far the span of angles may be from whole ones
WIDEST, NARROWEST = 1e-3, 2e-8  # m: peak to peak of any gear's transmission error
JUMP, CLOSING = 4.0, 0.1  # of the largest step between neighbours, and of peak to peak: a curve that does not close
MOST_POINTS = 1_000_000
Array = NDArray[np.float64]


@dataclass(frozen=True)
class TransmissionError:
    """A measured transmission error as a sum of orders of the revolution, Σ a cos 2π(k t + φ), t in revolutions.

    Parameters
    ----------
    harmonics : tuple of (int, float, float)
        Order, amplitude in m, and phase in turns: what `Machine(eccentricity=0, errors=…)` takes.
    left_out : float
        m, root mean square of what these orders do not have: higher ones, and noise.
    peak_to_peak : float
        m, of the measured curve.
    points, revolutions : int
        Measured points, and the revolutions that they cover.
    """

    harmonics: tuple[tuple[int, float, float], ...]
    left_out: float
    peak_to_peak: float
    points: int
    revolutions: int

    def __str__(self) -> str:
        """Return it in a line."""
        largest = max(self.harmonics, key=lambda each: each[1])
        return (
            f"{self.points} points of {self.revolutions} revolution{'s' if self.revolutions > 1 else ''}, "
            f"{1e6 * self.peak_to_peak:.3g} µm peak to peak: {len(self.harmonics)} orders up to "
            f"{self.harmonics[-1][0]}, the largest {1e6 * largest[1]:.3g} µm at order {largest[0]}; "
            f"{1e6 * self.left_out:.2g} µm rms left out"
        )


def transmission_error(angle: ArrayLike, error: ArrayLike, orders: int = 40) -> TransmissionError:
    """Take a measured transmission error apart into orders 1 to `orders`, by least squares.

    Parameters
    ----------
    angle : array_like, (n,)
        Rising, in revolutions, over one or more whole ones.
    error : array_like, (n,)
        m along the line of action; its mean does not matter.
    orders : int
        The highest order. Of more than 63 the largest are kept.

    Returns
    -------
    TransmissionError
        Its orders, and what they leave out.

    Raises
    ------
    ParameterError
        The curve is no transmission error over whole revolutions, or has too few points; the message says what to do.
    """
    turn, e = real_array("angle", angle), real_array("error", error)
    orders = require_integer("orders", orders, 1, HIGHEST_ORDER)
    require(turn.ndim == 1 and turn.shape == e.shape, f"give an error for each angle, got {e.size} for {turn.size}")
    require(turn.size <= MOST_POINTS, f"{turn.size} points are too many: give at most {MOST_POINTS}, every tenth or so")
    missing = np.flatnonzero(~(np.isfinite(turn) & np.isfinite(e)))
    require(
        not missing.size, f"point {missing[:1] + 1} of {turn.size} is not a finite number: measure it, or leave it out"
    )
    require(turn.size >= 4, f"{turn.size} points are no curve: give {2 * orders + 1} at least for {orders} orders")
    steps = np.diff(turn)
    require(not bool((steps < 0).all()), "the angles fall: turn the table around, if the gear was turned backwards")
    back = np.flatnonzero(steps <= 0)
    require(
        not back.size,
        f"angles must rise, and point {back[:1] + 2} does not: sort the table by angle, count on after a revolution "
        "(361° after 360°), and leave one of two points at the same angle",
    )
    turn, e, revolutions = _closed(turn, e)
    needed = 2 * orders + 1
    require(turn.size >= needed, f"{turn.size} points are too few for {orders} orders: give {needed}, or fewer orders")
    gap = _largest_gap(turn, revolutions)
    require(
        gap <= 0.5 / orders * (1.0 + WHOLE),
        f"there is a gap of {gap:.3g} revolutions between two angles, and order {orders} needs a point every "
        f"{0.5 / orders:.3g}: measure there, or lower orders to {max(1, int(0.5 / gap))}",
    )
    return _orders_of(turn, e, orders, revolutions)


def read_transmission_error(path: str | Path, orders: int = 40) -> TransmissionError:
    """Read a measured transmission error from a table with a header.

    Parameters
    ----------
    path : path
        A CSV file with a column `angle_deg`, `angle_rad` or `angle_rev` and one `error_um`, `error_mm` or `error_m`,
        over whole revolutions of the first gear.
    orders : int
        The highest order of the revolution.

    Returns
    -------
    TransmissionError
        The measured curve taken apart into orders, as by `transmission_error`.

    Raises
    ------
    RattleError
        The file cannot be read.
    ParameterError
        If columns are missing, a unit is unclear, or `transmission_error` refuses the curve.
    """
    found = read_columns(path, (*ANGLES, *ERRORS, *BARE))
    columns = []
    for bare, units in zip(BARE, (ANGLES, ERRORS), strict=True):
        given = [name for name in units if name in found]
        require(
            bool(given) or bare not in found,
            f"the column {bare} of {path} does not say its unit: name it {', '.join([*units][:-1])} or {[*units][-1]}",
        )
        require(len(given) == 1, f"{path} must have one column of {', '.join(units)}, it has {len(given)}")
        columns.append(found[given[0]] * units[given[0]])
    angle, error = columns
    return transmission_error(angle, error, orders)


def _closed(turn: Array, e: Array) -> tuple[Array, Array, int]:
    """Return the points of whole revolutions, without a last one that repeats the first, and how many they are."""
    span, step = float(turn[-1] - turn[0]), float(np.median(np.diff(turn)))
    with_end, without = round(span), round(span + step)
    repeats = abs(span - with_end) <= min(WHOLE, 0.5 * step) and with_end >= 1
    near = repeats or (abs(span + step - without) <= max(WHOLE, step) and without >= 1)
    require(
        near,
        f"the angles span {span:.3g} revolutions, which are not whole ones: cut the table to whole revolutions, or "
        "name the column angle_deg, angle_rad or angle_rev if the angles are in another unit",
    )
    height = float(np.ptp(e))
    require(
        height <= WIDEST,
        f"the error is {1e3 * height:.3g} mm from peak to peak, which is no gear's: if these are µm, name the column "
        f"error_um",
    )
    require(
        height >= NARROWEST,
        f"the error is {1e6 * height:.2g} µm from peak to peak, less than any gear's: if these are mm, name the column "
        "error_mm, if m error_m",
    )
    open_by = abs(float(e[-1] - e[0]))
    largest = float(np.max(np.abs(np.diff(e))))
    allowed = max(JUMP * largest * (0.0 if repeats else 1.0), CLOSING * height)
    require(
        open_by <= allowed,
        f"the error does not close after a revolution: it begins at {1e6 * float(e[0]):.3g} µm and ends at "
        f"{1e6 * float(e[-1]):.3g} µm. Remove the drift of the measurement, or give the common period of both gears",
    )
    return (turn[:-1], e[:-1], with_end) if repeats else (turn, e, without)


def _largest_gap(turn: Array, revolutions: int) -> float:
    """Return the largest distance between neighbouring angles, all revolutions on top of each other."""
    angle = np.unique(turn % 1.0) if revolutions > 1 else np.sort(turn - turn[0])
    return float(max(np.max(np.diff(angle), initial=0.0), 1.0 - angle[-1] + angle[0]))


def _orders_of(turn: Array, e: Array, orders: int, revolutions: int) -> TransmissionError:
    order = np.arange(1, orders + 1)
    basis = np.exp(-2j * np.pi * turn[:, None] * order)
    matrix = np.hstack([np.ones((turn.size, 1)), basis.real, -basis.imag])
    found = np.linalg.lstsq(matrix, e, rcond=None)[0]
    phasor = found[1 : orders + 1] - 1j * found[orders + 1 :]
    kept = np.sort(np.argsort(-np.abs(phasor), kind="stable")[: MOST_HARMONICS - 1])
    part = np.real(np.exp(2j * np.pi * turn[:, None] * order[kept]) @ phasor[kept])
    left = e - found[0] - part
    harmonics = tuple(
        (int(order[i]), float(abs(phasor[i])), float(np.angle(phasor[i]) / (2.0 * np.pi) % 1.0)) for i in kept
    )
    rms = float(np.sqrt(np.mean(left**2)))
    return TransmissionError(harmonics, rms, float(np.ptp(e)), turn.size, revolutions)
