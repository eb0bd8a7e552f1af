"""Show the comparison maps that a viewer adds beside the first map, at most three."""

from __future__ import annotations

from collections.abc import Mapping

import panel as pn

from gear_rattle.service.explorer.common.address import MOST_FURTHER, ComparisonChoice
from gear_rattle.service.explorer.common.viewer import PageSession
from gear_rattle.service.explorer.common.watch import call_on_press
from gear_rattle.service.explorer.further.one import ComparisonMap
from gear_rattle.service.explorer.further.surveys import survey_menu_options
from gear_rattle.service.explorer.map.figure import MapFigure
from gear_rattle.service.explorer.map.planes import maps_by_name
from gear_rattle.service.explorer.map.shared import SharedState
from gear_rattle.service.explorer.state.events import ComparisonMapAdded
from gear_rattle.service.explorer.state.store import JOBS, PageStore


class ComparisonMaps:
    """Comparison maps of a page.

    panels: a panel for each of the MOST_FURTHER maps that a viewer can add, empty until the map is added. add_button:
    the button that adds a map.

    Parameters
    ----------
    first : MapFigure
        Figure of the first map, whose window all maps share.
    """

    def __init__(
        self, shared: SharedState, viewer: PageSession, store: PageStore, first: MapFigure, theme: str, sheet: str
    ) -> None:
        self._shared, self._viewer, self._store = shared, viewer, store
        self._first, self._theme, self._sheet = first, theme, sheet
        self.maps: list[ComparisonMap] = []
        self.panels = [pn.Column(sizing_mode="stretch_both", margin=0) for _ in range(MOST_FURTHER)]
        self.add_button = pn.widgets.Button(
            label="Add a second map", css_classes=["beside-map"], stylesheets=[sheet], margin=(2, 8, 2, 0),
            visible=False,
        )  # fmt: skip
        call_on_press(self.add_button, self._add_map)
        self._named: tuple[tuple[str, str], ...] = ()
        self.surveys: Mapping[str, str] = {}
        store.subscribe(
            self._on_view_change,
            "survey",
            "variable",
            "index",
            "slice",
            "delta",
            "epsilon",
            "overlays",
            "pins",
            "further",
            JOBS,
        )
        store.subscribe(self._on_pointer_change, "pointer")

    def _on_view_change(self) -> None:
        """Add or remove comparison maps until they are those of the view, and let each show its survey and variable."""
        view = self._store.view
        self.add_button.visible = not view.is_example_shown and len(view.further) < MOST_FURTHER
        if not self._store.is_list_loaded:
            return
        while len(self.maps) > len(view.further):
            self.maps.pop().end()
            self.panels[len(self.maps)].param.update(objects=[], css_classes=[])
        while len(self.maps) < len(view.further):
            index = len(self.maps)
            figure = MapFigure(self._theme, self._store.dispatch, self._first, f"further{index + 2}")
            made = ComparisonMap(self._shared, self._viewer, self._store, figure, self._sheet, index)
            self.maps.append(made)
            self.panels[index].param.update(objects=[made.panel], css_classes=["shown"])
        jobs = [status.job for status in self._store.jobs.values()]
        named = tuple((each.id, each.name) for each in jobs if each.is_readable)
        if self.maps and named != self._named:
            self._named, self.surveys = named, survey_menu_options(jobs)
        for each in self.maps:
            each.show_view(self.surveys)

    def _on_pointer_change(self) -> None:
        for each in self.maps:
            each.show_pointer()

    def _add_map(self) -> None:
        """Add a map of the first map's survey: of a variable that the page does not show yet, if there is one."""
        view, request = self._store.view, self._store.request
        if request is None or view.is_example_shown:
            return
        names = list(maps_by_name(request).values())
        shown = {(view.variable, view.index), *((each.variable, each.index) for each in view.further)}
        free = [each for each in names if (each.variable, each.index) not in shown] or names
        self._store.dispatch(
            ComparisonMapAdded(ComparisonChoice(view.survey, free[0].variable, free[0].index, view.slice))
        )

    def end(self) -> None:
        """Stop all work of the comparison maps, because the page was closed."""
        for each in self.maps:
            each.end()
