"""How a map is looked at: a part of the plane, what its colours span, the lines on it, and what is written below."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from gear_rattle.workers.survey.values.quantities import QUANTITIES
from gear_rattle.workers.survey.values.schema import OF_PERIODIC, SLOT
from rattle.curves import NAMES

if TYPE_CHECKING:  # a second for who draws, not for who asks
    import xarray as xr
    from matplotlib.colors import Normalize

    from gear_rattle.workers.survey.request import SurveyRequest

Pair = tuple[float, float]
Span = Literal["auto", "robust", "full"]
Form = Literal["png", "svg", "pdf"]

ROBUST = (2.0, 98.0)  # percentiles
#: Beside bifurcation curves: the boundary crisis, the design limit, the codimension-two points.
CRISIS, LIMIT, POINTS = "crisis", "design_limit", "points"
#: Maps that follow from what a store has of families: the largest one of each cell, among all or among those that
#: rattle, and the share of one.
LARGEST, SHARE = "largest_family", "family_fraction"
#: Maps that only a survey has: windows are not computed finer for them.
SURVEY_ONLY = frozenset({LARGEST, SHARE, *OF_PERIODIC})
#: Of a survey whose slots are those of families too, which windows do not join.
IN_SLOTS = frozenset(quantity.name for quantity in QUANTITIES if SLOT in quantity.dims)
AMONG, WHICH = "among", ("all", "rattling")
LINES = (*NAMES, CRISIS, LIMIT, POINTS)
#: Styles of those lines that are no bifurcation curves, as `rattle.plot.STYLES` has them.
OWN_STYLES: dict[str, tuple[str, Any]] = {CRISIS: ("#00695c", (0, (4, 1.5))), LIMIT: ("#b8860b", "-")}
USUAL_SHARE = 0.9  # the least P(quiet) of a design limit
COVERED = 0xC4 / 0xFF  # how much is covered of the cells in which a chosen family is not
OPACITY = 0.3  # opacity of the interval of a design limit


def is_of_survey_only(variable: str, request: SurveyRequest) -> bool:
    """Return whether windows of a map are not computed finer: they have nothing that is its."""
    return variable in SURVEY_ONLY or (variable in IN_SLOTS and request.slots_follow_families)


@dataclass(frozen=True)
class Look:
    """Options of a picture: window, colours, lines, family and caption.

    delta, epsilon: (low, high) of the window, None: of all cells. span: the colours go as in all pictures, over the
    middle 96 % of the values, over all, or from low to high; log: evenly in the logarithm. lines: some of LINES, None:
    those that explain the map. family: the cells in which it is not are dimmed. caption: the text below.
    """

    delta: Pair | None = None
    epsilon: Pair | None = None
    span: Span | Pair = "auto"
    log: bool = False
    lines: tuple[str, ...] | None = None
    family: int | None = None
    caption: str = ""

    def cut(self, dataset: xr.Dataset) -> xr.Dataset:
        """Return the cells of a survey that the window shows, and those around them."""
        windows = {"delta": self.delta, "epsilon": self.epsilon}
        return dataset.isel({axis: _around(dataset[axis].values, *at) for axis, at in windows.items() if at})

    def with_caption(self, caption: str) -> Look:
        """Return the same, with this written below."""
        return replace(self, caption=caption)

    def norm(self, usual: Normalize, values: np.ndarray) -> Normalize:
        """Return the scale of the colours of these values, which pictures have on this one."""
        from matplotlib.colors import LogNorm, Normalize

        low, high, _ = limits_of(values, (float(usual.vmin or 0.0), float(usual.vmax or 0.0)), self.span)
        log = False
        if self.log:
            low, high, log, _ = positive(values, low, high, "")
        return (LogNorm if log else Normalize)(low, high)


USUAL = Look()


@dataclass(frozen=True)
class Finer:
    """Cells of a window that are finer than those of its survey: delta (n,), epsilon (m,), values (m, n)."""

    delta: np.ndarray
    epsilon: np.ndarray
    values: np.ndarray


@dataclass(frozen=True)
class Over:
    """Drawings over a map that take longer to find than to draw.

    lines: points (k, 2) of CRISIS and of LIMIT, NaN between pieces. band: dampings (n,), and the ends of the interval
    of the limit there, NaN where it is open. finer: drawn where it has a value.
    """

    lines: Mapping[str, np.ndarray] = field(default_factory=dict)
    band: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
    finer: Finer | None = None


NOTHING_OVER = Over()


def _around(cells: np.ndarray, low: float, high: float) -> slice:
    """Those of ascending cells that are in a range, and one on either side: two at least, or they have no width."""
    first = min(max(int(np.searchsorted(cells, low)) - 1, 0), max(cells.size - 2, 0))
    return slice(first, max(int(np.searchsorted(cells, high, "right")) + 1, first + 2))


def limits_of(shown: np.ndarray, auto: Pair, span: Span | Pair) -> tuple[float, float, str]:
    """Return the range of colours for these values, and a note on it."""
    if isinstance(span, tuple):
        return *span, ""
    low, high = auto
    if span != "auto" and shown.size:
        low, high = (float(x) for x in np.percentile(shown, ROBUST if span == "robust" else (0.0, 100.0)))
    if not low < high:
        return low, low + max(abs(low), 1.0) * 1e-3, "all values are equal"
    return low, high, ""


def positive(shown: np.ndarray, low: float, high: float, note: str) -> tuple[float, float, bool, str]:
    """Limits for a logarithmic scale, which shows positive values only; whether there can be one."""
    above = shown[shown > 0]
    if not above.size or high <= 0:
        return low, high, False, "nothing positive to show: the scale stays linear"
    low = low if low > 0 else float(above.min())
    if not low < high:
        high = 2.0 * low
    return low, high, True, note
