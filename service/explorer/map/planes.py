"""The numbers behind the maps: read once for all pages, and of a survey that runs only the tiles that are new."""

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
from gear_rattle.service.explorer.common.address import Chosen, Pair, Ranges
from gear_rattle.service.explorer.state.store import box_of_cells
from gear_rattle.service.state import Front
from gear_rattle.workers import SurveyRequest, open_survey
from gear_rattle.workers.errors import reading
from gear_rattle.workers.pictures.largest import open_maps
from gear_rattle.workers.pictures.levels import DisplayedCells, LevelPart, of_cells, of_level, part_for
from gear_rattle.workers.pictures.look import IN_SLOTS, LARGEST, SHARE, WHICH, variable_words
from gear_rattle.workers.pictures.planes import drawn_numbers, plane_of, with_periodic
from gear_rattle.workers.storage.store import has_added
from gear_rattle.workers.survey.levels.grid import GROUP, centres, halvings, levels_of
from gear_rattle.workers.survey.levels.reduce import pooled_cells
from gear_rattle.workers.survey.slices import slice_of
from gear_rattle.workers.survey.tiles import tiles_at
from gear_rattle.workers.survey.values.schema import CELL, Group

KEPT, KEPT_CELLS = 24, 24_000_000  # maps, and cells of them all, which take 5 bytes each
ENLARGED = 200  # points along an axis of an enlarged window
SIDE = 512  # cells along an axis that are drawn at once, unless the screen is known to have room for more
BAND = 1 << 20  # numbers that are read at a time
SLICE_SECONDS = 1.0  # of reading, after which what is known is drawn
Key = tuple[str, str, int, int, bool]
Room = tuple[int, int]  # pixels along (delta, epsilon)
UNSEEN: Room = (700, 550)  # of a map whose browser has not said it


@dataclass(frozen=True)
class MapBlock:
    """The cells of a map that are drawn: values float32 and status (epsilon, delta), and what they cover.

    Of more cells than there is room for, several are one, which shows what is rare among them. shares, without: of
    `gear_rattle.workers.pictures.levels.DisplayedCells`.
    """

    delta: np.ndarray
    epsilon: np.ndarray
    values: np.ndarray
    status: np.ndarray
    box: Ranges
    shares: Mapping[int, float] = field(default_factory=dict)
    without: float | None = None

    def at(self, delta: float, epsilon: float) -> float | None:
        """Return the value at a point; None outside."""
        j, i = (_nearest(axis, value) for axis, value in ((self.delta, delta), (self.epsilon, epsilon)))
        return None if j is None or i is None else float(self.values[i, j])


