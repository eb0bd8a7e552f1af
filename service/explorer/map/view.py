"""Show the map of the chosen survey, with its lines, their key, and the numbers of a cell."""

from __future__ import annotations

from collections.abc import AsyncGenerator, Sequence
from functools import partial
from html import escape

import panel as pn

from gear_rattle.service.database.tables import UNREADABLE, JobRow, State
from gear_rattle.service.errors import MissingPartError
from gear_rattle.service.explorer.common.address import KEYBOARD, MapChoice, View, points_by_pin_number
from gear_rattle.service.explorer.common.changes import handler_in_event_loop
from gear_rattle.service.explorer.common.drawings import Show
from gear_rattle.service.explorer.common.text import MapHeading, TextPane
from gear_rattle.service.explorer.common.viewer import PageSession
from gear_rattle.service.explorer.map.colouring import Colouring, LegendColour
from gear_rattle.service.explorer.map.controls import explain_how_to_read_map
from gear_rattle.service.explorer.map.cursor import CursorKeys
from gear_rattle.service.explorer.map.figure import MapFigure
from gear_rattle.service.explorer.map.overlays import MapLinesWithKey
from gear_rattle.service.explorer.map.picture import settings_of_drawn_map
from gear_rattle.service.explorer.map.planes import SIDE, MapBlock, MapPlane
from gear_rattle.service.explorer.map.readout import (
    Readout,
    cell_in_words,
    cell_summary,
    cell_tables,
    value_of_finer_cell,
)
from gear_rattle.service.explorer.map.shared import SharedState, default_variable, is_closed_form_map
from gear_rattle.service.explorer.map.survey_map import SurveyMap
from gear_rattle.service.explorer.point.state import marks_of_open_point
from gear_rattle.service.explorer.state.events import DefaultMapChosen, MapDrawn
from gear_rattle.service.explorer.state.store import JOBS, PageStore
from gear_rattle.workers.pictures.look import LARGEST, replace_periods_with_revolutions
from rattle import RattleError

BEGINS = "<p class=faint>The first cells of this survey are being computed.</p>"
SURVEY_WAITS = "<p class=faint>This survey waits for its turn.</p>"
GONE = "<p>This survey is no longer there. Choose another one.</p>"


