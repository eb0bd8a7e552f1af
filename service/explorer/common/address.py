"""Write the state of an explorer page as the query of its URL, and read it back."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Literal, NamedTuple
from urllib.parse import urlencode

from gear_rattle.service.explorer.common.address_fields import (
    address_field,
    address_field_texts,
    pair_text,
    parse_address_fields,
    parse_pair,
    parse_point,
    parse_text_or_default,
    require_allowed_text,
    require_between,
)
from gear_rattle.service.explorer.common.point_state import PointTabsState
from gear_rattle.service.harmonics import harmonic_texts, read_harmonics
from gear_rattle.service.operations.diagrams import Pair
from gear_rattle.workers.pictures.look import LINES, POINTS, USUAL_SHARE
from rattle import Machine
from rattle.curves import NAMES, QUIET_LIMIT
from rattle.models import ADDED, Model, model_of, with_harmonics
from rattle.parameters import Harmonic
from rattle.populations import MOST_SHARE

Ranges = tuple[Pair, Pair]  # (low, high) of δ and of ε in a figure, which may show more than the plane δ > 0, ε ≥ 0
Limits = Literal["auto", "robust", "full"]
LIMITS: tuple[Limits, ...] = ("auto", "robust", "full")
OVERLAYS = LINES  # names of all lines and marks that can be drawn over a map
#: Default lines over a map: BORDERS (all curves of the model and its codimension-two points) over the map of regions,
#: and FEW_LINES over any other map.
FEW_LINES, BORDERS, REGION = ("SN1", "G1", QUIET_LIMIT), (*NAMES, POINTS), "region"
UNCHOSEN: Ranges = (0.4, 1.0), (0.0, 0.3)  # window of (δ, ε) if no survey is chosen
THEMES = ("light", "dark")
MOST_PINS = 8
UNNAMED_PARAMETER = next(iter(ADDED))  # the additional parameter whose value stands in an address without its name
HARMONIC_PREFIX = "harmonic:"  # prefix of a harmonic in the text of a pin
# most characters of a value in an address, 2000 for each of MOST_PINS pins; longer values are ignored
LONGEST_VALUE = 16_000
POINT_STATE_PREFIX = "p."
KEYBOARD = "keyboard"
EXAMPLE = "example"  # stands in place of a survey's id for the example that comes with the explorer
MOST_FURTHER = 3
FURTHER = tuple(f"map{number}" for number in range(2, 2 + MOST_FURTHER))


class EnteredMachine(NamedTuple):
    """Numbers of a machine that a viewer entered, in SI units except the speed `rpm` in revolutions per minute.

    A number that was not entered is None.
    """

    inertia: float
    drag: float
    backlash: float
    eccentricity: float
    radius: float
    rpm: float
    drive: str = "torque"
    stiffness: float | None = None
    restitution: float | None = None
    load_torque: float | None = None
    mesh_error: float | None = None
    mesh_error_2: float | None = None
    mesh_error_3: float | None = None
    teeth: float | None = None
    driven_teeth: float | None = None
    driven_inertia: float | None = None
    driven_drag: float | None = None
    driven_radius: float | None = None
    driven_eccentricity: float | None = None

    @property
    def machine(self) -> Machine:
        """Machine with these numbers. Raises ParameterError if they are not valid."""
        return Machine(**self._asdict())

    @property
    def address_text(self) -> str:
        """Text of the machine in an address: the values `inertia` to `stiffness`, then all others as name:value."""
        plain = ["" if each is None else str(each) for each in self[:UNNAMED_COUNT]]
        more = [f"{name}:{value}" for name, value in list(self._asdict().items())[UNNAMED_COUNT:] if value is not None]
        return ",".join([*plain, *more])


# in addresses the values of the fields before "restitution" stand without their names
UNNAMED_COUNT = EnteredMachine._fields.index("restitution")


class Pin(NamedTuple):
    """Parameter point that a viewer keeps, to compare it with other points.

    added: names and values of the parameters that the point's model has besides δ, ε and β. harmonics: the harmonics
    of the point's forcing, without the first.
    """

    delta: float
    epsilon: float
    beta: float
    added: tuple[tuple[str, float], ...] = ()
    harmonics: tuple[Harmonic, ...] = ()

    @property
    def model(self) -> Model:
        """Model of the gear at this point. Raises ParameterError if a parameter is not valid."""
        return with_harmonics(model_of(self.beta, **dict(self.added)), self.harmonics)

    @property
    def address_text(self) -> str:
        """Text of the pin in an address. The stiffness κ is written without its name, as in older addresses."""
        more = [repr(value) if name == UNNAMED_PARAMETER else f"{name}:{value!r}" for name, value in self.added]
        harmonics = [HARMONIC_PREFIX + each for each in harmonic_texts(self.harmonics)]
        return ",".join([*map(repr, self[:3]), *more, *harmonics])

    @property
    def label(self) -> str:
        """Text of the pin in the table of pinned points."""
        return f"δ {self.delta:.4g}, ε {self.epsilon:.4g}"


def create_pin(delta: float, epsilon: float, model: Model) -> Pin:
    """Return the pin of a parameter point (δ, ε) of a model."""
    added = tuple((each.name, model.numbers[each.name]) for each in model.added)
    return Pin(delta, epsilon, model.beta, added, model.parameters_at(delta, epsilon).harmonics)


def points_by_pin_number(pins: Sequence[Pin], model: Model) -> dict[str, Pair]:
    """Return {number: point (δ, ε)} for the pins of one model. Each pin is numbered by its place in `pins`, from 1."""
    return {str(i): (pin.delta, pin.epsilon) for i, pin in enumerate(pins, start=1) if pin.model == model}


@dataclass(frozen=True)
class MapChoice:
    """Map of a survey: the name of its variable, and an index if the variable has a map for each attractor or orbit."""

    variable: str
    index: int = 0

    @property
    def address_text(self) -> str:
        """Text of the map in a page's address: variable,index."""
        return f"{self.variable},{self.index}"

    @classmethod
    def parse(cls, text: str) -> MapChoice:
        """Return the map that a text in an address names. Raises ValueError if the text is not valid."""
        variable, _, index = text.partition(",")
        return cls(_parse_name(variable), _parse_index(index or "0"))


