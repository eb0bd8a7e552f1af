"""Samples and their outcomes, known orbits, capture regions, and visited-cell bitmaps (compiled)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from rattle.flight.forcing import DRIFT, largest_forcing_slope
from rattle.flight.law import wrap_phase_difference
from rattle.numerics.compile import inline
from rattle.numerics.struct_of_arrays import StructOfArrays, define_kernel_columns

GRID = 32  # boxes along each side of the visited-cell bitmap of a chaotic trajectory
HIGHEST_BITMAP_SPEED = 14.0  # largest speed at which a visited-cell bitmap may end, in units of `speed_unit`
RECURRENCE = 1e-6  # a return this close to an earlier state, in τ and in v/`speed_unit`, starts Newton's method
Known = TypeVar("Known", bound=StructOfArrays)
CONTACT = -1  # value of `Trajectories.pause` for a sample that has entered a contact phase
# Lyapunov exponents leave out this many first impacts, while the tangent vector turns to the most expanding direction
ALIGNMENT = 64


class Outcome(IntEnum):
    """Outcome of a sample.

    UNRESOLVED
        The sample has not reached an attractor yet.
    QUIET
        The sample is certain to stay in contact with Σ⁺.
    PERIODIC
        A stable orbit has captured the sample.
    CHAOTIC
        The sample is on a chaotic attractor.
    UNDECIDED
        The sample reached no attractor and did not pass the test for chaos within its budget.
    RECURRENT
        The sample has returned close to an earlier state, and its orbit is searched. This outcome is temporary.
    FAILED
        The sample cannot be followed. Tables count it as undecided.

    Tables and stores hold the numbers from QUIET to UNDECIDED as kinds of attractors; `rattle.KINDS` has their names.
    Numba reads the members as constants.
    """

    UNRESOLVED = 0
    QUIET = 1
    PERIODIC = 2
    CHAOTIC = 3
    UNDECIDED = 4
    RECURRENT = 5
    FAILED = 6


@dataclass(frozen=True, eq=False)
class Trajectories(StructOfArrays):
    """Trajectories of n samples: cell, state, impacts so far, limit of impacts, outcome, and the capturing orbit.

    `time` holds the forcing periods so far. When a sample returns close to an earlier state, `gap` is set to the number
    of impacts between the two states. If no orbit is found there, `pause` is set to the number of impacts that the
    sample must have made before another such return counts.
    """

    cell: Any
    tau: Any
    v: Any
    impacts: Any
    limit: Any
    status: Any
    orbit: Any
    gap: Any
    pause: Any
    time: Any


class SampleSets(NamedTuple):
    """Samples of n cells: `sample_numbers` (k,), ordered by cell, and how many samples each cell has, `size` (n,)."""

    sample_numbers: NDArray[np.int64]
    size: NDArray[np.int64]

    @property
    def first_sample_index(self) -> NDArray[np.int64]:
        """Index (n,) in `sample_numbers` of the first sample of each cell."""
        return np.asarray(np.cumsum(self.size) - self.size)

    def split_by_cell(self) -> list[NDArray[np.int64]]:
        """Return one array of samples for each cell."""
        return np.split(self.sample_numbers, self.first_sample_index[1:]) if self.size.size else []

    def select_cells(self, chosen: NDArray[np.bool_]) -> SampleSets:
        """Return the samples of the cells chosen by the flags `chosen` (n,)."""
        return SampleSets(self.sample_numbers[np.repeat(chosen, self.size)], self.size[chosen])

    def select_evenly(self, most: int) -> SampleSets:
        """Return at most `most` samples of each cell, at even distances in the order of its samples."""
        size = np.minimum(most, self.size)
        number = np.arange(size.sum()) - np.repeat(np.cumsum(size) - size, size)
        first, among, of = (np.repeat(x, size) for x in (self.first_sample_index, self.size, size))
        return SampleSets(self.sample_numbers[first + number * among // of], size)

    def cells_where_all(self, holds: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return flags (n,) of the cells where `holds` (k,) is true for all samples of the cell."""
        cell = np.repeat(np.arange(self.size.size), self.size)
        return np.asarray(np.bincount(cell[~holds], minlength=self.size.size) == 0)

    def largest_by_cell(self, values: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the largest of `values` (indexed by sample number) in each cell, (n,). No cell may be empty."""
        return np.asarray(np.maximum.reduceat(values[self.sample_numbers], self.first_sample_index))

    def smallest_by_cell(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the smallest of `values` (indexed by sample number) in each cell, (n,). No cell may be empty."""
        return (
            np.asarray(np.minimum.reduceat(values[self.sample_numbers], self.first_sample_index))
            if self.size.size
            else np.zeros(0)
        )


@dataclass(frozen=True, eq=False)
class KnownOrbits(StructOfArrays):
    """Stable orbits known in each cell: arrays (n_cells, room), of which the first n entries of a row are used.

    An orbit has its label (m, n₊, n₋), its fastest point (τ, v), and ln|multiplier|/m of both multipliers: `first` and
    `second`. `contacts` is the number of contact phases in a period. A label counts a run of impacts that ends in
    contact as one impact; `merged` is the number of impacts on Σ⁺ that the label leaves out for this reason. `contacts`
    and `merged` are 0 for elastic impacts.
    """

    n: Any
    m: Any
    n_plus: Any
    n_minus: Any
    tau: Any
    v: Any
    first: Any
    second: Any
    contacts: Any
    merged: Any


@dataclass(frozen=True, eq=False)
class CaptureRegions(StructOfArrays):
    """Capture regions around points (τ, v) of the known orbits: arrays (n_cells, room), the first n of a row are used.

    A state is captured where c00 Δτ² + 2 c01 Δτ Δv + c11 Δv² < 1. `orbit` is the number of the orbit in its cell.
    """

    n: Any
    orbit: Any
    tau: Any
    v: Any
    c00: Any
    c01: Any
    c11: Any


TrajectoryColumns = define_kernel_columns("TrajectoryColumns", Trajectories, __name__)
OrbitColumns = define_kernel_columns("OrbitColumns", KnownOrbits, __name__)
BallColumns = define_kernel_columns("BallColumns", CaptureRegions, __name__)


def create_orbit_tables(n_cells: int, room: int, balls_per_orbit: int) -> tuple[KnownOrbits, CaptureRegions]:
    """Return empty tables of orbits and of capture regions, with room for `room` orbits in each cell."""
    shape, balls = (n_cells, room), (n_cells, room * balls_per_orbit)
    orbits = KnownOrbits(
        n=np.zeros(n_cells, np.int64),
        **{name: np.zeros(shape, np.int64) for name in ("m", "n_plus", "n_minus", "contacts", "merged")},
        **{name: np.zeros(shape) for name in ("tau", "v", "first", "second")},
    )
    return orbits, CaptureRegions(
        n=np.zeros(n_cells, np.int64),
        orbit=np.zeros(balls, np.int64),
        **{name: np.zeros(balls) for name in ("tau", "v", "c00", "c01", "c11")},
    )


def copy_with_double_capacity(table: Known) -> Known:
    """Return a copy of a table (n_cells, room) with twice the room."""
    columns = table.columns()
    wider = {name: np.concatenate([x, np.zeros_like(x)], axis=1) for name, x in columns.items() if name != "n"}
    return table.replace(**wider)


@inline
def find_capturing_orbit(tau, v, cell, balls):
    """Return the number of the orbit of this cell whose capture region holds the state (τ, v), −1 if none does."""
    for p in range(balls.n[cell]):
        x, y = wrap_phase_difference(tau - balls.tau[cell, p]), v - balls.v[cell, p]
        if balls.c00[cell, p] * x * x + 2.0 * balls.c01[cell, p] * x * y + balls.c11[cell, p] * y * y < 1.0:
            return balls.orbit[cell, p]
    return -1


@inline
def bitmap_top_speed(epsilon, unit):
    """Return the speed at which a visited-cell bitmap ends. unit: the unit of speed differences (`speed_unit`)."""
    return min(DRIFT + largest_forcing_slope(epsilon), HIGHEST_BITMAP_SPEED * unit)


@inline
def mark_visited_cell(tau, v, top, footprint):
    """Set the bit of the state (τ, v) in a visited-cell bitmap.

    Rows are intervals of phase, bits of a row are intervals of speed from 0 to `top`. The last bit also stands for
    all higher speeds.
    """
    row = min(int(tau * GRID), GRID - 1)
    column = min(int(v / top * GRID), GRID - 1)
    footprint[row] |= np.uint64(1) << np.uint64(column)


class ReferenceState(NamedTuple):
    """A reference state of Brent's cycle search: the state after n returns.

    The state after `n_of_next_reference` returns is the next reference.
    """

    tau: float
    v: float
    n: int
    n_of_next_reference: int


@inline
def first_reference_state(tau, v):
    """Return the first reference state of Brent's cycle search: (τ, v), the state after 0 returns."""
    return ReferenceState(tau, v, 0, 1)


@inline
def check_sample_outcome(tau, v, n, k, reference, samples, balls, unit):
    """Check after n returns whether sample k is captured, or has returned close to the reference state.

    If it has returned, the number of returns since the reference state is written to `samples.gap`.

    Returns
    -------
    tuple
        (status, orbit, reference): the outcome, the number of the capturing orbit (−1 if none), and the reference state
        for the next check.
    """
    orbit = find_capturing_orbit(tau, v, samples.cell[k], balls)
    if orbit >= 0:
        return Outcome.PERIODIC, orbit, reference
    near = abs(v - reference.v) < RECURRENCE * unit and abs(wrap_phase_difference(tau - reference.tau)) < RECURRENCE
    if near and n > reference.n and samples.impacts[k] + n >= samples.pause[k]:
        samples.gap[k] = n - reference.n
        return Outcome.RECURRENT, -1, reference
    if n >= reference.n_of_next_reference:
        return Outcome.UNRESOLVED, -1, ReferenceState(tau, v, n, 2 * reference.n_of_next_reference)
    return Outcome.UNRESOLVED, -1, reference


@inline
def store_sample(tau, v, n, total, k, status, orbit, samples):
    """Write the state of sample k after n more returns, which took `total` forcing periods, and its outcome."""
    samples.tau[k], samples.v[k], samples.status[k], samples.orbit[k] = tau, v, status, orbit
    samples.impacts[k] += n
    samples.time[k] += total
