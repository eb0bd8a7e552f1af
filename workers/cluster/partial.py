"""Tiles in parts: a task computes cells of a tile for a few seconds, and another task continues with the rest."""

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

PART_SECONDS = 2.0  # longest task, unless one cell takes longer: surveys take turns between tasks
FEW = 16  # a tile with fewer cells has no parts
QUICK = 0.25  # a tile that takes less than this share of the seconds has no parts


@dataclass(frozen=True)
class PartialTile:
    """A partly computed tile.

    values: arrays of the whole tile. done (rows, columns): the computed cells; the gears of a population are one row.
    record: sums over these cells. slowest: seconds of a cell in the slowest group so far.
    """

    values: TileArrays
    done: np.ndarray
    record: TileRecord
    slowest: float

    @property
    def is_whole(self) -> bool:
        """True if all cells are computed."""
        return bool(self.done.all())


def is_divisible(request: AnyRequest, cells: int) -> bool:
    """Return whether a tile of so many cells can take long and be computed in parts.

    Closed forms take no time, and leaves of a refined survey share cells: these have no parts.

    Returns
    -------
    bool
        True if `compute_partly` may be used.
    """
    if cells < FEW:
        return False
    if isinstance(request, PopulationRequest):
        return True
    return request.refine is None and bool({*SAMPLED, Group.BASINS} & set(request.quantities))


def compute_partly(
    request: AnyRequest, tile: AnyTile, before: PartialTile | None, seconds: float, expected: float = math.inf
) -> PartialTile:
    """Compute further cells of a tile, for so many seconds.

    No cell depends on those that are computed with it, so results do not depend on the parts. The size of a group of
    cells follows from the slowest cells of the tile: corners and middle are computed first, each alone, for an
    estimate.

    Parameters
    ----------
    before : PartialTile | None
        The cells computed so far; None for none.
    seconds : float
        No further group of cells begins after these; at least one cell is computed.
    expected : float
        Seconds of a cell in the slowest part of the survey so far. A tile that is quick even at that rate is computed
        at once, because groups would take longer.

    Returns
    -------
    PartialTile
        The tile with more cells computed.
    """
    began = time.perf_counter()
    part = before or _nothing(tile)
    if before is None and expected * part.done.size < QUICK * seconds:
        return _extended(part, request, tile, *(slice(0, size) for size in part.done.shape))
    while True:
        left = max(seconds - (time.perf_counter() - began), 0.0)
        most = int(min(max(left / part.slowest, 1.0), part.done.size)) if part.slowest else 1
        part = _extended(part, request, tile, *_next_group(part.done, most))
        if part.is_whole or time.perf_counter() - began >= seconds:
            return part


def _nothing(tile: AnyTile) -> PartialTile:
    shape = tuple(span.stop - span.start for span in tile.spans)
    return PartialTile({}, np.zeros((1, *shape)[-2:], bool), TileRecord(tile.index, 0, (), 0, 0.0), 0.0)


def _next_group(done: np.ndarray, most: int) -> tuple[slice, slice]:
    """Return the rows and columns of the next cells, which are adjacent and at most so many."""
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


def _extended(part: PartialTile, request: AnyRequest, tile: AnyTile, rows: slice, columns: slice) -> PartialTile:
    began = time.perf_counter()
    values, record = compute_tile(request, _piece(tile, rows, columns))
    slowest = max((time.perf_counter() - began) / record.cells, part.slowest)
    arrays, done = {name: array.copy() for name, array in part.values.items()}, part.done.copy()
    for name, value in values.items():
        at: tuple[Any, ...] = (..., rows, columns) if isinstance(tile, Tile) else (columns, ...)
        if name not in arrays:
            arrays[name] = np.zeros(
                (*value.shape[:-2], *done.shape) if isinstance(tile, Tile) else (done.size, *value.shape[1:]),
                value.dtype,
            )
        arrays[name][at] = value
    done[rows, columns] = True
    return PartialTile(arrays, done, _sum(part.record, record), slowest)


def _piece(tile: AnyTile, rows: slice, columns: slice) -> AnyTile:
    """Return these rows and columns of a tile, as a tile with the same index."""
    if isinstance(tile, Tile):
        return replace(tile, epsilon=_within(tile.epsilon, rows), delta=_within(tile.delta, columns))
    return replace(tile, gear=_within(tile.gear, columns))


def _within(span: slice, part: slice) -> slice:
    return slice(span.start + part.start, span.start + part.stop)


def _sum(one: TileRecord, other: TileRecord) -> TileRecord:
    return TileRecord(
        one.index,
        one.cells + other.cells,
        tuple(sorted(one.failed_cells + other.failed_cells)),
        one.undecided_cells + other.undecided_cells,
        one.seconds + other.seconds,
        one.impacts + other.impacts,
        one.filled_cells + other.filled_cells,
    )
