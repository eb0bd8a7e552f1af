"""Costs of the tiles of a run: predicted from some of their cells, measured when they end, and the time left."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from gear_rattle.workers.cluster.partial import PartialTile
from gear_rattle.workers.kinds import AnyTile
from gear_rattle.workers.survey.tiles import TileRecord

MANY = 64  # tiles from which cells are measured: with fewer, the first finished tiles say as much
MEASURED = 256  # the most tiles of which cells are computed for their cost ...
FEWEST, EACH = 128, 5  # ... the fewest such cells of all tiles, and the most of one tile
KEPT = 64  # the most cells of a tile whose measured cell is kept; in larger tiles it is computed again with the others
NEAREST = 5  # measured cells whose mean predicts a tile's cost: a single one may be expensive by chance
TRUST = 1.0  # weight of the predictions relative to the measured seconds of finished tiles
BITS = 20  # bits of the number of a row or column of tiles


@dataclass
class Begun:
    """State of a run, with which it continues after a pause.

    partial: partly computed tiles, by index. foreseen: predicted seconds of a cell of a tile, by index.
    """

    partial: dict[int, PartialTile] = field(default_factory=dict)
    foreseen: dict[int, float] = field(default_factory=dict)
    _each: int = 1  # measured cells of a tile
    _expected: dict[int, float] = field(default_factory=dict)  # predicted seconds of each tile that is left ...
    _rest: float = 0.0  # ... and of all of them
    _ended: float = 0.0  # predicted seconds of the finished tiles, and measured ones (_spent)
    _spent: float = 0.0

    def to_measure(self, tiles: Sequence[AnyTile], columns: int) -> list[AnyTile]:
        """Return the tiles, of a grid with so many columns, of which cells are computed to predict the cost."""
        if len(tiles) + len(self.foreseen) < MANY:
            return []
        new = [tile for tile in tiles if tile.index not in self.foreseen]
        self._each = min(max(FEWEST // max(len(tiles), 1), 1), EACH)
        return evenly(new, columns)[: MEASURED - len(self.foreseen)]

    def take_measured(self, tile: AnyTile) -> bool:
        """Note the cost of a tile after one more of its cells; return whether it needs further cells."""
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
        """Predict the cost of each of these tiles, which are all that are left, from measured tiles near it.

        Without any measurement a cell counts as one second, until finished tiles show the pace.
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
        """Sort tiles: partly computed ones, then the most expensive ones; equally expensive ones spread over the plane.

        Few tiles stay in their order.

        Returns
        -------
        list[AnyTile]
            The same tiles, the first to be computed first.
        """
        if len(tiles) + len(self.foreseen) < MANY:
            return list(tiles)
        return sorted(
            evenly(tiles, columns), key=lambda tile: (tile.index not in self.partial, -self._expected[tile.index])
        )

    def seconds_left(self, threads: int) -> float | None:
        """Return the seconds until all tiles have ended; None if nothing has been measured."""
        trusted = TRUST * (self._ended + self._rest) if self.foreseen else 0.0
        if not threads or not self._ended + trusted:
            return None
        pace = (self._spent + trusted) / (self._ended + trusted)
        if self.foreseen:  # overestimated tiles begin first, so their savings must not be extrapolated to the others
            pace = max(pace, 1.0)
        lefts, begun = [], 0.0
        for index, part in self.partial.items():
            done, seconds = part.record.cells, self._expected[index]
            begun += seconds
            if done < EACH:
                lefts.append(max(pace * seconds - part.record.seconds, 0.0))
            else:  # the tile's own cells predict better
                lefts.append(part.record.seconds / done * (part.done.size - done))
        others = pace * max(self._rest - begun, 0.0)
        return max((others + math.fsum(lefts)) / threads, max(lefts, default=0.0))


def evenly(tiles: Iterable[AnyTile], columns: int) -> list[AnyTile]:
    """Sort tiles of a grid with so many columns so that the first ones, however many, are spread over the plane.

    Every second row and column comes before the others, among these every second one first, and so on, as in ordered
    dithering.

    Returns
    -------
    list[AnyTile]
        The same tiles, reordered.
    """
    tiles = list(tiles)
    rows, across = np.divmod(np.array([tile.index for tile in tiles], np.int64), columns)
    rank = np.zeros(len(tiles), np.int64)
    for bit in range(BITS):
        rank += ((rows >> bit & 1) + 2 * (across >> bit & 1)) << (2 * (BITS - bit))
    return [tiles[place] for place in np.argsort(rank, kind="stable").tolist()]
