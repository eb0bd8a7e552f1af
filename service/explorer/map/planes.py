"""The numbers behind the maps: read once for all pages, and of a survey that runs only the tiles that are new."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from service.database.tables import JobRow, State
from service.errors import MissingError
from service.explorer.common.address import Pair, Ranges
from service.state import Front
from workers import SurveyRequest, open_survey
from workers.pictures.maps import numbers, plane_of, with_periodic
from workers.survey.slices import slice_of
from workers.survey.tiles import tiles_at
from workers.survey.values.schema import CELL

KEPT, KEPT_CELLS = 24, 24_000_000  # maps, and cells of them all, which take 5 bytes each
ENLARGED = 200  # points along an axis of an enlarged window
SIDE = 1024  # cells along an axis that are drawn at once: more than a screen has room for
BAND = 1 << 20  # numbers that are read at a time
SLICE_SECONDS = 1.0  # of reading, after which what is known is drawn
Key = tuple[str, str, int, int]


@dataclass(frozen=True)
class Block:
    """The cells of a map that are drawn: values float32 and status (epsilon, delta), and what they cover.

    Of more than SIDE cells along an axis, these are some, evenly spread, each in the place of those beside it.
    """

    delta: np.ndarray
    epsilon: np.ndarray
    values: np.ndarray
    status: np.ndarray
    box: Ranges

    def at(self, delta: float, epsilon: float) -> float | None:
        """The value at a point; None outside."""
        j, i = (_nearest(axis, value) for axis, value in ((self.delta, delta), (self.epsilon, epsilon)))
        return None if j is None or i is None else float(self.values[i, j])


class Plane:
    """One map of one survey: `values`, float32 (epsilon, delta), and `status` of each cell."""

    def __init__(self, front: Front, job: JobRow, variable: str, index: int, number: int = 0) -> None:
        place = front.directory.store(job.id)
        if not place.exists():
            raise MissingError(f"The survey is {job.state} and has no numbers yet.")
        self.id, self.number = job.id, job.number
        self._front = front
        request = SurveyRequest.model_validate(job.request)
        along = request.along(number)
        self._dataset = slice_of(open_survey(place), *along)
        self.plane, self._index = plane_of(self._dataset, variable, index), index
        self.request = request.at(along)
        self.delta, self.epsilon = (np.asarray(self._dataset[axis], np.float64) for axis in ("delta", "epsilon"))
        self.values = np.full(self.plane.shape, np.nan, np.float32)
        self.status = np.zeros(self.plane.shape, np.int8)
        self._tiles = {tile.index: tile for tile in tiles_at(request, along)}
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
        """These tiles, and where most of some rows of tiles are among them the rows: fewer and larger readings."""
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
        self.values[where] = numbers(with_periodic(self._dataset, self.plane[where], self._index))
        self.status[where] = np.asarray(self._dataset["status"][where])

    @property
    def box(self) -> Ranges:
        """What the cells cover."""
        return box_of(self.delta, self.epsilon)

    @property
    def is_thinned(self) -> bool:
        """Whether there are more cells than are drawn at once."""
        return max(self.values.shape) > SIDE

    def block(self, window: Ranges | None = None) -> Block:
        """The cells in a window, or all, as they are drawn."""
        spans = window or self.box
        j, i = (_some(axis, span) for axis, span in zip((self.delta, self.epsilon), spans, strict=True))
        where = np.ix_(i.chosen, j.chosen)
        box = j.covered, i.covered
        return Block(self.delta[j.chosen], self.epsilon[i.chosen], self.values[where], self.status[where], box)

    def enlarged(self, window: Ranges) -> Block:
        """A window that is far narrower than the survey, each point of it as the cell that it is in."""
        (left, right), (bottom, top) = window
        delta, epsilon = (
            low + (np.arange(ENLARGED) + 0.5) * (high - low) / ENLARGED for low, high in ((left, right), (bottom, top))
        )
        values = np.full((ENLARGED, ENLARGED), np.nan, np.float32)
        status = np.zeros(values.shape, np.int8)
        j, i = (_places(axis, points) for axis, points in ((self.delta, delta), (self.epsilon, epsilon)))
        inside = np.ix_(i >= 0, j >= 0)
        from_cells = np.ix_(i[i >= 0], j[j >= 0])
        values[inside], status[inside] = self.values[from_cells], self.status[from_cells]
        return Block(delta, epsilon, values, status, window)

    def at(self, delta: float, epsilon: float) -> tuple[float, int] | None:
        """Value and status of the cell at a point; None outside of the survey."""
        j, i = (_nearest(axis, value) for axis, value in ((self.delta, delta), (self.epsilon, epsilon)))
        return None if j is None or i is None else (float(self.values[i, j]), int(self.status[i, j]))

    def cell(self, delta: float, epsilon: float) -> xr.Dataset | None:
        """All that the survey has of the cell at a point, loaded; None outside of it. Blocks: for a thread."""
        j, i = (_nearest(axis, value) for axis, value in ((self.delta, delta), (self.epsilon, epsilon)))
        if j is None or i is None:
            return None
        names = [name for name, values in self._dataset.data_vars.items() if values.dims[-2:] == CELL]
        return self._dataset[names].isel(epsilon=i, delta=j).load()


class _Some(NamedTuple):
    """Cells along an axis that are drawn, and what they cover with those between them."""

    chosen: np.ndarray
    covered: Pair


def _some(axis: np.ndarray, span: Pair) -> _Some:
    """At most SIDE cells that lie in a span, evenly spread; the nearest one of an empty span."""
    half = (axis[-1] - axis[0]) / (2 * (axis.size - 1))
    first, end = (int(each) for each in np.searchsorted(axis, (span[0] - half, span[1] + half)))
    first = min(first, axis.size - 1)
    number = max(end - first, 1)
    kept = -(-number // -(-number // SIDE))
    chosen = first + ((np.arange(kept) + 0.5) * number / kept).astype(int)
    return _Some(chosen, (float(axis[first] - half), float(axis[first + number - 1] + half)))


def box_of(delta: np.ndarray, epsilon: np.ndarray) -> Ranges:
    """What cells cover: half a cell more on each side."""
    dx, dy = ((axis[-1] - axis[0]) / (2 * max(axis.size - 1, 1)) for axis in (delta, epsilon))
    return (float(delta[0] - dx), float(delta[-1] + dx)), (float(epsilon[0] - dy), float(epsilon[-1] + dy))


def _nearest(axis: np.ndarray, value: float) -> int | None:
    """Index of the cell along an axis that holds a value, half a cell beyond the ends too."""
    half = (axis[-1] - axis[0]) / (2 * (axis.size - 1))
    if not axis[0] - half <= value <= axis[-1] + half:
        return None
    return int(np.abs(axis - value).argmin())


def _places(axis: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Indices of the cells along an axis that hold values, −1 beyond the ends."""
    step = (axis[-1] - axis[0]) / (axis.size - 1)
    found = np.floor((values - axis[0]) / step + 0.5).astype(int)
    return np.where((found >= 0) & (found < axis.size), found, -1)


