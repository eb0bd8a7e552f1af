"""The lines over the map and their key: each line is found by a task of its own, and the key tells what is missing."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Sequence
from typing import Any

from rattle import RattleError
from rattle.models import AnyModel
from service.explorer import overlays
from service.explorer.address import CRISIS, POINTS, Pair
from service.explorer.lists import Key
from service.explorer.map import Map
from service.explorer.viewer import Viewer
from service.kernels import Part


class Lines:
    """The lines that may be drawn on a map; `on_chosen` is called when the viewer switches some on or off."""

    def __init__(
        self,
        crises: overlays.Crises,
        viewer: Viewer,
        canvas: Map,
        chosen: Sequence[str],
        on_chosen: Callable[[], None],
    ) -> None:
        self._crises, self._viewer, self._map = crises, viewer, canvas
        self._tasks: dict[str, asyncio.Task[None]] = {}
        self._entries: list[dict[str, Any]] = []
        self.key = Key(overlays=self._entries, chosen=list(chosen), margin=0, sizing_mode="stretch_width")
        self.key.param.watch(lambda _event: on_chosen(), "chosen")
        canvas.choose(tuple(chosen))

    @property
    def chosen(self) -> tuple[str, ...]:
        """The lines that are switched on, in the order of the key."""
        return tuple(name for name in overlays.OVERLAYS if name in self.key.chosen)

    def tell(self, model: AnyModel) -> None:
        """Tell in the key what the lines of this model mean."""
        self._entries = overlays.entries(model)
        self.key.overlays = self._entries

    def draw(self, names: Sequence[str], model: AnyModel, window: tuple[Pair, Pair]) -> None:
        """Find some lines of a model in a window, instead of what was being found of them."""
        for name in names:
            if name in self._tasks:
                self._tasks.pop(name).cancel()
            self._tasks[name] = self._viewer.start(self._line(name, model, window))

    async def _line(self, name: str, model: AnyModel, window: tuple[Pair, Pair]) -> None:
        await self._viewer.front.kernels.require(model.name, Part.CURVES, patience=math.inf)
        if name == POINTS:
            points = await self._viewer.read(lambda: overlays.points_of(model))
            self._viewer.change(lambda: self._map.points(points))
            return
        if name == CRISIS:
            self._note(name, "is being computed …")
            try:
                pieces, missing = [await self._crises.of(model)], ""
            except RattleError as error:
                pieces, missing = [], str(error)
        else:
            pieces, missing = await self._viewer.read(lambda: overlays.pieces_of(name, model, *window))
        self._note(name, "", missing)
        self._viewer.change(lambda: self._map.line(name, pieces))

    def _note(self, name: str, note: str, missing: str = "") -> None:
        entries = [
            each | {"note": note, "missing": bool(missing), "meaning": missing or each["meaning"]}
            if each["name"] == name
            else each
            for each in self._entries
        ]
        if entries != self._entries:
            self._entries = entries
            self._viewer.change(lambda: self.key.param.update(overlays=entries))
