"""The numbers behind the maps: read once for all pages, and of a survey that runs only the tiles that are new."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
import xarray as xr

from service.errors import MissingError
from service.state import Front
from service.tables import JobRow, State
from workers import SurveyRequest, open_survey, tiles_of
from workers.maps import numbers, plane_of
from workers.schema import CELL

KEPT = 24  # maps; of a million cells each has some 8 MB
Key = tuple[str, str, int]
Map = TypeVar("Map")


class Plane:
    """One map of one survey: `values`, float32 (epsilon, delta), and `status` of each cell."""

    def __init__(self, front: Front, job: JobRow, variable: str, index: int) -> None:
        place = front.directory.store(job.id)
        if not place.exists():
            raise MissingError(f"The survey is {job.state} and has no numbers yet.")
        self.id, self.number = job.id, job.number
        self._front = front
        self._dataset = open_survey(place)
        self.plane = plane_of(self._dataset, variable, index)
        self.request = SurveyRequest.model_validate(job.request)
        self.delta, self.epsilon = (np.asarray(self._dataset[axis], np.float64) for axis in ("delta", "epsilon"))
        self.values = np.full(self.plane.shape, np.nan, np.float32)
        self.status = np.zeros(self.plane.shape, np.int8)
        self._tiles = {tile.index: tile for tile in tiles_of(self.request)}
        self._known: set[int] = set()
        self._lock = threading.Lock()
        self.version = 0  # grows with what is known

    def update(self, job: JobRow) -> int:
        """Read what has been computed since the last time; returns the version. Blocks: for a thread."""
        with self._lock:
            whole = job.state == State.SUCCESSFUL
            done = set(self._tiles) if whole else self._front.database.tiles_done(self.id)
            fresh = [self._tiles[index] for index in done - self._known if index in self._tiles]
            if 2 * len(fresh) > len(self._tiles):
                self._read((slice(None), slice(None)))
            else:
                for tile in fresh:
                    self._read((tile.epsilon, tile.delta))
            if fresh:
                self._known |= {tile.index for tile in fresh}
                self.version += 1
            return self.version

    def _read(self, where: tuple[slice, slice]) -> None:
        self.values[where] = numbers(self.plane[where])
        self.status[where] = np.asarray(self._dataset["status"][where])

    def cell(self, delta: float, epsilon: float) -> xr.Dataset | None:
        """All that the survey has of the cell at a point, loaded; None outside of it. Blocks: for a thread."""
        j, i = (_nearest(axis, value) for axis, value in ((self.delta, delta), (self.epsilon, epsilon)))
        if j is None or i is None:
            return None
        names = [name for name, values in self._dataset.data_vars.items() if values.dims[-2:] == CELL]
        return self._dataset[names].isel(epsilon=i, delta=j).load()


def _nearest(axis: np.ndarray, value: float) -> int | None:
    """Index of the cell along an axis that holds a value, half a cell beyond the ends too."""
    half = (axis[-1] - axis[0]) / (2 * (axis.size - 1))
    if not axis[0] - half <= value <= axis[-1] + half:
        return None
    return int(np.abs(axis - value).argmin())


class Atlas:
    """The maps that pages show now or showed lately."""

    def __init__(self, front: Front) -> None:
        self._front = front
        self._lock = threading.Lock()
        self._planes: OrderedDict[Key, Plane] = OrderedDict()

    def plane(self, job: JobRow, variable: str, index: int) -> Plane:
        """A map, up to date.

        Raises:
            MissingError: the survey has no numbers yet.
            SurveyError: it has no such map, or cannot be read.
        """
        key = (job.id, variable, index)
        with self._lock:
            plane = self._planes.get(key)
            if plane is not None:
                self._planes.move_to_end(key)
        if plane is None:
            plane = Plane(self._front, job, variable, index)
            with self._lock:
                plane = self._planes.setdefault(key, plane)
                while len(self._planes) > KEPT:
                    self._planes.popitem(last=False)
        plane.update(job)
        return plane

    def forget(self, kept: Callable[[str], bool]) -> None:
        """Let go of the maps of surveys that are no longer there."""
        with self._lock:
            for key in [key for key in self._planes if not kept(key[0])]:
                del self._planes[key]


def maps_of(request: SurveyRequest) -> dict[str, Any]:
    """The variables of a survey that are maps, in the order of the store; each with the names of its several maps."""
    from workers.quantities import COORDINATES, stored

    return {
        quantity.name: COORDINATES[quantity.dims[0]].values if len(quantity.dims) > 2 else ()
        for quantity in stored(request.quantities, request.model)
        if quantity.per_cell
    }
