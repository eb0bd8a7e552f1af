"""The options of a map's picture: window, range of colours, lines, and caption."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from gear_rattle.workers.survey.values.quantities import QUANTITIES
from gear_rattle.workers.survey.values.schema import OF_PERIODIC, SLOT
from rattle.curves import NAMES

if TYPE_CHECKING:  # takes a second to import, and only drawing needs it
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
#: Maps that exist for surveys only: a window of such a map cannot be computed at finer resolution.
SURVEY_ONLY = frozenset({LARGEST, SHARE, *OF_PERIODIC})
#: Further maps without finer windows, if the survey's slots follow families, because a window has no families.
IN_SLOTS = frozenset(quantity.name for quantity in QUANTITIES if SLOT in quantity.dims)
AMONG, WHICH = "among", ("all", "rattling")
LINES = (*NAMES, CRISIS, LIMIT, POINTS)
#: Styles of lines other than bifurcation curves, in the form of `rattle.plot.STYLES`.
OWN_STYLES: dict[str, tuple[str, Any]] = {CRISIS: ("#00695c", (0, (4, 1.5))), LIMIT: ("#b8860b", "-")}
USUAL_SHARE = 0.9  # default probability of running quietly up to a design limit
COVERED = 0xC4 / 0xFF  # opacity of the white cover over cells without the chosen family
OPACITY = 0.3  # opacity of the interval of a design limit


def is_of_survey_only(variable: str, request: SurveyRequest) -> bool:
    """Return whether a map exists for surveys only, so that its windows cannot be computed at finer resolution."""
    return variable in SURVEY_ONLY or (variable in IN_SLOTS and request.slots_follow_families)


def variable_words(name: str) -> str:
    """Return the name of a variable in words: a velocity of a store is the size of one, a speed."""
    return name.replace("_", " ").replace("velocity", "speed")


def in_revolutions(text: str) -> str:
    """Return a text about a machine, whose forcing period is a revolution."""
    return text.replace("forcing period", "revolution").replace("watched periods", "watched revolutions")


@dataclass(frozen=True)
class Look:
    """Options of a picture.

    delta, epsilon: (low, high) of the window, None for all cells. span: range of the colours: "auto" (the usual range
    of the variable), "robust" (the middle 96 % of the values), "full" (all values), or (low, high). log: logarithmic
    colours. lines: names from LINES; None for the lines that explain the map. family: cells without this family are
    dimmed. caption: text below the map.
    """

    delta: Pair | None = None
    epsilon: Pair | None = None
    span: Span | Pair = "auto"
    log: bool = False
    lines: tuple[str, ...] | None = None
    family: int | None = None
    caption: str = ""

    def cut(self, dataset: xr.Dataset) -> xr.Dataset:
        """Return the cells of a survey inside the window, with one more cell on each side."""
        windows = {"delta": self.delta, "epsilon": self.epsilon}
        return dataset.isel({axis: _around(dataset[axis].values, *at) for axis, at in windows.items() if at})

    def with_caption(self, caption: str) -> Look:
        """Return a copy with another caption."""
        return replace(self, caption=caption)

    def norm(self, usual: Normalize, values: np.ndarray) -> Normalize:
        """Return the colour scale for these values. usual: the variable's usual scale."""
        from matplotlib.colors import LogNorm, Normalize

        low, high, _ = limits_of(values, (float(usual.vmin or 0.0), float(usual.vmax or 0.0)), self.span)
        log = False
        if self.log:
            low, high, log, _ = positive(values, low, high, "")
        return (LogNorm if log else Normalize)(low, high)


USUAL = Look()


@dataclass(frozen=True)
class Finer:
    """Cells of a window at a finer resolution than the survey's: delta (n,), epsilon (m,), values (m, n)."""

    delta: np.ndarray
    epsilon: np.ndarray
    values: np.ndarray


@dataclass(frozen=True)
class Over:
    """Overlays of a map that are computed beforehand, because this takes long.

    lines: points (k, 2) of the lines CRISIS and LIMIT, by name; NaN between pieces. band: dampings (n,), and both ends
    of the design limit's confidence interval at each, NaN at an open end. finer: cells of finer resolution, drawn where
    they have a value.
    """

    lines: Mapping[str, np.ndarray] = field(default_factory=dict)
    band: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
    finer: Finer | None = None


NOTHING_OVER = Over()


def _around(cells: np.ndarray, low: float, high: float) -> slice:
    """Return the cells of an ascending axis inside a range, with one more on each side, at least two altogether."""
    first = min(max(int(np.searchsorted(cells, low)) - 1, 0), max(cells.size - 2, 0))
    return slice(first, max(int(np.searchsorted(cells, high, "right")) + 1, first + 2))


def limits_of(shown: np.ndarray, auto: Pair, span: Span | Pair) -> tuple[float, float, str]:
    """Return the range of colours for the shown values, and a note for the viewer, or "". auto: the usual range."""
    if isinstance(span, tuple):
        return *span, ""
    low, high = auto
    if span != "auto" and shown.size:
        low, high = (float(x) for x in np.percentile(shown, ROBUST if span == "robust" else (0.0, 100.0)))
    if not low < high:
        return low, low + max(abs(low), 1.0) * 1e-3, "all values are equal"
    return low, high, ""


def positive(shown: np.ndarray, low: float, high: float, note: str) -> tuple[float, float, bool, str]:
    """Return limits (low, high) of a logarithmic scale, whether such a scale is possible, and a note for the viewer."""
    above = shown[shown > 0]
    if not above.size or high <= 0:
        return low, high, False, "nothing positive to show: the scale stays linear"
    low = low if low > 0 else float(above.min())
    if not low < high:
        high = 2.0 * low
    return low, high, True, note
