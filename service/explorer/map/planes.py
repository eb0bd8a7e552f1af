"""Read the numbers of maps, once for all pages. While a survey runs, only its new tiles are read."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from gear_rattle.service.database.tables import JobRow, State
from gear_rattle.service.explorer.common.address import MapChoice, Pair, Ranges
from gear_rattle.service.explorer.state.store import box_of_cells
from gear_rattle.service.operations.surveys import written_tiles
from gear_rattle.service.state import ApplicationState
from gear_rattle.workers import SurveyRequest, open_survey
from gear_rattle.workers.errors import report_damage
from gear_rattle.workers.pictures.largest import open_survey_for_map
from gear_rattle.workers.pictures.levels import (
    DisplayedCells,
    LevelPart,
    choose_level_for_window,
    read_displayed_level_cells,
    reduce_cells,
)
from gear_rattle.workers.pictures.look import IN_SLOTS, LARGEST, SHARE, WHICH, variable_in_words
from gear_rattle.workers.pictures.planes import map_of_variable, mask_nonperiodic, values_to_draw
from gear_rattle.workers.storage.store import has_added_node
from gear_rattle.workers.survey.levels.grid import (
    GROUP,
    centres_of_level_cells,
    possible_levels,
    stored_levels_of_shape,
)
from gear_rattle.workers.survey.levels.reduce import pool_cells
from gear_rattle.workers.survey.slices import select_slice
from gear_rattle.workers.survey.tiles import tiles_of_slice
from gear_rattle.workers.survey.values.schema import CELL, Group

# most maps in memory, and most cells of all these maps together; a cell takes 5 bytes
MOST_MAPS, MOST_MAP_CELLS = 24, 24_000_000
# a very narrow window is drawn at this many points along each axis; each point has the value of the cell around it
ENLARGED_POINTS = 200
SIDE = 512  # most cells that are drawn along an axis, unless the screen is known to have more pixels
MOST_CELLS_AT_ONCE = 1 << 20  # most cells that are read at once, unless a single row of tiles has more
READING_SECONDS = 1.0  # seconds after which reading pauses, so that the cells read so far are drawn
Key = tuple[str, str, int, int, bool]
Room = tuple[int, int]  # pixels along (delta, epsilon)
UNSEEN: Room = (700, 550)  # assumed pixels of a map until the browser has reported them


@dataclass(frozen=True)
class MapBlock:
    """Drawn cells of a map: `values` (float32) and `status`, both (epsilon, delta), and the `box` that the cells cover.

    If a map has more cells than pixels, a drawn cell stands for several cells: it shows a rare code among them, or a
    number such as their mean. shares: for a map of codes, each code's share of all cells for which the block stands.
    without: for a map of numbers, the share of these cells that have no number. `shares` is {} and `without` is None
    where the drawn cells have to be counted instead.
    """

    delta: np.ndarray
    epsilon: np.ndarray
    values: np.ndarray
    status: np.ndarray
    box: Ranges
    shares: Mapping[int, float] = field(default_factory=dict)
    without: float | None = None

    def value_at(self, delta: float, epsilon: float) -> float | None:
        """Return the value at a point; None outside of the cells."""
        j, i = (_cell_index(axis, value) for axis, value in ((self.delta, delta), (self.epsilon, epsilon)))
        return None if j is None or i is None else float(self.values[i, j])


class MapPlane:
    """Map of a survey: the `values` (float32) and the `status` of its cells, both (epsilon, delta).

    number: number of the survey's job in the database.

    Parameters
    ----------
    index : int
        Number of the slot or the orbit, for a variable that has a map for each; otherwise 0.
    slice_number : int
        Number of the slice; 0 for a survey without a third axis.
    """

    is_kept = True  # True if all cells are kept in memory

    def __init__(self, front: ApplicationState, job: JobRow, variable: str, index: int, slice_number: int = 0) -> None:
        _, place = front.find_job_and_existing_store(job.id)
        self.id, self.number = job.id, job.number
        self._front = front
        request = SurveyRequest.model_validate(job.request)
        self._place, self._along = place, request.slice_index(slice_number)
        self._dataset = open_survey_for_map(partial(open_survey, place), variable, *self._along)
        self.plane, self._index = map_of_variable(self._dataset, variable, index), index
        self.request = request.slice_request(self._along)
        self._levels = possible_levels(self.request.shape)
        self.delta, self.epsilon = (np.asarray(self._dataset[axis], np.float64) for axis in ("delta", "epsilon"))
        kept = self.plane.shape if self.is_kept else (0, 0)
        self.values, self.status = np.full(kept, np.nan, np.float32), np.zeros(kept, np.int8)
        self._tiles = {tile.index: tile for tile in tiles_of_slice(request, self._along)} if self.is_kept else {}
        self._known: set[int] = set()
        self._lock = threading.Lock()

    def update(self, job: JobRow) -> bool:
        """Read new tiles for at most READING_SECONDS; return whether all are read. This method blocks: use a thread."""
        with self._lock:
            deadline = time.monotonic() + READING_SECONDS
            whole = job.state == State.SUCCESSFUL
            done = set(self._tiles) if whole else written_tiles(self._front, self.id)
            fresh = (done - self._known).intersection(self._tiles)
            for indices in self._tiles_to_read(fresh):
                if time.monotonic() > deadline:
                    return False
                self._read_tiles(indices)
                self._known.update(fresh.intersection(indices))
            return True

    def _tiles_to_read(self, fresh: set[int]) -> Iterator[list[int]]:
        """Yield lists of tiles to read at once.

        The tiles are taken in groups of whole rows of tiles, with at most MOST_CELLS_AT_ONCE cells or one row. If more
        than half of a group's tiles are fresh, all tiles of the group make one list. Otherwise each fresh tile makes a
        list of its own.

        fresh: tiles that are written to the store and not read yet.

        Yields
        ------
        list[int]
            Indices of tiles.
        """
        _, across = self.request.tile_grid_shape
        together = across * max(1, MOST_CELLS_AT_ONCE // (self.delta.size * self.request.tile_shape[0]))
        every = list(self._tiles)
        for start in range(0, len(every), together):
            indices = every[start : start + together]
            new = [index for index in indices if index in fresh]
            if 2 * len(new) > len(indices):
                yield indices
            else:
                yield from ([index] for index in new)

    def _read_tiles(self, indices: Sequence[int]) -> None:
        first, last = self._tiles[indices[0]], self._tiles[indices[-1]]
        where = (slice(first.epsilon.start, last.epsilon.stop), slice(first.delta.start, last.delta.stop))
        self.values[where] = values_to_draw(mask_nonperiodic(self._dataset, self.plane[where], self._index))
        self.status[where] = np.asarray(self._dataset["status"][where])

    @property
    def box(self) -> Ranges:
        """Box that the cells cover."""
        return box_of_cells(self.delta, self.epsilon)

    def has_more_cells_than_pixels(self, room: Room = (SIDE, SIDE)) -> bool:
        """Return whether the map has more cells than pixels along δ or along ε. room: pixels along (delta, epsilon)."""
        return self.delta.size > room[0] or self.epsilon.size > room[1]

    def block(self, window: Ranges | None = None, room: Room = (SIDE, SIDE), *, anywhere: bool = False) -> MapBlock:
        """Return the cells to draw in a window. A drawn cell stands for several cells if there are too few pixels.

        Parameters
        ----------
        window : Ranges | None
            Ranges of δ and of ε; None for the whole survey.
        room : (int, int)
            Pixels along δ and along ε.
        anywhere : bool
            True if a cell that stands for several cells shows their largest value, so that a small part of a family
            remains visible. This needs a map with its cells in memory (`is_kept`). If False, the cell shows a rare one
            of its codes, or the mean or a rare extreme of its numbers.

        Returns
        -------
        MapBlock
            The block.
        """
        (j, end_j), (i, end_i) = (
            _cell_range(axis, span) for axis, span in zip((self.delta, self.epsilon), window or self.box, strict=True)
        )
        part = choose_level_for_window(self._levels, (i, j), (end_i, end_j), room[::-1])
        seen, (rows, columns) = self._largest_values(part) if anywhere else self._read_displayed_cells(part), part.spans
        across, along = (part.level.covered_cells if part.level else (1, 1))[::-1]
        delta, epsilon = (
            centres_of_level_cells(self.delta, across)[columns],
            centres_of_level_cells(self.epsilon, along)[rows],
        )
        box = _covered_range(self.delta, across, columns), _covered_range(self.epsilon, along, rows)
        return MapBlock(delta, epsilon, seen.values, seen.status, box, seen.code_shares, seen.share_without_number)

    def _read_displayed_cells(self, part: LevelPart) -> DisplayedCells:
        if part.level is None:
            return DisplayedCells(*self._values_and_status(*part.spans))
        return reduce_cells(self.plane, *self._values_and_status(*_covered_cells(part)), part.level)

    def _largest_values(self, part: LevelPart) -> DisplayedCells:
        if part.level is None:
            return DisplayedCells(*self._values_and_status(*part.spans))
        values, status = self._values_and_status(*_covered_cells(part))
        return DisplayedCells(
            pool_cells(values, part.level.covered_cells, np.fmax, np.nan),
            pool_cells(status, part.level.covered_cells, np.maximum),
        )

    def _values_and_status(self, rows: slice, columns: slice) -> tuple[np.ndarray, np.ndarray]:
        """Return the values and the status of the cells in these rows (ε) and columns (δ)."""
        return self.values[rows, columns], self.status[rows, columns]

    def read_values_and_status(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the values and the status of all cells. This method blocks: use a thread."""
        return self._values_and_status(slice(None), slice(None))

    def enlarged_block(self, window: Ranges) -> MapBlock:
        """Return ENLARGED_POINTS² points of a very narrow window, each with the value of the cell around it."""
        (left, right), (bottom, top) = window
        delta, epsilon = (
            low + (np.arange(ENLARGED_POINTS) + 0.5) * (high - low) / ENLARGED_POINTS
            for low, high in ((left, right), (bottom, top))
        )
        values = np.full((ENLARGED_POINTS, ENLARGED_POINTS), np.nan, np.float32)
        status = np.zeros(values.shape, np.int8)
        j, i = (cell_indices(axis, points) for axis, points in ((self.delta, delta), (self.epsilon, epsilon)))
        inside = np.ix_(i >= 0, j >= 0)
        if inside[0].size and inside[1].size:
            i, j = i[i >= 0], j[j >= 0]
            found = self._values_and_status(slice(i[0], i[-1] + 1), slice(j[0], j[-1] + 1))
            values[inside], status[inside] = (each[np.ix_(i - i[0], j - j[0])] for each in found)
        return MapBlock(delta, epsilon, values, status, window)

    def value_and_status(self, delta: float, epsilon: float) -> tuple[float, int] | None:
        """Return the value and the status of the cell at a point; None outside of the survey."""
        j, i = (_cell_index(axis, value) for axis, value in ((self.delta, delta), (self.epsilon, epsilon)))
        if j is None or i is None:
            return None
        value, status = self._values_and_status(slice(i, i + 1), slice(j, j + 1))
        return float(value[0, 0]), int(status[0, 0])

    def cell_at(self, delta: float, epsilon: float) -> xr.Dataset | None:
        """Return all variables of the cell at a point; None outside of the survey. This method blocks: use a thread."""
        j, i = (_cell_index(axis, value) for axis, value in ((self.delta, delta), (self.epsilon, epsilon)))
        if j is None or i is None:
            return None
        names = [
            name
            for name, values in self._dataset.data_vars.items()
            # the maps LARGEST and SHARE are no variables of the store: they are made from stored variables
            if values.dims[-2:] == CELL and name not in (LARGEST, SHARE)
        ]
        return self._dataset[names].isel(epsilon=i, delta=j).load()


