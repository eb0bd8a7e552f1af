"""Fill the tabs of the motion and of the diagram, and compute the yield of gears with the point's tolerances."""

from __future__ import annotations

import asyncio
from html import escape

import rattle
from gear_rattle.service.explorer.common.point_state import DIAGRAM, MOTION, NUMBERS, PointTolerances
from gear_rattle.service.explorer.common.text import faint_html
from gear_rattle.service.explorer.design import rattling, tolerance
from gear_rattle.service.explorer.design.fields import machine_at_other_point
from gear_rattle.service.explorer.point import loudness, motion, parts, point_diagram
from gear_rattle.service.explorer.point.panel import CLICKED_STATE, PointPanel
from gear_rattle.service.explorer.point.parts import DiagramContents
from gear_rattle.service.explorer.point.state import (
    ATTRACTORS,
    CHAOS,
    READY,
    SHOWN_POINT,
    OpenPoint,
    chosen_diagram_point,
)
from gear_rattle.service.explorer.point.work import waiting_html
from rattle.plot import legend_name

POINTS = 3000  # computed points of a motion
# Numbers of forcing periods that are shown: 3 m for a P(m, n₊, n₋), but at least PERIODS and at most MOST_PERIODS;
# CHAOTIC_PERIODS for a chaotic motion; PERIODS for every other motion.
PERIODS, MOST_PERIODS, CHAOTIC_PERIODS = 12.0, 60.0, 30.0
CLICKED_MOTION_COLOUR = "#8a96a3"  # colour of the motion from a clicked state
QUIET_COLOUR = "#8f8000"  # colour of lines of quiet motion, a yellow that is dark enough for a white background


class MotionTab:
    """The chosen motion, with its spectrum and its sound."""

    def __init__(self, point: OpenPoint, panel: PointPanel) -> None:
        self._point, self._panel = point, panel
        self._shown: tuple[object, ...] | None = None
        self._motion: asyncio.Task[None] | None = None
        self._sound: asyncio.Task[None] | None = None
        point.subscribe_to_view(self._on_view_change, "point_state")
        point.subscribe_to_view(self._on_sound_request, "sounds")
        point.subscribe(self._on_view_change, ATTRACTORS, SHOWN_POINT, READY)
        if point.machine is not None:
            panel.rpm_field.value = float(f"{point.machine.rpm:.6g}")

    def _on_view_change(self) -> None:
        """Fill the menu of motions. If the tab of the motion is open, compute and show the chosen motion."""
        point = self._point
        if point.attractors is not None:
            self._offer_motions(point.attractors.attractors)
        if point.is_ready and point.tabs_state.shown_tab == MOTION and self._shown != self._motion_key:
            self._shown = self._motion_key
            part = point.work.run_part_or_show_error(self._panel.under_motion, self._compute_motion)
            self._motion = point.work.start(part, self._motion)

    def _offer_motions(self, attractors: tuple[rattle.Attractor, ...]) -> None:
        """Fill the menu of motions: the attractors, and the motion from the clicked state if there is one."""
        options = {f"{i + 1}. {legend_name(each)}": i for i, each in enumerate(attractors)}
        number = self._point.attractor_number
        if self._point.tabs_state.start is not None:
            tau, v = self._point.tabs_state.start
            options[f"from τ = {tau:.4f}, v = {v:.4g}"] = number = CLICKED_STATE
        self._panel.offer_motions(options, number)

    @property
    def _motion_key(self) -> tuple[object, ...]:
        """Values that decide which motion is shown: number of the attractor, clicked initial condition, gear."""
        return self._point.tabs_state.attractor, self._point.tabs_state.start, self._point.shown_point.gear

    async def _compute_motion(self) -> None:
        point, panel = self._point, self._panel
        requested, gear, periods, shade = self._motion_key, point.shown_point.gear, PERIODS, CLICKED_MOTION_COLOUR
        attractor = None
        if point.tabs_state.start is not None:
            (tau, v), what = point.tabs_state.start, "From the chosen initial condition"
        elif (attractor := point.shown_attractor) is None:
            raise rattle.RattleError(
                "No attractor is known at this point. Click in the basins to see the motion from the clicked state."
            )
        else:
            tau, v, what = attractor.tau, attractor.v, legend_name(attractor)
            shade = QUIET_COLOUR if attractor.kind == "quiet" else point.palette.colour(attractor)
            whole = min(max(PERIODS, 3.0 * attractor.m), MOST_PERIODS)
            periods = CHAOTIC_PERIODS if attractor.kind == "chaotic" else whole
        found = await point.work.compute(parts.motion_from_state, gear, tau, v, periods, POINTS, what="The motion")

        def show() -> None:
            if requested != self._motion_key:
                return  # another motion has been chosen meanwhile
            panel.motions.show(found, gear.beta, shade, point.period)
            panel.under_motion.html = faint_html(motion.motion_caption(found, what, point.period, attractor))
            panel.sound_text.html = ""
            panel.under_spectrum.html = ""
            panel.spectrum.clear()

        await point.work.apply_document_change(show)
        if attractor is not None and attractor.kind != "undecided" and requested == self._motion_key:
            await point.work.run_part_or_show_error(
                panel.under_spectrum, lambda: self._compute_spectrum(attractor, shade)
            )

    async def _compute_spectrum(self, attractor: rattle.Attractor, shade: str) -> None:
        point, requested, gear = self._point, self._motion_key, self._point.shown_point.gear
        machine = (
            machine_at_other_point(point.machine, gear.delta, gear.epsilon)
            if point.is_at_other_point
            else point.machine
        )
        found = await point.work.compute(rattling.spectrum_of_attractor, gear, attractor, what="The spectrum")

        def show() -> None:
            if requested == self._motion_key:
                self._panel.spectrum.show(found, machine, shade)
                self._panel.under_spectrum.html = faint_html(loudness.spectrum_caption(found, legend_name(attractor)))

        await point.work.apply_document_change(show)

    def _on_sound_request(self) -> None:
        self._panel.sound_text.html = waiting_html("the sound")
        work = self._point.work
        self._sound = work.start(work.run_part_or_show_error(self._panel.sound_text, self._compute_sound), self._sound)

    async def _compute_sound(self) -> None:
        point, attractor, rpm = self._point, self._point.shown_attractor, self._point.store.view.rpm
        if point.tabs_state.start is not None or attractor is None:
            raise rattle.RattleError("Only an attractor has a sound. Choose an attractor in the list of motions.")
        if not rpm:
            raise rattle.RattleError("A sound needs a speed above 0 rpm.")
        found = await point.work.compute(
            rattling.sound_file_bytes, point.shown_point.gear, attractor, rpm, what="The sound"
        )
        await point.work.set_text(self._panel.sound_text, loudness.audio_html(found))


