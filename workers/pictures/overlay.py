"""Draw bifurcation curves and codimension-two points over a map of a survey."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from gear_rattle.workers.pictures.look import LIMIT, NO_OVERLAYS, OPACITY, OWN_STYLES, OverlayData
from gear_rattle.workers.survey.axes import Window
from gear_rattle.workers.survey.plane_curves import MissingCurve, trace_curve_in_window, window_around
from gear_rattle.workers.survey.slices import surveyed_model
from rattle import plot
from rattle.curves import NAMES

#: For each variable the bifurcation curves that explain its map, drawn by default.
CURVES_ON: dict[str, tuple[str, ...]] = {
    "region": NAMES,
    "quiet_fraction": ("SN1", "quiet_limit"),
    "lyapunov_max": ("SN1", "G1", "G2"),
    **dict.fromkeys(
        ("basin_entropy", "boundary_basin_entropy", "boundary_distance", "crisis_side"), ("SN1", "quiet_limit")
    ),
}


def draw_curves(
    axes: Axes, dataset: xr.Dataset, names: Sequence[str], over: OverlayData = NO_OVERLAYS
) -> list[np.ndarray]:
    """Draw the lines `names` over a map, and return the points (k, 2) of each drawn line, with NaN between pieces."""
    model, window, drawn = surveyed_model(dataset), _survey_window(dataset), []
    limits = {"xlim": axes.get_xlim(), "ylim": axes.get_ylim()}
    if LIMIT in names and over.limit_interval is not None:
        axes.fill_between(*over.limit_interval, color=OWN_STYLES[LIMIT][0], alpha=OPACITY, linewidth=0)
    for name in (name for name in names if name in model.curve_names):
        curve = trace_curve_in_window(name, model, window)
        if not isinstance(curve, MissingCurve) and len(curve):
            drawn.append(plot.draw_curve(axes, curve))
    for name in (name for name in names if name in over.lines):
        plot.draw_line(axes, name, over.lines[name], OWN_STYLES[name])
        drawn.append(over.lines[name])
    axes.set(**limits)
    return drawn


def _survey_window(dataset: xr.Dataset) -> Window:
    return window_around(dataset["delta"].values, dataset["epsilon"].values)


def draw_codimension_two_points(axes: Axes, dataset: xr.Dataset, curves: Sequence[np.ndarray]) -> None:
    """Mark the codimension-two points of the model, and write their names away from the curves and existing text."""
    plot.mark_codimension_two_points(axes, surveyed_model(dataset).codimension_two(), curves)
