"""Build the document of one open page from its parts, and carry out the viewer's actions on surveys."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any

import panel as pn
from bokeh.events import ConnectionLost, DocumentReady
from bokeh.models import CustomJS
from pydantic import ValidationError

from gear_rattle.service.access.keys import Caller
from gear_rattle.service.database.tables import JobKind, Scope
from gear_rattle.service.errors import ServiceError, UnknownSurveyError
from gear_rattle.service.explorer.common.address import EXAMPLE, FURTHER, View
from gear_rattle.service.explorer.common.lists import SurveyMenu
from gear_rattle.service.explorer.common.news import JobStatus, mean_cells_per_second
from gear_rattle.service.explorer.common.text import alert_html
from gear_rattle.service.explorer.common.viewer import CALLER, PageSession
from gear_rattle.service.explorer.common.watch import WidgetWatcher, call_on_press
from gear_rattle.service.explorer.design.go_to import NavigationPanel
from gear_rattle.service.explorer.families.view import FamiliesView
from gear_rattle.service.explorer.files import help_html, read_asset
from gear_rattle.service.explorer.further.maps import ComparisonMaps
from gear_rattle.service.explorer.map.beside import PanelBesideMap
from gear_rattle.service.explorer.map.controls import MapControls
from gear_rattle.service.explorer.map.figure import MapFigure
from gear_rattle.service.explorer.map.shared import SharedState, default_survey
from gear_rattle.service.explorer.map.view import MapView
from gear_rattle.service.explorer.page.form import SurveyForm, error_message
from gear_rattle.service.explorer.page.head import SCHEME, theme_of
from gear_rattle.service.explorer.page.rows import example_row, survey_row
from gear_rattle.service.explorer.pins.pins_view import PinsView
from gear_rattle.service.explorer.section.section import ProfileSection
from gear_rattle.service.explorer.state.events import SurveyChosen
from gear_rattle.service.explorer.state.store import JOBS, PageStore, request_of_job
from gear_rattle.service.operations.surveys import (
    SurveyDescription,
    find_job,
    remove_survey,
    set_survey_name_and_notes,
    verify_survey,
)


class _Template(pn.Template):
    """Panel's template with a short `repr`."""

    def __repr__(self) -> str:
        # Panel's own repr lists all parts of the page, and Panel makes it again for each part
        return type(self).__name__


def open_page(shared: SharedState) -> pn.Template:
    """Return a new page for the caller of the current request, with the view that the URL describes."""
    document = pn.state.curdoc
    assert document is not None  # Panel sets `curdoc` while it makes a page
    viewer = PageSession(shared.front, CALLER.get(), document)
    view = View.parse(pn.state.session_args)
    theme = theme_of(view, SCHEME.get())
    config: Any = pn.config
    config.theme = "dark" if theme == "dark" else "default"  # Panel keeps this setting for the current page only
    page = Page(shared, viewer, view, theme)
    document.js_on_event(DocumentReady, CustomJS(code="arrived()"))
    document.js_on_event(ConnectionLost, CustomJS(code="lost()"))
    document.config.notify_connection_status = False  # Bokeh's own notice is not accessible; `lost` shows another
    document.on_session_destroyed(lambda _context: page.end())
    return page.template


