"""The document of one open page: its parts, and how they act on each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from html import escape
from typing import Any

import panel as pn
from bokeh.events import ConnectionLost, DocumentReady
from bokeh.models import CustomJS
from pydantic import ValidationError

from gear_rattle.service.database.tables import JobKind, Scope
from gear_rattle.service.errors import ServiceError, UnknownSurveyError
from gear_rattle.service.explorer.common.address import FURTHER, Pair, Pin, View
from gear_rattle.service.explorer.common.changes import in_event_loop
from gear_rattle.service.explorer.common.lists import SurveyMenu
from gear_rattle.service.explorer.common.news import JobStatus, overall_rate
from gear_rattle.service.explorer.common.viewer import CALLER, Viewer
from gear_rattle.service.explorer.common.watch import on_press
from gear_rattle.service.explorer.families.view import FamiliesView
from gear_rattle.service.explorer.files import asset, tour
from gear_rattle.service.explorer.further.maps import FurtherMaps
from gear_rattle.service.explorer.map.shared import Shared, shown_first
from gear_rattle.service.explorer.map.view import MapView
from gear_rattle.service.explorer.page.form import Form, what_is_wrong
from gear_rattle.service.explorer.page.head import SCHEME, theme_of
from gear_rattle.service.explorer.page.rows import row_of
from gear_rattle.service.explorer.pins.view import Pins
from gear_rattle.service.explorer.section.section import Section
from gear_rattle.service.operations.surveys import Description, describe_survey, remove_survey, verify_survey
from gear_rattle.workers import SurveyRequest


class _Template(pn.Template):
    """Panel's, in less time."""

    def __repr__(self) -> str:
        return type(self).__name__  # Panel's lists all parts, and is made for each of them


def open_page(shared: Shared) -> pn.Template:
    """Return a new page, for the caller of the request that is being answered, with the view of its URL."""
    document = pn.state.curdoc
    assert document is not None  # Panel has set it
    viewer = Viewer(shared.front, CALLER.get(), document)
    view = View.parse(pn.state.session_args)
    theme = theme_of(view, SCHEME.get())
    config: Any = pn.config
    config.theme = "dark" if theme == "dark" else "default"  # of this page
    page = Page(shared, viewer, view, theme)
    document.js_on_event(DocumentReady, CustomJS(code="arrived()"))
    document.js_on_event(ConnectionLost, CustomJS(code="lost()"))
    document.on_session_destroyed(lambda _context: page.end())
    return page.template