@dataclass(frozen=True)
class ComparisonChoice:
    """Choice of a comparison map.

    minus: True for a difference: the first map of the page minus the map of the same variable of `survey`.
    """

    survey: str
    variable: str
    index: int = 0
    slice: int = 0
    minus: bool = False

    @property
    def address_text(self) -> str:
        """Text of the comparison map in a page's address: survey,variable,index,slice, and ",minus" if `minus`."""
        parts = (self.survey, self.variable, str(self.index), str(self.slice), "minus" if self.minus else "")
        return ",".join(parts).rstrip(",")

    @classmethod
    def parse(cls, text: str) -> ComparisonChoice:
        """Return the comparison map that a text in an address names. Raises ValueError if the text is not valid."""
        survey, variable, index, number, *minus = text.split(",")
        return cls(
            _parse_name(survey), _parse_name(variable), _parse_index(index), _parse_index(number), minus == ["minus"]
        )


class PointerPosition(NamedTuple):
    """Point (δ, ε) that a viewer points at. source: name of the figure under the mouse; KEYBOARD for keys."""

    at: Pair
    source: str


class DrawnMapSettings(NamedTuple):
    """Settings with which a map was drawn.

    limits: (low, high) of the colours, computed if the view has a rule for them; None for a categorical map. log: True
    if the colours are on a log scale. pixels: size of the map on the screen, None if the whole survey is shown.
    """

    limits: Pair | None
    log: bool
    pixels: tuple[int, int] | None


def address_text(value: EnteredMachine | Pin | MapChoice | ComparisonChoice) -> str:
    """Return the text that stands for a value in the address (URL) of a page."""
    return value.address_text


def _parse_name(text: str) -> str:
    if not (text.isascii() and text.replace("_", "").isalnum()):
        raise ValueError(f"A name has letters, digits and underscores only, not {text!r}.")
    return text


def _parse_index(text: str) -> int:
    return min(max(int(text), 0), 64)


def _parse_family(text: str) -> int:
    return require_between(int(text), 0, 2**31 - 1)


def _parse_window(text: str) -> Pair:
    low, high = parse_pair(text)
    if not low < high or not math.isfinite(high - low):
        raise ValueError(f"A window needs a lower end below its upper end, not {text!r}.")
    return low, high