class PyramidMapPlane(MapPlane):
    """Map of a completed survey with pyramid levels. Cells are read from the store when they are drawn."""

    is_kept = False

    def __init__(self, front: ApplicationState, job: JobRow, variable: str, index: int, slice_number: int = 0) -> None:
        super().__init__(front, job, variable, index, slice_number)
        self._levels = stored_levels_of_shape(self.request.shape)
        self._opened: dict[str, xr.Dataset] = {}

    def update(self, job: JobRow) -> bool:  # noqa: ARG002  # a completed survey does not change
        """Read nothing, because cells are read when they are drawn; return True, as if all tiles were read."""
        return True

    def _read_displayed_cells(self, part: LevelPart) -> DisplayedCells:
        if part.level is None:
            return super()._read_displayed_cells(part)
        return read_displayed_level_cells(
            self.plane, self._open_level(part.level.path), self._index, part.level, part.spans
        )

    def _open_level(self, path: str) -> xr.Dataset:
        with self._lock:
            if path not in self._opened:
                self._opened[path] = select_slice(open_survey(self._place, path), *self._along)
            return self._opened[path]

    def _values_and_status(self, rows: slice, columns: slice) -> tuple[np.ndarray, np.ndarray]:
        with report_damage(f"the map of {self.plane.name}"):
            cells = values_to_draw(mask_nonperiodic(self._dataset, self.plane[rows, columns], self._index))
            return cells.astype(np.float32), np.asarray(self._dataset["status"][rows, columns])


