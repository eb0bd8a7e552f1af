"""Beside the map: what is known of the cell that is pointed at, and the view of the point that was clicked."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from html import escape
from typing import Any

import panel as pn

from rattle.models import AnyModel
from service.explorer.address import Pair
from service.explorer.planes import Plane
from service.explorer.point import PointView
from service.explorer.readout import readout
from service.explorer.viewer import Viewer

RESERVED = frozenset({"self", "front", "delta", "epsilon", "model"})  # an address may name anything
OPENED = "with-point"  # the page gives it more room


class Beside:
    """The right side of the page."""

    def __init__(
        self,
        viewer: Viewer,
        text: pn.pane.HTML,
        sheet: str,
        on_close: Callable[[], None],
        on_state: Callable[[dict[str, Any]], None],
    ) -> None:
        self._viewer, self._text, self._on_close, self._on_state = viewer, text, on_close, on_state
        self._zoom = pn.pane.HTML("", stylesheets=[sheet], margin=0, sizing_mode="stretch_width")
        self._close = pn.widgets.Button(
            label="Close the point", stylesheets=[sheet], visible=False, margin=(0, 0, 6, 0)
        )
        self._close.on_click(lambda _event: self.close(tell=True))
        self._view: PointView | None = None
        self._point = pn.Column(sizing_mode="stretch_width", margin=0)
        self.panel = pn.Column(self._zoom, self._close, self._point, text, sizing_mode="stretch_width", margin=0)

    def say(self, text: str) -> None:
        """What the finer computation of the window does."""
        self._zoom.object = f'<p class="faint" role="status">{escape(text)}</p>' if text else ""

    async def read(self, plane: Plane, delta: float, epsilon: float, window: tuple[Pair, Pair]) -> None:
        """Show what is known at a point."""
        model = plane.request.gear_model
        found = await self._viewer.read(lambda: readout(plane.cell(delta, epsilon), delta, epsilon, model, window))
        self._viewer.change(lambda: self._text.param.update(object=found))

    def open(self, delta: float, epsilon: float, model: AnyModel, state: Mapping[str, str]) -> None:
        """Show the view of a point."""
        self._drop()
        known = {name: value for name, value in state.items() if name not in RESERVED}
        self._view = view = PointView(self._viewer.front, delta, epsilon, model, **known)
        view.param.watch(lambda event: self._on_state(event.new), "state")
        self._point[:] = [view]
        self._close.visible = True
        self.panel.css_classes = [OPENED]

    def close(self, tell: bool = False) -> None:
        """Put the view of the point away."""
        self._drop()
        self._close.visible = False
        self.panel.css_classes = []
        if tell:
            self._on_close()

    def _drop(self) -> None:
        if self._view is not None:
            self._view.stop()
            self._view = None
        self._point.clear()
