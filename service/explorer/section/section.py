"""The profile of the survey along the diagram of the point that is open: which variable, from where to where."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial
from html import escape
from typing import Any

import panel as pn

from gear_rattle.service.database.tables import JobRow
from gear_rattle.service.explorer.common.address import Chosen, Pair, View
from gear_rattle.service.explorer.common.drawings import Drawings, Show
from gear_rattle.service.explorer.common.text import Text
from gear_rattle.service.explorer.common.viewer import Viewer
from gear_rattle.service.explorer.common.watch import Watch
from gear_rattle.service.explorer.map.planes import map_names
from gear_rattle.service.explorer.map.shared import Shared
from gear_rattle.service.explorer.point.panel import Below
from gear_rattle.service.explorer.point.state import DIAGRAM, PointState, stands_for
from gear_rattle.service.explorer.section.picture import ProfilePicture
from gear_rattle.service.explorer.section.profile import Ends, profile_in_words, profile_of
from gear_rattle.service.operations.diagrams import diagram_ends, diagram_span
from gear_rattle.workers import SurveyRequest
from rattle import RattleError

OTHER_GEAR = "This point is of another gear than the survey, which has no profile of it."
NO_WAY = "A way leads to a δ above 0 and an ε of 0 or more."


class Section:
    """Profile below the diagram.

    `keep` remembers what is chosen in the view, `go_through` has the diagram drawn from the open point to another one.
    """

    def __init__(
        self,
        shared: Shared,
        viewer: Viewer,
        theme: str,
        sheet: str,
        keep: Callable[..., None],
        go_through: Callable[[Pair], None],
    ) -> None:
        self._shared, self._viewer, self._theme, self._sheet = shared, viewer, theme, sheet
        self._keep, self._go_through = keep, go_through
        self.below = Below()
        self._said = Text("", sheet, margin=(0, 4))
        self._way: tuple[Any, ...] = ()
        self._drawings = Drawings(viewer)
        self._watch = Watch()
        styled: dict[str, Any] = {"stylesheets": [sheet], "margin": (2, 4)}
        self._variable = pn.widgets.Select(label="Profile of", options={}, width=230, **styled)
        self._low, self._high, self._delta, self._epsilon = (
            pn.widgets.FloatInput(label=label, width=105, **styled)
            for label in ("values from", "values to", "way to δ", "way to ε")
        )
        self._watch.on(self._variable, self._on_variable)
        for field in (self._low, self._high):
            self._watch.on(field, self._on_limits)
        for field in (self._delta, self._epsilon):
            self._watch.on(field, self._on_way)

    @cached_property
    def _picture(self) -> ProfilePicture:
        found = ProfilePicture(self._theme, self.below.x_range)
        self.below.panel[:] = [
            Text("<h2>Along the diagram</h2>", self._sheet, margin=(0, 4)).pane,
            pn.FlexBox(
                self._variable, self._low, self._high, self._delta, self._epsilon, margin=0,
                sizing_mode="stretch_width", align_items="flex-end",
            ),
            pn.pane.Bokeh(found.figure, sizing_mode="stretch_width", margin=(0, 4)),
            self._said.pane,
        ]  # fmt: skip
        return found

    def follow(self, view: View, job: JobRow | None) -> None:
        """Show what belongs to this view; job: of its survey, None without any."""
        state = PointState.read(view.point_state, 0.0)
        is_seen = view.point is not None and state.open_tab == DIAGRAM
        if not is_seen or (view.survey and (job is None or not job.is_readable)):
            self._drawings.stop()
            self.below.panel.visible = False
            return
        place = view.point, view.machine, state.direction, state.span, state.to
        wanted = view.survey, view.slice, view.variable, view.index, view.profile, view.profile_limits, place
        self._drawings.want(wanted, [job] if job is not None else [], partial(self._draw, view, job, state))

    async def _draw(self, view: View, job: JobRow | None, state: PointState) -> Show:
        assert view.point is not None
        whole = SurveyRequest.model_validate(job.request) if job is not None else self._shared.exact.request
        request = whole.at(whole.along(view.slice))
        _, model = stands_for(view.point, view.machine, request.machine, request.gear_model)
        try:
            gear = model.gear(*view.point)
            ends = diagram_ends(gear, state.direction, state.span, state.to)
            span = (0.0, 1.0) if state.to else diagram_span(gear, state.direction, state.span)
            chosen, options = _offered(request, view)
            if model != request.gear_model:
                raise RattleError(OTHER_GEAR)
            plane = await self._viewer.read(partial(self._shared.plane, job, chosen.variable, chosen.index, view.slice))
            found = await self._viewer.read(partial(profile_of, plane, ends))
        except RattleError as error:
            return partial(self._refuse, str(error))

        def show() -> None:
            self._offer(options, chosen, ends)
            limits = self._picture.show(found, span, view.profile_limits if view.profile == chosen else None)
            with self._watch.paused():
                self._low.value, self._high.value = limits
            if self._way != (ends, span):  # else a viewer may have moved the axis
                self._way = ends, span
                self.below.x_range.update(start=span[0], end=span[1])
            self._said.html = f'<p class="faint">{escape(profile_in_words(found))}</p>'
            self.below.panel.visible = True

        return show

    def _offer(self, options: dict[str, str], chosen: Chosen, ends: Ends) -> None:
        with self._watch.paused():
            self._variable.param.update(options=options, value=chosen.written)
            self._delta.value, self._epsilon.value = ends[1]

    def _refuse(self, why: str) -> None:
        self._picture.clear()
        self._said.html = f'<p class="notice" role="alert">{escape(why)}</p>'
        self.below.panel.visible = True

    def _on_variable(self) -> None:
        self._keep(profile=Chosen.read(str(self._variable.value)), profile_limits=None)

    def _on_limits(self) -> None:
        low, high = self._low.value, self._high.value
        if low is None or high is None or not low < high:
            self._refuse("The profile needs two limits, the first below the second.")
        else:
            self._keep(profile=Chosen.read(str(self._variable.value)), profile_limits=(float(low), float(high)))

    def _on_way(self) -> None:
        delta, epsilon = self._delta.value, self._epsilon.value
        if delta is None or epsilon is None or delta <= 0 or epsilon < 0:
            self._refuse(NO_WAY)
        else:
            self._go_through((float(delta), float(epsilon)))


def _offered(request: SurveyRequest, view: View) -> tuple[Chosen, dict[str, str]]:
    """Return the map whose profile is shown, the visible one unless a viewer has chosen another, and all others."""
    options = {words: chosen.written for words, chosen in map_names(request).items()}
    for chosen in (view.profile, Chosen(view.variable, view.index)):
        if chosen is not None and chosen.written in options.values():
            return chosen, options
    return Chosen.read(next(iter(options.values()))), options
