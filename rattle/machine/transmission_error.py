"""Measured transmission errors: read and check a table of angles and errors, and decompose the errors into orders."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.errors import require, require_integer, require_real_array
from rattle.numerics.tables import read_columns
from rattle.parameters import HIGHEST_ORDER, MOST_HARMONICS

#: {name of a column of a table: size of its unit}; the size is in revolutions for angles and in metres for errors.
ANGLES = {"angle_deg": 1.0 / 360.0, "angle_rad": 1.0 / (2.0 * np.pi), "angle_rev": 1.0}
ERRORS = {"error_um": 1e-6, "error_mm": 1e-3, "error_m": 1.0}
#: Names of columns that do not state a unit. A file with such a column, but none of the same quantity with a unit, is
#: refused.
COLUMNS_WITHOUT_UNIT = ("angle", "error")
#: Largest difference between the span of angles and whole revolutions, in revolutions.
REVOLUTION_TOLERANCE = 0.01
#: Largest and least plausible peak-to-peak height of a transmission error, m.
LARGEST_HEIGHT, LEAST_HEIGHT = 1e-3, 2e-8
#: The errors at both ends of a curve may differ by CLOSING_ERROR times its peak-to-peak height. If the last point does
#: not repeat the first, they may also differ by JUMP times the largest step between neighbouring points.
JUMP, CLOSING_ERROR = 4.0, 0.1
MOST_POINTS = 1_000_000
Array = NDArray[np.float64]


@dataclass(frozen=True)
class TransmissionError:
    """A measured transmission error as a sum Σ a cos 2π(k t + φ) over orders k, with t in revolutions.

    Parameters
    ----------
    harmonics : tuple of (int, float, float)
        Order, amplitude in m, and phase in turns, as `Machine(eccentricity=0, errors=…)` takes them.
    left_out : float
        Root mean square of the part that the harmonics leave out (other orders and noise), m.
    peak_to_peak : float
        Height of the measured curve, m.
    points, revolutions : int
        Numbers of measured points, and of revolutions that they cover.
    """

    harmonics: tuple[tuple[int, float, float], ...]
    left_out: float
    peak_to_peak: float
    points: int
    revolutions: int

    def __str__(self) -> str:
        """Return one line with the number of points, the peak-to-peak height and the orders of the curve."""
        largest = max(self.harmonics, key=lambda each: each[1])
        return (
            f"{self.points} points of {self.revolutions} revolution{'s' if self.revolutions > 1 else ''}, "
            f"{1e6 * self.peak_to_peak:.3g} µm peak to peak: {len(self.harmonics)} orders up to "
            f"{self.harmonics[-1][0]}, the largest {1e6 * largest[1]:.3g} µm at order {largest[0]}; "
            f"{1e6 * self.left_out:.2g} µm rms left out"
        )


def transmission_error(angle: ArrayLike, error: ArrayLike, orders: int = 40) -> TransmissionError:
    """Decompose a measured transmission error into orders 1 to `orders`, by least squares.

    Parameters
    ----------
    angle : array_like, (n,)
        Rising angles in revolutions, over one or more whole revolutions.
    error : array_like, (n,)
        The error along the line of action in m; its mean has no effect.
    orders : int
        The highest order. Above 63 orders, only the 63 with the largest amplitudes are kept.

    Returns
    -------
    TransmissionError
        The orders, and the root mean square of the part that they leave out.

    Raises
    ------
    ParameterError
        If the curve is no transmission error over whole revolutions, or has too few points.
    """
    turn, e = require_real_array("angle", angle), require_real_array("error", error)
    orders = require_integer("orders", orders, 1, HIGHEST_ORDER)
    require(
        turn.ndim == 1 and turn.shape == e.shape,
        f"angle and error must be lists of the same length, got shapes {turn.shape} and {e.shape}",
    )
    require(
        turn.size <= MOST_POINTS,
        f"{turn.size:,} points are too many: give at most {MOST_POINTS:,}, such as every tenth",
    )
    missing = np.flatnonzero(~(np.isfinite(turn) & np.isfinite(e)))
    require(
        not missing.size,
        f"the angle or the error of point {missing[:1].sum() + 1} of {turn.size} is not a finite number: measure the "
        "point, or leave it out",
    )
    require(turn.size >= 4, f"{turn.size} points are too few: give at least {2 * orders + 1} for {orders} orders")
    steps = np.diff(turn)
    require(
        not bool((steps < 0).all()),
        "angles must rise, but these fall: reverse the table if the gear was turned backwards",
    )
    back = np.flatnonzero(steps <= 0)
    require(
        not back.size,
        f"angles must rise, and that of point {back[:1].sum() + 2} does not: sort the table by angle, "
        "leave out one of two points at the same angle, or go on with 361° after 360°",
    )
    turn, e, revolutions = _cut_to_whole_revolutions(turn, e)
    needed = 2 * orders + 1
    require(turn.size >= needed, f"{turn.size} points are too few for {orders} orders: give {needed}, or fewer orders")
    gap = _widest_angle_step(turn, revolutions)
    require(
        gap <= 0.5 / orders * (1.0 + REVOLUTION_TOLERANCE),
        f"there is a gap of {gap:.3g} revolutions between two angles, and order {orders} needs a point every "
        f"{0.5 / orders:.3g}: measure there, or lower orders to {max(1, int(0.5 / gap))}",
    )
    return _fit_orders(turn, e, orders, revolutions)


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
        The orders of the measured curve, from `transmission_error`.

    Raises
    ------
    RattleError
        If the file cannot be read.
    ParameterError
        If columns are missing or appear twice, a cell is not a number, a unit is missing, or `transmission_error`
        refuses the curve.
    """
    found = read_columns(path, (*ANGLES, *ERRORS, *COLUMNS_WITHOUT_UNIT))
    columns = []
    for bare, units in zip(COLUMNS_WITHOUT_UNIT, (ANGLES, ERRORS), strict=True):
        given = [name for name in units if name in found]
        require(
            bool(given) or bare not in found,
            f"the column {bare} of {path} does not say its unit: name it {', '.join([*units][:-1])} or {[*units][-1]}",
        )
        require(
            len(given) == 1, f"{path} must have exactly one of the columns {', '.join(units)}, but has {len(given)}"
        )
        columns.append(found[given[0]] * units[given[0]])
    angle, error = columns
    return transmission_error(angle, error, orders)


