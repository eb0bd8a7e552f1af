"""Show the profile of the survey along the diagram of the open point."""

from __future__ import annotations

from collections.abc import AsyncGenerator
from functools import cached_property, partial
from typing import Any

import panel as pn

from gear_rattle.service.database.tables import JobRow
from gear_rattle.service.explorer.common.address import MapChoice, View
from gear_rattle.service.explorer.common.drawings import DrawingRunner, Show
from gear_rattle.service.explorer.common.point_state import DIAGRAM
from gear_rattle.service.explorer.common.text import TextPane, alert_html, faint_html
from gear_rattle.service.explorer.common.viewer import PageSession
from gear_rattle.service.explorer.common.watch import WidgetWatcher
from gear_rattle.service.explorer.map.planes import options_of_map_menu
from gear_rattle.service.explorer.map.shared import SharedState
from gear_rattle.service.explorer.point.panel import FigureBelowDiagram
from gear_rattle.service.explorer.point.state import machine_and_model_of_open_point
from gear_rattle.service.explorer.section.picture import ProfileFigure
from gear_rattle.service.explorer.section.profile import Ends, compute_profile, profile_in_words
from gear_rattle.service.explorer.state.events import DiagramEndChosen, ProfileChosen
from gear_rattle.service.explorer.state.store import JOBS, PageStore
from gear_rattle.service.operations.diagrams import diagram_ends, diagram_span
from gear_rattle.workers import SurveyRequest
from rattle import RattleError
from rattle.models import Model

OTHER_GEAR = "The survey is of another gear than this point, so it has no profile here. Choose a point of its gear."
NO_END_POINT = "The end point needs a δ above 0 and an ε of at least 0."


class ProfileSection:
    """Section for the profile of a survey along the diagram of the open point, in the panel `profile_place`."""

    def __init__(self, shared: SharedState, viewer: PageSession, store: PageStore, theme: str, sheet: str) -> None:
        self._shared, self._viewer, self._store = shared, viewer, store
        self._theme, self._sheet = theme, sheet
        self.profile_place = FigureBelowDiagram()
        self.said = TextPane("", sheet, margin=(0, 4))
        self._shown_ends: tuple[Any, ...] = ()
        self.drawings = DrawingRunner(viewer, self._show_error)
        self._watch = WidgetWatcher()
        styled: dict[str, Any] = {"stylesheets": [sheet], "margin": (2, 4)}
        self.variable = pn.widgets.Select(label="Profile of", options={}, width=230, **styled)
        self.low, self.high, self.delta, self.epsilon = (
            pn.widgets.FloatInput(label=label, width=105, **styled)
            for label in ("values from", "values to", "way to δ", "way to ε")
        )
        self._watch.call_on_change(self.variable, self._on_variable_change)
        for field in (self.low, self.high):
            self._watch.call_on_change(field, self._on_profile_limits)
        for field in (self.delta, self.epsilon):
            self._watch.call_on_change(field, self._on_end_point)
        store.subscribe(
            self._on_view_change, "survey", "slice", "variable", "index", "point", "machine", "point_state", "profile",
            "profile_limits", JOBS,
        )  # fmt: skip

    @cached_property
    def profile_figure(self) -> ProfileFigure:
        """Figure of the profile, made when a profile is first shown."""
        found = ProfileFigure(self._theme, self.profile_place.x_range)
        self.profile_place.panel[:] = [
            TextPane("<h2>Along the diagram</h2>", self._sheet, margin=(0, 4)).pane,
            pn.FlexBox(
                self.variable, self.low, self.high, self.delta, self.epsilon, margin=0,
                sizing_mode="stretch_width", align_items="flex-end",
            ),
            pn.pane.Bokeh(found.figure, sizing_mode="stretch_width", margin=(0, 4)),
            self.said.pane,
        ]  # fmt: skip
        return found

    def _on_view_change(self) -> None:
        view, job = self._store.view, self._store.job
        is_seen = view.point is not None and view.point_state.shown_tab == DIAGRAM
        opened, request = machine_and_model_of_open_point(self._store), self._store.request
        if not is_seen or opened is None or request is None:
            self.drawings.stop()
            self.profile_place.panel.visible = False
            return
        place = view.point, view.machine, view.point_state.diagram_choice
        wanted = view.survey, view.slice, view.variable, view.index, view.profile, view.profile_limits, place
        jobs = [job] if job is not None else []
        self.drawings.request(wanted, jobs, partial(self._draw, view, job, request, opened[1]))

    async def _draw(
        self, view: View, job: JobRow | None, request: SurveyRequest, model: Model
    ) -> AsyncGenerator[Show, None]:
        assert view.point is not None
        gear = model.gear(*view.point)
        direction, half_span, to = view.point_state.diagram_choice
        ends = diagram_ends(gear, direction, half_span, to)
        span = (0.0, 1.0) if to else diagram_span(gear, direction, half_span)
        chosen, options = options_of_map_menu(request, view.profile, MapChoice(view.variable, view.index))
        if model != request.gear_model:
            raise RattleError(OTHER_GEAR)
        plane = await self._viewer.run_in_thread(
            partial(self._shared.plane, job, chosen.variable, chosen.index, view.slice)
        )
        found = await self._viewer.run_in_thread(partial(compute_profile, plane, ends))

        def show() -> None:
            self._set_options(options, chosen, ends)
            limits = self.profile_figure.show(found, span, view.profile_limits if view.profile == chosen else None)
            with self._watch.ignore_changes():
                self.low.value, self.high.value = limits
            if self._shown_ends != (ends, span):  # otherwise the axis stays where a viewer has moved it
                self._shown_ends = ends, span
                self.profile_place.x_range.update(start=span[0], end=span[1])
            self.said.html = faint_html(profile_in_words(found))
            self.profile_place.panel.visible = True

        yield show

    def _set_options(self, options: dict[str, str], chosen: MapChoice, ends: Ends) -> None:
        with self._watch.ignore_changes():
            self.variable.param.update(options=options, value=chosen.address_text)
            self.delta.value, self.epsilon.value = ends[1]

    def _show_error(self, why: RattleError | str) -> None:
        self.profile_figure.clear()
        self.said.html = alert_html(str(why))
        self.profile_place.panel.visible = True

    def _on_variable_change(self) -> None:
        self._store.dispatch(ProfileChosen(MapChoice.parse(str(self.variable.value))))

    def _on_profile_limits(self) -> None:
        low, high = self.low.value, self.high.value
        if low is None or high is None or not low < high:
            self._show_error("The profile needs two limits, the first below the second.")
        else:
            chosen = MapChoice.parse(str(self.variable.value))
            self._store.dispatch(ProfileChosen(chosen, (float(low), float(high))))

    def _on_end_point(self) -> None:
        delta, epsilon = self.delta.value, self.epsilon.value
        if delta is None or epsilon is None or delta <= 0 or epsilon < 0:
            self._show_error(NO_END_POINT)
        else:
            self._store.dispatch(DiagramEndChosen((float(delta), float(epsilon))))
