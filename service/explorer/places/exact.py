"""Maps that a page can show before a survey is computed.

These are the maps of the example that comes with the explorer, and the maps of the regions and of the motions A to D of
an unfinished survey, which are computed from closed forms. In the example, too, the regions and the motions A to D are
computed from closed forms; its other variables are read from a file that comes with the explorer.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from threading import Lock
from typing import Any

import numpy as np
import xarray as xr

from gear_rattle.service.database.tables import JobRow
from gear_rattle.service.errors import MissingPartError
from gear_rattle.service.explorer.map.planes import SIDE, MapPlane, map_names_by_variable
from gear_rattle.service.explorer.places.example import CLOSED_FORMS, MAPS, REQUEST, load_stored_variables
from gear_rattle.service.explorer.places.example import KEPT as SAMPLED
from gear_rattle.workers import Axis, SurveyRequest
from gear_rattle.workers.pictures.planes import map_of_variable, values_to_draw
from gear_rattle.workers.survey.levels.grid import possible_levels
from gear_rattle.workers.survey.tiles import cells_of_tile
from gear_rattle.workers.survey.values.cells import Cells
from gear_rattle.workers.survey.values.quantities import dimension_labels, variables_of_groups

MOST_UNFINISHED = 8  # most maps of unfinished surveys in memory


class ClosedFormPlane(MapPlane):
    """Map whose values are closed forms, without a computed survey. The constructor blocks: use a thread.

    `cell_at` computes the closed forms at exactly the point that it is given, not at the centre of a cell.
    """

    def __init__(self, cells: Cells, dataset: xr.Dataset, variable: str, index: int) -> None:
        self.id, self.number, self.request, self._evaluated = "", 0, REQUEST, cells
        self.plane, self._levels = map_of_variable(dataset, variable, index), possible_levels(REQUEST.shape)
        self.delta, self.epsilon = cells.delta, cells.epsilon
        self.values = values_to_draw(self.plane).astype(np.float32)
        self.status = np.ones(self.values.shape, np.int8)

    def cell_at(self, delta: float, epsilon: float) -> xr.Dataset | None:
        """Return the region and the motions A to D at a point; None unless δ > 0 and ε ≥ 0."""
        if delta <= 0 or epsilon < 0:
            return None
        here = replace(self._evaluated, delta=np.array([delta]), epsilon=np.array([epsilon]))
        return _closed_form_dataset(here).isel(delta=0, epsilon=0)


class ExamplePlane(ClosedFormPlane):
    """Map of the survey that comes with the explorer as an example."""

    def __init__(self, cells: Cells, dataset: xr.Dataset, variable: str, index: int) -> None:
        super().__init__(cells, dataset, variable, index)
        self._sampled = dataset[list(SAMPLED)]

    def cell_at(self, delta: float, epsilon: float) -> xr.Dataset | None:
        """Return the closed forms at a point, with the stored variables of its cell; None unless δ > 0 and ε ≥ 0.

        Outside of the example's cells, the result has the closed forms alone.

        Returns
        -------
        xr.Dataset | None
            Variables at the point.
        """
        here = super().cell_at(delta, epsilon)
        if here is None or self.value_and_status(delta, epsilon) is None:
            return here
        around = self._sampled.sel(delta=delta, epsilon=epsilon, method="nearest")
        return here.merge(around.drop_vars(["delta", "epsilon"]))


class UnfinishedSurveyPlane(ClosedFormPlane):
    """Closed-form map of an unfinished survey, at most SIDE cells along an axis. The constructor blocks: use a thread.

    load_computed_map: a function that returns the map of the cells that the survey has computed. `cell_at` reads the
    cell at a point from this map, and returns the closed forms at the point if the cell is not computed yet.
    """

    def __init__(
        self,
        request: SurveyRequest,
        survey_id: str,
        variable: str,
        index: int,
        load_computed_map: Callable[[], MapPlane],
    ) -> None:
        cells = cells_of_tile(_coarse_closed_form_request(request))
        super().__init__(cells, _closed_form_dataset(cells, {variable}), variable, index)
        self.id, self.request, self._load_computed_map = survey_id, request, load_computed_map
        self._levels = possible_levels(cells.shape)
        # `cells` holds all quantities that it has evaluated, which would fill the memory. So this map keeps a copy of
        # its own plane, and a copy of `cells` without evaluated quantities.
        self.plane, self._evaluated = self.plane.copy(), replace(cells)

    def cell_at(self, delta: float, epsilon: float) -> xr.Dataset | None:
        """Return the variables of the survey's cell at a point; None outside of the survey.

        If the cell is not computed yet, the result has the closed forms at the point.

        Returns
        -------
        xr.Dataset | None
            Variables of the cell, or closed forms.
        """
        if self.value_and_status(delta, epsilon) is None:
            return None
        with suppress(MissingPartError):  # raised while the survey is queued and has no cells yet
            found = self._load_computed_map().cell_at(delta, epsilon)
            if found is not None and found["status"]:
                return found
        return super().cell_at(delta, epsilon)


def _closed_form_request(request: SurveyRequest) -> SurveyRequest:
    """Return the request of a survey of the same cells that computes only the closed forms."""
    return SurveyRequest(beta=request.beta, delta=request.delta, epsilon=request.epsilon, quantities=CLOSED_FORMS)


def _coarse_closed_form_request(request: SurveyRequest) -> SurveyRequest:
    """Return the request of a survey of the closed forms in the same plane, with at most SIDE cells along each axis."""
    delta, epsilon = (
        Axis(start=axis.start, stop=axis.stop, num=min(axis.num, SIDE)) for axis in (request.delta, request.epsilon)
    )
    return _closed_form_request(request.model_copy(update={"delta": delta, "epsilon": epsilon}))


class ExactMaps:
    """Maps that need no computed survey. Closed forms are computed at the first request, for all pages."""

    request = REQUEST

    @property
    def maps(self) -> dict[str, Any]:
        """Maps of the example survey: {variable: names of its maps; () if the variable has a single map}."""
        exact = map_names_by_variable(_closed_form_request(REQUEST))
        return {name: names for name, names in map_names_by_variable(REQUEST).items() if name in {*MAPS, *exact}}

    def __init__(self) -> None:
        self._unfinished: OrderedDict[tuple[str, str, int, int], MapPlane] = OrderedDict()
        self._lock = Lock()

    def map_of_unfinished_survey(
        self, job: JobRow, variable: str, index: int, number: int, computed: Callable[[], MapPlane]
    ) -> MapPlane:
        """Return a closed-form map of an unfinished survey, whose `cell_at` reads computed cells from the survey.

        This method blocks: use a thread.

        Parameters
        ----------
        index : int
            Number of the attractor or orbit, if the variable has a map for each; otherwise 0.
        number : int
            Number of the slice; 0 without a third axis.
        computed : Callable[[], MapPlane]
            Called by `cell_at`. Returns the map of the cells that the survey has computed; raises MissingPartError if
            the survey has computed no cells yet.

        Returns
        -------
        MapPlane
            The map, which all pages share.
        """
        key = job.id, variable, index, number
        with self._lock:
            if key not in self._unfinished:
                request = SurveyRequest.model_validate(job.request)
                slice_ = request.slice_request(request.slice_index(number))
                self._unfinished[key] = UnfinishedSurveyPlane(slice_, job.id, variable, index, computed)
            self._unfinished.move_to_end(key)
            while len(self._unfinished) > MOST_UNFINISHED:
                self._unfinished.popitem(last=False)
            return self._unfinished[key]

    def plane(self, variable: str, index: int) -> MapPlane:
        """Return a map of the explorer's example. index: number of the orbit. The call blocks: use a thread."""
        return ExamplePlane(self._cells, self._dataset, variable, index)

    @cached_property
    def _cells(self) -> Cells:
        return cells_of_tile(_closed_form_request(REQUEST))

    @cached_property
    def _dataset(self) -> xr.Dataset:
        return _closed_form_dataset(self._cells).merge(load_stored_variables(), join="exact")


def _closed_form_dataset(cells: Cells, names: Collection[str] = ()) -> xr.Dataset:
    """Return the variables in closed form, computed at all cells, as a dataset like that of `open_survey`.

    names: names of the variables to compute, () for all variables in closed form.

    Returns
    -------
    xr.Dataset
        Variables, with the coordinates δ and ε.
    """
    every = [each for each in variables_of_groups(CLOSED_FORMS, REQUEST.model) if each.is_per_cell]
    quantities = [each for each in every if not names or each.name in names]
    dims = {dim for each in quantities for dim in each.dims[:-2]}
    labels = {dim: list(dimension_labels(dim, 1)) for dim in dims}
    # values of `status`, the only variable here without a group; its evaluator is not called, and every cell counts as
    # computed
    done = np.ones(cells.shape, np.int8)
    values = {
        each.name: (each.dims, np.asarray(each.evaluate(cells)) if each.group else done, each.attributes)
        for each in quantities
    }
    return xr.Dataset(values, coords=labels | {"delta": cells.delta, "epsilon": cells.epsilon})
