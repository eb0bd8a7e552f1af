"""The blocks of a tile, and the leaves (squares of cells) of a block.

A tile is covered by blocks of BLOCK × BLOCK cells. A leaf is a square of cells that contains its own edges. A block
begins as one leaf. A leaf is divided into four quarters until all computed cells in it have the same motions.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from gear_rattle.workers.survey.refined.asked import BLOCK


class Leaves(NamedTuple):
    """Several leaves (squares of cells) of equal size; the arrays have shape (k,) for k leaves.

    block: the number of the block of each leaf. row, column: the leaf's first row and column in the block. size: a leaf
    of size n has n + 1 cells along a side; the last row and column of a leaf are also the first row and column of its
    neighbours.
    """

    block: np.ndarray
    row: np.ndarray
    column: np.ndarray
    size: int

    def select(self, which: np.ndarray) -> Leaves:
        """Return the leaves that an index or mask selects."""
        return Leaves(self.block[which], self.row[which], self.column[which], self.size)


class LeafCells(NamedTuple):
    """The cells of k leaves (squares of cells); the arrays have shape (k, size + 1, size + 1).

    block: the number of each cell's block. row, column: the cell's position in the block. inside: whether the cell is
    in the grid.
    """

    block: np.ndarray
    row: np.ndarray
    column: np.ndarray
    inside: np.ndarray


@dataclass(frozen=True, eq=False)
class Blocks:
    """The blocks that cover the cells rows × columns of a grid. grid: the shape of the grid.

    The frame consists of these cells and of the next row and the next column of the grid, if the grid has them. The
    added row and column are the far edges of the last blocks.
    """

    rows: slice
    columns: slice
    grid: tuple[int, int]

    @cached_property
    def frame(self) -> tuple[slice, slice]:
        """The ranges of rows and columns of the grid that the frame (see `Blocks`) covers."""
        found = (slice(s.start, min(s.stop + 1, n)) for s, n in zip((self.rows, self.columns), self.grid, strict=True))
        rows, columns = found
        return rows, columns

    @cached_property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns of the frame (see `Blocks`)."""
        rows, columns = self.frame
        return rows.stop - rows.start, columns.stop - columns.start

    @cached_property
    def block_origins(self) -> tuple[np.ndarray, np.ndarray]:
        """First row and first column of each block (blocks,), counted from the start of the frame (see `Blocks`)."""
        down, right = (np.arange(0, span.stop - span.start, BLOCK) for span in (self.rows, self.columns))
        return np.repeat(down, right.size), np.tile(right, down.size)

    @cached_property
    def last_indices(self) -> tuple[np.ndarray, np.ndarray]:
        """The last row and the last column of each block (blocks,), counted from the block's first row and column."""
        top, left = self.block_origins
        return np.minimum(BLOCK, self.shape[0] - 1 - top), np.minimum(BLOCK, self.shape[1] - 1 - left)

    @property
    def n_cells(self) -> int:
        """Number of cells of the frame (see `Blocks`)."""
        return self.shape[0] * self.shape[1]

    def undivided_leaves(self) -> Leaves:
        """Return the leaves before any division: one leaf for each block, which covers the whole block."""
        number = np.arange(self.block_origins[0].size)
        return Leaves(number, np.zeros_like(number), np.zeros_like(number), BLOCK)

    def divide_leaves(self, leaves: Leaves) -> Leaves:
        """Return the quarters of each leaf; at the end of a grid, quarters without cells of their own are left out."""
        half = leaves.size // 2
        block, row, column = (np.repeat(x, 4) for x in leaves[:3])
        row = row + np.tile([0, 0, half, half], leaves.block.size)
        column = column + np.tile([0, half, 0, half], leaves.block.size)
        last = self.last_indices[0][block], self.last_indices[1][block]
        there = ((row < last[0]) | (row == 0)) & ((column < last[1]) | (column == 0))
        return Leaves(block, row, column, half).select(there)

    def cells_of_leaves(self, leaves: Leaves) -> LeafCells:
        """Return the cells of these leaves; `inside` is False for positions outside the grid."""
        along = np.arange(leaves.size + 1)
        row, column = leaves.row[:, None] + along, leaves.column[:, None] + along
        block = leaves.block[:, None]
        inside = (row <= self.last_indices[0][block])[:, :, None] & (column <= self.last_indices[1][block])[:, None, :]
        row, column = np.minimum(row, self.last_indices[0][block]), np.minimum(column, self.last_indices[1][block])
        shape = inside.shape
        return LeafCells(
            np.broadcast_to(block[:, :, None], shape),
            np.broadcast_to(row[:, :, None], shape),
            np.broadcast_to(column[:, None, :], shape),
            inside,
        )

    def cell_numbers(self, square: LeafCells) -> np.ndarray:
        """Return the numbers of the cells of leaves. The cells of the frame (see `Blocks`) are numbered row by row."""
        block, row, column = square.block[:, :1, :1], square.row[:, :, :1], square.column[:, :1]
        top, left = (corner[block] for corner in self.block_origins)
        number: np.ndarray = (top + row) * self.shape[1] + left + column
        return number

    def edge_cells(self, leaves: Leaves) -> np.ndarray:
        """Return the numbers of the cells on the edges of leaves, sorted and without repetition."""
        square = self.cells_of_leaves(leaves)
        row, column = square.row, square.column
        ends = (row[:, :1], row[:, -1:]), (column[:, :, :1], column[:, :, -1:])
        on = (row == ends[0][0]) | (row == ends[0][1]) | (column == ends[1][0]) | (column == ends[1][1])
        return self.sort_without_repetitions(self.cell_numbers(square)[on])

    def sort_without_repetitions(self, cells: np.ndarray) -> np.ndarray:
        """Return the numbers of cells sorted and without repetitions, ten times as fast as `np.unique`."""
        there = np.zeros(self.n_cells, bool)
        there[cells] = True
        return np.flatnonzero(there)


def concatenate_leaves(parts: Iterable[Leaves]) -> Leaves:
    """Return all leaves of several groups as one group. The leaves must have the same size."""
    many = list(parts)
    block, row, column = (np.concatenate(x) for x in zip(*(each[:3] for each in many), strict=True))
    return Leaves(block, row, column, many[0].size)
