"""Show the profile of the survey along the diagram of the open point."""

from __future__ import annotations

from collections.abc import AsyncGenerator
from functools import cached_property, partial
from html import escape
from typing import Any

import panel as pn

from gear_rattle.service.database.tables import JobRow
from gear_rattle.service.explorer.common.address import MapChoice, View
from gear_rattle.service.explorer.common.drawings import DrawingRunner, Show
from gear_rattle.service.explorer.common.text import Text
from gear_rattle.service.explorer.common.viewer import Viewer
from gear_rattle.service.explorer.common.watch import WidgetWatcher
from gear_rattle.service.explorer.map.planes import map_names
from gear_rattle.service.explorer.map.shared import SharedState
from gear_rattle.service.explorer.point.panel import FigurePlace
from gear_rattle.service.explorer.point.state import DIAGRAM, PointState, machine_and_model
from gear_rattle.service.explorer.section.picture import ProfilePicture
from gear_rattle.service.explorer.section.profile import Ends, profile_in_words, profile_of
from gear_rattle.service.explorer.state.events import DiagramEndChosen, ProfileChosen
from gear_rattle.service.explorer.state.store import JOBS, Store
from gear_rattle.service.operations.diagrams import diagram_ends, diagram_span
from gear_rattle.workers import SurveyRequest
from rattle import RattleError

OTHER_GEAR = "The survey is of another gear than this point, so it has no profile along this diagram."
NO_WAY = "The end point needs a δ above 0 and an ε of at least 0."


class ProfileSection:
    """Profile of the survey along the diagram of the open point. below: its panel, which is below the diagram."""

    def __init__(self, shared: SharedState, viewer: Viewer, store: Store, theme: str, sheet: str) -> None:
        self._shared, self._viewer, self._store = shared, viewer, store
        self._theme, self._sheet = theme, sheet
        self.below = FigurePlace()
        self.said = Text("", sheet, margin=(0, 4))
        self._way: tuple[Any, ...] = ()
        self.drawings = DrawingRunner(viewer)
        self._watch = WidgetWatcher()
        styled: dict[str, Any] = {"stylesheets": [sheet], "margin": (2, 4)}
        self.variable = pn.widgets.Select(label="Profile of", options={}, width=230, **styled)
        self.low, self.high, self.delta, self.epsilon = (
            pn.widgets.FloatInput(label=label, width=105, **styled)
            for label in ("values from", "values to", "way to δ", "way to ε")
        )
        self._watch.call_on_change(self.variable, self._on_variable)
        for field in (self.low, self.high):
            self._watch.call_on_change(field, self._on_limits)
        for field in (self.delta, self.epsilon):
            self._watch.call_on_change(field, self._on_way)
        store.subscribe(
            self._on_view_change, "survey", "slice", "variable", "index", "point", "machine", "point_state", "profile",
            "profile_limits", JOBS,
        )  # fmt: skip

    @cached_property
    def picture(self) -> ProfilePicture:
        """Figure of the profile, made when a profile is first shown."""
        found = ProfilePicture(self._theme, self.below.x_range)
        self.below.panel[:] = [
            Text("<h2>Along the diagram</h2>", self._sheet, margin=(0, 4)).pane,
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
        state = PointState.read(view.point_state, 0.0)
        is_seen = view.point is not None and state.shown_tab == DIAGRAM
        if not is_seen or (view.survey and (job is None or not job.is_readable)):
            self.drawings.stop()
            self.below.panel.visible = False
            return
        place = view.point, view.machine, state.direction, state.span, state.to
        wanted = view.survey, view.slice, view.variable, view.index, view.profile, view.profile_limits, place
        self.drawings.request(wanted, [job] if job is not None else [], partial(self._draw, view, job, state))

    async def _draw(self, view: View, job: JobRow | None, state: PointState) -> AsyncGenerator[Show, None]:
        assert view.point is not None
        whole = SurveyRequest.model_validate(job.request) if job is not None else self._shared.exact.request
        request = whole.slice_request(whole.slice_index(view.slice))
        _, model = machine_and_model(view.point, view.machine, request.machine, request.gear_model)
        try:
            gear = model.gear(*view.point)
            ends = diagram_ends(gear, state.direction, state.span, state.to)
            span = (0.0, 1.0) if state.to else diagram_span(gear, state.direction, state.span)
            chosen, options = _profile_options(request, view)
            if model != request.gear_model:
                raise RattleError(OTHER_GEAR)
            plane = await self._viewer.run_in_thread(
                partial(self._shared.plane, job, chosen.variable, chosen.index, view.slice)
            )
            found = await self._viewer.run_in_thread(partial(profile_of, plane, ends))
        except RattleError as error:
            yield partial(self._show_error, str(error))
            return

        def show() -> None:
            self._set_options(options, chosen, ends)
            limits = self.picture.show(found, span, view.profile_limits if view.profile == chosen else None)
            with self._watch.paused():
                self.low.value, self.high.value = limits
            if self._way != (ends, span):  # if the diagram is the same, its axis stays as a viewer may have moved it
                self._way = ends, span
                self.below.x_range.update(start=span[0], end=span[1])
            self.said.html = f'<p class="faint">{escape(profile_in_words(found))}</p>'
            self.below.panel.visible = True

        yield show

    def _set_options(self, options: dict[str, str], chosen: MapChoice, ends: Ends) -> None:
        with self._watch.paused():
            self.variable.param.update(options=options, value=chosen.address_text)
            self.delta.value, self.epsilon.value = ends[1]

    def _show_error(self, why: str) -> None:
        self.picture.clear()
        self.said.html = f'<p class="notice" role="alert">{escape(why)}</p>'
        self.below.panel.visible = True

    def _on_variable(self) -> None:
        self._store.dispatch(ProfileChosen(MapChoice.read(str(self.variable.value))))

    def _on_limits(self) -> None:
        low, high = self.low.value, self.high.value
        if low is None or high is None or not low < high:
            self._show_error("The profile needs two limits, the first below the second.")
        else:
            chosen = MapChoice.read(str(self.variable.value))
            self._store.dispatch(ProfileChosen(chosen, (float(low), float(high))))

    def _on_way(self) -> None:
        delta, epsilon = self.delta.value, self.epsilon.value
        if delta is None or epsilon is None or delta <= 0 or epsilon < 0:
            self._show_error(NO_WAY)
        else:
            self._store.dispatch(DiagramEndChosen((float(delta), float(epsilon))))


def _profile_options(request: SurveyRequest, view: View) -> tuple[MapChoice, dict[str, str]]:
    """Return the map of the profile, by default the visible map, and the text of each map by its name in words."""
    options = {words: chosen.address_text for words, chosen in map_names(request).items()}
    for chosen in (view.profile, MapChoice(view.variable, view.index)):
        if chosen is not None and chosen.address_text in options.values():
            return chosen, options
    return MapChoice.read(next(iter(options.values()))), options
