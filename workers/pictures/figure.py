"""Draw the picture of a survey: regions with the curves between them, quiet fraction, largest Lyapunov exponent."""

from collections.abc import Iterable

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gear_rattle.workers.errors import SurveyError
from gear_rattle.workers.pictures.machine_axes import draw_machine_axes
from gear_rattle.workers.pictures.maps import WITHOUT_VALUE, draw_legend, draw_map
from gear_rattle.workers.pictures.overlay import CURVES_ON, draw_codimension_two_points, draw_curves
from gear_rattle.workers.survey.slices import surveyed_model
from rattle import REGIONS
from rattle.plot import HALO, new_figure

PANELS = {
    "region": "Regions",
    "quiet_fraction": "Quiet fraction of the sample",
    "lyapunov_max": "Largest Lyapunov exponent",
}


def survey_figure(dataset: xr.Dataset) -> Figure:
    """Draw a survey, finished or not: a panel each for regions, quiet fraction and largest Lyapunov exponent.

    Returns
    -------
    Figure
        A matplotlib figure, with a panel for each of the three variables that the survey has.

    Raises
    ------
    SurveyError
        The survey has none of the three variables.
    """
    model = surveyed_model(dataset)
    panels = [name for name in PANELS if name in dataset]
    if not panels:
        raise SurveyError(f"the survey has no map to draw: compute a survey with one of {', '.join(PANELS)}")
    figure = new_figure(6.0 * len(panels), 5.0)
    curves: dict[str, tuple[Axes, list[np.ndarray]]] = {}
    for axes, name in zip(np.atleast_1d(figure.subplots(1, len(panels))), panels, strict=True):
        draw_map(axes, dataset, dataset[name], WITHOUT_VALUE.get(name, "none"))
        draw_machine_axes(axes, dataset)
        axes.set_title(PANELS[name])
        curves[name] = axes, draw_curves(axes, dataset, CURVES_ON[name])
        draw_legend(axes)
    figure.suptitle(f"Gear model, {model}", fontsize=13)
    if "region" in curves:
        axes, drawn = curves["region"]
        _write_names_of_survey_regions(axes, dataset)
        draw_codimension_two_points(axes, dataset, drawn)
    return figure


def _write_names_of_survey_regions(axes: Axes, dataset: xr.Dataset) -> None:
    """Write each region's name where the region is widest."""
    places = region_name_positions(*(np.asarray(dataset[name]) for name in ("region", "delta", "epsilon")))
    for name, where in places.items():
        axes.text(*where, name, ha="center", va="center", fontsize=13, weight="bold", path_effects=HALO, zorder=5)


def region_name_positions(region: np.ndarray, delta: np.ndarray, epsilon: np.ndarray) -> dict[str, tuple[float, float]]:
    """Return the names of the regions of a map (epsilon, delta), each with the point where the region is widest."""
    widest = innermost_cells(region, range(1, len(REGIONS)))
    return {REGIONS[code]: (float(delta[j]), float(epsilon[i])) for code, (i, j, _) in widest.items()}


def innermost_cells(codes: np.ndarray, wanted: Iterable[int]) -> dict[int, tuple[int, int, float]]:
    """Return for each wanted code that occurs in a map (m, n) the cell farthest from other codes and the map's edge.

    Returns
    -------
    dict[int, tuple[int, int, float]]
        By code: row and column of the cell, and its distance in cells from the nearest cell with another code or beyond
        the edge of the map.
    """
    from scipy.ndimage import distance_transform_edt  # imported here: loading it takes a fifth of a second

    places = {}
    for code in wanted:
        inside = codes == code
        if inside.any():
            # A margin of cells with another code keeps the name away from the frame.
            depth = distance_transform_edt(np.pad(inside, 1))[1:-1, 1:-1]
            i, j = np.unravel_index(np.argmax(depth), depth.shape)
            places[code] = int(i), int(j), float(depth[i, j])
    return places