def _covered_cells(part: LevelPart) -> tuple[slice, slice]:
    """Return the rows and the columns of the survey's cells that a part of a level covers."""
    spans = zip(part.spans, part.level.covered_cells if part.level else (1, 1), strict=True)
    rows, columns = (slice(span.start * cells, span.stop * cells) for span, cells in spans)
    return rows, columns


def _cell_range(axis: np.ndarray, span: Pair) -> tuple[int, int]:
    """Return the index of the first cell along an axis that meets a span, and the last such index plus one.

    If the span meets no cell, the result is the nearest cell.

    Returns
    -------
    tuple[int, int]
        First index, and last index plus one.
    """
    half = (axis[-1] - axis[0]) / (2 * (axis.size - 1))
    first, end = (int(each) for each in np.searchsorted(axis, (span[0] - half, span[1] + half)))
    first = min(first, axis.size - 1)
    return first, max(end, first + 1)


def _covered_range(axis: np.ndarray, factor: int, span: slice) -> Pair:
    """Return the range of δ or ε that some cells of a pyramid level cover.

    axis: centres of the survey's cells. factor: number of the survey's cells along the axis that one cell of the level
    covers. span: first cell of the level, and one past the last.

    Returns
    -------
    Pair
        Lower and upper edge of the cells.
    """
    step = (axis[-1] - axis[0]) / (axis.size - 1)
    begin = axis[0] - step / 2
    return float(begin + span.start * factor * step), float(begin + span.stop * factor * step)


