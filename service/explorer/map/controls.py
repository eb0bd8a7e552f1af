"""Choose a map: its variable (featured maps have buttons), its attractor or orbit, its slice, and its colour range."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, NamedTuple

import panel as pn

from gear_rattle.service.explorer.common.address import Pair
from gear_rattle.service.explorer.common.lists import MapButtons
from gear_rattle.service.explorer.common.text import TextPane, alert_html
from gear_rattle.service.explorer.common.watch import WidgetWatcher
from gear_rattle.service.explorer.map.shared import SharedState
from gear_rattle.service.explorer.state.events import ColourRangeChosen, MapIndexChosen, SliceChosen, VariableChosen
from gear_rattle.service.explorer.state.store import JOBS, PageStore
from gear_rattle.workers import SurveyRequest
from gear_rattle.workers.pictures.look import LARGEST, variable_in_words
from gear_rattle.workers.survey.values.quantities import variable_groups_of_model
from gear_rattle.workers.survey.values.schema import Group
from rattle.models import ADDED, BETA

LIMIT_NAMES = {"auto": "default", "robust": "middle 96 %", "full": "all values"}
LETTERS = {each.name: each.symbol for each in (BETA, *ADDED.values())}
UNPRINTED = "@media print { :host { display: none !important; } }"
OWN, LOG = "own", "log scale"
ATTRACTOR_INDEX = "Attractor no."


class FeaturedMap(NamedTuple):
    """Map with a button.

    variables: the button shows the first of these variables that the survey has. group: quantity that must be ticked in
    the form of a new survey, so that the survey has one of these variables. meaning: how to read the map.
    """

    button: str
    variables: tuple[str, ...]
    group: Group
    meaning: str


FEATURED = (
    FeaturedMap(
        "Quiet",
        ("quiet_fraction",),
        Group.ATTRACTORS,
        "Yellow: the gear runs quietly from most starts. Dark: it rattles. Click anywhere for its motions.",
    ),
    FeaturedMap(
        "Motions",
        (LARGEST, "attractor_kind"),
        Group.ATTRACTORS,
        "The motion that most starts end in. Click anywhere to see all of them.",
    ),
    FeaturedMap(
        "Chaos",
        ("lyapunov_max", "chaotic_fraction"),
        Group.LYAPUNOV,
        "How fast two nearly equal rattling motions part: chaotic where the exponent is above 0, periodic below.",
    ),
    FeaturedMap(
        "Loudness",
        ("worst_level",),
        Group.INTENSITY,
        "Energy of the loudest motion's impacts: 0 dB is one impact a forcing period, +10 dB ten times its energy.",
    ),
    FeaturedMap(
        "Regions",
        ("region",),
        Group.REGION,
        "Which of A to D, the motions of one forcing period, exist: none in I, A and C in II; see Help for the others.",
    ),
)


def describe_map_buttons(names: Collection[str], request: SurveyRequest) -> list[dict[str, Any]]:
    """Return the value of `MapButtons.buttons` for the featured maps. names: the variables that the survey has."""
    buttons = []
    for each in FEATURED:
        variable = next((name for name in each.variables if name in names), "")
        about = each.meaning if variable else _reason_of_missing_map(each, request)
        buttons.append({"label": each.button, "variable": variable, "about": about, "missing": not variable})
    return buttons


def _reason_of_missing_map(featured: FeaturedMap, request: SurveyRequest) -> str:
    """Return a text about a featured map that a survey lacks: how to get the map, or that the model never has it."""
    if featured.group not in variable_groups_of_model(request.model, bool(request.harmonics)):
        return f"{featured.button}: not computed in this survey, because its model has no quantity {featured.group}."
    return (
        f"{featured.button}: not computed in this survey. A new survey has this map if {featured.group} is ticked "
        "among the quantities of its form (Advanced settings)."
    )


def explain_how_to_read_map(variable: str) -> str:
    """Return a sentence that says how to read the map of a variable; "" if no featured map shows the variable."""
    return next((each.meaning for each in FEATURED if variable in each.variables), "")


class MapControls:
    """Widgets that choose a map.

    featured: the buttons of the featured maps. panel: all other widgets. row: the part of `panel` without the
    message about wrong limits; the page adds widgets of other classes to it.
    """

    def __init__(self, shared: SharedState, store: PageStore, sheet: str) -> None:
        self._shared, self._store = shared, store
        styled: dict[str, Any] = {"stylesheets": [sheet], "margin": (2, 8, 2, 0)}
        self.buttons = MapButtons(margin=styled["margin"])
        self.variable = pn.widgets.Select(label="Map", options=[], width=205, **styled)
        self.index = pn.widgets.Select(label=ATTRACTOR_INDEX, options=[], width=110, visible=False, **styled)
        self.slice = pn.widgets.IntSlider(
            label="", start=0, end=1, show_value=False, width=150, visible=False, stylesheets=[sheet],
            margin=(2, 16, 2, 0),
        )  # fmt: skip
        options = {name: rule for rule, name in LIMIT_NAMES.items()} | {"from … to": OWN}
        self.rule = pn.widgets.Select(label="Colour range", options=options, width=180, **styled)
        self.low = pn.widgets.FloatInput(label="from", width=110, **styled)
        self.high = pn.widgets.FloatInput(label="to", width=110, **styled)
        self.log = pn.widgets.CheckBoxGroup(options=[LOG], **{**styled, "margin": (2, 8, 8, 4)})
        self.wrong = TextPane("", sheet)
        self._watch = WidgetWatcher()
        for widget, used in (
            (self.variable, self._on_variable_change), (self.index, self._on_index_change),
            (self.slice, self._on_slice_change), (self.rule, self._on_rule_change), (self.log, self._on_rule_change),
            (self.low, self._on_entered_limits), (self.high, self._on_entered_limits),
        ):  # fmt: skip
            self._watch.call_on_change(widget, used)
        self._watch.call_on_change(self.buttons, self._on_variable_button, "chosen")
        self.featured = pn.Row(self.buttons, margin=0, stylesheets=[UNPRINTED])
        self.row = pn.FlexBox(
            self.variable, self.index, self.slice, self.rule, self.low, self.high, self.log,
            margin=0, sizing_mode="stretch_width", align_items="flex-end", stylesheets=[UNPRINTED],
        )  # fmt: skip
        self.panel = pn.Column(self.row, self.wrong.pane, margin=0, sizing_mode="stretch_width")
        self._show_limits()
        store.subscribe(self._offer_maps, "survey", JOBS, "variable", "index", "slice")
        store.subscribe(self._show_limits, "limits", "log", "seen")

    def _offer_maps(self) -> None:
        """Fill the menus with the maps of the survey, and select the map that the view shows."""
        view, whole = self._store.view, self._store.survey_request_with_all_slices
        maps = self._shared.maps(self._store)
        if whole is None or view.variable not in maps:
            return
        buttons, names = describe_map_buttons(maps, whole), maps[view.variable]
        is_featured = any(each["variable"] == view.variable for each in buttons)
        with self._watch.ignore_changes():
            self.variable.options = {variable_in_words(name): name for name in maps}
            self.variable.value = view.variable
            self.buttons.param.update(buttons=buttons, chosen=view.variable if is_featured else "")
            self.index.visible = bool(names)
            self.index.label = "Orbit" if "A" in names else ATTRACTOR_INDEX
            self.index.options = {str(name): number for number, name in enumerate(names)}
            if names:
                self.index.value = min(view.index, len(names) - 1)
            self.slice.visible = bool(whole.third_axis_name)
            for name, axis in whole.third_axis.items():
                (number,) = whole.slice_index(view.slice)
                label = f"{LETTERS[name]} = {axis.values()[number]:g}"
                self.slice.param.update(end=axis.num - 1, value=number, label=label)

    def _show_limits(self) -> None:
        """Show the widgets for the range of the colours, or hide them if the map is categorical or no map is drawn."""
        view = self._store.view
        drawn = None if view.seen is None else view.seen.limits
        is_own = isinstance(view.limits, tuple)
        with self._watch.ignore_changes():
            self.rule.value = OWN if is_own else view.limits
            self.log.value = [LOG] if view.log else []
            self.rule.visible = self.log.visible = drawn is not None
            self.low.visible = self.high.visible = drawn is not None and is_own
            if drawn is not None:
                self.low.value, self.high.value = view.limits if isinstance(view.limits, tuple) else drawn

    def _on_variable_button(self) -> None:
        if any(each["variable"] == self.buttons.chosen for each in self.buttons.buttons):
            self._store.dispatch(VariableChosen(self.buttons.chosen))

    def _on_variable_change(self) -> None:
        self._store.dispatch(VariableChosen(str(self.variable.value)))

    def _on_index_change(self) -> None:
        self._store.dispatch(MapIndexChosen(int(self.index.value)))

    def _on_slice_change(self) -> None:
        self._store.dispatch(SliceChosen(int(self.slice.value or 0)))

    def _on_rule_change(self) -> None:
        """Dispatch the chosen rule for the colour range together with the chosen scale, linear or logarithmic.

        The rule OWN stands for limits that a viewer enters; until then the limits are those of the drawn map.
        """
        view, limits = self._store.view, self.rule.value
        if limits == OWN:
            limits = view.limits if isinstance(view.limits, tuple) else view.seen and view.seen.limits
        if limits is not None:
            self._store.dispatch(ColourRangeChosen(limits, bool(self.log.value)))

    def _on_entered_limits(self) -> None:
        own = parse_entered_limits(self.low.value, self.high.value, self._store.view.log)
        self.wrong.html = alert_html(own) if isinstance(own, str) else ""
        if isinstance(own, tuple):
            self._store.dispatch(ColourRangeChosen(own, self._store.view.log))


def parse_entered_limits(low: float | None, high: float | None, log: bool) -> Pair | str:
    """Return the limits that a viewer has entered, or a message that says why they are not valid."""
    if low is None or high is None:
        return "Enter two numbers as colour limits."
    if not low < high:
        return f"Colours cannot span {low:g} to {high:g}: the first limit must be below the second."
    if log and high <= 0:
        return f"A log scale shows positive values only: the second limit must be above 0, not {high:g}."
    return low, high
