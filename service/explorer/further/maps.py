"""The maps beside the first one: as many as a viewer adds, three at most."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import panel as pn

from gear_rattle.service.database.tables import JobRow
from gear_rattle.service.explorer.common.address import MOST_FURTHER, Further, Pair, View
from gear_rattle.service.explorer.common.viewer import Viewer
from gear_rattle.service.explorer.common.watch import on_press
from gear_rattle.service.explorer.further.one import Around, FurtherCallbacks, FurtherMap
from gear_rattle.service.explorer.further.surveys import surveys_of
from gear_rattle.service.explorer.map.planes import map_names
from gear_rattle.service.explorer.map.shared import Shared
from gear_rattle.service.explorer.map.view import MapView


class FurtherMaps:
    """`places` are where they are shown, `add` is the button for another one.

    `map` gives the first map, which keeps what is chosen in its view.
    """

    def __init__(self, shared: Shared, viewer: Viewer, theme: str, sheet: str, first: Callable[[], MapView]) -> None:
        self._shared, self._viewer, self._theme, self._sheet, self._first = shared, viewer, theme, sheet, first
        self._maps: dict[int, FurtherMap] = {}
        self._named: tuple[tuple[str, str], ...] = ()
        self._surveys: Mapping[str, str] = {}
        self.places = [pn.Column(sizing_mode="stretch_both", margin=0) for _ in range(MOST_FURTHER)]
        self.add = pn.widgets.Button(
            label="Add a second map",
            css_classes=["beside-map"],
            stylesheets=[sheet],
            margin=(2, 8, 2, 0),
            visible=False,
        )
        on_press(self.add, self._add)

    def follow(self, view: View, jobs: Mapping[str, JobRow]) -> None:
        """Show what belongs to this view."""
        self.add.visible = bool(view.survey) and len(view.further) < MOST_FURTHER
        named = tuple((each.id, each.name) for each in jobs.values() if each.is_readable)
        if view.further and named != self._named:
            self._named, self._surveys = named, surveys_of(jobs)
        around = Around(view, self._first().window, jobs, self._surveys)
        for i, place in enumerate(self.places):
            if i < len(view.further):
                self._made(i, place).follow(view.further[i], around)
            elif i in self._maps:
                self._maps.pop(i).end()
                place.clear()
                place.css_classes = []

    def _made(self, i: int, place: pn.Column) -> FurtherMap:
        if i not in self._maps:
            first = self._first()
            uses = FurtherCallbacks(first.open_point, first.through, first.point_at, first.moved, first.reset)
            change = partial(self._change, i)
            self._maps[i] = FurtherMap(
                self._shared, self._viewer, self._theme, self._sheet, first.map, i + 2, uses, change
            )
            place.append(self._maps[i].panel)
            place.css_classes = ["shown"]
        return self._maps[i]

    def point_at(self, at: Pair) -> None:
        """Mark a point that is pointed at in the first map."""
        for each in self._maps.values():
            each.point_at(at)

    def _change(self, i: int, chosen: Further | None) -> None:
        further = list(self._first().view.further)
        further[i : i + 1] = [chosen] if chosen is not None else []
        self._first().keep(further=tuple(further))

    def _add(self) -> None:
        """Another variable of the same survey, the next that is not shown."""
        first = self._first()
        if first.request is None or len(first.view.further) >= MOST_FURTHER:
            return
        names = list(map_names(first.request).values())
        shown = {(first.view.variable, first.view.index)} | {(each.variable, each.index) for each in first.view.further}
        free = [each for each in names if (each.variable, each.index) not in shown] or names
        added = Further(first.view.survey, free[0].variable, free[0].index, first.view.slice)
        first.keep(further=(*first.view.further, added))

    def end(self) -> None:
        """Release the resources of a closed page."""
        for each in self._maps.values():
            each.end()
