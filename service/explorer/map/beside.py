"""Beside the map: what is known of the cell that is pointed at, and the view of the point that was clicked."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from typing import Any

import panel as pn

from gear_rattle.service.explorer.common.address import Pair, Ranges
from gear_rattle.service.explorer.common.figures import PRINTED
from gear_rattle.service.explorer.common.text import Text
from gear_rattle.service.explorer.common.viewer import Viewer
from gear_rattle.service.explorer.common.watch import on_press
from gear_rattle.service.explorer.design.go_to import GoTo
from gear_rattle.service.explorer.map.planes import MapBlock, MapPlane
from gear_rattle.service.explorer.map.readout import finer_value, readout
from gear_rattle.service.explorer.point.panel import Below, PointPanel
from gear_rattle.service.explorer.point.parts import Chances, chances_of_cell
from gear_rattle.service.explorer.point.view import PointView
from rattle import Machine
from rattle.models import Model

RESERVED = frozenset({"self", "panel", "front", "delta", "epsilon", "model", "machine"})  # an address may name anything
OPENED = "with-point"  # the page gives it more room
#: On a small screen the first thing that is seen of a point is its answer.
ANSWER_FIRST = f"@media (max-width: 1199px) {{ :host(.{OPENED}) > .go-to-place {{ order: 1; }} }}"
HINT = "<p class=faint>Point at the map to read a cell; click or tap it to look closer.</p>"


class Beside:
    """The right side of the page."""

    def __init__(
        self,
        viewer: Viewer,
        theme: str,
        sheet: str,
        on_close: Callable[[], None],
        on_state: Callable[[dict[str, Any]], None],
        go_to: GoTo,
        below: Below | None = None,
    ) -> None:
        self._viewer, self._on_close, self._on_state = viewer, on_close, on_state
        self._theme, self._below, self._go_to = theme, below, go_to
        self._text = Text(HINT, sheet)
        self._close = pn.widgets.Button(
            label="Close the point", stylesheets=[sheet], visible=False, margin=(0, 0, 6, 0)
        )
        on_press(self._close, lambda: self.close(tell=True))
        self._view: PointView | None = None
        self._reading: asyncio.Task[None] | None = None
        self._points: PointPanel | None = None
        self._point = pn.Column(sizing_mode="stretch_width", margin=0, stylesheets=[PRINTED])
        go_to.row.append(self._close)
        self.panel = pn.Column(
            go_to.panel, self._point, self._text.pane, sizing_mode="stretch_width", margin=0,
            stylesheets=[PRINTED, ANSWER_FIRST],
        )  # fmt: skip

    def read(self, plane: MapPlane, finer: MapBlock | None, delta: float, epsilon: float, window: Ranges) -> None:
        """Show what is known at a point, and no more what was asked for before."""
        self._give_up_reading()
        self._reading = self._viewer.start(self._read(plane, finer, delta, epsilon, window))

    def _give_up_reading(self) -> None:
        if self._reading is not None:
            self._reading.cancel()

    async def _read(
        self, plane: MapPlane, finer: MapBlock | None, delta: float, epsilon: float, window: Ranges
    ) -> None:
        model, here = plane.request.gear_model, finer_value(plane, finer, delta, epsilon)
        machine = plane.request.machine
        sample = plane.request.initial_conditions
        is_whole = (*sample.tau, sample.v_min, sample.v_max) == (0.0, 1.0, 0.0, None)  # as that of a point

        def read() -> tuple[str, Chances | None]:
            cell = plane.cell(delta, epsilon)
            known = chances_of_cell(cell, sample.count) if cell is not None and is_whole else None
            return readout(cell, delta, epsilon, model, window, here, machine), known

        found, known = await self._viewer.read(read)

        def show() -> None:
            self._text.html = found
            if known is not None and self._view is not None:
                self._view.tell_survey(model, (delta, epsilon), known)

        self._viewer.change(show)

    def forget(self) -> None:
        """Show no cell: what was read is no longer shown."""
        self._give_up_reading()
        self._text.html = HINT

    def open(
        self, delta: float, epsilon: float, model: Model, machine: Machine | None, state: Mapping[str, str]
    ) -> None:
        """Show the view of a point."""
        self._drop()
        points = self._points or PointPanel(self._theme, self._below)
        known = {name: value for name, value in state.items() if name not in RESERVED}
        self._view = view = PointView(points, self._viewer.front, delta, epsilon, model, machine, **known)
        view.param.watch(lambda event: self._on_state(event.new), "state")
        self.panel.css_classes = [OPENED]
        self._close.visible = self._point.visible = True
        if self._points is None:
            self._points = points
            self._point.append(points.column)

    def go_through(self, to: Pair) -> bool:
        """Draw the diagram of the point that is open from there to another one; whether one is open."""
        return self._view is not None and self._view.go_through(to)

    def close(self, tell: bool = False) -> None:
        """Put the view of the point away."""
        self._drop()
        self._close.visible = self._point.visible = False
        if self._points is not None:
            self._points.clear()
        self.panel.css_classes = []
        if tell:
            self._on_close()

    def end(self) -> None:
        """Give up the view of the point: its page was closed, and its document is no more."""
        self._drop()

    def _drop(self) -> None:
        if self._view is not None:
            self._view.stop()
            self._view = None
