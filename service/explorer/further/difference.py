"""Compute the difference of two surveys: the same variable of both, on the cells of the first survey."""

from __future__ import annotations

import math

import numpy as np
import xarray as xr

from gear_rattle.service.explorer.map.planes import MapPlane, cell_indices
from gear_rattle.workers import SurveyRequest
from gear_rattle.workers.errors import SurveyError
from gear_rattle.workers.pictures.look import LARGEST
from gear_rattle.workers.pictures.maps import SYMMETRIC, map_title
from gear_rattle.workers.survey.levels.grid import possible_levels
from gear_rattle.workers.survey.values.evaluate import FAILED
from gear_rattle.workers.survey.values.schema import CELL, is_phase

MOST_CELLS = 24_000_000
SAME, OTHER = "the_same", "different"


def require_small_survey(request: SurveyRequest) -> None:
    """Raise SurveyError if a survey has too many cells for a difference, because differences are held in memory."""
    if (size := math.prod(request.shape)) > MOST_CELLS:
        raise SurveyError(
            f"A difference needs surveys of at most {MOST_CELLS:,} cells, and one of these surveys has {size:,} cells: "
            "submit a survey of a smaller window, or compute the difference in Python."
        )


class DifferenceMap(MapPlane):
    """The first map minus another map of the same variable, float32. For maps of codes: 1 where they differ, else 0.

    A difference of phases is wrapped to [−0.5, 0.5). The value is NaN where either map has no value. The status is 0
    where either map is not computed or the other map has no cell, and FAILED where a cell of either map failed.

    has_same_grid: True if both maps have the same cells. Otherwise each cell of the first map is compared with that
    cell of the other map that contains the centre of the first map's cell.
    """

    def __init__(self, first: MapPlane, other: MapPlane) -> None:
        """Read both maps. This call blocks: use a thread, and call `require_small_survey` first.

        Raises
        ------
        SurveyError
            The maps show families, which each survey numbers in its own way.
        """
        if first.plane.name == LARGEST:
            raise SurveyError("Families are numbered differently in each survey: choose another map.")
        self._first = first
        self.id, self.number, self.request = f"{first.id} {other.id}", first.number, first.request
        self.delta, self.epsilon, self._levels = first.delta, first.epsilon, possible_levels(first.request.shape)
        axes = ((other.delta, first.delta), (other.epsilon, first.epsilon))
        self.has_same_grid = all(np.array_equal(*pair) for pair in axes)
        column, row = (cell_indices(*pair) for pair in axes)
        (mine, status), (others, beside) = first.read_values_and_status(), other.read_values_and_status()
        others, beside = (each[np.ix_(row, column)] for each in (others, beside))
        reached = np.logical_and.outer(row >= 0, column >= 0)
        done = (status > 0) & (beside > 0) & reached
        failed = (status == FAILED) | (beside == FAILED)
        self.status = np.where(done, np.where(failed, FAILED, 1), 0).astype(np.int8)
        known = done & ~failed & ~np.isnan(mine) & ~np.isnan(others)
        variable, codes = first.plane, "flag_meanings" in first.plane.attrs or first.plane.dtype == bool
        with np.errstate(invalid="ignore"):
            found = np.where(mine == others, np.float32(0.0), mine - others)
        if codes:
            found = (mine != others).astype(np.float32)
        elif is_phase(str(variable.name)):
            found = (found + 0.5) % 1.0 - 0.5
        self.values = np.where(known, found, np.float32(np.nan)).astype(np.float32)
        meanings = {"flag_meanings": f"{SAME} {OTHER}"} if codes else {SYMMETRIC: True}
        attributes = {"long_name": f"difference: {map_title(variable)}", **meanings}
        self.plane = xr.DataArray(self.values, dims=CELL, name=f"{variable.name}_difference", attrs=attributes)

    def cell_at(self, delta: float, epsilon: float) -> xr.Dataset | None:
        """Return all variables of the first map's cell at a point; None outside. This method blocks: use a thread."""
        return self._first.cell_at(delta, epsilon)