class DiagramTab:
    """The one-parameter diagram through the point, and the table of its events in the tab of numbers."""

    def __init__(self, point: OpenPoint, panel: PointPanel) -> None:
        self._point, self._panel = point, panel
        self._choice = point.tabs_state.diagram_choice
        self._known: DiagramContents | None = None
        self._drawn: DiagramContents | None = None
        self._task: asyncio.Task[None] | None = None
        point.subscribe_to_view(self._on_view_change, "point_state")
        point.subscribe(self._on_view_change, READY)
        point.subscribe(self._list_events, CHAOS)

    def _on_view_change(self) -> None:
        """Compute the chosen diagram if a tab that shows it is open, and mark the point that the slider chooses."""
        point, panel, state = self._point, self._panel, self._point.tabs_state
        if not point.is_ready:
            return
        panel.show_direction(state.direction)
        panel.mark_position(self._parameter_at_chosen_point)
        if self._choice != state.diagram_choice:
            point.work.cancel_after_grace(self._task)
            self._choice, self._known, self._task = state.diagram_choice, None, None
            panel.under_diagram.html = waiting_html("the diagram")
        is_shown = self._known is not None and (state.shown_tab == NUMBERS or self._drawn is self._known)
        if state.shown_tab in (DIAGRAM, NUMBERS) and not is_shown and (self._task is None or self._task.done()):
            said = panel.under_diagram if state.shown_tab == DIAGRAM else panel.events
            self._task = point.work.start(point.work.run_part_or_show_error(said, self._compute_diagram))

    @property
    def _parameter_at_chosen_point(self) -> float:
        """Value on the diagram's parameter axis at the point that the slider chooses."""
        gear, state = self._point.gear, self._point.tabs_state
        if state.to is not None:
            return state.at or 0.0
        delta, epsilon = chosen_diagram_point(gear, state) or (gear.delta, gear.epsilon)
        return epsilon if state.direction == "epsilon" else delta

    async def _compute_diagram(self) -> None:
        choice = self._choice
        if self._known is None:
            found = await self._point.work.compute(
                parts.compute_diagram_contents, self._point.gear, *choice, what="The diagram", slow=True
            )
            if choice != self._choice:
                return  # the viewer has chosen another diagram, which another task computes
            self._known = found
        await self._point.work.apply_document_change(self._show_diagram)

    def _show_diagram(self) -> None:
        found, panel = self._known, self._panel
        if found is None:
            return
        self._list_events()
        if self._point.tabs_state.shown_tab == DIAGRAM:
            self._drawn = found
            panel.diagram.show(found, self._parameter_at_chosen_point)
            said = faint_html(point_diagram.diagram_caption(found))
            panel.under_diagram.html = point_diagram.diagram_legend_html(found, panel.theme) + said

    def _list_events(self) -> None:
        """Fill the table of events: events of the diagram, and beginnings and ends of chaos."""
        if self._known is not None:
            self._panel.events.html = point_diagram.diagram_table_html(self._known, self._point.chaos)


class YieldSection:
    """The fields of the tolerances, and the yield of gears with these tolerances, in the tab "answer"."""

    def __init__(self, point: OpenPoint, panel: PointPanel) -> None:
        self._point, self._panel = point, panel
        self._requested: tuple[PointTolerances | None, int] = None, point.store.view.yields
        self._task: asyncio.Task[None] | None = None
        point.subscribe_to_view(self._on_view_change, "point_state", "yields")
        point.subscribe(self._fill_fields_from_view, READY)

    def _fill_fields_from_view(self) -> None:
        """Set the fields to the tolerances of the view. If the view has tolerances, compute the yield."""
        point = self._point
        self._panel.visible_tolerance_fields.fill(point.gear, point.machine, point.tabs_state.tolerance)
        self._on_view_change()

    def _on_view_change(self) -> None:
        widths, requested = self._point.tabs_state.tolerance, self._requested
        if not self._point.is_ready or widths is None:
            return
        self._requested = widths, self._point.store.view.yields
        if requested != self._requested:
            said, work = self._panel.visible_tolerance_fields.said, self._point.work
            said.html = waiting_html("the yield")
            self._task = work.start(work.run_part_or_show_error(said, lambda: self._compute_yield(widths)), self._task)

    async def _compute_yield(self, widths: PointTolerances) -> None:
        point = self._point
        found = await point.work.compute(
            tolerance.compute_yield, point.gear, point.machine, widths, what="The yield", slow=True
        )

        def show() -> None:
            if widths == point.tabs_state.tolerance:
                self._panel.visible_tolerance_fields.said.html = (
                    f"<p>{escape(tolerance.describe_yield(found, widths.share))}</p>"
                )

        await point.work.apply_document_change(show)
