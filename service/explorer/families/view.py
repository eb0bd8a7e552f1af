"""Show the family that a viewer has chosen: its description below the map, and its cells on it."""

from __future__ import annotations

from collections.abc import AsyncGenerator
from functools import partial
from html import escape
from typing import Any, NamedTuple

import numpy as np
import panel as pn

from gear_rattle.service.database.tables import JobRow
from gear_rattle.service.errors import MissingPartError
from gear_rattle.service.explorer.common.address import View
from gear_rattle.service.explorer.common.drawings import DrawingRunner, Show
from gear_rattle.service.explorer.common.text import TextPane
from gear_rattle.service.explorer.common.viewer import PageSession
from gear_rattle.service.explorer.common.watch import WidgetWatcher, call_on_press
from gear_rattle.service.explorer.families.description import (
    FamilyDescription,
    FamilyExtent,
    describe_family,
    family_in_words,
    names_of_first_families,
    open_stored_families,
    require_family,
)
from gear_rattle.service.explorer.map.figure import MapFigure
from gear_rattle.service.explorer.map.planes import MapBlock, MapPlane
from gear_rattle.service.explorer.map.shared import SharedState
from gear_rattle.service.explorer.state.events import FamilyChosen, PointOpened
from gear_rattle.service.explorer.state.store import JOBS, PageStore
from gear_rattle.workers import Group, SurveyError, SurveyRequest
from gear_rattle.workers.pictures.look import SHARE
from rattle import RattleError

NO_FAMILY = "all of them"
NO_NUMBERS = "The families of this survey are known once the survey is computed."
DIAGRAM_LABELS = {"delta": "Its diagram along δ", "epsilon": "Its diagram along ε"}


class FamilyData(NamedTuple):
    """Data of a survey's families, read from its store. The data do not depend on the window of the map.

    names: the names of the MOST_LISTED families with the most cells. family, plane: the description of the chosen
    family, and the map of its basin fraction; None if no family is chosen, or if the survey has no family of the chosen
    number. message: a message for the viewer if the survey has no family of the chosen number, else "".
    """

    names: list[str]
    family: FamilyDescription | None = None
    plane: MapPlane | None = None
    message: str = ""