class Atlas:
    """The maps that pages show now or showed lately."""

    def __init__(self, front: Front) -> None:
        self._front = front
        self._lock = threading.Lock()
        self._planes: OrderedDict[Key, Plane] = OrderedDict()

    def plane(self, job: JobRow, variable: str, index: int, number: int = 0) -> tuple[Plane, bool]:
        """A map, of a third axis the one of this slice, and whether all that is there of it has been read; if not, ask
        again.

        Raises:
            MissingError: the survey has no numbers yet.
            SurveyError: it has no such map, or cannot be read.
        """
        key = (job.id, variable, index, number)
        with self._lock:
            plane = self._planes.get(key)
            if plane is not None:
                self._planes.move_to_end(key)
        if plane is None:
            plane = Plane(self._front, job, variable, index, number)
            with self._lock:
                plane = self._planes.setdefault(key, plane)
                while len(self._planes) > 1 and (len(self._planes) > KEPT or self._cells > KEPT_CELLS):
                    self._planes.popitem(last=False)
        return plane, plane.update(job)

    @property
    def _cells(self) -> int:
        return sum(plane.values.size for plane in self._planes.values())

    def forget(self, kept: Callable[[str], bool]) -> None:
        """Let go of the maps of surveys that are no longer there."""
        with self._lock:
            for key in [key for key in self._planes if not kept(key[0])]:
                del self._planes[key]


def maps_of(request: SurveyRequest) -> dict[str, Any]:
    """The variables of a survey that are maps, in the order of the store; each with the names of its several maps."""
    from workers.survey.values.quantities import held, labels_of

    return {
        quantity.name: labels_of(quantity.dims[0], request.n_slots) if len(quantity.dims) > 2 else ()
        for quantity in held(request.quantities, request.model)
        if quantity.per_cell
    }
