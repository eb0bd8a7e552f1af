"""The picture of a survey: its regions with the curves that bound them, where quiet survives, how chaotic it gets."""

from collections.abc import Iterable

import numpy as np
import xarray as xr
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.ndimage import distance_transform_edt

from workers.curves import CURVES, codimension_two
from workers.errors import SurveyError
from workers.maps import draw_legend, draw_map, new_figure

PANELS = {
    "region": ("Regions", ("SN1", "PDC", "G1", "G2", "quiet_limit")),
    "quiet_fraction": ("Quiet fraction of the sample", ("SN1", "quiet_limit")),
    "lyapunov_max": ("Largest Lyapunov exponent", ("SN1", "G1", "G2")),
}
STYLES = {
    "SN1": ("black", "-"),
    "PDC": ("#7b3294", "--"),
    "G1": ("#c51b1b", "-"),
    "G2": ("#c51b1b", (0, (4, 1.5))),
    "quiet_limit": ("#08519c", ":"),
}
POINTS = {"COD21": (-34, -40, "s"), "COD22": (26, -26, "D")}  # offset of the label in points, marker
ROMAN = ("", "I", "II", "III", "IV", "V")
HALO = [patheffects.withStroke(linewidth=2.5, foreground="white")]


def survey_figure(dataset: xr.Dataset) -> Figure:
    """Draw a survey, finished or not: a panel each for regions, quiet fraction and largest Lyapunov exponent.

    Raises:
        SurveyError: the survey has none of the three.
    """
    panels = [name for name in PANELS if name in dataset]
    if not panels:
        raise SurveyError(f"nothing to draw: ask for a survey with one of {', '.join(PANELS)}")
    figure = new_figure(5.6 * len(panels), 5.0)
    beta = float(dataset.attrs["beta"])
    for axes, name in zip(np.atleast_1d(figure.subplots(1, len(panels), sharey=True)), panels, strict=True):
        title, curves = PANELS[name]
        draw_map(axes, dataset, dataset[name], nothing="only quiet")
        axes.set_title(title)
        axes.label_outer()
        _draw_curves(axes, curves, beta)
        if name == "region":
            _name_regions(axes, dataset)
            _draw_points(axes, beta)
        draw_legend(axes)
    figure.suptitle(f"Gear model, half-backlash β = {beta:g}", fontsize=13)
    return figure


def _draw_curves(axes: Axes, names: Iterable[str], beta: float) -> None:
    """Draw the curves that cross the map."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    delta = np.linspace(left, right, 1001)
    delta = delta[delta > 0]
    for name in names:
        epsilon = CURVES[name].epsilon(delta, beta)
        if np.any((epsilon >= bottom) & (epsilon <= top)):
            colour, dashes = STYLES[name]
            label = name.replace("_", " ")
            axes.plot(delta, epsilon, color=colour, linestyle=dashes, linewidth=1.4, label=label, path_effects=HALO)
    axes.set(xlim=(left, right), ylim=(bottom, top))


def _draw_points(axes: Axes, beta: float) -> None:
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    for name, (x, y, marker) in POINTS.items():
        delta, epsilon = codimension_two(name, beta)
        if left <= delta <= right and bottom <= epsilon <= top:
            axes.plot(delta, epsilon, marker, color="white", markeredgecolor="black", markersize=5, zorder=4)
            axes.annotate(
                name,
                (delta, epsilon),
                (x, y),
                textcoords="offset points",
                ha="center",
                fontsize=8,
                arrowprops={"arrowstyle": "-", "linewidth": 0.8, "shrinkB": 3},
                path_effects=HALO,
                zorder=5,
            )


def _name_regions(axes: Axes, dataset: xr.Dataset) -> None:
    """Write each region's number where the region is widest."""
    region = np.asarray(dataset["region"])
    for label, name in enumerate(ROMAN):
        inside = region == label
        if label and inside.any():
            # A margin of cells outside keeps the number off the frame.
            depth = distance_transform_edt(np.pad(inside, 1))[1:-1, 1:-1]
            i, j = np.unravel_index(np.argmax(depth), depth.shape)
            where = float(dataset["delta"][j]), float(dataset["epsilon"][i])
            axes.text(*where, name, ha="center", va="center", fontsize=13, weight="bold", path_effects=HALO, zorder=5)
