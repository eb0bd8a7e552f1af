"""Events that change the view of a page: a viewer's actions, and the page's own choice or drawing of a map."""

from __future__ import annotations

from dataclasses import dataclass

from gear_rattle.service.explorer.common.address import (
    ComparisonChoice,
    DrawnMapSettings,
    EnteredMachine,
    Limits,
    MapChoice,
    Pair,
    Pin,
    Ranges,
)
from gear_rattle.service.explorer.common.point_state import PointTabsState, PointTolerances


@dataclass(frozen=True)
class SurveyChosen:
    """A survey was chosen by its id. is_new: True if it was just submitted, and so is shown with its default map."""

    survey: str
    is_new: bool = False


@dataclass(frozen=True)
class VariableChosen:
    """A variable of the survey was chosen: the page shows its map."""

    variable: str


@dataclass(frozen=True)
class DefaultMapChosen:
    """The page itself chose a map, because no viewer chose one or because the survey lacks the chosen map."""

    variable: str
    index: int
    slice: int


@dataclass(frozen=True)
class MapIndexChosen:
    """One of several maps of the variable was chosen by its index."""

    index: int


@dataclass(frozen=True)
class SliceChosen:
    """A slice of a survey with a third axis was chosen by its number, from 0."""

    slice: int


@dataclass(frozen=True)
class ColourRangeChosen:
    """The range of the colours was set. log: True for a log scale."""

    limits: Limits | Pair
    log: bool


@dataclass(frozen=True)
class MapDrawn:
    """A map was drawn, or the drawn map was removed.

    seen: settings of the drawn map, None if the map was removed. limits: `View.limits` when the map was drawn. A
    drawing with logarithmic colours replaces a lower limit of 0 or less. In this case the view gets the limits of
    `seen`, unless a viewer has changed the view's limits in the meantime.
    """

    seen: DrawnMapSettings | None
    limits: Limits | Pair = "auto"


@dataclass(frozen=True)
class OverlaysChosen:
    """The lines over the map were chosen."""

    overlays: tuple[str, ...]


@dataclass(frozen=True)
class RequiredShareSet:
    """The probability of quiet running that the design limit requires was set."""

    share: float


@dataclass(frozen=True)
class FamilyChosen:
    """A family was chosen by its number, or None if the choice of a family was removed."""

    family: int | None


@dataclass(frozen=True)
class WindowMoved:
    """The map was moved or zoomed to another window."""

    window: Ranges


@dataclass(frozen=True)
class WindowReset:
    """The map was set back to the whole survey."""


@dataclass(frozen=True)
class WindowBackChosen:
    """Back was chosen: the map shows the previous window again."""


@dataclass(frozen=True)
class WindowForwardChosen:
    """Forward was chosen: the map shows again the window that it showed before `WindowBackChosen`."""


@dataclass(frozen=True)
class PointerMoved:
    """A viewer points at (δ, ε). source: name of the figure under the mouse, or KEYBOARD."""

    at: Pair
    source: str


@dataclass(frozen=True)
class PointOpened:
    """A point (δ, ε) was opened. machine: the machine that was entered for the point, or None.

    state: new state of the point's tabs, or None. None keeps the tabs as they are if the same point with the same
    machine is open already. If another point or none is open, None gives the default state with the same open tab.
    """

    point: Pair
    machine: EnteredMachine | None = None
    state: PointTabsState | None = None


@dataclass(frozen=True)
class TabChosen:
    """A tab of the open point was chosen by its name, see `TABS`."""

    tab: str


@dataclass(frozen=True)
class AttractorChosen:
    """An attractor was chosen, to show its motion. attractor: its number, from 0 by falling basin fraction."""

    attractor: int


@dataclass(frozen=True)
class InitialConditionChosen:
    """An initial condition (τ, v) was chosen in the picture of the basins, to show the motion that begins there."""

    start: Pair


@dataclass(frozen=True)
class DirectionChosen:
    """The axis of the diagram was chosen, "epsilon" or "delta"."""

    direction: str


@dataclass(frozen=True)
class DiagramPointChosen:
    """A point of the diagram was chosen.

    at: its position from 0, the diagram's first point, to 1, its last. None: the open point itself was chosen.
    """

    at: float | None


@dataclass(frozen=True)
class YieldRequested:
    """The yield of the open point with these tolerances was requested."""

    tolerance: PointTolerances


@dataclass(frozen=True)
class SoundRequested:
    """The sound of the shown motion was requested. rpm: speed of the machine, None if a viewer entered none."""

    rpm: float | None


@dataclass(frozen=True)
class DiagramEndChosen:
    """A diagram from the open point to the point `to` (δ, ε) was requested. If no point is open, `to` is opened."""

    to: Pair


@dataclass(frozen=True)
class PointClosed:
    """The open point was closed."""


@dataclass(frozen=True)
class BookmarkChosen:
    """A bookmark was chosen: its window is shown, and its point is opened. point: None closes the open point.

    state: new state of the point's tabs, or None, see `PointOpened`.
    """

    window: Ranges
    point: Pair | None
    state: PointTabsState | None = None


@dataclass(frozen=True)
class ProfileChosen:
    """A map was chosen for the profile below the diagram. limits: range of the profile's axis, None for the default."""

    profile: MapChoice
    limits: Pair | None = None


@dataclass(frozen=True)
class ComparisonMapAdded:
    """A comparison map was added."""

    further: ComparisonChoice


@dataclass(frozen=True)
class ComparisonMapChanged:
    """Another map was chosen for the comparison map with the number `index`, from 0 (the main map has no number)."""

    index: int
    further: ComparisonChoice


@dataclass(frozen=True)
class ComparisonMapRemoved:
    """Comparison map number `index` was removed, 0 for the second map of the page."""

    index: int


@dataclass(frozen=True)
class PinAdded:
    """A point was pinned."""

    pin: Pin


@dataclass(frozen=True)
class PinRemoved:
    """A pin was removed."""

    pin: Pin


Event = (
    SurveyChosen | VariableChosen | DefaultMapChosen | MapIndexChosen | SliceChosen | ColourRangeChosen | MapDrawn |
    OverlaysChosen | RequiredShareSet | FamilyChosen | WindowMoved | WindowReset | WindowBackChosen |
    WindowForwardChosen |
    PointerMoved | PointOpened | TabChosen | AttractorChosen | InitialConditionChosen | DirectionChosen |
    DiagramPointChosen | YieldRequested | SoundRequested | DiagramEndChosen | PointClosed | BookmarkChosen |
    ProfileChosen | ComparisonMapAdded | ComparisonMapChanged | ComparisonMapRemoved | PinAdded | PinRemoved
)  # fmt: skip
