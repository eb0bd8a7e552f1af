"""Show the open point beside the map."""

from __future__ import annotations

import asyncio
from contextlib import suppress

import panel as pn

from gear_rattle.service.database.tables import JobRow
from gear_rattle.service.explorer.common.address import View
from gear_rattle.service.explorer.common.figures import PRINTED
from gear_rattle.service.explorer.common.viewer import PageSession
from gear_rattle.service.explorer.map.shared import SharedState
from gear_rattle.service.explorer.point.panel import FigureBelowDiagram, PointPanel
from gear_rattle.service.explorer.point.parts import SampledAttractors, attractors_of_survey_cell
from gear_rattle.service.explorer.point.state import machine_and_model_of_open_point
from gear_rattle.service.explorer.point.view import PointView
from gear_rattle.service.explorer.state.store import JOBS, PageStore
from rattle import Machine, RattleError
from rattle.models import Model

POINT_CLASS = "with-point"  # CSS class of the panel while a point is open, which gives the panel more room on the page
#: On a small screen the list of bookmarks moves below the open point, so that the point's answer is seen first.
ANSWER_FIRST = f"@media (max-width: 1199px) {{ :host(.{POINT_CLASS}) > .go-to-place {{ order: 1; }} }}"


class PanelBesideMap:
    """Right side of the page: the panel `above`, below it the open point, and below the point the panel `under`.

    profile_place: panel for the profile of a survey. It stands inside the open point's panel, below its diagram.

    Attributes
    ----------
    point : PointView | None
        View of the open point, None if no point is open.
    """

    def __init__(
        self,
        shared: SharedState,
        viewer: PageSession,
        store: PageStore,
        theme: str,
        profile_place: FigureBelowDiagram,
        above: pn.Column,
        under: pn.Column,
    ) -> None:
        self._shared, self._viewer, self._store = shared, viewer, store
        self._theme, self._profile_place = theme, profile_place
        self.point: PointView | None = None
        self._open_key: tuple[object, ...] = ()  # (δ, ε), machine and model of the open point
        self._answering: asyncio.Task[None] | None = None
        self._points: PointPanel | None = None
        self._column = pn.Column(sizing_mode="stretch_width", margin=0, stylesheets=[PRINTED])
        self.panel = pn.Column(
            above, self._column, under, sizing_mode="stretch_width", margin=0, stylesheets=[PRINTED, ANSWER_FIRST]
        )
        store.subscribe(self._on_view_change, "point", "machine", "survey", "slice", JOBS)

    def _on_view_change(self) -> None:
        view, opened = self._store.view, machine_and_model_of_open_point(self._store)
        if view.point is None:
            self._close_point()
        elif opened is not None and (key := (view.point, *opened)) != self._open_key:
            self._open_key = key
            self._open_point(view, *opened)

    def _open_point(self, view: View, machine: Machine | None, model: Model) -> None:
        assert view.point is not None
        self.end()
        points = self._points or PointPanel(self._theme, self._store.dispatch, self._profile_place)
        self.point = point = PointView(points, self._viewer.front, self._store, *view.point, model, machine)
        self.panel.css_classes = [POINT_CLASS]
        self._column.visible = True
        if self._points is None:
            self._points = points
            self._column.append(points.column)
        self._answering = self._viewer.start(self._show_fractions_of_cell(point, view, self._store.job, model))

    async def _show_fractions_of_cell(self, point: PointView, view: View, job: JobRow | None, model: Model) -> None:
        """Show the basin fractions of the survey's cell around the point, if any, until the point is computed."""
        assert view.point is not None
        at = view.point

        def read() -> SampledAttractors | None:
            with suppress(RattleError):  # reading raises this error while no values of the survey are stored
                plane = self._shared.plane(job, view.variable, view.index, view.slice)
                sample, cell = plane.request.initial_conditions, plane.cell_at(*at)
                # True if the survey samples the whole default box of (τ, v), as a clicked point does
                is_whole = (*sample.tau_range, sample.v_min, sample.v_max) == (0.0, 1.0, 0.0, None)
                if cell is not None and is_whole and plane.request.gear_model == model:
                    return attractors_of_survey_cell(cell, sample.count)
            return None

        known = await self._viewer.run_in_thread(read)
        if known is not None:
            self._viewer.schedule_document_change(lambda: point.show_survey_attractors(known))

    def _close_point(self) -> None:
        self.end()
        self._open_key = ()
        self._column.visible = False
        if self._points is not None:
            self._points.clear()
        self.panel.css_classes = []

    def end(self) -> None:
        """Stop the view of the open point and its computations."""
        if self._answering is not None:
            self._answering.cancel()
        if self.point is not None:
            self.point.stop()
            self.point = None
