"""The options of a map's picture: window, range of colours, lines, and caption."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from gear_rattle.workers.survey.values.quantities import QUANTITIES
from gear_rattle.workers.survey.values.schema import OF_PERIODIC, SLOT
from rattle.curves import NAMES

if TYPE_CHECKING:  # not imported at run time, because matplotlib takes long to import, and only drawing needs it
    import xarray as xr
    from matplotlib.colors import Normalize

    from gear_rattle.workers.survey.request import SurveyRequest

Pair = tuple[float, float]
Span = Literal["auto", "robust", "full"]
Form = Literal["png", "svg", "pdf"]

ROBUST = (2.0, 98.0)  # percentiles of the values at the ends of the span "robust"
#: Lines other than bifurcation curves: the boundary crisis, the design limit, the codimension-two points.
CRISIS, LIMIT, POINTS = "crisis", "design_limit", "points"
#: Maps that are computed from a store's families: the largest family of each cell, and the share of one family.
LARGEST, SHARE = "largest_family", "family_fraction"
#: Maps that need the whole survey, so that a window of them cannot be computed at finer resolution.
SURVEY_ONLY = frozenset({LARGEST, SHARE, *OF_PERIODIC})
#: Variables with a map for each slot. If slots follow families, a window of these maps cannot be computed at finer
#: resolution either, because a window has no families.
IN_SLOTS = frozenset(quantity.name for quantity in QUANTITIES if SLOT in quantity.dims)
AMONG, WHICH = "among", ("all", "rattling")
LINES = (*NAMES, CRISIS, LIMIT, POINTS)
#: Styles of lines other than bifurcation curves, in the form of `rattle.plot.STYLES`.
OWN_STYLES: dict[str, tuple[str, Any]] = {CRISIS: ("#00695c", (0, (4, 1.5))), LIMIT: ("#b8860b", "-")}
USUAL_SHARE = 0.9  # a design limit's default probability of running quietly
COVERED = 0xC4 / 0xFF  # opacity of the white cover over cells without the chosen family
OPACITY = 0.3  # opacity of the area that shows the 95 % interval of a design limit


def needs_whole_survey(variable: str, request: SurveyRequest) -> bool:
    """Return whether a map needs the whole survey, so that a window of it cannot be computed at finer resolution."""
    return variable in SURVEY_ONLY or (variable in IN_SLOTS and request.slots_follow_families)


def variable_in_words(name: str) -> str:
    """Return the name of a variable in words. "velocity" becomes "speed", because stores hold only sizes of Φ'."""
    return name.replace("_", " ").replace("velocity", "speed")


def replace_periods_with_revolutions(text: str) -> str:
    """Return a text about a machine with "revolution" in place of "forcing period", because both last equally long."""
    return text.replace("forcing period", "revolution").replace("watched periods", "watched revolutions")


@dataclass(frozen=True)
class MapPictureOptions:
    """Options of a picture.

    delta, epsilon: (low, high) of the window, None for all cells. span: the range of the colours: "auto" (the usual
    range of the variable), "robust" (the middle 96 % of the values), "full" (all values), or (low, high). log: whether
    the colour scale is logarithmic. lines: names from LINES to draw; None for the lines that explain the map.
    family: the number of a family; cells without it are dimmed; None to dim no cells. caption: text below the map.
    """

    delta: Pair | None = None
    epsilon: Pair | None = None
    span: Span | Pair = "auto"
    log: bool = False
    lines: tuple[str, ...] | None = None
    family: int | None = None
    caption: str = ""

    def cut_to_window(self, dataset: xr.Dataset) -> xr.Dataset:
        """Return the cells of a survey inside the window, with one more cell on each side."""
        windows = {"delta": self.delta, "epsilon": self.epsilon}
        return dataset.isel({axis: _cells_around(dataset[axis].values, *at) for axis, at in windows.items() if at})

    def with_caption(self, caption: str) -> MapPictureOptions:
        """Return a copy with another caption."""
        return replace(self, caption=caption)

    def colour_norm(self, usual: Normalize, values: np.ndarray) -> Normalize:
        """Return matplotlib's norm (range of colours) for these values. usual: the usual norm of the variable."""
        from matplotlib.colors import LogNorm, Normalize

        low, high, _ = colour_limits(values, (float(usual.vmin or 0.0), float(usual.vmax or 0.0)), self.span)
        log = False
        if self.log:
            low, high, log, _ = logarithmic_scale_limits(values, low, high, "")
        return (LogNorm if log else Normalize)(low, high)


USUAL_LOOK = MapPictureOptions()


@dataclass(frozen=True)
class FinerCells:
    """Cells of a window at a finer resolution than the survey's: delta (n,), epsilon (m,), values (m, n)."""

    delta: np.ndarray
    epsilon: np.ndarray
    values: np.ndarray


@dataclass(frozen=True)
class OverlayData:
    """Overlays of a map. They are computed before the map is drawn, because the computation takes long.

    lines: points (k, 2) of the lines CRISIS and LIMIT, by name, with NaN between pieces. limit_interval: dampings (n,),
    and the lower and the upper ends (n,) of the design limit's 95 % interval there; None for no interval. finer_cells:
    cells of finer resolution, which are drawn where they have a value, or None.
    """

    lines: Mapping[str, np.ndarray] = field(default_factory=dict)
    limit_interval: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
    finer_cells: FinerCells | None = None


NO_OVERLAYS = OverlayData()


def _cells_around(axis: np.ndarray, low: float, high: float) -> slice:
    """Return the cells of an ascending axis with values from low to high, and one more cell on each side.

    Returns
    -------
    slice
        At least two cells, if the axis has two.
    """
    first = min(max(int(np.searchsorted(axis, low)) - 1, 0), max(axis.size - 2, 0))
    return slice(first, max(int(np.searchsorted(axis, high, "right")) + 1, first + 2))


def colour_limits(shown: np.ndarray, auto: Pair, span: Span | Pair) -> tuple[float, float, str]:
    """Return the range (low, high) of the colours for the shown values, and a note for the viewer, "" for no note.

    auto: the usual range of the variable. span: as in `MapPictureOptions`.

    Returns
    -------
    tuple[float, float, str]
        The range and the note.
    """
    if isinstance(span, tuple):
        return *span, ""
    low, high = auto
    if span != "auto" and shown.size:
        low, high = (float(x) for x in np.percentile(shown, ROBUST if span == "robust" else (0.0, 100.0)))
    if not low < high:
        return low, low + max(abs(low), 1.0) * 1e-3, "all values are equal"
    return low, high, ""


def logarithmic_scale_limits(shown: np.ndarray, low: float, high: float, note: str) -> tuple[float, float, bool, str]:
    """Return limits (low, high) of a logarithmic scale, whether such a scale is possible, and a note for the viewer.

    low, high, note: the limits and the note for a linear scale.

    Returns
    -------
    tuple[float, float, bool, str]
        The limits; False if no shown value is positive, or if `high` is not; and the note.
    """
    above = shown[shown > 0]
    if not above.size or high <= 0:
        return low, high, False, "nothing positive to show: the scale stays linear"
    low = low if low > 0 else float(above.min())
    if not low < high:
        high = 2.0 * low
    return low, high, True, note
