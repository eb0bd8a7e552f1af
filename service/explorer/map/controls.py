"""The controls of the map: its variable, with buttons for some, its index, and the range of its colours."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import panel as pn

from gear_rattle.service.explorer.common.address import LIMITS, Limits, Pair
from gear_rattle.service.explorer.common.watch import Watch, on_press
from gear_rattle.service.explorer.map.colouring import Colouring
from gear_rattle.workers import SurveyRequest
from gear_rattle.workers.pictures.look import LARGEST, variable_words
from rattle.models import ADDED, BETA

LIMIT_NAMES = {"auto": "default", "robust": "middle 96 %", "full": "all values"}
LETTERS = {each.name: each.symbol for each in (BETA, *ADDED.values())}
UNPRINTED = "@media print { :host { display: none !important; } }"
OWN, LOG = "own", "log scale"
NUMBERED = "Attractor no."


class FeaturedMap(NamedTuple):
    """A map with a button; variables: those that show it, the best first."""

    button: str
    variables: tuple[str, ...]
    meaning: str


FEATURED = (
    FeaturedMap(
        "Quiet",
        ("quiet_fraction",),
        "Yellow: the gear runs quietly from most starts. Dark: it rattles. Click anywhere for its motions.",
    ),
    FeaturedMap(
        "Motions", (LARGEST, "attractor_kind"), "The motion that most starts end in. Click anywhere to see all of them."
    ),
    FeaturedMap(
        "Chaos",
        ("lyapunov_max", "chaotic_fraction"),
        "How fast two nearly equal rattling motions part: chaotic where the exponent is above 0, periodic below.",
    ),
    FeaturedMap(
        "Loudness",
        ("worst_level",),
        "Energy of the loudest motion's impacts: 0 dB is one impact a forcing period, +10 dB ten times its energy.",
    ),
    FeaturedMap(
        "Regions",
        ("region",),
        "Which of A to D, the motions of one forcing period, exist: none in I, A and C in II; see Help for the others.",
    ),
)


def featured_in(names: Collection[str]) -> dict[str, str]:
    """Return the variables that have a button, by its text, of those that a survey has."""
    found = {each.button: next((name for name in each.variables if name in names), None) for each in FEATURED}
    return {button: name for button, name in found.items() if name is not None}


def meaning_of(variable: str) -> str:
    """Return how to read a map; nothing for a map without a button."""
    return next((each.meaning for each in FEATURED if variable in each.variables), "")


@dataclass(frozen=True)
class ControlCallbacks:
    """Functions called when a viewer has used a control."""

    variable: Callable[[], None]
    index: Callable[[], None]
    slice: Callable[[], None]
    limits: Callable[[], None]
    own: Callable[[], None]
    save: Callable[[], None]


class Controls:
    """The widgets. To set them calls nobody."""

    def __init__(self, sheet: str, log: bool, uses: ControlCallbacks) -> None:
        styled: dict[str, Any] = {"stylesheets": [sheet], "margin": (2, 8, 2, 0)}
        self._featured: dict[str, str] = {}  # variables that have a button, by its text
        self._buttons = pn.widgets.RadioButtonGroup(
            label="Maps", options=[], color="primary", variant="outline", **styled
        )
        self._variable = pn.widgets.Select(label="Map", options=[], width=205, **styled)
        self._index = pn.widgets.Select(label=NUMBERED, options=[], width=110, visible=False, **styled)
        self._slice = pn.widgets.IntSlider(
            label="",
            start=0,
            end=1,
            show_value=False,
            width=150,
            visible=False,
            **{**styled, "margin": (2, 16, 2, 0)},
        )
        options = {name: rule for rule, name in LIMIT_NAMES.items()} | {"from … to": OWN}
        self._rule = pn.widgets.Select(label="Colour range", options=options, width=180, **styled)
        self._low = pn.widgets.FloatInput(label="from", width=110, **styled)
        self._high = pn.widgets.FloatInput(label="to", width=110, **styled)
        chosen = [LOG] if log else []
        self._log = pn.widgets.CheckBoxGroup(options=[LOG], value=chosen, **{**styled, "margin": (2, 8, 8, 4)})
        save = pn.widgets.Button(label="New survey from this view", **styled, css_classes=["save"])
        on_press(save, lambda: uses.save())
        self._watch = Watch()
        for widget, used in (
            (self._buttons, lambda: self._choose(self._featured[self._buttons.value], uses.variable)),
            (self._variable, lambda: self._choose(self._variable.value, uses.variable)),
            (self._index, uses.index), (self._slice, uses.slice),
            (self._rule, uses.limits), (self._low, uses.own), (self._high, uses.own), (self._log, uses.limits),
        ):  # fmt: skip
            self._watch.on(widget, used)
        self.featured = pn.Row(self._buttons, margin=0, stylesheets=[UNPRINTED])
        self.panel = pn.FlexBox(
            self._variable, self._index, self._slice, self._rule, self._low, self._high, self._log, save,
            margin=0, sizing_mode="stretch_width", align_items="flex-end", stylesheets=[UNPRINTED],
        )  # fmt: skip

    @property
    def variable(self) -> str:
        """The variable that is chosen."""
        return str(self._variable.value)

    @property
    def index(self) -> int:
        """The index that is chosen."""
        return int(self._index.value)

    @property
    def slice(self) -> int:
        """The slice of a third axis that is chosen."""
        return int(self._slice.value or 0)

    @property
    def rule(self) -> Limits | None:
        """By which rule the colours span the values; None: between limits of the viewer's own."""
        rule = self._rule.value
        if rule == OWN:
            return None
        return rule if rule in LIMITS else "auto"

    def limits(self, shown: Limits | Pair, colours: Colouring | None) -> Limits | Pair | None:
        """Return the range of colours where the map has this one.

        None: nothing is shown whose limits could be taken over.

        Returns
        -------
        Limits | Pair | None
            The range, or None.
        """
        if self.rule is not None:
            return self.rule
        if isinstance(shown, tuple) or colours is None:
            return shown if isinstance(shown, tuple) else None
        return colours.low, colours.high

    @property
    def log(self) -> bool:
        """True if colours are on a log scale."""
        return bool(self._log.value)

    @property
    def own(self) -> Pair | str:
        """The viewer's own limits, or why they are none."""
        low, high = self._low.value, self._high.value
        if low is None or high is None:
            return "Colours need two limits: a number each."
        if not low < high:
            return f"Colours cannot span {low:g} to {high:g}: the first limit must be below the second."
        if self.log and high <= 0:
            return f"A log scale shows positive values only: the second limit must be above 0, not {high:g}."
        return low, high

    def _choose(self, variable: str, then: Callable[[], None]) -> None:
        """Show a variable in both controls that choose one."""
        with self._watch.paused():
            self._variable.value, self._buttons.value = variable, self._button_of(variable)
        then()

    def _button_of(self, variable: str) -> str | None:
        return next((button for button, name in self._featured.items() if name == variable), None)

    def offer_variables(self, names: Collection[str], chosen: str) -> None:
        """Offer the variables of a survey."""
        self._featured = featured_in(names)
        with self._watch.paused():
            self._variable.options = {variable_words(name): name for name in names}
            self._variable.value = chosen
            self._buttons.options = list(self._featured)
            self._buttons.value = self._button_of(chosen)

    def offer_indices(self, names: Sequence[object], chosen: int) -> None:
        """Offer the indices of a variable, none if it has no such dimension."""
        with self._watch.paused():
            self._index.visible = bool(names)
            self._index.label = "Orbit" if "A" in names else NUMBERED
            self._index.options = {str(name): number for number, name in enumerate(names)}
            if names:
                self._index.value = chosen

    def offer_slices(self, request: SurveyRequest, chosen: int) -> None:
        """Offer the slices of a survey, none without a third axis."""
        with self._watch.paused():
            self._slice.visible = bool(request.third)
            for name, axis in request.third_axis.items():
                label = f"{LETTERS[name]} = {axis.values()[chosen]:g}"
                self._slice.param.update(end=axis.num - 1, value=chosen, label=label)

    def show_limits(self, limits: Limits | Pair, colours: Colouring | None) -> None:
        """Show the range of colours, where they are continuous."""
        continuous, own = colours is not None and not colours.categorical, isinstance(limits, tuple)
        with self._watch.paused():
            self._rule.value = OWN if own else limits
            self._rule.visible = self._log.visible = continuous
            self._low.visible = self._high.visible = continuous and own
            if colours is not None and continuous:
                self._low.value, self._high.value = colours.low, colours.high