class MapView(SurveyMap):
    """First map of a page. parts: its panels, by their names in the page's document."""

    def __init__(
        self, shared: SharedState, viewer: PageSession, store: PageStore, figure: MapFigure, sheet: str
    ) -> None:
        super().__init__(shared, viewer, store, figure, MapHeading(sheet), TextPane("", sheet, is_spoken=True))
        self.lines = MapLinesWithKey(shared.overlaid, viewer, store, figure, sheet)
        self.keys = CursorKeys(viewer.document, figure.figure, store)
        self.readout = Readout(sheet)
        self._survey_at_choice: tuple[str, str] | None = None  # (id, state) at the last call of `_choose_map`
        self._marked: tuple[object, ...] = ()
        self._drawn_slice: tuple[str, int] | None = None  # id of the drawn survey, number of the drawn slice
        for size in ("inner_width", "inner_height"):  # a browser reports the size after the first drawing
            figure.figure.on_change(size, handler_in_event_loop(self._on_size))
        self.parts = {
            "title": self.title.pane,
            "plot": pn.pane.Bokeh(figure.figure, sizing_mode="stretch_both", margin=0),
            "said": self.said.pane,
            "key": self.lines.panel,
        }
        store.subscribe(self._choose_map, "survey", JOBS)
        store.subscribe(self._on_view_change, "survey", JOBS, "variable", "index", "slice", "limits", "log")
        store.subscribe(self._on_window_change, "delta", "epsilon")
        store.subscribe(self._mark_pointer, "pointer")
        store.subscribe(self._read_cell_at_pointer, "pointer", "point")
        store.subscribe(self._mark_point_and_pins, "point", "machine", "point_state", "pins", "survey", "slice", JOBS)

    def show_legend_colours(self, shades: Sequence[LegendColour]) -> None:
        """Show in the key the meaning of each colour and the share of the cells that have the colour."""
        self.lines.show_legend_colours(shades)

    def _choose_map(self) -> None:
        """Choose the map of a survey that was just chosen or begins to run: the viewer's choice, or the default map."""
        store, view, whole, job = (
            self._store,
            self._store.view,
            self._store.survey_request_with_all_slices,
            self._store.job,
        )
        if whole is None or not store.is_list_loaded:
            self._survey_at_choice = None
            return
        now = view.survey, "" if job is None else job.state
        is_other = self._survey_at_choice is None or self._survey_at_choice[0] != view.survey
        begins = self._survey_at_choice != now and now[1] == State.RUNNING and not view.is_variable_chosen
        self._survey_at_choice = now
        if is_other or begins:
            maps = self._shared.maps(store)
            stays = view.is_variable_chosen and view.variable in maps
            is_waiting = now[1] == State.ACCEPTED
            variable = view.variable if stays else default_variable(whole, is_waiting)
            index = view.index if view.index < len(maps[variable]) else 0
            store.dispatch(DefaultMapChosen(variable, index, sum(whole.slice_index(view.slice))))
            self.figure.show_axes_of(whole.machine)

    def _on_view_change(self) -> None:
        """Request a drawing of the view's map, or write that the chosen survey is gone or cannot be read."""
        store, view, job = self._store, self._store.view, self._store.job
        if self._drawn_slice != (view.survey, view.slice):
            self._drawn_slice, self.plane = (view.survey, view.slice), None
        if not store.is_list_loaded:
            return
        if not view.is_example_shown and (job is None or not job.is_readable):
            self.drawings.stop()
            self.plane = None
            self.show_nothing(GONE if job is None else f"<p>{UNREADABLE}</p>")
            if job is None:
                self._shared.atlas.forget(lambda survey_id: survey_id != view.survey)
            return
        chosen = MapChoice(view.variable, view.index)
        if self._chosen not in (None, chosen) or self.plane is None:
            self.forget_window()  # the finer cells of the window belong to another map
        request = store.request
        is_large = request is not None and max(request.shape) > SIDE
        # the drawing of a large survey, or of a map with names of families, depends on the pixels of the figure
        room = self.figure.pixels if is_large or view.variable == LARGEST else ()
        what = view.survey, view.slice, chosen, view.limits, view.log, room
        self.drawings.request(what, [] if job is None else [job], partial(self._draw, view, job))

    async def _draw(self, view: View, job: JobRow | None) -> AsyncGenerator[Show, None]:
        if job is None:
            yield partial(
                self._show, view, *await self._viewer.run_in_thread(partial(self._shared.compute_example_map, view))
            )
            return
        whole = self._store.survey_request_with_all_slices
        is_known = whole is not None and is_closed_form_map(whole, view.variable)
        if job.state == State.ACCEPTED and not job.started and not is_known:
            yield partial(self.show_nothing, SURVEY_WAITS)
            return
        is_whole = False
        while not is_whole:  # each call reads for a limited time, and the cells read so far are drawn
            plane, is_whole, block, colours = await self._viewer.run_in_thread(
                partial(self._shared.load_drawn_map, job, view, self.figure.pixels)
            )
            yield partial(self._show, view, plane, block, colours)

    def show_error(self, error: RattleError) -> None:
        """Write why the map could not be drawn, or that the first cells of the survey are being computed."""
        job = self._store.job
        # any state that is not final counts, because the page's copy of the job may be old: the survey may run by now
        is_empty = job is not None and not State(job.state).is_final and not job.cells_done
        if is_empty and isinstance(error, MissingPartError):
            self.show_nothing(BEGINS)
        else:
            super().show_error(error)

    def show_nothing(self, why: str) -> None:
        """Remove all cells and all text about them, and write why no map is shown. why: HTML."""
        super().show_nothing(why)
        self._store.dispatch(MapDrawn(None))
        self.stop_reading()
        self.readout.clear()
        if self.plane is None:
            self.figure.show_window(self._store.window)

    def _show(self, view: View, plane: MapPlane, block: MapBlock, colours: Colouring) -> None:
        is_first = self.plane is None
        note = f" <span class=faint>({escape(colours.note)})</span>" if colours.note else ""
        meaning = explain_how_to_read_map(view.variable)
        title = f"{f'<b>{escape(meaning)}</b><br>' if meaning else ''}{escape(colours.title)}{note}"
        self.title.show_description(title if plane.request.machine is None else replace_periods_with_revolutions(title))
        if is_first:
            self.figure.show_window(self._store.window)
        self.draw_map(plane, block, colours, MapChoice(view.variable, view.index), view.limits, view.log)
        self._dispatch_drawn_settings()
        self._read_cell_at_pointer()
        self._shared.on_map_drawn()

    def _dispatch_drawn_settings(self) -> None:
        """Dispatch the settings with which the map is drawn, so that links lead to pictures with the same settings."""
        if self.colours is not None:
            pixels = self.figure.pixels if self._store.view.window else None
            self._store.dispatch(MapDrawn(settings_of_drawn_map(self.colours, pixels), self._colour_range_and_scale[0]))

    def _on_size(self, _attribute: str, _old: object, _new: object) -> None:
        self._dispatch_drawn_settings()
        self._on_view_change()

    def _on_window_change(self) -> None:
        self.figure.show_window(self._store.window)
        self.draw_visible_window()
        self._dispatch_drawn_settings()

    def show_finer_cells(self, finer: MapBlock) -> None:
        """Draw finer cells of the window, and read the cell under the pointer again."""
        super().show_finer_cells(finer)
        self._viewer.schedule_document_change(self._read_cell_at_pointer)

    def _mark_pointer(self) -> None:
        pointer = self._store.view.pointer
        is_here = pointer is None or pointer.source == self.figure.figure.name
        self.figure.mark_cursor(None if pointer is None or is_here else pointer.at)

    def _read_cell_at_pointer(self) -> None:
        """Show the numbers of the cell at the pointer or, without a pointer, of the cell at the open point."""
        self.stop_reading()
        pointer, plane = self._store.view.pointer, self.plane
        said = ""
        if pointer is not None and plane is not None and pointer.source == KEYBOARD:
            said = f"<p>{escape(cell_in_words(plane, *pointer.at, self._store.window, self.finer))}</p>"
        self.said.html = said
        at = self._store.view.point if pointer is None else pointer.at
        if at is None:
            self.readout.clear()
        elif plane is not None:
            request, window, here = plane.request, self._store.window, value_of_finer_cell(plane, self.finer, *at)

            def read() -> tuple[str, str]:
                cell = plane.cell_at(*at)
                return cell_summary(cell, request), cell_tables(cell, *at, request, window, here)

            def show(texts: tuple[str, str]) -> None:
                self.readout.show(*texts, self._store.view.point is not None)

            self.read_cell(read, show)

    def _mark_point_and_pins(self) -> None:
        """Mark the pins and the open point, with the ellipse of its tolerances and the line of its diagram.

        A point or pin is marked only if its model is that of the map.
        """
        view, model, machine = self._store.view, self._store.model, self._store.machine
        self.figure.mark_pins(points_by_pin_number(view.pins, model))
        if (marked := (view.point, view.machine, view.point_state, model, machine)) != self._marked:
            self._marked = marked
            at, lines = marks_of_open_point(view, model, machine)
            self.figure.mark_point(at)
            self.figure.draw_lines_at_point(lines)
