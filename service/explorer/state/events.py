"""Events: everything that a viewer does on the page, and that changes its view."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gear_rattle.service.explorer.common.address import AsSeen, Chosen, Entered, Further, Limits, Pair, Pin, Ranges


@dataclass(frozen=True)
class SurveyChosen:
    """A survey was chosen by its id; with `is_new` it shows its usual map, whatever was chosen before."""

    survey: str
    is_new: bool = False


@dataclass(frozen=True)
class VariableChosen:
    """A variable of the survey was chosen."""

    variable: str


@dataclass(frozen=True)
class MapOffered:
    """The page settled on a map that its survey has, in place of one that it does not have or that nobody chose."""

    variable: str
    index: int
    slice: int


@dataclass(frozen=True)
class IndexChosen:
    """One of several maps of the variable was chosen."""

    index: int


@dataclass(frozen=True)
class SliceChosen:
    """A slice of a survey with a third axis was chosen."""

    slice: int


@dataclass(frozen=True)
class LimitsSet:
    """The range of colours was set, and whether it is on a log scale."""

    limits: Limits | Pair
    log: bool


@dataclass(frozen=True)
class MapDrawn:
    """A map was drawn with these settings, for the limits that a view had; None if nothing is shown."""

    seen: AsSeen | None
    limits: Limits | Pair = "auto"


@dataclass(frozen=True)
class OverlaysChosen:
    """The lines over the map were chosen."""

    overlays: tuple[str, ...]


@dataclass(frozen=True)
class ShareSet:
    """P(quiet) of the design limit was set."""

    share: float


@dataclass(frozen=True)
class FamilyChosen:
    """A family was chosen by its number, or none."""

    family: int | None


@dataclass(frozen=True)
class WindowMoved:
    """Another window is shown."""

    window: Ranges


@dataclass(frozen=True)
class WindowReset:
    """The whole survey is shown."""


@dataclass(frozen=True)
class WentBack:
    """The window before is shown again."""


@dataclass(frozen=True)
class WentForward:
    """The window that was left by going back is shown again."""


@dataclass(frozen=True)
class Pointed:
    """A viewer points at (δ, ε) in the figure of this name, or by the keyboard."""

    at: Pair
    source: str


@dataclass(frozen=True)
class PointOpened:
    """A point (δ, ε) was opened, that of a machine if one was entered; `state`: of its tabs, if it begins with one."""

    point: Pair
    machine: Entered | None = None
    state: Mapping[str, str] | None = None


@dataclass(frozen=True)
class PointChanged:
    """Another state of the open point's tabs was chosen."""

    state: Mapping[str, str]


@dataclass(frozen=True)
class WayChosen:
    """The diagram of the open point goes to this point (δ, ε); where none is open, this one is opened."""

    to: Pair


@dataclass(frozen=True)
class PointClosed:
    """The open point was closed."""


@dataclass(frozen=True)
class PlaceChosen:
    """A place with a name was chosen: a window, and the point that is open there, if there is one."""

    window: Ranges
    point: Pair | None
    state: Mapping[str, str]


@dataclass(frozen=True)
class ProfileChosen:
    """The map was chosen whose profile stands below the diagram, with the limits of its axis."""

    profile: Chosen
    limits: Pair | None = None


@dataclass(frozen=True)
class MapAdded:
    """Another map was put beside the first."""

    further: Further


@dataclass(frozen=True)
class MapChanged:
    """Another map is shown in this place beside the first."""

    place: int
    further: Further


@dataclass(frozen=True)
class MapRemoved:
    """The map in this place beside the first was removed."""

    place: int


@dataclass(frozen=True)
class PinAdded:
    """A point was pinned."""

    pin: Pin


@dataclass(frozen=True)
class PinRemoved:
    """A pin was removed."""

    pin: Pin


Event = (
    SurveyChosen | VariableChosen | MapOffered | IndexChosen | SliceChosen | LimitsSet | MapDrawn | OverlaysChosen
    | ShareSet | FamilyChosen | WindowMoved | WindowReset | WentBack | WentForward | Pointed | PointOpened
    | PointChanged | WayChosen | PointClosed | PlaceChosen | ProfileChosen | MapAdded | MapChanged | MapRemoved
    | PinAdded | PinRemoved
)  # fmt: skip
