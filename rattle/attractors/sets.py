"""Samples of several cells, cell by cell: what is done with those of every cell, without a loop over cells."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Sets(NamedTuple):
    """The samples (k,) of cells (n,), those of a cell on end, and how many each cell has."""

    which: NDArray[np.int64]
    size: NDArray[np.int64]

    @property
    def starts(self) -> NDArray[np.int64]:
        """Where each cell's samples begin, (n,)."""
        return np.asarray(np.cumsum(self.size) - self.size)

    def each(self) -> list[NDArray[np.int64]]:
        """The samples of each cell."""
        return np.split(self.which, self.starts[1:]) if self.size.size else []

    def only(self, chosen: NDArray[np.bool_]) -> Sets:
        """Those of the chosen cells, chosen (n,)."""
        return Sets(self.which[np.repeat(chosen, self.size)], self.size[chosen])

    def evenly(self, most: int) -> Sets:
        """At most so many samples of each cell, evenly among them."""
        size = np.minimum(most, self.size)
        number = np.arange(size.sum()) - np.repeat(np.cumsum(size) - size, size)
        first, among, of = (np.repeat(x, size) for x in (self.starts, self.size, size))
        return Sets(self.which[first + number * among // of], size)

    def all_of(self, holds: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Of which cells it holds for all samples, from samples (k,)."""
        cell = np.repeat(np.arange(self.size.size), self.size)
        return np.asarray(np.bincount(cell[~holds], minlength=self.size.size) == 0)

    def largest(self, values: NDArray[np.int64]) -> NDArray[np.int64]:
        """The largest of these values of samples in each cell, none of which is without."""
        return np.asarray(np.maximum.reduceat(values[self.which], self.starts))

    def smallest(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """The smallest, likewise."""
        return np.asarray(np.minimum.reduceat(values[self.which], self.starts)) if self.size.size else np.zeros(0)