class FamiliesView:
    """The view of a chosen family. menu: the menu of families. panel: the family's description, below the map.

    Parameters
    ----------
    figure : MapFigure
        Figure of the map, on which the cells without the family are dimmed.
    """

    def __init__(
        self, shared: SharedState, viewer: PageSession, store: PageStore, figure: MapFigure, sheet: str
    ) -> None:
        self._shared, self._viewer, self._store, self._figure = shared, viewer, store, figure
        styled: dict[str, Any] = {"stylesheets": [sheet], "margin": (2, 8, 2, 0)}
        self.menu = pn.widgets.Select(label="Family", options={NO_FAMILY: ""}, width=165, visible=False, **styled)
        self._watch = WidgetWatcher()
        self._watch.call_on_change(self.menu, self._on_family_choice)
        self._along = {
            name: pn.widgets.Button(label=label, visible=False, **styled) for name, label in DIAGRAM_LABELS.items()
        }
        for name, button in self._along.items():
            call_on_press(button, partial(self.open_diagram, name))
        self.said = TextPane("", sheet)
        self.panel = pn.Column(
            self.said.pane, pn.FlexBox(*self._along.values(), margin=0), sizing_mode="stretch_width", margin=0,
            visible=False,
        )  # fmt: skip
        self._extents: dict[str, FamilyExtent] = {}
        self.drawings = DrawingRunner(viewer, self._show_error)
        # id of the survey, number of the slice, and number of the family that are shown; None for no family
        self._shown_family: tuple[str, int, int | None] = ("", 0, None)
        self._known: tuple[tuple[Any, ...], FamilyData] | None = None
        store.subscribe(self._on_view_change, "survey", "slice", "family", "delta", "epsilon", "seen", JOBS)

    def _on_view_change(self) -> None:
        view, job = self._store.view, self._store.job
        if job is None or not job.is_readable or not _has_families(job):
            self.drawings.stop()
            self._hide_choices()
            self.panel.visible = False
            return
        shown = view.survey, view.slice, view.family
        if self._shown_family != shown:  # another family, slice or survey was chosen
            if self._shown_family[:2] != shown[:2]:
                self._set_options({}, None)
            self._shown_family = shown
            self._clear_description()
        wanted = (*shown, view.window, self._figure.pixels if view.window else ())
        self.drawings.request(wanted, [job], partial(self._draw, view, job))

    async def _draw(self, view: View, job: JobRow) -> AsyncGenerator[Show, None]:
        window, has_too_large_cells, pixels = view.window, self._figure.has_too_large_cells, self._figure.pixels
        key = view.slice, view.family, job.id, job.state, job.cells_done
        before = self._known[1] if self._known is not None and self._known[0] == key else None

        def read() -> tuple[FamilyData, MapBlock | None]:
            known = before or self._read_families(view, job)
            if known.plane is None:
                return known, None
            if window and has_too_large_cells:
                return known, known.plane.enlarged_block(window)
            return known, known.plane.block(window, pixels, anywhere=True)

        known, seen = await self._viewer.run_in_thread(read)
        self._known = key, known
        yield partial(self._show_family, view.family, known, seen)

    def _read_families(self, view: View, job: JobRow) -> FamilyData:
        place = self._shared.front.directory.store(job.id)
        if not place.exists():
            raise MissingPartError(NO_NUMBERS)
        found = open_stored_families(place, SurveyRequest.model_validate(job.request), view.slice)
        names = names_of_first_families(found)
        if view.family is None:
            return FamilyData(names)
        try:
            require_family(found, view.family)
        except SurveyError as error:
            return FamilyData(names, message=str(error))
        plane = self._shared.plane(job, SHARE, view.family, view.slice)
        return FamilyData(names, describe_family(found, plane, view.family), plane)

    def _show_family(self, number: int | None, known: FamilyData, seen: MapBlock | None) -> None:
        options = {name: str(i) for i, name in enumerate(known.names)}
        self.panel.visible = True
        if known.family is None or seen is None:
            self._set_options(options, None)
            self._clear_description()
            self._show_message(known.message)
            return
        # the chosen family is added, because the list has only the first MOST_LISTED families
        self._set_options(options | {known.family.name: str(number)}, number)
        self._figure.dim_cells(np.isnan(seen.values) | (seen.values <= 0), seen.box)
        self._extents = {each.direction: each for each in known.family.extents}
        for name, button in self._along.items():
            button.visible = name in self._extents
        self.said.html = family_in_words(known.family, self._store.model)

    def _set_options(self, options: dict[str, str], number: int | None) -> None:
        value = "" if number is None else str(number)
        with self._watch.ignore_changes():
            self.menu.param.update(options={NO_FAMILY: ""} | options, value=value, visible=True)

    def _show_error(self, error: RattleError) -> None:
        self._hide_choices()
        self.panel.visible = True
        self._show_message(str(error))

    def _hide_choices(self) -> None:
        self._clear_description()
        self.menu.visible = False

    def _show_message(self, why: str) -> None:
        self.said.html = f'<p class="faint" role="status">{escape(why)}</p>' if why else ""

    def _clear_description(self) -> None:
        self._extents = {}
        self.said.html = ""
        for button in self._along.values():
            button.visible = False
        self._figure.undim_cells()

    def _on_family_choice(self) -> None:
        chosen = str(self.menu.value)
        self._store.dispatch(FamilyChosen(int(chosen) if chosen else None))

    def open_diagram(self, direction: str) -> None:
        """Open the point in the middle of the family's longest row ("delta") or column, with a diagram along it."""
        extent = self._extents.get(direction)
        if extent is not None:
            self._store.dispatch(PointOpened(extent.middle, state=extent.state))


def _has_families(job: JobRow) -> bool:
    return Group.FAMILIES in SurveyRequest.model_validate(job.request).quantities
