"""The loudness of the attractors of many cells, for all rows of a table at once."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.chaos import BATCHES
from rattle.attractors.classify import PERIODS, WATCH
from rattle.attractors.samples import Outcome
from rattle.attractors.table import AttractorTable
from rattle.flight.first_impact import OK
from rattle.flight.law import wrap_phase_difference
from rattle.intensity.intensity import intensity_fields_from_sums, intensity_half_widths
from rattle.intensity.motions import CLOSED, ENDLESS, one_period_limits
from rattle.intensity.runs import collect_impacts_in_cell, sum_impacts_with_contacts
from rattle.intensity.visit import COLUMNS, FASTEST, TIME, mean_contact_force_at_point, sum_impacts
from rattle.numerics.compile import kernel
from rattle.orbits.iterates import MOST_IMPACTS
from rattle.orbits.return_map import point_of_cell

STRETCH = 512.0  # forcing periods for which a chaotic motion is followed at strong damping

Array = NDArray[np.float64]
#: A function that follows chaotic motions (n,). Its arguments are their cells, phases and speeds, the durations (n,)
#: for which it follows them, divided by STRETCH, and the record of cells. It returns sums (n, BATCHES, COLUMNS) over
#: their impacts.
Stretch = Callable[[NDArray[np.int64], Array, Array, Array, Any], Array]


class Intensities(NamedTuple):
    """The fields of `Intensity` for every attractor of a table, arrays (n,), with 95 % half-widths.

    Half-widths are 0 for exact values; for chaotic motions they come from 32 batches. Rows are NaN for undecided
    samples, for periodic motions that do not close after their period, and for chaotic motions that became quiet, or
    could not be followed, during the observation.
    """

    impacts_plus: Array
    impacts_minus: Array
    mean_speed: Array
    largest_speed: Array
    energy: Array
    contact: Array
    impulse: Array
    impacts_plus_error: Array
    impacts_minus_error: Array
    mean_speed_error: Array
    energy_error: Array
    contact_error: Array
    impulse_error: Array


VALUE_COUNT = 7  # the first 7 fields of `Intensities` are values, the others are half-widths of values
# the first 6 of these values for a quiet motion; the last one, the impulse, depends on the parameters
QUIET_VALUES = (0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


@kernel
def write_period_sums(cell, n_plus, tau, v, cells, sums):
    """Write sums (n, COLUMNS) over the impacts of one period of each motion (n,).

    `sums` must be zero at the start. Sums become NaN if the motion is not back at its first state after the period.
    """
    for i in range(cell.size):
        point = point_of_cell(cell[i], cells)
        status, tau1, v1, _time = sum_impacts(tau[i], v[i], n_plus[i], np.inf, MOST_IMPACTS, point, sums[i : i + 1])
        closed = abs(wrap_phase_difference(tau1 - tau[i])) <= CLOSED and abs(v1 - v[i]) <= CLOSED * sums[i, FASTEST]
        if status != OK or not closed:
            sums[i] = np.nan


@kernel
def write_mean_forces(cell, cells, forces):
    """Write the mean contact force of the cells with the numbers `cell` (n,) to `forces` (n,)."""
    for i in range(cell.size):
        forces[i] = mean_contact_force_at_point(point_of_cell(cell[i], cells))


def _sum_impacts_of_contact_motion(table: AttractorTable, row: int, cells: Any) -> Array:
    """Return the sums (COLUMNS,) over a period of a motion with contact phases.

    The sums are NaN if the motion is not back at its first state after the period.

    Returns
    -------
    Array
        The sums of `sum_impacts_with_contacts`.
    """
    tau, v, m = float(table.tau[row]), float(table.v[row]), int(table.m[row])
    returns, periods = one_period_limits(m, table.n_plus[row], table.contacts[row])
    status, tau1, v1, found = collect_impacts_in_cell(int(table.cell[row]), cells, tau, v, int(returns), float(periods))
    closed = abs(wrap_phase_difference(tau1 - tau)) <= CLOSED and abs(v1 - v) <= CLOSED * found.speed.max(initial=0.0)
    return sum_impacts_with_contacts(found, m) if status == OK and closed else np.full(COLUMNS, np.nan)


@kernel
def write_batch_sums(cell, tau, v, periods, cells, sums):
    """Write sums (n, BATCHES, COLUMNS) over the impacts of each motion (n,) in BATCHES successive batches.

    Motion i is followed for periods[i] forcing periods, and all its batches last equally long. `sums` must be zero at
    the start. The sums of a motion that becomes quiet, or cannot be followed for so long, become NaN.
    """
    for i in range(cell.size):
        point = point_of_cell(cell[i], cells)
        status, _tau, _v, time = sum_impacts(tau[i], v[i], ENDLESS, periods[i], MOST_IMPACTS, point, sums[i])
        if status != OK or time < periods[i]:
            sums[i] = np.nan


def follow_motions_one_by_one(
    cell: NDArray[np.int64], tau: Array, v: Array, length_factors: Array, cells: Any
) -> Array:
    """Follow chaotic motions (n,) one after another, and sum over their impacts (a function of the type `Stretch`).

    length_factors (n,): the duration for which each motion is followed, divided by STRETCH forcing periods.

    Returns
    -------
    Array
        Sums (n, BATCHES, COLUMNS); NaN for a motion that becomes quiet or cannot be followed.
    """
    sums = np.zeros((cell.size, BATCHES, COLUMNS))
    write_batch_sums(cell, tau, v, STRETCH * length_factors, cells, sums)
    return sums


def intensities_of(table: AttractorTable, cells: Any, stretch: Stretch) -> Intensities:
    """Return the intensity of every attractor of a table, with error bars.

    The result is exact for periodic motions. A chaotic motion is followed for so long that this takes a few per cent of
    the computing time that its classification took.

    Parameters
    ----------
    table : AttractorTable
        The attractors.
    cells : Any
        The record of cells, as kernels take it.
    stretch : Stretch
        The function that follows chaotic motions.

    Returns
    -------
    Intensities
        The intensities, a row for each attractor.
    """
    found = np.full((len(Intensities._fields), table.cell.size), np.nan)
    quiet = np.flatnonzero(table.kind == Outcome.QUIET)
    mean = np.empty(quiet.size)
    write_mean_forces(table.cell[quiet], cells, mean)
    found[:VALUE_COUNT, quiet] = [*(np.full(quiet.size, x) for x in QUIET_VALUES), 0.5 * mean]
    found[VALUE_COUNT:, quiet] = 0.0

    periodic = np.flatnonzero((table.kind == Outcome.PERIODIC) & (table.contacts == 0))
    around = np.zeros((periodic.size, COLUMNS))
    write_period_sums(*(x[periodic] for x in (table.cell, table.n_plus, table.tau, table.v)), cells, around)
    around[:, TIME] = np.rint(around[:, TIME])
    held = np.flatnonzero((table.kind == Outcome.PERIODIC) & (table.contacts > 0))
    if held.size:
        periodic = np.append(periodic, held)
        around = np.concatenate([around, [_sum_impacts_of_contact_motion(table, int(row), cells) for row in held]])
    found[:VALUE_COUNT, periodic] = intensity_fields_from_sums(around[:, None])
    found[VALUE_COUNT:, periodic] = np.where(np.isnan(around[:, TIME]), np.nan, 0.0)

    chaotic = np.flatnonzero(table.kind == Outcome.CHAOTIC)
    cell = table.cell[chaotic]
    sums = stretch(
        cell, table.tau[chaotic], table.v[chaotic], np.maximum(1.0, WATCH / (PERIODS * cells.delta[cell])), cells
    )
    found[:VALUE_COUNT, chaotic], found[VALUE_COUNT:, chaotic] = (
        intensity_fields_from_sums(sums),
        intensity_half_widths(sums),
    )
    return Intensities(*found)
