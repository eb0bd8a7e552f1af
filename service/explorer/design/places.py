"""Bookmarks of the plane at β = 0.6: codimension-two points, the crisis, and the figures of the paper."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from gear_rattle.service.explorer.common.address import Pair, Ranges
from gear_rattle.service.explorer.common.point_state import PointTabsState
from rattle.plot import FIGURE_4, FIGURE_5, FIGURE_6, FIGURE_7, FIGURE_8, FIGURE_9

#: Points from `rattle.curves.codimension_two`. A window with half-widths EITHER_WAY shows the curves that meet there.
CORNERS = {
    "COD20, where C flips on G1": (0.54177, 0.18323),
    "COD21, equal multipliers on G1": (0.75904, 0.09550),
    "COD22, where SN1, G1 and G2 meet": (0.77015, 0.09789),
    "COD23, where SN2 and PD1 end on G1": (0.76016, 0.09571),
}
EITHER_WAY = 0.004, 0.001
#: Points (δ, ε) at which a boundary crisis ends chaos, from `rattle.crisis.boundary_crisis`.
CRISES = {"0.6": (0.6, 0.1108867568), "0.762": (0.762, 0.09742235)}


@dataclass(frozen=True)
class Bookmark:
    """A window of the plane, with a point to open in it (None for no point), and the state of the point's tabs.

    state: if it is None, the tabs stay or get their default state, as `PointOpened` describes.
    """

    window: Ranges
    point: Pair | None = None
    state: PointTabsState | None = None


def bookmarks() -> dict[str, Bookmark]:
    """Return all bookmarks by name."""
    return dict(_named_bookmarks())


def shown_bookmark(window: Ranges | None, point: Pair | None) -> Bookmark | None:
    """Return the bookmark that a view shows, None if there is none.

    The bookmark has the window and the open point of the view. If no bookmark has both, the bookmark is the first that
    has the same window and no point.

    Parameters
    ----------
    window : Ranges | None
        Window of the view, None for the whole survey.
    point : Pair | None
        Open point of the view.

    Returns
    -------
    Bookmark | None
        The bookmark.
    """
    there = [each for each in bookmarks().values() if each.window == window]
    return next((each for wanted in (point, None) for each in there if each.point == wanted), None)


def _named_bookmarks() -> Iterator[tuple[str, Bookmark]]:
    for name, (delta, epsilon) in CORNERS.items():
        wide, high = EITHER_WAY
        yield name, Bookmark(((delta - wide, delta + wide), (epsilon - high, epsilon + high)))
    for name, point in CRISES.items():
        yield f"The crisis at δ = {name}", Bookmark(FIGURE_7, point)
    delta, several = FIGURE_4
    for epsilon in several:
        yield f"Figure 4: basins at ε = {epsilon:g}", Bookmark(FIGURE_7, (delta, epsilon))
    for name, (delta, (low, high)) in {"5": FIGURE_5, "9": FIGURE_9}.items():
        middle = (low + high) / 2
        state = PointTabsState(span=float(f"{(high - low) / 2:.12g}"))
        diagram = Bookmark(FIGURE_7 if name == "5" else FIGURE_8, (delta, middle), state)
        yield f"Figure {name}: diagram at δ = {delta:g}", diagram
    yield "Figure 6: manifolds", Bookmark(FIGURE_7, FIGURE_6)
    yield "Figure 7: the plane", Bookmark(FIGURE_7)
    yield "Figure 8: about COD21 and COD22", Bookmark(FIGURE_8)
