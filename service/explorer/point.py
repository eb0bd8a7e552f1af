"""What is known of one parameter point in closed form."""

from __future__ import annotations

from html import escape
from typing import Any

import panel as pn
import param

import rattle
from rattle.plot.plane import REGIONS
from service.state import Front


class PointView(pn.viewable.Viewer):
    """One parameter point; `state` is what its URL has to keep."""

    state = param.Dict(default={})

    def __init__(self, front: Front, delta: float, epsilon: float, beta: float, **state: str) -> None:
        super().__init__(state=dict(state))
        self._front = front
        gear = rattle.Gear(delta, epsilon, beta)
        rows: list[str] = [f"region {REGIONS[int(gear.region())] or 'none'}"]
        rows += [f"{orbit.name}: {'stable' if orbit.stable else 'unstable'}" for orbit in gear.orbits()]
        self._panel = pn.pane.HTML("<p>" + escape("; ".join(rows)) + "</p>", css_classes=["point"])

    def __panel__(self) -> Any:
        return self._panel
