"""The accessor `survey.rattle` of an `xarray.Dataset`; importing this module registers it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import xarray as xr

if TYPE_CHECKING:  # not imported at run time, because matplotlib takes long to import
    from matplotlib.figure import Figure


@xr.register_dataset_accessor("rattle")
class SurveyAccessor:
    """The accessor `rattle` of a survey's dataset, with methods that draw it."""

    def __init__(self, survey: xr.Dataset) -> None:
        self._survey = survey

    def plot(self, variable: str = "region", index: int = 0, slice_number: int | None = None) -> Figure:
        """Draw a variable over the (δ, ε) plane.

        The colour bar has the names of codes, or the unit of numbers. Bifurcation curves that explain the map are drawn
        over it, and a legend says why cells have no value.

        Parameters
        ----------
        variable : str
            Any variable over (epsilon, delta), by default the regions.
        index : int
            The number of the map, from 0, if the variable has a map for each orbit or slot; else 0.
        slice_number : int | None
            The number of the slice, from 0, if the survey has a third axis; None if it has no third axis.

        Returns
        -------
        Figure
            A matplotlib figure, which notebooks show and `savefig` writes.

        Raises
        ------
        SurveyError
            The survey has no such map, or the map cannot be read.
        """
        from gear_rattle.workers.pictures.maps import draw_map_figure
        from gear_rattle.workers.survey.slices import select_slice

        return draw_map_figure(select_slice(self._survey, slice_number), variable, index)
