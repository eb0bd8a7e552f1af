"""The blocks of a tile, and their leaves: squares of cells with their edges, halved until nothing differs inside."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from gear_rattle.workers.survey.refined.asked import BLOCK


class Leaves(NamedTuple):
    """Squares (k,) of equal size: their block, and their first row and column in it.

    A leaf of size n has n + 1 cells a side: its last row and column are the first ones of the next leaves.
    """

    block: np.ndarray
    row: np.ndarray
    column: np.ndarray
    size: int

    def of(self, which: np.ndarray) -> Leaves:
        """Return a selection of the leaves."""
        return Leaves(self.block[which], self.row[which], self.column[which], self.size)


class Square(NamedTuple):
    """The cells of leaves (k, size + 1, size + 1): block, row and column in it; `inside`: whether it is in the grid."""

    block: np.ndarray
    row: np.ndarray
    column: np.ndarray
    inside: np.ndarray


@dataclass(frozen=True, eq=False)
class Blocks:
    """The blocks of the cells rows × columns of a grid of this shape.

    The frame is these cells with the next row and column of the grid, if there are any: the last edges of its blocks.
    """

    rows: slice
    columns: slice
    grid: tuple[int, int]

    @cached_property
    def frame(self) -> tuple[slice, slice]:
        """Rows and columns of the frame in the grid."""
        found = (slice(s.start, min(s.stop + 1, n)) for s, n in zip((self.rows, self.columns), self.grid, strict=True))
        rows, columns = found
        return rows, columns

    @cached_property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns of the frame."""
        rows, columns = self.frame
        return rows.stop - rows.start, columns.stop - columns.start

    @cached_property
    def corners(self) -> tuple[np.ndarray, np.ndarray]:
        """First row and column of each block in the frame (blocks,)."""
        down, right = (np.arange(0, span.stop - span.start, BLOCK) for span in (self.rows, self.columns))
        return np.repeat(down, right.size), np.tile(right, down.size)

    @cached_property
    def last(self) -> tuple[np.ndarray, np.ndarray]:
        """The last row and column of each block (blocks,), its far edges included."""
        top, left = self.corners
        return np.minimum(BLOCK, self.shape[0] - 1 - top), np.minimum(BLOCK, self.shape[1] - 1 - left)

    @property
    def n_cells(self) -> int:
        """Number of cells of the frame."""
        return self.shape[0] * self.shape[1]

    def whole(self) -> Leaves:
        """Return one leaf for each block."""
        number = np.arange(self.corners[0].size)
        return Leaves(number, np.zeros_like(number), np.zeros_like(number), BLOCK)

    def halves(self, leaves: Leaves) -> Leaves:
        """Return the four quarters of leaves, without those that have no cell inside."""
        half = leaves.size // 2
        block, row, column = (np.repeat(x, 4) for x in leaves[:3])
        row = row + np.tile([0, 0, half, half], leaves.block.size)
        column = column + np.tile([0, half, 0, half], leaves.block.size)
        last = self.last[0][block], self.last[1][block]
        there = ((row < last[0]) | (row == 0)) & ((column < last[1]) | (column == 0))
        return Leaves(block, row, column, half).of(there)

    def square(self, leaves: Leaves) -> Square:
        """Return the cells of leaves."""
        along = np.arange(leaves.size + 1)
        row, column = leaves.row[:, None] + along, leaves.column[:, None] + along
        block = leaves.block[:, None]
        inside = (row <= self.last[0][block])[:, :, None] & (column <= self.last[1][block])[:, None, :]
        row, column = np.minimum(row, self.last[0][block]), np.minimum(column, self.last[1][block])
        shape = inside.shape
        return Square(
            np.broadcast_to(block[:, :, None], shape),
            np.broadcast_to(row[:, :, None], shape),
            np.broadcast_to(column[:, None, :], shape),
            inside,
        )

    def cell(self, square: Square) -> np.ndarray:
        """Return the numbers of cells in the frame."""
        block, row, column = square.block[:, :1, :1], square.row[:, :, :1], square.column[:, :1]
        top, left = (corner[block] for corner in self.corners)
        number: np.ndarray = (top + row) * self.shape[1] + left + column
        return number

    def edges(self, leaves: Leaves) -> np.ndarray:
        """Return the cells of the frame on an edge of leaves, each once, sorted."""
        square = self.square(leaves)
        row, column = square.row, square.column
        ends = (row[:, :1], row[:, -1:]), (column[:, :, :1], column[:, :, -1:])
        on = (row == ends[0][0]) | (row == ends[0][1]) | (column == ends[1][0]) | (column == ends[1][1])
        return self.each_once(self.cell(square)[on])

    def each_once(self, cells: np.ndarray) -> np.ndarray:
        """Return cells of the frame sorted and each once; `np.unique` takes ten times as long."""
        there = np.zeros(self.n_cells, bool)
        there[cells] = True
        return np.flatnonzero(there)


def cells_together(parts: Iterable[Leaves]) -> Leaves:
    """Return leaves of one size in one table."""
    many = list(parts)
    block, row, column = (np.concatenate(x) for x in zip(*(each[:3] for each in many), strict=True))
    return Leaves(block, row, column, many[0].size)
