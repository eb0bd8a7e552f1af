"""Show one comparison map, with the window, the pointer and the lines of the first map."""

from __future__ import annotations

from collections.abc import AsyncGenerator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from html import escape
from typing import Any

import panel as pn

from gear_rattle.service.database.tables import JobRow
from gear_rattle.service.explorer.common.address import (
    ComparisonChoice,
    MapChoice,
    Ranges,
    View,
    points_by_pin_number,
)
from gear_rattle.service.explorer.common.drawings import Show
from gear_rattle.service.explorer.common.text import MapHeading, TextPane
from gear_rattle.service.explorer.common.viewer import PageSession
from gear_rattle.service.explorer.common.watch import WidgetWatcher, call_on_press
from gear_rattle.service.explorer.further.difference import DifferenceMap, require_small_survey
from gear_rattle.service.explorer.map.colouring import Colouring, LegendColour, compute_colouring
from gear_rattle.service.explorer.map.figure import MapFigure
from gear_rattle.service.explorer.map.overlays import LINES_OF_ALL_WINDOWS, MapLines
from gear_rattle.service.explorer.map.picture import picture_links, picture_query, settings_of_drawn_map
from gear_rattle.service.explorer.map.planes import MapBlock, MapPlane, options_of_map_menu
from gear_rattle.service.explorer.map.readout import cell_in_words
from gear_rattle.service.explorer.map.shared import SharedState
from gear_rattle.service.explorer.map.survey_map import SurveyMap
from gear_rattle.service.explorer.state.events import ComparisonMapChanged, ComparisonMapRemoved
from gear_rattle.service.explorer.state.store import PageStore, request_of_job
from gear_rattle.workers import SurveyRequest

SHOWN = "shown"
GONE = "This survey is no longer there. Choose another survey for this map."
NO_FIRST = "Choose a survey for the first map."
MINUS = "first map less this one"