def _parse_positive_window(text: str) -> Pair:
    low, high = _parse_window(text)
    if high <= 0:
        raise ValueError(f"The upper end of a window of δ must be above 0, not {text!r}.")
    return low, high


def _parse_machine(text: str) -> EnteredMachine:
    parts = text.split(",")
    *numbers, drive, stiffness = parts[:UNNAMED_COUNT]
    inertia, drag, backlash, eccentricity, radius, rpm = map(float, numbers)
    more = {name: float(value) for name, _, value in (each.partition(":") for each in parts[UNNAMED_COUNT:])}
    known = EnteredMachine._fields[UNNAMED_COUNT:]
    for name in more:
        if name not in known:
            raise ValueError(f"The machine has no number named {name!r}: use one of {', '.join(known)}.")
    rigid = float(stiffness) if stiffness else None
    found = EnteredMachine(inertia, drag, backlash, eccentricity, radius, rpm, drive, rigid, **more)
    found.machine.gear  # noqa: B018 - raises a ParameterError, which is a ValueError, if no gear is possible
    return found


def _parse_pins(text: str) -> tuple[Pin, ...]:
    found = []
    for each in text.split(";")[:MOST_PINS]:
        delta, epsilon, beta, *more = each.split(",")
        plain = [one for one in more if not one.startswith(HARMONIC_PREFIX)]
        added = dict(_parse_added_parameter(one) for one in plain)
        if len(added) < len(plain):
            raise ValueError(f"A pin has two values of one parameter: {text!r}.")
        harmonics = read_harmonics(one.removeprefix(HARMONIC_PREFIX) for one in more if one.startswith(HARMONIC_PREFIX))
        pin = Pin(*parse_point(f"{delta},{epsilon}"), float(beta), tuple(added.items()), harmonics)
        pin.model.gear(pin.delta, pin.epsilon)  # raises a ParameterError, which is a ValueError, if no gear is possible
        found.append(pin)
    return tuple(dict.fromkeys(found))


def _parse_added_parameter(text: str) -> tuple[str, float]:
    name, _, value = text.rpartition(":")
    return name or UNNAMED_PARAMETER, float(value)


def _parse_share(text: str) -> float:
    share = float(text)
    if not 0.0 < share <= MOST_SHARE:
        raise ValueError(f"The probability of quiet running must be above 0 and at most {MOST_SHARE}, not {text!r}.")
    return share


def _parse_colour_limits(text: str) -> Limits | Pair:
    for rule in LIMITS:
        if text == rule:
            return rule
    return _parse_window(text)


def _parse_overlays(text: str) -> tuple[str, ...]:
    chosen = text.split(",")
    return tuple(name for name in OVERLAYS if name in chosen)


