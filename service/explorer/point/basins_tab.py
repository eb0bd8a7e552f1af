"""Fill the tab of the basins: basins at the open point, or at another point (δ, ε) of its diagram.

A slider moves along the diagram, from its first point (δ, ε) to its last, and chooses this other point.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from functools import partial
from html import escape

import rattle
from gear_rattle.service.explorer.common.address import Pair
from gear_rattle.service.explorer.common.point_state import BASINS, MOTION
from gear_rattle.service.explorer.common.text import TextPane
from gear_rattle.service.explorer.point import parts
from gear_rattle.service.explorer.point.basins import basins_caption
from gear_rattle.service.explorer.point.panel import SLIDER_STEPS, PointPanel
from gear_rattle.service.explorer.point.parts import StatePlaneLines
from gear_rattle.service.explorer.point.state import (
    ATTRACTORS,
    ORBITS,
    READY,
    SHOWN_POINT,
    OpenPoint,
    ShownPoint,
    chosen_diagram_point,
    ends_of_diagram_line,
)
from rattle.models import model_of_gear

#: (cells along each axis, method) of each picture of the basins at the open point, from the first to the finest.
RESOLUTIONS = ((100, "cells"), (300, "refined"), (600, "refined"))
#: (cells along each axis, method) of each picture of the basins at another point of the diagram.
OTHER_POINT_RESOLUTIONS = ((100, "cells"), (300, "refined"))
# (text that shows the error if the computation fails, computation)
Part = tuple[TextPane, Callable[[], Awaitable[None]]]


class BasinsTab:
    """The tab with basins and lines in the (τ, v) plane, at the open point or at another point of its diagram.

    When the basins of another point are known, the tab of the motion shows a motion of that point too.
    """

    def __init__(self, point: OpenPoint, panel: PointPanel) -> None:
        self._point, self._panel = point, panel
        self._basins: rattle.Basins | None = None
        self._lines: StatePlaneLines | None = None
        self._chosen_point: Pair | None = None  # point (δ, ε) that the slider chooses; None for the open point itself
        first, *finer = [(panel.under_basins, partial(self._compute_open_point_basins, *each)) for each in RESOLUTIONS]
        self._open_point_parts: list[Part] = [first, (panel.about_lines, self._compute_lines), *finer]
        self._other_point_parts: list[Part] = []
        self._tasks: dict[bool, asyncio.Task[None]] = {}
        point.subscribe_to_view(self._on_view_change, "point_state")
        point.subscribe(self._on_view_change, READY)
        point.subscribe(self._mark_initial_state, ATTRACTORS, SHOWN_POINT)
        point.subscribe(self._show_orbits, ORBITS)
        self._on_view_change()

    def _on_view_change(self) -> None:
        point = self._point
        chosen = chosen_diagram_point(point.gear, point.tabs_state)
        self._show_slider(chosen)
        if chosen != self._chosen_point:
            self._chosen_point = chosen
            if chosen is None:
                point.update(shown_point=ShownPoint(point.gear))
                self._show_open_point_basins()
                self._show_open_point_lines()
            else:
                computations = (partial(self._compute_basins_at, chosen, *each) for each in OTHER_POINT_RESOLUTIONS)
                self._other_point_parts = [(self._panel.under_basins, each) for each in computations]
        self._mark_initial_state()
        for is_at_other_point in (False, True):
            task = self._tasks.get(is_at_other_point)
            if point.is_ready and self._parts_to_compute(is_at_other_point) and (task is None or task.done()):
                self._tasks[is_at_other_point] = point.work.start(self._compute_missing_parts(is_at_other_point))

    def _show_slider(self, chosen: Pair | None) -> None:
        """Set the slider to the chosen point (δ, ε) of the diagram, or to the open point if `chosen` is None."""
        gear, state = self._point.gear, self._point.tabs_state
        (begin, end), here = ends_of_diagram_line(gear, state), (gear.delta, gear.epsilon)
        axis = max((0, 1), key=lambda each: abs(end[each] - begin[each]))
        length = end[axis] - begin[axis]
        open_point_stop = round(SLIDER_STEPS * (here[axis] - begin[axis]) / length) if length else 0
        self._panel.show_diagram_point(
            open_point_stop if state.at is None else round(SLIDER_STEPS * state.at), open_point_stop, chosen or here
        )

    def _parts_to_compute(self, is_at_other_point: bool) -> list[Part]:
        """Return the parts of the basins that the open tab needs and whose computation has not begun.

        is_at_other_point: True for the parts at the other point that the slider chooses, False for the parts at the
        open point.

        Returns
        -------
        list[Part]
            The parts in their order; the caller removes a part from this list when it begins the part. The list is
            empty if the open tab shows no basins, or if `is_at_other_point` is True while the slider is at the open
            point, or False while the slider is at another point.
        """
        tab = self._point.tabs_state.shown_tab
        if is_at_other_point:
            return self._other_point_parts if self._chosen_point is not None and tab in (BASINS, MOTION) else []
        return self._open_point_parts if self._chosen_point is None and tab == BASINS else []

    async def _compute_missing_parts(self, is_at_other_point: bool) -> None:
        while missing := self._parts_to_compute(is_at_other_point):
            await self._point.work.run_part_or_show_error(*missing.pop(0))

    async def _compute_open_point_basins(self, side: int, method: str) -> None:
        slow = method != "cells"
        found = await self._point.work.compute(
            parts.compute_basins, self._point.gear, side, method, what="The basins", slow=slow
        )

        def show() -> None:
            self._basins = found
            if self._chosen_point is None:
                self._show_open_point_basins()

        await self._point.work.apply_document_change(show)

    async def _compute_lines(self) -> None:
        found = await self._point.work.compute(
            parts.compute_plane_lines, self._point.gear, what="The manifolds", slow=True
        )

        def show() -> None:
            self._lines = found
            if self._chosen_point is None:
                self._show_open_point_lines()

        await self._point.work.apply_document_change(show)

    async def _compute_basins_at(self, chosen: Pair, side: int, method: str) -> None:
        """Compute basins at a point of the diagram on side × side cells, and show them if the point is still chosen."""
        gear, slow = model_of_gear(self._point.gear).gear(*chosen), method != "cells"
        found = await self._point.work.compute(
            parts.compute_basins_and_orbits, gear, side, method, what="The basins", slow=slow
        )

        def show() -> None:
            if chosen == self._chosen_point:  # otherwise the viewer has chosen another point meanwhile
                self._panel.picture.remove_lines()
                self._panel.about_lines.html = ""
                self._show_cells(found.basins, found.orbits)
                self._panel.under_basins.html = basins_caption(found.basins, (), self._point.palette)
                self._point.update(shown_point=ShownPoint(gear, found.basins.attractors))

        await self._point.work.apply_document_change(show)

    def _show_cells(self, found: rattle.Basins, orbits: tuple[rattle.Orbit, ...]) -> None:
        self._panel.picture.show_cells(found, self._point.palette)
        self._panel.picture.show_orbits(orbits)
        self._mark_initial_state()

    def _show_open_point_basins(self) -> None:
        if self._basins is not None:
            self._show_cells(self._basins, self._point.orbits)
            self._show_legend()

    def _show_open_point_lines(self) -> None:
        if self._lines is not None:
            self._panel.picture.show_lines(self._lines.lines)
            notes = "".join(f"<li>{escape(each)}</li>" for each in self._lines.missing)
            self._panel.about_lines.html = f'<ul class="faint">{notes}</ul>' if notes else ""
            self._show_legend()

    def _show_legend(self) -> None:
        if self._basins is not None:
            lines = self._lines.lines if self._lines is not None else ()
            self._panel.under_basins.html = basins_caption(self._basins, lines, self._point.palette)

    def _show_orbits(self) -> None:
        if self._basins is not None and self._chosen_point is None:
            self._panel.picture.show_orbits(self._point.orbits)

    def _mark_initial_state(self) -> None:
        """Mark the initial state of the chosen motion."""
        attractor = self._point.shown_attractor
        if (start := self._point.tabs_state.start) is not None:
            self._panel.mark_initial_state(*start)
        elif attractor is not None:
            self._panel.mark_initial_state(attractor.tau, attractor.v)
