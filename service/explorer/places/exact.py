"""The paper's plane without any survey: its regions and period-one motions, which are closed forms."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
import xarray as xr

from service.explorer.map.planes import Plane
from workers import Axis, SurveyRequest
from workers.pictures.planes import numbers, plane_of
from workers.survey.levels.grid import halvings
from workers.survey.tiles import cells_of
from workers.survey.values.cells import Cells
from workers.survey.values.quantities import held, labels_of
from workers.survey.values.schema import Group

#: A cell is half a step wider than the axes on either side, so that the map is the paper's δ 0.4 … 1, ε 0 … 0.3.
ASKED = SurveyRequest(
    delta=Axis(start=0.4015, stop=0.9985, num=200),
    epsilon=Axis(start=0.001, stop=0.299, num=150),
    quantities=(Group.REGION, Group.ORBITS),
)


class ExactPlane(Plane):
    """One map of these. What is read at a point is computed there. Blocks: for a thread."""

    def __init__(self, cells: Cells, found: xr.Dataset, variable: str, index: int) -> None:
        self.id, self.number, self.request, self._evaluated = "", 0, ASKED, cells
        self.plane, self._levels = plane_of(found, variable, index), halvings(ASKED.shape)
        self.delta, self.epsilon = cells.delta, cells.epsilon
        self.values = numbers(self.plane).astype(np.float32)
        self.status = np.ones(self.values.shape, np.int8)

    def cell(self, delta: float, epsilon: float) -> xr.Dataset | None:
        """The region and the motions A to D of a point."""
        if delta <= 0 or epsilon < 0:
            return None
        here = replace(self._evaluated, delta=np.array([delta]), epsilon=np.array([epsilon]))
        return _dataset(here).isel(delta=0, epsilon=0)


class Exact:
    """The maps, computed once for all pages, when the first of them is asked for."""

    request = ASKED

    def plane(self, variable: str, index: int) -> Plane:
        """See `WithoutSurvey`."""
        return ExactPlane(self._cells, self._found, variable, index)

    @cached_property
    def _cells(self) -> Cells:
        return cells_of(ASKED)

    @cached_property
    def _found(self) -> xr.Dataset:
        return _dataset(self._cells)


def _dataset(cells: Cells) -> xr.Dataset:
    """What is asked of cells, as an open survey has it."""
    quantities = [each for each in held(ASKED.quantities, ASKED.model) if each.per_cell]
    dims = {dim for each in quantities for dim in each.dims[:-2]}
    labels = {dim: list(labels_of(dim, 1)) for dim in dims}
    done = np.ones(cells.shape, np.int8)  # the status, which alone has no group
    values = {
        each.name: (each.dims, np.asarray(each.evaluate(cells)) if each.group else done, each.attributes)
        for each in quantities
    }
    return xr.Dataset(values, coords=labels | {"delta": cells.delta, "epsilon": cells.epsilon})
