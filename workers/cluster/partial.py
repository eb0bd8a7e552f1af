"""Compute tiles in parts: a task computes cells of a tile for a few seconds, and the next task continues."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gear_rattle.workers.kinds import AnyRequest, AnyTile, compute_tile
from gear_rattle.workers.populations.request import PopulationRequest
from gear_rattle.workers.survey.tiles import Tile, TileArrays, TileRecord
from gear_rattle.workers.survey.values.schema import SAMPLED, Group

PART_SECONDS = 2.0  # intended duration of a task, short so that other tasks can begin soon
FEW = 16  # a tile with fewer cells is not computed in parts
QUICK_SHARE = 0.25  # a tile expected to take less than this share of a task's time is not divided


@dataclass(frozen=True)
class PartialTile:
    """A partly computed tile.

    values: arrays of the whole tile, 0 in cells that are not computed.
    is_computed (rows, columns): flags of the computed cells; the gears of a population are one row.
    record: sums over the computed cells. slowest_seconds_per_cell: seconds per cell of the slowest group of cells so
    far.
    """

    values: TileArrays
    is_computed: np.ndarray
    record: TileRecord
    slowest_seconds_per_cell: float

    @property
    def is_whole(self) -> bool:
        """True if all cells are computed."""
        return bool(self.is_computed.all())


def is_tile_divisible(request: AnyRequest, cells: int) -> bool:
    """Return whether a tile with this number of cells may take long, and can be computed in parts.

    Tiles of quantities in closed form take no time. Tiles of a refined survey cannot be divided, because the leaves
    (squares of cells that are filled from their rims) share cells.

    Returns
    -------
    bool
        True if `compute_tile_partly` may be used.
    """
    if cells < FEW:
        return False
    if isinstance(request, PopulationRequest):
        return True
    return request.refine is None and bool({*SAMPLED, Group.BASINS} & set(request.quantities))


def compute_tile_partly(
    request: AnyRequest, tile: AnyTile, before: PartialTile | None, seconds: float, expected: float = math.inf
) -> PartialTile:
    """Compute further cells of a tile for some seconds.

    No cell depends on other cells, so results do not depend on the division into parts. Cells are computed in groups.
    The middle and the corners are computed first, each alone; the size of all other groups follows from the slowest
    group so far.

    Parameters
    ----------
    before : PartialTile | None
        The tile with the cells computed so far; None at first.
    seconds : float
        No further group begins after this time. At least one cell is computed.
    expected : float
        Seconds per cell of the slowest part of the survey so far. A tile that takes little time even at this rate is
        computed at once, because dividing it into groups would take longer.

    Returns
    -------
    PartialTile
        The tile with more cells computed.
    """
    began = time.perf_counter()
    part = before or _create_empty_part(tile)
    if before is None and expected * part.is_computed.size < QUICK_SHARE * seconds:
        return _compute_group_of_cells(part, request, tile, *(slice(0, size) for size in part.is_computed.shape))
    while True:
        left = max(seconds - (time.perf_counter() - began), 0.0)
        most = (
            int(min(max(left / part.slowest_seconds_per_cell, 1.0), part.is_computed.size))
            if part.slowest_seconds_per_cell
            else 1
        )
        part = _compute_group_of_cells(part, request, tile, *_next_group_of_cells(part.is_computed, most))
        if part.is_whole or time.perf_counter() - began >= seconds:
            return part


def _create_empty_part(tile: AnyTile) -> PartialTile:
    shape = tuple(span.stop - span.start for span in tile.spans)
    return PartialTile({}, np.zeros((1, *shape)[-2:], bool), TileRecord(tile.index, 0, (), 0, 0.0), 0.0)


def _next_group_of_cells(done: np.ndarray, most: int) -> tuple[slice, slice]:
    """Return the rows and columns of the next group: at most `most` adjacent cells that are not computed yet."""
    rows, columns = done.shape
    for i, j in ((rows // 2, columns // 2), (0, 0), (0, -1), (-1, 0), (-1, -1)):
        if not done[i, j]:
            i, j = i % rows, j % columns
            return slice(i, i + 1), slice(j, j + 1)
    row, first = divmod(int(np.argmin(done)), columns)
    if first == 0 and most >= columns:
        is_begun = np.any(done[row : row + most // columns], axis=1)
        if not is_begun[0]:
            return slice(row, row + (int(np.argmax(is_begun)) if is_begun.any() else is_begun.size)), slice(0, columns)
    free = done[row, first : first + most]
    return slice(row, row + 1), slice(first, first + (int(np.argmax(free)) if free.any() else free.size))


def _compute_group_of_cells(
    part: PartialTile, request: AnyRequest, tile: AnyTile, rows: slice, columns: slice
) -> PartialTile:
    began = time.perf_counter()
    values, record = compute_tile(request, _subtile(tile, rows, columns))
    slowest = max((time.perf_counter() - began) / record.cells, part.slowest_seconds_per_cell)
    arrays, done = {name: array.copy() for name, array in part.values.items()}, part.is_computed.copy()
    for name, value in values.items():
        at: tuple[Any, ...] = (..., rows, columns) if isinstance(tile, Tile) else (columns, ...)
        if name not in arrays:
            arrays[name] = np.zeros(
                (*value.shape[:-2], *done.shape) if isinstance(tile, Tile) else (done.size, *value.shape[1:]),
                value.dtype,
            )
        arrays[name][at] = value
    done[rows, columns] = True
    return PartialTile(arrays, done, _sum_records(part.record, record), slowest)


def _subtile(tile: AnyTile, rows: slice, columns: slice) -> AnyTile:
    """Return some rows and columns of a tile as a tile with the same index."""
    if isinstance(tile, Tile):
        return replace(tile, epsilon=_subslice(tile.epsilon, rows), delta=_subslice(tile.delta, columns))
    return replace(tile, gear=_subslice(tile.gear, columns))


def _subslice(span: slice, part: slice) -> slice:
    return slice(span.start + part.start, span.start + part.stop)


def _sum_records(first: TileRecord, second: TileRecord) -> TileRecord:
    return TileRecord(
        first.index,
        first.cells + second.cells,
        tuple(sorted(first.failed_cells + second.failed_cells)),
        first.undecided_cells + second.undecided_cells,
        first.seconds + second.seconds,
        first.impacts + second.impacts,
        first.filled_cells + second.filled_cells,
    )