class MapPlane:
    """One map of one survey: `values`, float32 (epsilon, delta), and `status` of each cell."""

    is_kept = True  # in memory, all cells

    def __init__(self, front: Front, job: JobRow, variable: str, index: int, number: int = 0) -> None:
        _, place = front.with_numbers(job.id)
        self.id, self.number = job.id, job.number
        self._front = front
        request = SurveyRequest.model_validate(job.request)
        self._place, self._along = place, request.along(number)
        self._dataset = open_maps(partial(open_survey, place), variable, *self._along)
        self.plane, self._index = plane_of(self._dataset, variable, index), index
        self.request = request.at(self._along)
        self._levels = halvings(self.request.shape)
        self.delta, self.epsilon = (np.asarray(self._dataset[axis], np.float64) for axis in ("delta", "epsilon"))
        kept = self.plane.shape if self.is_kept else (0, 0)
        self.values, self.status = np.full(kept, np.nan, np.float32), np.zeros(kept, np.int8)
        self._tiles = {tile.index: tile for tile in tiles_at(request, self._along)} if self.is_kept else {}
        self._known: set[int] = set()
        self._lock = threading.Lock()

    def update(self, job: JobRow) -> bool:
        """Read what has been computed since the last time, for a moment; whether that was all. Blocks: for a thread."""
        with self._lock:
            deadline = time.monotonic() + SLICE_SECONDS
            whole = job.state == State.SUCCESSFUL
            done = set(self._tiles) if whole else self._front.database.tiles_done(self.id)
            fresh = (done - self._known).intersection(self._tiles)
            for indices in self._bands(fresh):
                if time.monotonic() > deadline:
                    return False
                self._read(indices)
                self._known.update(fresh.intersection(indices))
            return True

    def _bands(self, fresh: set[int]) -> Iterator[list[int]]:
        """Yield these tiles by rows, and whole rows where most of their tiles are needed: fewer and larger readings."""
        _, across = self.request.tile_grid
        together = across * max(1, BAND // (self.delta.size * self.request.tile_shape[0]))
        every = list(self._tiles)
        for start in range(0, len(every), together):
            indices = every[start : start + together]
            new = [index for index in indices if index in fresh]
            if 2 * len(new) > len(indices):
                yield indices
            else:
                yield from ([index] for index in new)

    def _read(self, indices: Sequence[int]) -> None:
        first, last = self._tiles[indices[0]], self._tiles[indices[-1]]
        where = (slice(first.epsilon.start, last.epsilon.stop), slice(first.delta.start, last.delta.stop))
        self.values[where] = drawn_numbers(with_periodic(self._dataset, self.plane[where], self._index))
        self.status[where] = np.asarray(self._dataset["status"][where])

    @property
    def box(self) -> Ranges:
        """Box that the cells cover."""
        return box_of_cells(self.delta, self.epsilon)

    def is_thinned(self, room: Room = (SIDE, SIDE)) -> bool:
        """Return whether there are more cells than this room, of pixels along (delta, epsilon), is for."""
        return self.delta.size > room[0] or self.epsilon.size > room[1]

    def block(self, window: Ranges | None = None, room: Room = (SIDE, SIDE), *, anywhere: bool = False) -> MapBlock:
        """Return the cells in a window, or all, as they are drawn with so many pixels along (delta, epsilon).

        Parameters
        ----------
        anywhere : bool
            Of cells that are drawn as one the largest value, instead of the mean or what is rare; of a plane that is
            kept.

        Returns
        -------
        MapBlock
            The block.
        """
        (j, end_j), (i, end_i) = (
            _within(axis, span) for axis, span in zip((self.delta, self.epsilon), window or self.box, strict=True)
        )
        part = part_for(self._levels, (i, j), (end_i, end_j), room[::-1])
        seen, (rows, columns) = self._largest(part) if anywhere else self._seen(part), part.at
        across, along = (part.level.cells if part.level else (1, 1))[::-1]
        delta, epsilon = centres(self.delta, across)[columns], centres(self.epsilon, along)[rows]
        box = _covered(self.delta, across, columns), _covered(self.epsilon, along, rows)
        return MapBlock(delta, epsilon, seen.values, seen.status, box, seen.shares, seen.without)

    def _seen(self, part: LevelPart) -> DisplayedCells:
        if part.level is None:
            return DisplayedCells(*self._cells(*part.at))
        return of_cells(self.plane, *self._cells(*_cells_of(part)), part.level)

    def _largest(self, part: LevelPart) -> DisplayedCells:
        if part.level is None:
            return DisplayedCells(*self._cells(*part.at))
        values, status = self._cells(*_cells_of(part))
        return DisplayedCells(
            pooled_cells(values, part.level.cells, np.fmax, np.nan), pooled_cells(status, part.level.cells, np.maximum)
        )

    def _cells(self, rows: slice, columns: slice) -> tuple[np.ndarray, np.ndarray]:
        """Values and status of some cells."""
        return self.values[rows, columns], self.status[rows, columns]

    def whole(self) -> tuple[np.ndarray, np.ndarray]:
        """Values and status of all cells. Blocks: for a thread."""
        return self._cells(slice(None), slice(None))

    def enlarged(self, window: Ranges) -> MapBlock:
        """Return a window that is far narrower than the survey, each point of it as the cell that it is in."""
        (left, right), (bottom, top) = window
        delta, epsilon = (
            low + (np.arange(ENLARGED) + 0.5) * (high - low) / ENLARGED for low, high in ((left, right), (bottom, top))
        )
        values = np.full((ENLARGED, ENLARGED), np.nan, np.float32)
        status = np.zeros(values.shape, np.int8)
        j, i = (cells_at(axis, points) for axis, points in ((self.delta, delta), (self.epsilon, epsilon)))
        inside = np.ix_(i >= 0, j >= 0)
        if inside[0].size and inside[1].size:
            i, j = i[i >= 0], j[j >= 0]
            found = self._cells(slice(i[0], i[-1] + 1), slice(j[0], j[-1] + 1))
            values[inside], status[inside] = (each[np.ix_(i - i[0], j - j[0])] for each in found)
        return MapBlock(delta, epsilon, values, status, window)

    def at(self, delta: float, epsilon: float) -> tuple[float, int] | None:
        """Value and status of the cell at a point; None outside of the survey."""
        j, i = (_nearest(axis, value) for axis, value in ((self.delta, delta), (self.epsilon, epsilon)))
        if j is None or i is None:
            return None
        value, status = self._cells(slice(i, i + 1), slice(j, j + 1))
        return float(value[0, 0]), int(status[0, 0])

    def cell(self, delta: float, epsilon: float) -> xr.Dataset | None:
        """Return all that the survey has of the cell at a point, loaded; None outside of it. Blocks: for a thread."""
        j, i = (_nearest(axis, value) for axis, value in ((self.delta, delta), (self.epsilon, epsilon)))
        if j is None or i is None:
            return None
        names = [
            name
            for name, values in self._dataset.data_vars.items()
            if values.dims[-2:] == CELL and name not in (LARGEST, SHARE)  # which follow from the others
        ]
        return self._dataset[names].isel(epsilon=i, delta=j).load()


class LeveledPlane(MapPlane):
    """A map of a survey that has ended and has levels: what is drawn is read when it is drawn."""

    is_kept = False

    def __init__(self, front: Front, job: JobRow, variable: str, index: int, number: int = 0) -> None:
        super().__init__(front, job, variable, index, number)
        self._levels = levels_of(self.request.shape)
        self._opened: dict[str, xr.Dataset] = {}

    def update(self, job: JobRow) -> bool:  # noqa: ARG002  # of one that has ended
        """Nothing is new."""
        return True

    def _seen(self, part: LevelPart) -> DisplayedCells:
        if part.level is None:
            return super()._seen(part)
        return of_level(self.plane, self._level(part.level.path), self._index, part.level, part.at)

    def _level(self, path: str) -> xr.Dataset:
        with self._lock:
            if path not in self._opened:
                self._opened[path] = slice_of(open_survey(self._place, path), *self._along)
            return self._opened[path]

    def _cells(self, rows: slice, columns: slice) -> tuple[np.ndarray, np.ndarray]:
        with reading(f"the map of {self.plane.name}"):
            cells = drawn_numbers(with_periodic(self._dataset, self.plane[rows, columns], self._index))
            return cells.astype(np.float32), np.asarray(self._dataset["status"][rows, columns])


def _cells_of(part: LevelPart) -> tuple[slice, slice]:
    """Rows and columns of the survey's cells in a part of a level."""
    spans = zip(part.at, part.level.cells if part.level else (1, 1), strict=True)
    rows, columns = (slice(span.start * cells, span.stop * cells) for span, cells in spans)
    return rows, columns


def _within(axis: np.ndarray, span: Pair) -> tuple[int, int]:
    """Return the first cell along an axis that lies in a span, and the one after the last.

    The nearest cell of an empty span.

    Returns
    -------
    tuple[int, int]
        Both numbers.
    """
    half = (axis[-1] - axis[0]) / (2 * (axis.size - 1))
    first, end = (int(each) for each in np.searchsorted(axis, (span[0] - half, span[1] + half)))
    first = min(first, axis.size - 1)
    return first, max(end, first + 1)


def _covered(axis: np.ndarray, cells: int, span: slice) -> Pair:
    """Return the range that cells of a level cover, or of the map itself."""
    step = (axis[-1] - axis[0]) / (axis.size - 1)
    begin = axis[0] - step / 2
    return float(begin + span.start * cells * step), float(begin + span.stop * cells * step)


def _nearest(axis: np.ndarray, value: float) -> int | None:
    """Index of the cell along an axis that holds a value, half a cell beyond the ends too."""
    half = (axis[-1] - axis[0]) / (2 * (axis.size - 1))
    if not axis[0] - half <= value <= axis[-1] + half:
        return None
    return int(np.abs(axis - value).argmin())


def cells_at(axis: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the indices of the cells along an axis that hold values, −1 beyond the ends."""
    step = (axis[-1] - axis[0]) / (axis.size - 1)
    found = np.floor((values - axis[0]) / step + 0.5).astype(int)
    return np.where((found >= 0) & (found < axis.size), found, -1)


class Atlas:
    """The maps that pages show now or showed lately."""

    def __init__(self, front: Front) -> None:
        self._front = front
        self._lock = threading.Lock()
        self._planes: OrderedDict[Key, MapPlane] = OrderedDict()

    def plane(self, job: JobRow, variable: str, index: int, number: int = 0) -> tuple[MapPlane, bool]:
        """Return a map, of a third axis the one of this slice, and whether all that is there of it has been read.

        If not, ask again. One of slots is read anew when the survey has ended: they may have been moved.

        Returns
        -------
        tuple[MapPlane, bool]
            The map, and whether it is complete.

        Raises
        ------
        MissingError
            The survey has no numbers yet.
        SurveyError
            It has no such map, or cannot be read.
        """
        key = (job.id, variable, index, number, variable in IN_SLOTS and job.state == State.SUCCESSFUL)
        with self._lock:
            plane = self._planes.get(key)
            if plane is not None:
                self._planes.move_to_end(key)
        if plane is None:
            plane = self._new(job, variable)(self._front, job, variable, index, number)
            with self._lock:
                plane = self._planes.setdefault(key, plane)
                while len(self._planes) > 1 and (len(self._planes) > KEPT or self._cells > KEPT_CELLS):
                    self._planes.popitem(last=False)
        return plane, plane.update(job)

    def _new(self, job: JobRow, variable: str) -> type[MapPlane]:
        """How a map of a survey is read."""
        if variable in (LARGEST, SHARE):  # which levels have not
            return MapPlane
        is_large = levels_of(SurveyRequest.model_validate(job.request).shape)
        ended = is_large and job.state == State.SUCCESSFUL
        return LeveledPlane if ended and has_added(self._front.directory.store(job.id), GROUP) else MapPlane

    @property
    def _cells(self) -> int:
        return sum(plane.values.size for plane in self._planes.values())

    def forget(self, kept: Callable[[str], bool]) -> None:
        """Let go of the maps of surveys that are no longer there."""
        with self._lock:
            for key in [key for key in self._planes if not kept(key[0])]:
                del self._planes[key]


def maps_of(request: SurveyRequest) -> dict[str, Any]:
    """Return the variables of a survey that are maps, in the order of the store.

    Each with the names of its several maps.

    Returns
    -------
    dict[str, Any]
        Names by variable.
    """
    from gear_rattle.workers.survey.values.quantities import held, labels_of

    joined = {LARGEST: WHICH} if Group.FAMILIES in request.quantities else {}
    return {
        quantity.name: labels_of(quantity.dims[0], request.n_slots) if len(quantity.dims) > 2 else ()
        for quantity in held(request.quantities, request.model)
        if quantity.per_cell
    } | joined


def map_names(request: SurveyRequest) -> dict[str, Chosen]:
    """Return the same one by one, by their names in words."""
    named = {}
    for name, labels in maps_of(request).items():
        words = variable_words(name)
        for index, label in enumerate(labels or ("",)):
            named[f"{words}, {label}" if labels else words] = Chosen(name, index)
    return named