@dataclass(frozen=True)
class View:
    """State of a page. Two views with the same address are equal.

    Attributes
    ----------
    family : int | None
        Number of the highlighted family; cells without it are dimmed. None if no family is highlighted.
    limits : Limits | Pair
        Rule for the range of colours, or (low, high).
    overlays : tuple[str, ...] | None
        Lines that a viewer chose, None for the default lines; the property `lines` returns the drawn lines.
    delta, epsilon : Pair | None
        Window (low, high) along each axis, None for the whole survey.
    machine : EnteredMachine | None
        Machine that a viewer entered for the open point, None if no machine was entered.
    share : float
        Probability of quiet running that the design limit requires.
    profile : MapChoice | None
        Map whose profile is drawn below the diagram, None for the map that is shown.
    theme : str
        Theme of the page, "light" or "dark"; empty for the theme of the viewer's system.
    point_state : PointTabsState
        State of the open point's tabs.
    pins : tuple[Pin, ...]
        Points that are compared.
    is_variable_chosen : bool
        True if a viewer or the address chose the variable. This field and all later ones are not in the address.
    sounds, yields : int
        How often viewers requested the sound of a motion, and the yield of the point's tolerances.
    rpm : float | None
        Speed of the machine whose sound was requested; None if a viewer entered none.
    pointer : PointerPosition | None
        Point that a viewer points at.
    seen : DrawnMapSettings | None
        Settings of the drawn map, None where nothing is drawn.
    before, after : tuple[Ranges | None, ...]
        Windows for Back and for Forward, the next window last; an entry None is the whole survey.
    """

    survey: str = address_field("", _parse_name)
    variable: str = address_field("", _parse_name)
    index: int = address_field(0, _parse_index)
    slice: int = address_field(0, _parse_index)
    family: int | None = address_field(None, _parse_family)
    limits: Limits | Pair = address_field(
        "auto", _parse_colour_limits, lambda limits: limits if limits in LIMITS else pair_text(limits)
    )
    log: bool = address_field(False, lambda text: text == "1", lambda _: "1")
    overlays: tuple[str, ...] | None = address_field(None, _parse_overlays, lambda each: ",".join(each) or "none")
    delta: Pair | None = address_field(None, _parse_positive_window, pair_text)
    epsilon: Pair | None = address_field(None, _parse_window, pair_text)
    point: Pair | None = address_field(None, parse_point, pair_text)
    machine: EnteredMachine | None = address_field(None, _parse_machine, address_text)
    share: float = address_field(USUAL_SHARE, _parse_share, repr)
    further: tuple[ComparisonChoice, ...] = ()
    profile: MapChoice | None = address_field(None, MapChoice.parse, address_text)
    profile_limits: Pair | None = address_field(None, _parse_window, pair_text)
    theme: str = address_field("", partial(require_allowed_text, THEMES))
    point_state: PointTabsState = field(default_factory=PointTabsState)
    pins: tuple[Pin, ...] = address_field((), _parse_pins, lambda pins: ";".join(map(address_text, pins)))
    is_variable_chosen: bool = field(default=False, compare=False)
    sounds: int = field(default=0, compare=False)
    yields: int = field(default=0, compare=False)
    rpm: float | None = field(default=None, compare=False)
    pointer: PointerPosition | None = field(default=None, compare=False)
    seen: DrawnMapSettings | None = field(default=None, compare=False)
    before: tuple[Ranges | None, ...] = field(default=(), compare=False)
    after: tuple[Ranges | None, ...] = field(default=(), compare=False)

    @property
    def window(self) -> Ranges | None:
        """Window that is shown, None for the whole survey."""
        return (self.delta, self.epsilon) if self.delta and self.epsilon else None

    @property
    def is_example_shown(self) -> bool:
        """True if the page shows the example, because a viewer chose it or because no survey is chosen."""
        return self.survey in ("", EXAMPLE)

    @property
    def lines(self) -> tuple[str, ...]:
        """Lines over the map: the chosen lines, or the default lines of the map."""
        return self.lines_on_map(self.variable)

    def lines_on_map(self, variable: str) -> tuple[str, ...]:
        """Return the lines over the map of a variable: the lines that a viewer chose, or the default lines."""
        if self.overlays is not None:
            return self.overlays
        return BORDERS if variable == REGION else FEW_LINES

    @classmethod
    def parse(cls, query: Mapping[str, Sequence[bytes]]) -> View:
        """Return the view that a query describes. A field whose text is missing or invalid gets its default."""
        firsts = {name: values[0].decode("utf-8", "replace") for name, values in query.items() if values}
        texts = {name: value for name, value in firsts.items() if len(value) <= LONGEST_VALUE}
        found = parse_address_fields(cls, texts)
        if "point" in found:
            state = {
                name.removeprefix(POINT_STATE_PREFIX): text
                for name, text in texts.items()
                if name.startswith(POINT_STATE_PREFIX)
            }
            found["point_state"] = PointTabsState.parse(state)
        else:
            found.pop("machine", None)
        others = (parse_text_or_default(texts, name, ComparisonChoice.parse, None) for name in FURTHER)
        further = tuple(each for each in others if each is not None)
        return cls(**found, further=further, is_variable_chosen="variable" in found)

    def query(self) -> str:
        """Return the query that describes this view, with a leading "?"; "" if all fields have their defaults."""
        texts = address_field_texts(self) | dict(zip(FURTHER, map(address_text, self.further), strict=False))
        if self.point is None:
            texts.pop("machine", None)
        else:
            texts |= {POINT_STATE_PREFIX + name: text for name, text in self.point_state.address_texts().items()}
        return "?" + urlencode(texts, safe=",;") if texts else ""
