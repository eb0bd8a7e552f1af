"""Predict the costs of a run's tiles and the run's remaining time, from a few measured cells and finished tiles."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from gear_rattle.workers.cluster.partial import PartialTile
from gear_rattle.workers.kinds import AnyTile
from gear_rattle.workers.survey.tiles import TileRecord

MANY = 64  # in a run of fewer tiles no cells are measured, because finished tiles soon predict the costs as well
MOST_MEASURED_TILES = 256  # at most this many tiles have measured cells
# number of measured cells in each tile: LEAST_MEASURED divided by the number of tiles, rounded down, but at least one
# cell and at most MOST_PER_TILE cells
LEAST_MEASURED, MOST_PER_TILE = 128, 5
#: The values of a tile's measured cells are kept if the tile has at most this many cells for each measured cell. In a
#: larger tile they are computed again: a computation of all cells takes less time than one that leaves out a few cells.
KEPT = 64
NEAREST = 5  # a tile's cost is the mean of this many measured tiles near it, because a single tile may be untypical
#: Predictions are corrected by (measured + w) / (predicted + w), from measured and predicted seconds of finished tiles.
#: The weight w is this multiple of the predicted seconds of all tiles, so that few finished tiles change little.
PREDICTION_WEIGHT = 1.0
BITS = 20  # row numbers and column numbers of tiles have at most this many bits


@dataclass
class RunState:
    """State of a run of tiles, from which the run continues after a pause.

    partial: partly computed tiles, by index. seconds_per_cell: mean time of the measured cells of each tile that has
    such cells, by index of the tile.
    """

    partial: dict[int, PartialTile] = field(default_factory=dict)
    seconds_per_cell: dict[int, float] = field(default_factory=dict)
    _cells_per_tile: int = 1  # number of cells to measure in each tile that is measured
    _expected: dict[int, float] = field(default_factory=dict)  # predicted seconds of each remaining tile, by index
    _remaining: float = 0.0  # predicted seconds of all remaining tiles
    _predicted_finished_seconds: float = 0.0  # predicted seconds of all finished tiles
    _measured_finished_seconds: float = 0.0  # measured seconds of all finished tiles

    def tiles_to_measure(self, tiles: Sequence[AnyTile], columns: int) -> list[AnyTile]:
        """Return tiles, spread over the plane, of which some cells are to be computed first, to predict costs.

        columns: the number of columns of the grid of tiles.

        Returns
        -------
        list[AnyTile]
            Tiles without measured cells, so few that at most MOST_MEASURED_TILES tiles are measured in the whole run.
            Empty in a run of fewer than MANY tiles.
        """
        if len(tiles) + len(self.seconds_per_cell) < MANY:
            return []
        new = [tile for tile in tiles if tile.index not in self.seconds_per_cell]
        self._cells_per_tile = min(max(LEAST_MEASURED // max(len(tiles), 1), 1), MOST_PER_TILE)
        return sort_tiles_evenly(new, columns)[: MOST_MEASURED_TILES - len(self.seconds_per_cell)]

    def record_measured_cell(self, tile: AnyTile) -> bool:
        """Record a tile's cost after one of its cells was measured. Return whether to measure another of its cells."""
        part = self.partial[tile.index]
        self.seconds_per_cell[tile.index] = part.record.seconds / part.record.cells
        if part.record.cells < self._cells_per_tile:
            return True
        if tile.n_cells > KEPT * self._cells_per_tile:
            del self.partial[tile.index]
        return False

    def record_finished_tile(self, record: TileRecord) -> None:
        """Record the measured cost of a finished tile."""
        seconds = self._expected.pop(record.index)
        self._remaining -= seconds
        self._predicted_finished_seconds += seconds
        self._measured_finished_seconds += record.seconds

    def predict_costs(self, tiles: Sequence[AnyTile], columns: int) -> None:
        """Predict the cost of each remaining tile from the measured tiles near it. tiles: all remaining tiles.

        Without measurements a cell counts as one second, until finished tiles show how long a cell really takes.
        """
        self._expected = {tile.index: float(tile.n_cells) for tile in tiles}
        for index in self.partial.keys() - self._expected.keys():
            del self.partial[index]
        if self.seconds_per_cell and tiles:
            from scipy.spatial import KDTree  # imported here, because it takes a tenth of a second to load

            known = np.array(list(self.seconds_per_cell))
            wanted = np.array(list(self._expected))
            nearest = KDTree(np.stack(np.divmod(known, columns), axis=1))
            number = range(1, min(NEAREST, known.size) + 1)
            which = nearest.query(np.stack(np.divmod(wanted, columns), axis=1), number)[1]
            cells = np.array(list(self._expected.values()))
            seconds = cells * np.array(list(self.seconds_per_cell.values()))[which].mean(axis=1)
            self._expected = dict(zip(wanted.tolist(), seconds.tolist(), strict=True))
        self._remaining = math.fsum(self._expected.values())

    def sort_by_cost(self, tiles: Sequence[AnyTile], columns: int) -> list[AnyTile]:
        """Sort tiles: first partly computed tiles, then by falling cost; equally expensive tiles spread over the plane.

        In a run of fewer than MANY tiles the order does not change.

        Returns
        -------
        list[AnyTile]
            The same tiles, in the order in which to compute them.
        """
        if len(tiles) + len(self.seconds_per_cell) < MANY:
            return list(tiles)
        return sorted(
            sort_tiles_evenly(tiles, columns),
            key=lambda tile: (tile.index not in self.partial, -self._expected[tile.index]),
        )

    def seconds_left(self, threads: int) -> float | None:
        """Return the seconds until all tiles have ended; None without threads, or before a cell or tile is measured."""
        trusted = (
            PREDICTION_WEIGHT * (self._predicted_finished_seconds + self._remaining) if self.seconds_per_cell else 0.0
        )
        if not threads or not self._predicted_finished_seconds + trusted:
            return None
        pace = (self._measured_finished_seconds + trusted) / (self._predicted_finished_seconds + trusted)
        # The tiles with the highest predictions begin first, and many of these predictions are too high. So a ratio of
        # measured to predicted seconds below 1 in the finished tiles must not be extrapolated to the other tiles.
        if self.seconds_per_cell:
            pace = max(pace, 1.0)
        lefts, begun = [], 0.0
        for index, part in self.partial.items():
            done, seconds = part.record.cells, self._expected[index]
            begun += seconds
            if done < MOST_PER_TILE:
                lefts.append(max(pace * seconds - part.record.seconds, 0.0))
            else:  # the tile's own computed cells predict better than its neighbours
                lefts.append(part.record.seconds / done * (part.is_computed.size - done))
        others = pace * max(self._remaining - begun, 0.0)
        return max((others + math.fsum(lefts)) / threads, max(lefts, default=0.0))


def sort_tiles_evenly(tiles: Iterable[AnyTile], columns: int) -> list[AnyTile]:
    """Sort tiles so that the first n tiles, for any n, spread over the plane. columns: number of columns of tiles.

    The order is that of ordered dithering: tiles with even row and column numbers come first, then the three groups of
    other parities. Within each of these four groups, the same rule sorts tiles by row and column numbers divided by 2,
    and so on.

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
