"""Show what a viewer chooses at a point: a motion, a diagram or tolerances."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from html import escape

import rattle
from gear_rattle.service.explorer.common.address import Pair
from gear_rattle.service.explorer.design import rattling, tolerance
from gear_rattle.service.explorer.design.fields import machine_at_other_point
from gear_rattle.service.explorer.design.tolerance import Tolerance
from gear_rattle.service.explorer.point import diagram, loudness, motion, parts
from gear_rattle.service.explorer.point.along import DiagramSlider
from gear_rattle.service.explorer.point.panel import PointPanel
from gear_rattle.service.explorer.point.parts import DiagramLines
from gear_rattle.service.explorer.point.state import DIAGRAM, MOTION, PointState
from gear_rattle.service.explorer.point.words import period_name
from gear_rattle.service.explorer.point.work import PointTasks, waiting_html
from rattle import Machine
from rattle.models import AnyGear
from rattle.plot import Palette, legend_name

POINTS = 3000  # computed points of a motion
PERIODS, MOST_PERIODS, CHAOTIC_PERIODS = 12.0, 60.0, 30.0  # forcing periods shown: 3 m of a P(m, n₊, n₋) within limits
CLICKED = -1  # number of the motion from the clicked state, in the list of motions
NO_ATTRACTOR = "#8a96a3"  # colour of the motion from a clicked state
QUIET_LINE = "#8f8000"  # colour of lines of quiet motion: its yellow, dark enough for a white background


class Choices:
    """Controls of one point: its motion with spectrum and sound, its diagram, and its tolerances.

    Parameters
    ----------
    chosen : PointState
        State of the tabs at first; `show_state` gets each later state.
    choose : Callable[[PointState], None]
        Called with the new state of the tabs when a viewer chooses.
    own_again : Callable[[], None]
        Called when the slider comes back to the point itself from another place.
    """

    def __init__(
        self,
        panel: PointPanel,
        work: PointTasks,
        gear: AnyGear,
        machine: Machine | None,
        palette: Palette,
        chosen: PointState,
        choose: Callable[[PointState], None],
        own_again: Callable[[], None],
    ) -> None:
        self._panel, self._work, self._palette = panel, work, palette
        self._gear, self._machine = gear, machine
        self._chosen, self._choose, self._own_again = chosen, choose, own_again
        self._period = period_name(machine)
        self._shown_motion: tuple[object, ...] | None = None
        self._known_diagram: DiagramLines | None = None
        self._drawn_diagram: DiagramLines | None = None
        self._chaos: list[tuple[str, str, Pair, str]] = []
        self._attractors: tuple[rattle.Attractor, ...] = ()
        self._motion: asyncio.Task[None] | None = None
        self._diagram: asyncio.Task[None] | None = None
        self._heard: asyncio.Task[None] | None = None
        self._yield: asyncio.Task[None] | None = None
        self._along = DiagramSlider(panel, work, gear, palette, self._on_place_shown)
        panel.on_place = self._along.go_to_stop
        panel.on_play = self._on_play
        panel.on_tap, panel.on_motion, panel.on_direction = self._on_tap, self._on_motion, self._on_direction
        panel.on_tab = self._on_tab

    @property
    def tab(self) -> str:
        """The tab that is open."""
        return self._chosen.shown_tab

    def show_state(self, chosen: PointState) -> None:
        """Show another state of the tabs."""
        before, self._chosen = self._chosen, chosen
        self._panel.show_tab(chosen.shown_tab)
        if chosen.way != before.way:
            self._restart_diagram()
        if (chosen.attractor, chosen.start) != (before.attractor, before.start):
            self._offer_motions()
            self.mark_initial_state()
        if chosen.tolerance not in (None, before.tolerance):
            self._start_yield(chosen.tolerance)

    def _on_tab(self, tab: str) -> None:
        self._choose(replace(self._chosen, tab=tab))

    def offer_results(self, attractors: tuple[rattle.Attractor, ...]) -> None:
        """Fill the controls for the motion, the diagram and the tolerances, once the point's attractors are known."""
        self._attractors = attractors
        self._offer_motions()
        self._panel.show_direction(self._chosen.direction)
        self._along.set_diagram(self._chosen)
        fields = self._panel.tolerance
        fields.on_request = self._on_tolerance
        fields.fill(self._gear, self._machine, self._chosen.tolerance)
        if self._machine is not None:
            self._panel.rpm.value = float(f"{self._machine.rpm:.6g}")
        if self._chosen.tolerance is not None:
            self._start_yield(self._chosen.tolerance)

    def _offer_motions(self) -> None:
        """Offer the attractors, and the clicked motion, as choices."""
        options = {f"{i + 1}. {legend_name(each)}": i for i, each in enumerate(self._attractors)}
        value = self._attractor_number if options else None
        if self._chosen.start is not None:
            tau, v = self._chosen.start
            options[f"from τ = {tau:.4f}, v = {v:.4g}"] = value = CLICKED
        self._panel.offer_motions(options, value)

    @property
    def _attractor_number(self) -> int:
        """Number of the attractor to show: the chosen one, else the first that is not quiet, else 0."""
        if self._chosen.attractor is not None and self._chosen.attractor < len(self._attractors):
            return self._chosen.attractor
        return next((i for i, each in enumerate(self._attractors) if each.kind != "quiet"), 0)

    @property
    def is_away(self) -> bool:
        """True if basins of another place than the point are shown."""
        return self._along.is_away

    def _on_place_shown(self, at: float | None) -> None:
        self._choose(replace(self._chosen, at=at))
        if "diagram" in self._panel.__dict__:  # the picture of the diagram has been made
            self._panel.diagram.mark_position(self._diagram_position)
        if at is None:
            self._own_again()
        self.mark_initial_state()
        self.show_motion()

    @property
    def _diagram_position(self) -> float:
        """Position of the visible place on the axis of the diagram."""
        if self._chosen.to is not None:
            return self._chosen.at or 0.0
        gear = self._along.gear
        return gear.epsilon if self._chosen.direction == "epsilon" else gear.delta

    def _shown_attractor(self) -> rattle.Attractor | None:
        """Return the attractor to show, None if none is known.

        At another place than the point, this is the attractor with the same name there. If there is none, it is the
        first attractor there that is not quiet, else the first.

        Returns
        -------
        rattle.Attractor | None
            The attractor.
        """
        own = self._attractors[self._attractor_number] if self._attractors else None
        if not self.is_away:
            return own
        there = self._along.attractors
        named = [each for each in there if own is not None and each.name == own.name]
        return (named or [each for each in there if each.kind != "quiet"] or list(there))[0]

    def _motion_key(self) -> tuple[object, ...]:
        """Return a key for the chosen motion: its attractor, its initial condition and its gear."""
        return self._chosen.attractor, self._chosen.start, self._along.gear

    def mark_initial_state(self) -> None:
        """Mark the initial state of the chosen motion in the basins."""
        attractor = self._shown_attractor()
        start = self._chosen.start or ((attractor.tau, attractor.v) if attractor is not None else None)
        if start is not None:
            self._panel.mark_initial_state(*start)

    def show_motion(self) -> None:
        """Show the chosen motion, if its tab is open and does not show it yet."""
        if self.tab != MOTION or self._shown_motion == self._motion_key():
            return
        self._shown_motion = self._motion_key()
        part = self._work.run_part(self._panel.under_motion, self._compute_motion)
        self._motion = self._work.start(part, self._motion)

    async def _compute_motion(self) -> None:
        asked, gear, periods, shade = self._motion_key(), self._along.gear, PERIODS, NO_ATTRACTOR
        attractor = None
        if self._chosen.start is not None:
            (tau, v), what = self._chosen.start, "From the chosen initial condition"
        elif (attractor := self._shown_attractor()) is None:
            raise rattle.RattleError(
                "No attractor is known here. Click in the basins to see the motion from that state."
            )
        else:
            tau, v, what = attractor.tau, attractor.v, legend_name(attractor)
            shade = QUIET_LINE if attractor.kind == "quiet" else self._palette.colour(attractor)
            whole = min(max(PERIODS, 3.0 * attractor.m), MOST_PERIODS)
            periods = CHAOTIC_PERIODS if attractor.kind == "chaotic" else whole
        found = await self._work.compute(parts.motion_from, gear, tau, v, periods, POINTS, what="The motion")

        def show() -> None:
            if asked != self._motion_key():
                return  # another motion has been chosen meanwhile
            self._panel.motions.show(found, gear.beta, shade, self._period)
            said = motion.motion_caption(found, what, self._period, attractor)
            self._panel.under_motion.html = f'<p class="faint">{escape(said)}</p>'
            self._panel.heard.html = ""
            self._panel.under_spectrum.html = ""
            self._panel.spectrum.clear()

        await self._work.change(show)
        if attractor is not None and attractor.kind != "undecided" and asked == self._motion_key():
            await self._work.run_part(self._panel.under_spectrum, lambda: self._compute_spectrum(attractor, shade))

    async def _compute_spectrum(self, attractor: rattle.Attractor, shade: str) -> None:
        asked, gear = self._motion_key(), self._along.gear
        machine = machine_at_other_point(self._machine, gear.delta, gear.epsilon) if self.is_away else self._machine
        found = await self._work.compute(rattling.spectrum_lines, gear, attractor, what="The spectrum")

        def show() -> None:
            if asked != self._motion_key():
                return
            self._panel.spectrum.show(found, machine, shade)
            said = loudness.spectrum_caption(found, legend_name(attractor))
            self._panel.under_spectrum.html = f'<p class="faint">{escape(said)}</p>'

        await self._work.change(show)

    def _on_play(self, rpm: float | None) -> None:
        self._panel.heard.html = waiting_html("the sound")
        self._heard = self._work.start(
            self._work.run_part(self._panel.heard, lambda: self._compute_sound(rpm)), self._heard
        )

    async def _compute_sound(self, rpm: float | None) -> None:
        attractor = self._shown_attractor()
        if self._chosen.start is not None or attractor is None:
            raise rattle.RattleError("Only an attractor has a sound. Choose an attractor in the list of motions.")
        if not rpm:
            raise rattle.RattleError("A sound needs a speed above 0 rpm.")
        found = await self._work.compute(rattling.sound_file, self._along.gear, attractor, rpm, what="The sound")
        await self._work.set_text(self._panel.heard, loudness.audio_html(found))

    def _on_tolerance(self, widths: Tolerance) -> None:
        if widths == self._chosen.tolerance:  # the same tolerances were entered again
            self._start_yield(widths)
        else:
            self._choose(replace(self._chosen, tolerance=widths))

    def _start_yield(self, widths: Tolerance) -> None:
        said = self._panel.tolerance.said
        said.html = waiting_html("the yield")
        self._yield = self._work.start(self._work.run_part(said, lambda: self._compute_yield(widths)), self._yield)

    async def _compute_yield(self, widths: Tolerance) -> None:
        found = await self._work.compute(
            tolerance.compute_yield, self._gear, self._machine, widths, what="The yield", slow=True
        )

        def show() -> None:
            if widths == self._chosen.tolerance:
                self._panel.tolerance.said.html = f"<p>{escape(tolerance.yield_in_words(found, widths.share))}</p>"

        await self._work.change(show)

    def request_diagram(self) -> None:
        """Show the events of the diagram in a table, and its picture if its tab is open."""
        is_new = self._known_diagram is None or self._drawn_diagram is not self._known_diagram
        if is_new and (self._diagram is None or self._diagram.done()):
            self._start_diagram()

    def _start_diagram(self) -> None:
        said = self._panel.under_diagram if self.tab == DIAGRAM else self._panel.events
        self._diagram = self._work.start(self._work.run_part(said, self._compute_diagram), self._diagram)

    async def _compute_diagram(self) -> None:
        if self._known_diagram is None:
            direction, span, to = way = self._chosen.way
            found = await self._work.compute(
                parts.diagram, self._gear, direction, span, to, what="The diagram", slow=True
            )
            if way != self._chosen.way:
                return  # another diagram was chosen, and is being computed
            self._known_diagram = found
        await self._work.change(self._show_diagram)

    def _show_diagram(self) -> None:
        found = self._known_diagram
        if found is None:
            return
        self._panel.events.html = diagram.diagram_table(found, self._chaos)
        if self.tab == DIAGRAM:
            self._drawn_diagram = found
            self._panel.diagram.show(found, self._diagram_position)
            said = f'<p class="faint">{escape(diagram.diagram_caption(found))}</p>'
            self._panel.under_diagram.html = diagram.diagram_legend(found, self._panel.theme) + said

    def show_chaos(self, chaos: list[tuple[str, str, Pair, str]]) -> None:
        """List beginnings and ends of chaos among the events of the diagram."""
        self._chaos = chaos
        if self._known_diagram is not None:
            self._panel.events.html = diagram.diagram_table(self._known_diagram, chaos)

    def _on_tap(self, tau: float, v: float) -> None:
        self._choose(replace(self._chosen, start=(tau, v), tab=MOTION))

    def _on_motion(self, number: int | None) -> None:
        if number is not None and number != CLICKED:
            self._choose(replace(self._chosen, attractor=number, start=None, tab=MOTION))

    def _on_direction(self, direction: str) -> None:
        self._choose(replace(self._chosen, direction=direction, to=None, at=None, tab=DIAGRAM))

    def _restart_diagram(self) -> None:
        """Compute and show the newly chosen diagram."""
        self._panel.show_direction(self._chosen.direction)
        self._along.set_diagram(self._chosen)
        self._known_diagram = None
        self._panel.under_diagram.html = waiting_html("the diagram")
        self._start_diagram()
