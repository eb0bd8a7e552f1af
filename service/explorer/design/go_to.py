"""To go to a place that has a name, or to a point that is entered: its δ and ε, or a machine in SI units."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from typing import Any

import panel as pn

from gear_rattle.service.explorer.common.address import Entered
from gear_rattle.service.explorer.common.text import Text
from gear_rattle.service.explorer.common.watch import Watch, on_press
from gear_rattle.service.explorer.design.fields import EXACT, POINT, MachineFields
from gear_rattle.service.explorer.design.places import Bookmark, places
from rattle import RattleError


class GoTo:
    """The names, and a button that opens the fields, which are made then.

    `on_point` gets (δ, ε), `on_machine` a machine, and `on_place` a place, of which it says why it cannot be shown, if
    so.
    """

    def __init__(
        self,
        sheet: str,
        on_point: Callable[[float, float], None],
        on_machine: Callable[[Entered], None],
        on_place: Callable[[Bookmark], str],
    ) -> None:
        self._sheet, self._on_point, self._on_machine, self._on_place = sheet, on_point, on_machine, on_place
        options = {"choose one …": ""} | places()
        self._named = pn.widgets.Select(
            label="Named places", options=options, value="", stylesheets=[sheet], width=220, margin=(0, 8, 6, 0)
        )
        self._watch = Watch()
        self._watch.on(self._named, self._go)
        self._said = Text("", sheet)
        self._open = pn.widgets.Button(
            label="Go to a point", css_classes=["go-to"], stylesheets=[sheet], margin=(0, 8, 6, 0)
        )
        on_press(self._open, self._toggle)
        self._fields: pn.Column | None = None
        self.row = pn.FlexBox(self._named, self._open, align_items="flex-end", sizing_mode="stretch_width", margin=0)
        self.panel = pn.Column(
            self.row, self._said.pane, css_classes=["go-to-place"], sizing_mode="stretch_width", margin=0
        )

    def _go(self) -> None:
        if place := self._named.value:
            self._said.html = ""
            if why := self._on_place(place):
                self._wrong(why)
            with self._watch.paused():
                self._named.value = ""  # so that it can be gone to again

    def _toggle(self) -> None:
        if self._fields is None:
            self._fields = self._made()
            self.panel.insert(1, self._fields)
        else:
            self._fields.visible = not self._fields.visible
        self._open.label = "Close" if self._fields.visible else "Go to a point"

    def _made(self) -> pn.Column:
        style: dict[str, Any] = {"sizing_mode": "stretch_width", "margin": (3, 4), "stylesheets": [self._sheet]}
        ways = {"damping δ, eccentricity ε": False, "a machine in SI units": True}
        self._in_si = pn.widgets.Select(label="Enter as", options=ways, **style)
        self._delta = pn.widgets.FloatInput(label="δ", value=0.6, start=0.0, format=EXACT, **style)
        self._epsilon = pn.widgets.FloatInput(label="ε", value=0.1, start=0.0, format=EXACT, **style)
        plain = pn.Row(self._delta, self._epsilon, sizing_mode="stretch_width")
        self._machine = MachineFields(POINT, self._sheet)
        self._machine.panel.visible = False
        show = pn.widgets.Button(label="Show", css_classes=["show"], margin=(6, 4), stylesheets=[self._sheet])
        on_press(show, self._show)

        def on_way(event: Any) -> None:
            plain.visible, self._machine.panel.visible = not event.new, event.new

        self._in_si.param.watch(on_way, "value")
        return pn.Column(self._in_si, plain, self._machine.panel, show, sizing_mode="stretch_width", margin=0)

    def _show(self) -> None:
        self._said.html = ""
        if not self._in_si.value:
            if self._delta.value and self._epsilon.value is not None:
                self._on_point(self._delta.value, self._epsilon.value)
            else:
                self._wrong("Give a damping above 0, and an eccentricity.")
            return
        given = self._machine.given()
        empty = [name for name, value in given.items() if value is None]
        if empty:
            self._wrong(f"A machine needs {' and '.join(empty)} too.")
            return
        entered = Entered(**given)
        try:
            entered.machine.gear  # noqa: B018 - raises what is wrong
        except RattleError as error:
            self._wrong(str(error))
        else:
            self._on_machine(entered)

    def _wrong(self, why: str) -> None:
        self._said.html = f'<p class="wrong" role="alert">{escape(why)}</p>'