class Page:
    """The parts of a page."""

    def __init__(self, shared: Shared, viewer: Viewer, view: View, theme: str) -> None:
        self._shared, self._viewer = shared, viewer
        location: Any = pn.state.location
        self._location = location
        self._location.param.watch(lambda _event: viewer.change(self._show_address), "search")
        self._standings: dict[str, JobStatus] = {}
        self._unasked = ""  # the survey that is shown because nobody chose one
        self._form: Form | None = None
        viewer.tell = self._tell
        sheet = asset("widgets.css")
        self._notice = pn.pane.HTML("", stylesheets=[sheet], margin=(0, 10), sizing_mode="stretch_width")
        self._list = SurveyMenu(
            self._act, chosen=view.survey, signed_in=viewer.signed_in, margin=0, sizing_mode="stretch_width"
        )
        self._new = pn.widgets.Button(
            label="New survey", color="primary", css_classes=["new"], stylesheets=[sheet], margin=8
        )
        on_press(self._new, self._toggle_form)
        # In a column of its own: what is put between others has all of them set anew.
        self._entering = pn.Column(sizing_mode="stretch_width", margin=0)
        self._side = pn.Column(
            self._new, self._entering, self._notice, self._list, sizing_mode="stretch_width", margin=0
        )
        self._pins = Pins(viewer, view.pins, self._on_pins, self._go_to_pin)
        self._further = FurtherMaps(shared, viewer, theme, sheet, lambda: self._map)
        self._section = Section(shared, viewer, theme, sheet, self._keep, self._go_through)
        self._families = FamiliesView(shared, viewer, sheet, lambda: self._map)
        self._map = MapView(
            shared, viewer, view, theme, sheet, self._remember, self._save_window, self._section.below,
            self._further.point_at,
        )  # fmt: skip
        self._map.offer(self._families.which)
        self._map.offer(self._further.add)
        self._list.param.watch(in_event_loop(lambda event: self._choose(event.new)), "chosen")
        self.template = self._laid_out(theme)
        shared.news.listen(self._on_news)

    def _laid_out(self, theme: str) -> pn.Template:
        template = _Template(asset("page.html"), location=True)
        for name, value in {
            "theme": theme,
            "other_theme": "Light" if theme == "dark" else "Dark",
            "signed_in": self._viewer.signed_in,
            "tour": tour(),
        }.items():
            template.add_variable(name, value)
        further = dict(zip(FURTHER, self._further.places, strict=True))
        own = {"side": self._side, "pins": self._pins.table, "families": self._families.panel}
        for name, part in {**own, **self._map.parts, **further}.items():
            template.add_panel(name, part)
        return template

    def _on_news(self, standings: Sequence[JobStatus]) -> None:
        self._viewer.start(self._take(standings))

    async def _take(self, standings: Sequence[JobStatus]) -> None:
        standings = await self._viewer.read(lambda: self._with_asked(standings))  # if the key still holds
        caller = self._viewer.caller
        rows = [row_of(each, self._map.view, caller.owns(each.job), self._map.seen) for each in standings]

        def show() -> None:
            self._standings = {each.job.id: each for each in standings}
            self._list.param.update(rows=rows, ready=True)
            shown = self._map.view.survey
            gone = shown == self._unasked and shown not in self._standings  # news may be older than a deletion
            if (not shown or gone) and (first := shown_first(each.job for each in standings)):
                self._unasked = first.id
                self._list.chosen = first.id
            self._map.follow(self._standings.get(self._map.view.survey))
            self._follow()

        self._viewer.change(show)

    def _with_asked(self, standings: Sequence[JobStatus]) -> Sequence[JobStatus]:
        """And the survey of the address, which need not be among the newest."""
        asked = self._map.view.survey
        if asked and all(each.job.id != asked for each in standings):
            with suppress(UnknownSurveyError):
                job = self._shared.front.database.job(asked, JobKind.SURVEY)
                return [*standings, JobStatus(job, overall_rate(job), None)]
        return standings

    def _choose(self, survey_id: str) -> None:
        if survey_id in self._standings:
            self._map.choose(self._standings[survey_id].job)

    def _remember(self, view: View) -> None:
        """Remember the view in the URL that reproduces it."""
        self._show_address()
        self._follow()
        if self._standings:
            owns = self._viewer.caller.owns
            self._list.rows = [row_of(each, view, owns(each.job), self._map.seen) for each in self._standings.values()]

    def _follow(self) -> None:
        """Follow the map: the parts that belong to it show the same survey."""
        view = self._map.view
        standing = self._standings.get(view.survey)
        job = standing.job if standing else None
        self._section.follow(view, job)
        self._families.follow(view, job)
        self._viewer.change(lambda: self._map.mark_pins(self._pins.pins))
        jobs = {survey_id: each.job for survey_id, each in self._standings.items()}
        self._further.follow(replace(view, pins=self._pins.pins), jobs)
        self._pins.follow(self._map.pin)

    def _keep(self, **values: Any) -> None:
        self._map.keep(**values)

    def _go_through(self, to: Pair) -> None:
        self._map.through(*to)

    def _show_address(self) -> None:
        """Also when the browser has just said what its address is: then what was shown before has been lost."""
        self._location.search = replace(self._map.view, pins=self._pins.pins).query()

    def _on_pins(self) -> None:
        self._show_address()
        self._viewer.change(self._follow)  # the table tells of it without the document's lock

    def _go_to_pin(self, pin: Pin) -> None:
        if not self._map.go_to_pin(pin):
            self._tell("This point is of another model than the map, or of other numbers of it: choose a survey of it.")

    def _toggle_form(self) -> None:
        if self._form is not None and self._form.panel in self._entering:
            self._entering.clear()
            self._side.css_classes = []
            self._new.param.update(label="New survey", color="primary")
        else:
            self._opened_form()

    def _opened_form(self) -> Form:
        if self._form is None:
            self._form = Form(self._viewer, self._submitted, asset("widgets.css"))
        if self._form.panel not in self._entering:
            self._entering.append(self._form.panel)
            self._side.css_classes = ["with-form"]
            self._new.param.update(label="Close the form", color="default")
        return self._form

    def _submitted(self, survey_id: str) -> None:
        self._toggle_form()

        async def show() -> None:
            job = await self._viewer.read(lambda: self._shared.front.database.job(survey_id))

            def choose() -> None:
                self._standings[survey_id] = JobStatus(job, None, None)
                self._map.show_usual_variable()
                self._list.chosen = survey_id

            self._viewer.change(choose)

        self._viewer.start(show())

    def _save_window(self) -> None:
        view = self._map.view
        window = self._map.window
        form = self._opened_form()
        form.fill_window(window, self._map.model, self._map.machine)
        if view.survey in self._standings and self._standings[view.survey].job.is_readable:
            form.sample.fill(self._request(view.survey))

    def _request(self, survey_id: str) -> SurveyRequest:
        """Return the request of a survey; with a third axis that of the visible slice."""
        request, view = SurveyRequest.model_validate(self._standings[survey_id].job.request), self._map.view
        return request.at(request.along(view.slice if survey_id == view.survey else 0))

    def _act(self, action: str, survey_id: str, entered: Mapping[str, Any]) -> None:
        if action == "again" and survey_id in self._standings and self._standings[survey_id].job.is_readable:
            self._opened_form().fill(self._request(survey_id))
        elif action in ("cancel", "delete") and survey_id in self._standings:
            self._viewer.start(self._remove(action, survey_id))
        elif action == "resume" and survey_id in self._standings:
            self._viewer.start(self._resume(survey_id))
        elif action == "describe" and survey_id in self._standings:
            self._viewer.start(self._describe(survey_id, entered))

    async def _resume(self, survey_id: str) -> None:
        def resume() -> None:
            verify_survey(self._shared.front, self._viewer.require(Scope.SUBMIT), survey_id)

        await self._viewer.read(resume, Scope.SUBMIT)

    async def _describe(self, survey_id: str, entered: Mapping[str, Any]) -> None:
        def describe() -> None:
            try:
                given = Description(name=entered.get("name"), notes=entered.get("notes"))
            except ValidationError as error:
                raise ServiceError(what_is_wrong(error)) from error
            caller = self._viewer.require(Scope.SUBMIT)
            describe_survey(self._shared.front, caller, survey_id, given)

        await self._viewer.read(describe, Scope.SUBMIT)

    async def _remove(self, action: str, survey_id: str) -> None:
        def remove() -> None:
            front = self._shared.front
            ended = front.database.job(survey_id).shown[0].final
            if ended == (action == "delete"):  # cancelling what has just ended shall not delete it
                remove_survey(front, self._viewer.require(Scope.SUBMIT), survey_id)

        await self._viewer.read(remove, Scope.SUBMIT)

    def _tell(self, text: str) -> None:
        def write() -> None:
            self._notice.object = f'<p class="notice" role="alert">{escape(text)}</p>'

        self._viewer.change(write)

    def end(self) -> None:
        """Release the resources after the browser has left."""
        self._shared.news.leave(self._on_news)
        self._map.end()
        self._further.end()
        self._families.end()
        self._pins.end()
        self._viewer.end()
