"""Costs of the tiles of a run: foreseen by some of their cells, measured as they end, and the time left."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from gear_rattle.workers.cluster.partial import PartialTile
from gear_rattle.workers.kinds import AnyTile
from gear_rattle.workers.survey.tiles import TileRecord

MANY = 64  # tiles: of fewer, the first ones tell as much as a cell of each
MEASURED = 256  # tiles of which cells are computed for their cost, at most ...
FEWEST, EACH = 128, 5  # ... so many cells in all at least, so many of one tile at most
KEPT = 64  # cells of a tile whose first cell is kept, not computed again with the others
NEAREST = 5  # measured cells whose mean is expected of a tile: the most expensive of single ones are so by chance
TRUST = 1.0  # what all that was foreseen counts beside what tiles have taken
BITS = 20  # of the number of a row or column of tiles


@dataclass
class Begun:
    """A run as far as it is: after a pause it goes on with the same object.

    partial: tiles of which a part is computed, by index. foreseen: seconds of a cell of tiles, by index.
    """

    partial: dict[int, PartialTile] = field(default_factory=dict)
    foreseen: dict[int, float] = field(default_factory=dict)
    _each: int = 1  # cells that are measured of a tile
    _expected: dict[int, float] = field(default_factory=dict)  # seconds of each tile that is left ...
    _rest: float = 0.0  # ... and of all of them
    _ended: float = 0.0  # that were expected of the tiles that have ended, and what these took
    _spent: float = 0.0

    def to_measure(self, tiles: Sequence[AnyTile], columns: int) -> list[AnyTile]:
        """Return the tiles of a grid with so many columns of which cells are to be computed for their cost."""
        if len(tiles) + len(self.foreseen) < MANY:
            return []
        new = [tile for tile in tiles if tile.index not in self.foreseen]
        self._each = min(max(FEWEST // max(len(tiles), 1), 1), EACH)
        return evenly(new, columns)[: MEASURED - len(self.foreseen)]

    def take_measured(self, tile: AnyTile) -> bool:
        """Note the cost of a tile of which a cell has been computed; whether more of them have to be."""
        part = self.partial[tile.index]
        self.foreseen[tile.index] = part.record.seconds / part.record.cells
        if part.record.cells < self._each:
            return True
        if tile.n_cells > KEPT * self._each:
            del self.partial[tile.index]
        return False

    def take_ended(self, record: TileRecord) -> None:
        """Note what a tile has cost."""
        seconds = self._expected.pop(record.index)
        self._rest -= seconds
        self._ended += seconds
        self._spent += record.seconds

    def expect(self, tiles: Sequence[AnyTile], columns: int) -> None:
        """Expect each of these tiles, all that are left, to cost what was foreseen near it.

        Without anything foreseen, one second a cell, until what ends tells the pace.
        """
        self._expected = {tile.index: float(tile.n_cells) for tile in tiles}
        for index in self.partial.keys() - self._expected.keys():
            del self.partial[index]
        if self.foreseen and tiles:
            from scipy.spatial import KDTree  # takes a tenth of a second to load, which workers need not

            known = np.array(list(self.foreseen))
            wanted = np.array(list(self._expected))
            nearest = KDTree(np.stack(np.divmod(known, columns), axis=1))
            number = range(1, min(NEAREST, known.size) + 1)
            which = nearest.query(np.stack(np.divmod(wanted, columns), axis=1), number)[1]
            cells = np.array(list(self._expected.values()))
            seconds = cells * np.array(list(self.foreseen.values()))[which].mean(axis=1)
            self._expected = dict(zip(wanted.tolist(), seconds.tolist(), strict=True))
        self._rest = math.fsum(self._expected.values())

    def in_order(self, tiles: Sequence[AnyTile], columns: int) -> list[AnyTile]:
        """Sort tiles: those that were begun, then the most expensive ones, of equal ones all over the plane.

        A few stay in their order.

        Returns
        -------
        list[AnyTile]
            The tiles in order.
        """
        if len(tiles) + len(self.foreseen) < MANY:
            return list(tiles)
        return sorted(
            evenly(tiles, columns), key=lambda tile: (tile.index not in self.partial, -self._expected[tile.index])
        )

    def seconds_left(self, threads: int) -> float | None:
        """Return the seconds until all tiles have ended; None if nothing tells them."""
        trusted = TRUST * (self._ended + self._rest) if self.foreseen else 0.0
        if not threads or not self._ended + trusted:
            return None
        pace = (self._spent + trusted) / (self._ended + trusted)
        if self.foreseen:  # tiles of which too much was expected begin, so that what they save is not saved again
            pace = max(pace, 1.0)
        lefts, begun = [], 0.0
        for index, part in self.partial.items():
            done, seconds = part.record.cells, self._expected[index]
            begun += seconds
            if done < EACH:
                lefts.append(max(pace * seconds - part.record.seconds, 0.0))
            else:  # its own cells tell more
                lefts.append(part.record.seconds / done * (part.done.size - done))
        others = pace * max(self._rest - begun, 0.0)
        return max((others + math.fsum(lefts)) / threads, max(lefts, default=0.0))


def evenly(tiles: Iterable[AnyTile], columns: int) -> list[AnyTile]:
    """Sort tiles of a grid with so many columns so that the first ones, however many, are spread over the plane.

    Every second row and column comes before the others, of these every second one first, and so on, as in ordered
    dithering.

    Returns
    -------
    list[AnyTile]
        The tiles in order.
    """

    def rank(tile: AnyTile) -> int:
        row, column = divmod(tile.index, columns)
        bits = ((row >> bit & 1) + 2 * (column >> bit & 1) for bit in range(BITS))
        return sum(pair << (2 * (BITS - place)) for place, pair in enumerate(bits))

    return sorted(tiles, key=rank)
