"""Predict the costs of a run's tiles from some of their cells and from finished tiles, and the time left."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from gear_rattle.workers.cluster.partial import PartialTile
from gear_rattle.workers.kinds import AnyTile
from gear_rattle.workers.survey.tiles import TileRecord

MANY = 64  # cells are measured if a run has at least this many tiles; else its first finished tiles predict as well
MEASURED = 256  # at most this many tiles have measured cells
FEWEST, EACH = 128, 5  # at least FEWEST cells are measured in all tiles together, but at most EACH in one tile
#: The measured cells of a tile are kept if the tile has at most this many cells for each measured cell. In larger tiles
#: they are computed again with all others, which takes less time than computing the others without them.
KEPT = 64
NEAREST = 5  # a tile's cost is the mean of this many measured tiles near it, because a single one may be an exception
#: The ratio of measured and predicted seconds of the finished tiles is drawn towards 1: this multiple of the predicted
#: seconds of all tiles is added to both.
TRUST = 1.0
BITS = 20  # numbers of rows and columns of tiles have at most this many bits


@dataclass
class RunState:
    """State of a run of tiles, from which the run continues after a pause.

    partial: partly computed tiles, by index. foreseen: mean seconds per measured cell of a tile, by index of the tile.
    """

    partial: dict[int, PartialTile] = field(default_factory=dict)
    foreseen: dict[int, float] = field(default_factory=dict)
    _each: int = 1  # how many cells are measured in a tile
    _expected: dict[int, float] = field(default_factory=dict)  # predicted seconds of each remaining tile, by index
    _rest: float = 0.0  # sum of _expected
    _ended: float = 0.0  # predicted seconds of all finished tiles
    _spent: float = 0.0  # measured seconds of all finished tiles

    def tiles_to_measure(self, tiles: Sequence[AnyTile], columns: int) -> list[AnyTile]:
        """Return tiles, spread over the plane, in which cells are to be measured to predict costs; none for few tiles.

        columns: the number of columns of the grid of tiles.

        Returns
        -------
        list[AnyTile]
            So many that in all at most MEASURED tiles have measured cells; empty in a run of fewer than MANY tiles.
        """
        if len(tiles) + len(self.foreseen) < MANY:
            return []
        new = [tile for tile in tiles if tile.index not in self.foreseen]
        self._each = min(max(FEWEST // max(len(tiles), 1), 1), EACH)
        return spread_evenly(new, columns)[: MEASURED - len(self.foreseen)]

    def record_measured(self, tile: AnyTile) -> bool:
        """Record a tile's cost after one of its cells was measured. Return whether to measure another of its cells."""
        part = self.partial[tile.index]
        self.foreseen[tile.index] = part.record.seconds / part.record.cells
        if part.record.cells < self._each:
            return True
        if tile.n_cells > KEPT * self._each:
            del self.partial[tile.index]
        return False

    def record_ended(self, record: TileRecord) -> None:
        """Record the measured cost of a finished tile."""
        seconds = self._expected.pop(record.index)
        self._rest -= seconds
        self._ended += seconds
        self._spent += record.seconds

    def predict_costs(self, tiles: Sequence[AnyTile], columns: int) -> None:
        """Predict the cost of each remaining tile from the measured tiles near it. tiles: all remaining tiles.

        Without measurements a cell counts as one second, until finished tiles show how long a cell really takes.
        """
        self._expected = {tile.index: float(tile.n_cells) for tile in tiles}
        for index in self.partial.keys() - self._expected.keys():
            del self.partial[index]
        if self.foreseen and tiles:
            from scipy.spatial import KDTree  # imported here, because it takes a tenth of a second to load

            known = np.array(list(self.foreseen))
            wanted = np.array(list(self._expected))
            nearest = KDTree(np.stack(np.divmod(known, columns), axis=1))
            number = range(1, min(NEAREST, known.size) + 1)
            which = nearest.query(np.stack(np.divmod(wanted, columns), axis=1), number)[1]
            cells = np.array(list(self._expected.values()))
            seconds = cells * np.array(list(self.foreseen.values()))[which].mean(axis=1)
            self._expected = dict(zip(wanted.tolist(), seconds.tolist(), strict=True))
        self._rest = math.fsum(self._expected.values())

    def sort_by_cost(self, tiles: Sequence[AnyTile], columns: int) -> list[AnyTile]:
        """Sort tiles: first partly computed tiles, then by falling cost; equally expensive tiles spread over the plane.

        Fewer than MANY tiles keep their order.

        Returns
        -------
        list[AnyTile]
            The same tiles, in the order in which to compute them.
        """
        if len(tiles) + len(self.foreseen) < MANY:
            return list(tiles)
        return sorted(
            spread_evenly(tiles, columns),
            key=lambda tile: (tile.index not in self.partial, -self._expected[tile.index]),
        )

    def seconds_left(self, threads: int) -> float | None:
        """Return the seconds until all tiles have ended; None without threads, or before a cell or tile is measured."""
        trusted = TRUST * (self._ended + self._rest) if self.foreseen else 0.0
        if not threads or not self._ended + trusted:
            return None
        pace = (self._spent + trusted) / (self._ended + trusted)
        # The tiles with the highest predictions begin first, and many of these predictions are too high. So a ratio of
        # measured to predicted seconds below 1 in the finished tiles must not be extrapolated to the other tiles.
        if self.foreseen:
            pace = max(pace, 1.0)
        lefts, begun = [], 0.0
        for index, part in self.partial.items():
            done, seconds = part.record.cells, self._expected[index]
            begun += seconds
            if done < EACH:
                lefts.append(max(pace * seconds - part.record.seconds, 0.0))
            else:  # the tile's own computed cells predict better than its neighbours
                lefts.append(part.record.seconds / done * (part.done.size - done))
        others = pace * max(self._rest - begun, 0.0)
        return max((others + math.fsum(lefts)) / threads, max(lefts, default=0.0))


def spread_evenly(tiles: Iterable[AnyTile], columns: int) -> list[AnyTile]:
    """Sort tiles so that the first n tiles, for any n, spread over the plane. columns: number of columns of tiles.

    The order is that of ordered dithering: tiles with even row and column numbers come first, then the three groups of
    other parities. Within each of these four groups the same rule holds for half the numbers, and so on.

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