def _cell_index(axis: np.ndarray, value: float) -> int | None:
    """Return the index, along an axis, of the cell that contains a value; None if no cell contains the value."""
    half = (axis[-1] - axis[0]) / (2 * (axis.size - 1))
    if not axis[0] - half <= value <= axis[-1] + half:
        return None
    return int(np.abs(axis - value).argmin())


def cell_indices(axis: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the index, along an axis, of the cell that contains each value; −1 for a value outside of all cells."""
    step = (axis[-1] - axis[0]) / (axis.size - 1)
    found = np.floor((values - axis[0]) / step + 0.5).astype(int)
    return np.where((found >= 0) & (found < axis.size), found, -1)


class MapCache:
    """Maps that pages show now or showed lately, in memory."""

    def __init__(self, front: ApplicationState) -> None:
        self._front = front
        self._lock = threading.Lock()
        self._planes: OrderedDict[Key, MapPlane] = OrderedDict()

    def plane(self, job: JobRow, variable: str, index: int, number: int = 0) -> tuple[MapPlane, bool]:
        """Return a map of a survey, or of its slice `number`, and whether all tiles computed so far have been read.

        If some tiles have not been read, call this method again. A map of one slot of attractors is read again when the
        survey has ended, because attractors may have moved to other slots.

        Returns
        -------
        tuple[MapPlane, bool]
            The map, and whether all tiles computed so far have been read.

        Raises
        ------
        MissingPartError
            The survey has no numbers yet.
        SurveyError
            The survey has no such map, or it cannot be read.
        """
        key = (job.id, variable, index, number, variable in IN_SLOTS and job.state == State.SUCCESSFUL)
        with self._lock:
            plane = self._planes.get(key)
            if plane is not None:
                self._planes.move_to_end(key)
        if plane is None:
            plane = self._plane_class(job, variable)(self._front, job, variable, index, number)
            with self._lock:
                plane = self._planes.setdefault(key, plane)
                while len(self._planes) > 1 and (len(self._planes) > MOST_MAPS or self._n_cells > MOST_MAP_CELLS):
                    self._planes.popitem(last=False)
        return plane, plane.update(job)

    def _plane_class(self, job: JobRow, variable: str) -> type[MapPlane]:
        """Return PyramidMapPlane if the store of a successful survey has pyramid levels of the map, else MapPlane."""
        if variable in (LARGEST, SHARE):  # the pyramid levels lack both maps
            return MapPlane
        is_large = stored_levels_of_shape(SurveyRequest.model_validate(job.request).shape)
        ended = is_large and job.state == State.SUCCESSFUL
        return PyramidMapPlane if ended and has_added_node(self._front.directory.store(job.id), GROUP) else MapPlane

    @property
    def _n_cells(self) -> int:
        return sum(plane.values.size for plane in self._planes.values())

    def forget(self, kept: Callable[[str], bool]) -> None:
        """Remove maps from memory. kept: function that returns, for the id of a survey, whether its maps stay."""
        with self._lock:
            for key in [key for key in self._planes if not kept(key[0])]:
                del self._planes[key]


def map_names_by_variable(request: SurveyRequest) -> dict[str, Any]:
    """Return the variables of a survey that can be drawn as maps, in the order of the store.

    Returns
    -------
    dict[str, Any]
        {variable: names of its maps, one for each slot or orbit; () if the variable has a single map}.
    """
    from gear_rattle.workers.survey.values.quantities import dimension_labels, variables_of_groups

    joined = {LARGEST: WHICH} if Group.FAMILIES in request.quantities else {}
    return {
        quantity.name: dimension_labels(quantity.dims[0], request.n_slots) if len(quantity.dims) > 2 else ()
        for quantity in variables_of_groups(request.quantities, request.model)
        if quantity.is_per_cell
    } | joined


def options_of_map_menu(request: SurveyRequest, *wanted: MapChoice | None) -> tuple[MapChoice, dict[str, str]]:
    """Return the map to select in a menu of a survey's maps, and the options of the menu.

    wanted: the maps that may be selected, the most wanted first; None stands for no map.

    Returns
    -------
    tuple[MapChoice, dict[str, str]]
        The first of the `wanted` maps that the survey has, else its first map; {name of a map: text in an address}.
    """
    maps = maps_by_name(request)
    chosen = next(each for each in (*wanted, *maps.values()) if each is not None and each in maps.values())
    return chosen, {words: each.address_text for words, each in maps.items()}


def maps_by_name(request: SurveyRequest) -> dict[str, MapChoice]:
    """Return all maps of a survey, each under its name in words."""
    named = {}
    for name, labels in map_names_by_variable(request).items():
        words = variable_in_words(name)
        for index, label in enumerate(labels or ("",)):
            named[f"{words}, {label}" if labels else words] = MapChoice(name, index)
    return named