def _cut_to_whole_revolutions(turn: Array, e: Array) -> tuple[Array, Array, int]:
    """Return angles and errors without a last point that repeats the first, and the number of whole revolutions.

    Returns
    -------
    tuple[Array, Array, int]
        Angles in revolutions, errors in m, and the number of revolutions.

    Raises
    ------
    ParameterError
        If the angles do not span whole revolutions, the peak-to-peak height of the errors is impossible, or the errors
        at both ends differ too much.
    """
    span, step = float(turn[-1] - turn[0]), float(np.median(np.diff(turn)))
    with_end, without = round(span), round(span + step)
    repeats = abs(span - with_end) <= min(REVOLUTION_TOLERANCE, 0.5 * step) and with_end >= 1
    near = repeats or (abs(span + step - without) <= max(REVOLUTION_TOLERANCE, step) and without >= 1)
    require(
        near,
        f"the angles must span whole revolutions, but span {span:.3g}: cut the table to whole revolutions, or "
        "name the column angle_deg, angle_rad or angle_rev if the angles are in another unit",
    )
    height = float(np.ptp(e))
    require(
        height <= LARGEST_HEIGHT,
        f"the error is {1e3 * height:.3g} mm from peak to peak, more than any gear's: if the errors are in µm, name "
        "the column error_um",
    )
    require(
        height >= LEAST_HEIGHT,
        f"the error is {1e6 * height:.2g} µm from peak to peak, less than any gear's: if the errors are in mm, name "
        "the column error_mm; if they are in m, error_m",
    )
    open_by = abs(float(e[-1] - e[0]))
    largest = float(np.max(np.abs(np.diff(e))))
    allowed = max(JUMP * largest * (0.0 if repeats else 1.0), CLOSING_ERROR * height)
    require(
        open_by <= allowed,
        f"the error does not close after a revolution: it begins at {1e6 * float(e[0]):.3g} µm and ends at "
        f"{1e6 * float(e[-1]):.3g} µm. Remove the drift of the measurement, or give the common period of both gears",
    )
    return (turn[:-1], e[:-1], with_end) if repeats else (turn, e, without)


def _widest_angle_step(turn: Array, revolutions: int) -> float:
    """Return the largest distance, in revolutions, between neighbouring angles on the circle; angles count modulo 1."""
    angle = np.unique(turn % 1.0) if revolutions > 1 else np.sort(turn - turn[0])
    return float(max(np.max(np.diff(angle), initial=0.0), 1.0 - angle[-1] + angle[0]))


def _fit_orders(turn: Array, e: Array, orders: int, revolutions: int) -> TransmissionError:
    """Fit orders 1 to `orders` by least squares, and keep the MOST_HARMONICS − 1 orders with the largest amplitudes."""
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
