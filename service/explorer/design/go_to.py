"""Panel to go to a bookmark, or to a point that a viewer enters as δ and ε or as a machine in SI units."""

from __future__ import annotations

from functools import partial
from typing import Any

import panel as pn

from gear_rattle.service.explorer.common.address import EnteredMachine
from gear_rattle.service.explorer.common.text import TextPane, alert_html
from gear_rattle.service.explorer.common.watch import WidgetWatcher, call_on_press
from gear_rattle.service.explorer.design.fields import POINT, MachineFields
from gear_rattle.service.explorer.design.places import Bookmark, bookmarks, shown_bookmark
from gear_rattle.service.explorer.state.events import BookmarkChosen, PointClosed, PointOpened
from gear_rattle.service.explorer.state.store import JOBS, PageStore
from rattle import RattleError
from rattle.models import BETA, DEFAULT_MODEL, MODELS

OPEN, CLOSE = "Go to a point", "Close this form"


class NavigationPanel:
    """A list of bookmarks, a button that opens the fields for a point, and a button that closes the open point."""

    def __init__(self, store: PageStore, sheet: str) -> None:
        self._store, self._sheet = store, sheet
        options = {"choose one …": ""} | bookmarks()
        self.named = pn.widgets.Select(
            label="Named places", options=options, value="", stylesheets=[sheet], width=220, margin=(0, 8, 6, 0)
        )
        self._watch = WidgetWatcher()
        self._watch.call_on_change(self.named, self._go_to_bookmark)
        self.said = TextPane("", sheet)
        self._open = pn.widgets.Button(label=OPEN, css_classes=["go-to"], stylesheets=[sheet], margin=(0, 8, 6, 0))
        call_on_press(self._open, self._toggle_fields)
        self._fields: pn.Column | None = None
        self._close = pn.widgets.Button(
            label="Close the point", stylesheets=[sheet], visible=store.view.point is not None, margin=(0, 0, 6, 0)
        )
        call_on_press(self._close, partial(store.dispatch, PointClosed()))
        store.subscribe(self._show_close_button, "point")
        store.subscribe(self._show_bookmark, "survey", "slice", "delta", "epsilon", "point", JOBS)
        row = pn.FlexBox(
            self.named, self._open, self._close, align_items="flex-end", sizing_mode="stretch_width", margin=0
        )
        self.panel = pn.Column(row, self.said.pane, css_classes=["go-to-place"], sizing_mode="stretch_width", margin=0)

    def _show_close_button(self) -> None:
        self._close.visible = self._store.view.point is not None

    def _show_bookmark(self) -> None:
        """Select in the list the bookmark that the view shows, or none if the view shows no bookmark."""
        view = self._store.view
        shown = shown_bookmark(view.window, view.point) if self._is_plane_of_bookmarks() else None
        with self._watch.ignore_changes():
            self.named.value = "" if shown is None else shown

    def _is_plane_of_bookmarks(self) -> bool:
        """Return whether the map shows the plane of the bookmarks: the default model at its default β."""
        return self._store.model == MODELS[DEFAULT_MODEL]()

    def _go_to_bookmark(self) -> None:
        """Go to the chosen bookmark; show an error instead if the map has another model or β than the bookmarks."""
        place: Bookmark | str = self.named.value
        if isinstance(place, str):
            self._show_bookmark()
            return
        if not self._is_plane_of_bookmarks():
            self._show_bookmark()
            named = f"{DEFAULT_MODEL} gear at β = {BETA.default}"
            self._show_error(f"The named places are in the plane of the {named}. Choose a survey of this gear first.")
            return
        self.said.html = ""
        self._store.dispatch(BookmarkChosen(place.window, place.point, place.state))

    def _toggle_fields(self) -> None:
        if self._fields is None:
            self._fields = self._build_fields()
            self.panel.insert(1, self._fields)
        else:
            self._fields.visible = not self._fields.visible
        self._open.label = CLOSE if self._fields.visible else OPEN

    def _build_fields(self) -> pn.Column:
        style: dict[str, Any] = {"sizing_mode": "stretch_width", "margin": (3, 4), "stylesheets": [self._sheet]}
        ways = {"damping δ, eccentricity ε": False, "a machine in SI units": True}
        self._in_si = pn.widgets.Select(label="Enter as", options=ways, **style)
        self._delta = pn.widgets.FloatInput(label="δ", value=0.6, start=0.0, **style)
        self._epsilon = pn.widgets.FloatInput(label="ε", value=0.1, start=0.0, **style)
        plain = pn.Row(self._delta, self._epsilon, sizing_mode="stretch_width")
        self._machine = MachineFields(POINT, self._sheet)
        self._machine.panel.visible = False
        show = pn.widgets.Button(label="Show", css_classes=["show"], margin=(6, 4), stylesheets=[self._sheet])
        call_on_press(show, self._open_entered_point)

        def on_entry_mode(event: Any) -> None:
            plain.visible, self._machine.panel.visible = not event.new, event.new

        self._in_si.param.watch(on_entry_mode, "value")
        return pn.Column(self._in_si, plain, self._machine.panel, show, sizing_mode="stretch_width", margin=0)

    def _open_entered_point(self) -> None:
        self.said.html = ""
        if not self._in_si.value:
            if self._delta.value and self._epsilon.value is not None:
                self._open_point(PointOpened((self._delta.value, self._epsilon.value)))
            else:
                self._show_error("Enter a damping δ above 0, and an eccentricity ε.")
            return
        given = self._machine.entered_numbers()
        empty = [name for name, value in given.items() if value is None]
        if empty:
            self._show_error(f"The machine lacks numbers: enter {' and '.join(empty)} too.")
            return
        entered = EnteredMachine(**given)
        try:
            gear = entered.machine.gear
        except RattleError as error:
            self._show_error(str(error))
        else:
            self._open_point(PointOpened((gear.delta, gear.epsilon), entered))

    def _open_point(self, event: PointOpened) -> None:
        """Open a point, and close the fields, which would push the answer below them out of sight."""
        self._toggle_fields()
        self._store.dispatch(event)

    def _show_error(self, why: str) -> None:
        self.said.html = alert_html(why, "wrong")