class Page:
    """One open page. Its parts share a store, and are inserted into the template of the page's document."""

    def __init__(self, shared: SharedState, viewer: PageSession, view: View, theme: str) -> None:
        self._shared, self._viewer = shared, viewer
        self.store = store = PageStore(view, shared.exact.request)
        location: Any = pn.state.location
        self._location = location
        self._location.param.watch(lambda _event: viewer.schedule_document_change(self._show_address), "search")
        self._has_list = False  # True once the list of surveys has arrived
        self._default_survey = ""  # id of the survey that is shown because the viewer chose none
        self._form: SurveyForm | None = None
        viewer.show_message = self._show_notice
        sheet = read_asset("widgets.css")
        self._notice = pn.pane.HTML("", stylesheets=[sheet], margin=(0, 10), sizing_mode="stretch_width")
        self._list = SurveyMenu(
            self._on_list_action,
            chosen=view.survey,
            signed_in=viewer.is_signed_in,
            margin=0,
            sizing_mode="stretch_width",
        )
        self._watch = WidgetWatcher()
        self._watch.call_on_change(self._list, self._on_survey_chosen, "chosen")
        self._new = pn.widgets.Button(
            label="New survey", color="primary", css_classes=["new"], stylesheets=[sheet], margin=8
        )
        call_on_press(self._new, self._toggle_form)
        save = pn.widgets.Button(
            label="New survey from this view", stylesheets=[sheet], margin=(2, 8, 2, 0), css_classes=["save"]
        )
        call_on_press(save, self._open_form_for_view)
        # The form has a column of its own, because Panel replaces all children of a column when one is inserted.
        self._entering = pn.Column(sizing_mode="stretch_width", margin=0)
        self._side = pn.Column(
            self._new, self._entering, self._notice, self._list, sizing_mode="stretch_width", margin=0
        )
        store.subscribe(self._choose_default_survey, JOBS)
        figure = MapFigure(theme, store.dispatch)
        self._map = MapView(shared, viewer, store, figure, sheet)
        controls = MapControls(shared, store, sheet)
        self._section = ProfileSection(shared, viewer, store, theme, sheet)
        go_to = NavigationPanel(store, sheet)
        self._beside = PanelBesideMap(
            shared, viewer, store, theme, self._section.profile_place, go_to.panel, self._map.readout.pane
        )
        self._families = FamiliesView(shared, viewer, store, figure, sheet)
        self._comparison_maps = ComparisonMaps(shared, viewer, store, figure, theme, sheet)
        self._pins = PinsView(viewer, store)
        controls.row.extend([save, self._families.menu, self._comparison_maps.add_button])
        self.template = self._build_template(
            theme,
            side=self._side,
            pins=self._pins.table,
            families=self._families.panel,
            featured=controls.featured,
            controls=controls.panel,
            beside=self._beside.panel,
            **self._map.parts,
            **dict(zip(FURTHER, self._comparison_maps.panels, strict=True)),
        )
        store.subscribe(self._show_address)
        store.subscribe(self._show_survey_list)
        shared.news.add_listener(self._on_statuses)

    def _build_template(self, theme: str, **parts: Any) -> pn.Template:
        template = _Template(read_asset("page.html"), location=True)
        for name, value in {
            "theme": theme,
            "other_theme": "Light" if theme == "dark" else "Dark",
            "signed_in": self._viewer.is_signed_in,
            "tour": help_html(),
        }.items():
            template.add_variable(name, value)
        for name, part in parts.items():
            template.add_panel(name, part)
        return template

    def _on_statuses(self, statuses: Sequence[JobStatus]) -> None:
        self._viewer.start(self._update_statuses(statuses))

    async def _update_statuses(self, statuses: Sequence[JobStatus]) -> None:
        # this call raises an error if the API key was revoked
        statuses = await self._viewer.run_in_thread(lambda: self._add_chosen_survey(statuses))
        self._viewer.schedule_document_change(
            lambda: self.store.update_surveys({each.job.id: each for each in statuses})
        )

    def _add_chosen_survey(self, statuses: Sequence[JobStatus]) -> Sequence[JobStatus]:
        """Return the statuses, and the chosen survey's status if it is not among them and the survey exists."""
        asked = self.store.view.survey
        if not self.store.view.is_example_shown and all(each.job.id != asked for each in statuses):
            with suppress(UnknownSurveyError):
                job = find_job(self._shared.front, asked, JobKind.SURVEY)
                return [*statuses, JobStatus(job, mean_cells_per_second(job), None)]
        return statuses

    def _choose_default_survey(self) -> None:
        """Show the default survey if no survey is chosen when the list of surveys first arrives.

        If this survey is deleted later, show the default survey among the other surveys. If the list is empty at
        first, the page shows the example. A survey that is submitted later does not replace the example, at which the
        viewer may be looking.
        """
        shown, jobs = self.store.view.survey, self.store.jobs
        is_first, self._has_list = not self._has_list, True
        # The list may contain a deleted survey for a moment, if its status was read before the deletion. Such a survey
        # may have become the default survey, so each new list is checked.
        gone = shown == self._default_survey and shown not in jobs
        if (gone if shown else is_first) and (first := default_survey(each.job for each in jobs.values())):
            self._default_survey = first.id
            self.store.dispatch(SurveyChosen(first.id))

    def _on_survey_chosen(self) -> None:
        """Show the survey, or the example, that is chosen in the list."""
        if self._list.chosen in (*self.store.jobs, EXAMPLE):
            self.store.dispatch(SurveyChosen(self._list.chosen))

    def _show_survey_list(self) -> None:
        """Show the surveys in the list, and the example as its last entry."""
        view, jobs, owns = self.store.view, self.store.jobs, self._viewer.caller.is_owner_of
        if self.store.is_list_loaded:
            rows = [survey_row(each, view, owns(each.job)) for each in jobs.values()]
            rows.append(example_row(self._shared.exact.request))
            with self._watch.ignore_changes():
                self._list.param.update(rows=rows, chosen=EXAMPLE if view.is_example_shown else view.survey, ready=True)

    def _show_address(self) -> None:
        """Write the view to the page's address, when the view has changed or the browser has changed the address."""
        self._location.search = self.store.view.query()

    def _toggle_form(self) -> None:
        if self._form is not None and self._form.panel in self._entering:
            self._entering.clear()
            self._side.css_classes = []
            self._new.param.update(label="New survey", color="primary")
        else:
            self._open_form()

    def _open_form(self) -> SurveyForm:
        if self._form is None:
            self._form = SurveyForm(self._viewer, self._on_submitted, read_asset("widgets.css"))
        if self._form.panel not in self._entering:
            self._entering.append(self._form.panel)
            self._side.css_classes = ["with-form"]
            self._new.param.update(label="Close the form", color="default")
        return self._form

    def _on_submitted(self, survey_id: str) -> None:
        self._toggle_form()

        async def show() -> None:
            job = await self._viewer.run_in_thread(lambda: find_job(self._shared.front, survey_id))

            def choose() -> None:
                self.store.update_surveys({**self.store.jobs, survey_id: JobStatus(job, None, None)})
                self.store.dispatch(SurveyChosen(survey_id, is_new=True))

            self._viewer.schedule_document_change(choose)

        self._viewer.start(show())

    def _open_form_for_view(self) -> None:
        store = self.store
        form = self._open_form()
        form.set_fields_to_window(store.window, store.model, store.machine)
        if not store.view.is_example_shown and store.request is not None:
            form.sample.fill(store.request)

    def _on_list_action(self, action: str, survey_id: str, entered: Mapping[str, Any]) -> None:
        if survey_id == EXAMPLE and action == "again":
            self._open_form().fill(self._shared.exact.request)
        if survey_id not in self.store.jobs:
            return
        job = self.store.jobs[survey_id].job
        if action == "again" and job.is_readable:
            request, view = request_of_job(job), self.store.view
            slice_ = request.slice_index(view.slice if survey_id == view.survey else 0)
            self._open_form().fill(request.slice_request(slice_))
        elif action in ("cancel", "delete"):
            self._start_action(lambda caller: self._cancel_or_delete(caller, survey_id, action == "delete"))
        elif action == "resume":
            self._start_action(lambda caller: verify_survey(self._shared.front, caller, survey_id))
        elif action == "describe":
            self._start_action(lambda caller: self._describe_survey(caller, survey_id, entered))

    def _start_action(self, act: Callable[[Caller], object]) -> None:
        """Start a task that calls `act` with the caller in a thread, if the caller may submit surveys."""

        async def run() -> None:
            await self._viewer.run_as_caller(act, Scope.SUBMIT)

        self._viewer.start(run())

    def _describe_survey(self, caller: Caller, survey_id: str, entered: Mapping[str, Any]) -> None:
        try:
            given = SurveyDescription(name=entered.get("name"), notes=entered.get("notes"))
        except ValidationError as error:
            raise ServiceError(error_message(error)) from error
        set_survey_name_and_notes(self._shared.front, caller, survey_id, given)

    def _cancel_or_delete(self, caller: Caller, survey_id: str, is_deletion: bool) -> None:
        ended = find_job(self._shared.front, survey_id).shown_state_and_message[0].is_final
        # `remove_survey` cancels a survey that waits or runs, and deletes a survey that has ended. A request to cancel
        # must not delete a survey that has ended since the request was made.
        if ended == is_deletion:
            remove_survey(self._shared.front, caller, survey_id)

    def _show_notice(self, text: str) -> None:
        def write() -> None:
            self._notice.object = alert_html(text)

        self._viewer.schedule_document_change(write)

    def end(self) -> None:
        """Stop all work of the page, and remove its listeners, after the browser has left."""
        self._shared.news.remove_listener(self._on_statuses)
        self._map.end()
        self._beside.end()
        self._comparison_maps.end()
        self._families.drawings.stop()
        self._section.drawings.stop()
        self._pins.end()
        self._viewer.end()