class ComparisonMap(SurveyMap):
    """Comparison map number `index`, 0 for the second map of the page. Widgets above it choose survey and variable."""

    def __init__(
        self, shared: SharedState, viewer: PageSession, store: PageStore, figure: MapFigure, sheet: str, index: int
    ) -> None:
        super().__init__(shared, viewer, store, figure, MapHeading(sheet), TextPane("", sheet))
        self._index = index
        self.lines = MapLines(viewer, figure)
        self.key, self.links = TextPane("", sheet), TextPane("", sheet)
        self._watch = WidgetWatcher()
        styled: dict[str, Any] = {"stylesheets": [sheet], "margin": (2, 8, 2, 0)}
        self.survey = pn.widgets.Select(label=f"Survey of map {index + 2}", options={}, width=175, **styled)
        self.variable = pn.widgets.Select(label=f"Map {index + 2}", options={}, width=175, **styled)
        self.minus = pn.widgets.CheckBoxGroup(options=[MINUS], **{**styled, "margin": (2, 8, 8, 4)})
        for widget in (self.survey, self.variable, self.minus):
            self._watch.call_on_change(widget, self._on_chosen)
        remove = pn.widgets.Button(label=f"Remove map {index + 2}", **styled)
        call_on_press(remove, partial(store.dispatch, ComparisonMapRemoved(index)))
        choices = pn.FlexBox(
            self.survey, self.variable, self.minus, remove, margin=0, sizing_mode="stretch_width",
            align_items="flex-end",
        )  # fmt: skip
        plot = pn.pane.Bokeh(figure.figure, sizing_mode="stretch_both", margin=0)
        self.panel = pn.Column(
            choices, self.title.pane, plot, self.key.pane, self.links.pane, self.said.pane,
            sizing_mode="stretch_both", margin=0, css_classes=[SHOWN],
        )  # fmt: skip
        self._drawn_choice: ComparisonChoice | None = None  # choice of the drawn map; None before the first drawing
        self._window: Ranges | None = None

    def show_view(self, surveys: Mapping[str, str]) -> None:
        """Show the survey and variable that the view has for this map. surveys: options of the menu of surveys."""
        view, jobs = self._store.view, self._store.jobs
        choice = view.further[self._index]
        job, first = (jobs[each].job if each in jobs else None for each in (choice.survey, view.survey))
        if job is None or not job.is_readable:
            self._show_no_map(GONE)
            return
        choice = self._show_choices(choice, job, surveys)
        if choice.minus and (first is None or not first.is_readable):
            self._show_no_map(NO_FIRST)
            return
        of_first = (view.survey, view.variable, view.index, view.slice) if choice.minus else ()
        of = (job, first) if first is not None and choice.minus else (job,)
        self.drawings.request((choice, of_first), of, partial(self._draw, choice, view, *of))
        if self.plane is not None:
            self._show_window_and_lines(self.plane)

    def _show_choices(self, choice: ComparisonChoice, job: JobRow, surveys: Mapping[str, str]) -> ComparisonChoice:
        """Set the menus to a choice, and return it. If the survey lacks the chosen map, choose its first map."""
        request = request_of_job(job)
        number = sum(request.slice_index(choice.slice))
        chosen, options = options_of_map_menu(request, MapChoice(choice.variable, choice.index))
        with self._watch.ignore_changes():
            self.survey.param.update(options=dict(surveys), value=f"{choice.survey},{number}")
            self.variable.param.update(options=options, value=chosen.address_text, visible=not choice.minus)
            self.minus.value = [MINUS] if choice.minus else []
        return replace(choice, variable=chosen.variable, index=chosen.index, slice=number)

    def _on_chosen(self) -> None:
        survey, _, number = str(self.survey.value).partition(",")
        chosen = MapChoice.parse(str(self.variable.value))
        choice = ComparisonChoice(survey, chosen.variable, chosen.index, int(number), bool(self.minus.value))
        self._store.dispatch(ComparisonMapChanged(self._index, choice))

    async def _draw(
        self, choice: ComparisonChoice, view: View, job: JobRow, first: JobRow | None = None
    ) -> AsyncGenerator[Show, None]:
        def read() -> tuple[MapPlane, MapBlock, Colouring]:
            if first is not None:
                for each in (first, job):
                    require_small_survey(request_of_job(each))
                wanted = view.variable, view.index
                other = self._shared.plane(job, *wanted, choice.slice)
                plane: MapPlane = DifferenceMap(self._shared.plane(first, *wanted, view.slice), other)
            else:
                plane = self._shared.plane(job, choice.variable, choice.index, choice.slice)
            block = plane.block(room=self.figure.pixels)
            return plane, block, compute_colouring(plane, block, "auto", False, self.figure.pixels)

        plane, block, colours = await self._viewer.run_in_thread(read)

        def show() -> None:
            self._drawn_choice = choice
            self.figure.show_axes_of(plane.request.machine)
            self.title.show_description(escape(_title_of(plane, colours, job, first, request_of_job(job))))
            self._window = self._store.window
            self.figure.show_window(self._window)
            is_computed = not isinstance(plane, DifferenceMap)
            self.draw_map(plane, block, colours, MapChoice(choice.variable, choice.index) if is_computed else None)
            self._show_window_and_lines(plane)

        yield show

    def _show_no_map(self, why: str) -> None:
        self.drawings.stop()
        self.show_nothing(f"<p>{why}</p>")

    def show_nothing(self, why: str) -> None:
        """Remove all cells, lines and pins, and write why no map is shown. why: HTML."""
        self.plane = None
        super().show_nothing(why)
        self.lines.clear()
        self.figure.mark_pins({})
        self.links.html = ""

    def _show_window_and_lines(self, plane: MapPlane) -> None:
        """Show on this map the window, the lines and the pins of the view, and links to its pictures."""
        view, window, model = self._store.view, self._store.window, plane.request.gear_model
        if self._window != window:
            self._window = window
            self.figure.show_window(window)
            self.draw_visible_window()
        self.figure.mark_pins(points_by_pin_number(view.pins, model))
        self.links.html = self._picture_links(plane, view)
        lines = view.lines if self._drawn_choice is None else view.lines_on_map(self._drawn_choice.variable)
        self.lines.draw([name for name in lines if name not in LINES_OF_ALL_WINDOWS], model, window)

    def show_pointer(self) -> None:
        """Mark the point at which a viewer points on any map, and write the value of this map's cell there."""
        pointer = self._store.view.pointer
        self.figure.mark_cursor(None if pointer is None else pointer.at)
        if pointer is not None and self.plane is not None:
            read = partial(cell_in_words, self.plane, *pointer.at, self._store.window, self.finer)
            self.read_cell(lambda: f"<p>{escape(read())}</p>", partial(setattr, self.said, "html"))

    def _picture_links(self, plane: MapPlane, first: View) -> str:
        """Return links to pictures of this map, in HTML; "" for a difference, which has no pictures."""
        choice, colours = self._drawn_choice, self.colours
        if choice is None or colours is None or isinstance(plane, DifferenceMap):
            return ""
        seen = settings_of_drawn_map(colours, self.figure.pixels if first.window else None)
        shown = replace(
            first, variable=choice.variable, index=choice.index, slice=choice.slice, family=None,
            overlays=tuple(name for name in first.lines_on_map(choice.variable) if name not in LINES_OF_ALL_WINDOWS),
        )  # fmt: skip
        query = picture_query(self._store.jobs[choice.survey].job.request, shown, seen)
        return f"<p class=faint>Picture: {picture_links(choice.survey, choice.variable, query)}</p>"

    def show_legend_colours(self, shades: Sequence[LegendColour]) -> None:
        """Show in the key below the map the meaning of each colour and the share of the cells that have the colour."""
        self.key.html = map_key_html(shades)


def _title_of(plane: MapPlane, colours: Colouring, job: JobRow, first: JobRow | None, request: SurveyRequest) -> str:
    # the title of a survey's map need not name the survey, because the menu above the map does
    if not isinstance(plane, DifferenceMap) or first is None:
        return f"{plane.request.gear_model}{f' ({colours.note})' if colours.note else ''}"
    cells = "the same cells"
    if not plane.has_same_grid:
        size = " × ".join(str(axis.num) for axis in (request.delta, request.epsilon))
        cells = f"each cell of the first survey with the nearest cell of the second, which has {size} cells"
    return f"{first.display_name} less {job.display_name}, {cells}: {colours.title}"


def map_key_html(shades: Sequence[LegendColour]) -> str:
    """Return the key of a map, in HTML: its colours with their meanings and shares."""
    entries = "".join(
        f'<li><span style="display:inline-block;width:.8rem;height:.8rem;background:{each.colour};'
        f'border:1px solid var(--strong-line)" aria-hidden="true"></span> {escape(each.label)}'
        f" {100 * each.share:.2g} %</li>"
        for each in shades
    )
    style = "display:flex;flex-wrap:wrap;gap:.1rem .8rem;margin:0;padding:0;list-style:none"
    return f'<ul style="{style}" aria-label="colours of this map">{entries}</ul>' if entries else ""
