"""What a viewer chooses to see of a point: one of its motions, and along which axis its diagram is."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from html import escape

import rattle
from rattle.models import AnyGear
from rattle.plot.colours import Palette, name_of
from service.explorer.point import diagram, motion, parts
from service.explorer.point.panel import PointPanel
from service.explorer.point.parts import DiagramLines
from service.explorer.point.state import PointState
from service.explorer.point.work import Work, waiting

POINTS = 3000  # of a motion
PERIODS, MOST_PERIODS, CHAOTIC_PERIODS = 12.0, 60.0, 30.0  # of a motion; of a periodic one three of its own
CLICKED = -1  # among the motions to choose from
NO_ATTRACTOR = "#8a96a3"


class Choices:
    """The motion and the diagram of one point; what is chosen is remembered."""

    def __init__(
        self,
        panel: PointPanel,
        work: Work,
        gear: AnyGear,
        palette: Palette,
        chosen: PointState,
        remember: Callable[[PointState], None],
    ) -> None:
        self._panel, self._work, self._gear, self._palette = panel, work, gear, palette
        self._chosen, self._remember = chosen, remember
        self._attractors: tuple[rattle.Attractor, ...] = ()
        self._motion: asyncio.Task[None] | None = None
        self._diagram: asyncio.Task[None] | None = None
        panel.on_tap, panel.on_motion, panel.on_direction = self._on_tap, self._on_motion, self._on_direction

    def offer(self, attractors: tuple[rattle.Attractor, ...]) -> None:
        """The attractors, as soon as they are known."""
        self._attractors = attractors
        self._offer_motions()
        self._panel.show_direction(self._chosen.direction)

    def _offer_motions(self) -> None:
        """The attractors, and what was clicked, as choices."""
        options = {f"{i + 1}. {name_of(each)}": i for i, each in enumerate(self._attractors)}
        value = self._attractor if options else None
        if self._chosen.start is not None:
            tau, v = self._chosen.start
            options[f"from τ = {tau:.4f}, v = {v:.4g}"] = value = CLICKED
        self._panel.offer_motions(options, value)

    @property
    def _attractor(self) -> int:
        """The attractor that is shown: the first one that rattles, unless another one is chosen."""
        if self._chosen.attractor is not None and self._chosen.attractor < len(self._attractors):
            return self._chosen.attractor
        return next((i for i, each in enumerate(self._attractors) if each.kind != "quiet"), 0)

    def show_motion(self) -> None:
        """The motion that is chosen."""
        part = self._work.part(self._panel.under_motion, self._one_motion)
        self._motion = self._work.start(part, self._motion)

    async def _one_motion(self) -> None:
        chosen, periods, shade = self._chosen, PERIODS, NO_ATTRACTOR
        attractor = None
        if self._chosen.start is not None:
            (tau, v), what = self._chosen.start, "From the chosen initial condition"
        elif not self._attractors:
            raise rattle.RattleError("There is no attractor to show: click in the basins for a motion.")
        else:
            attractor = self._attractors[self._attractor]
            tau, v, shade, what = attractor.tau, attractor.v, self._palette.colour(attractor), name_of(attractor)
            whole = min(max(PERIODS, 3.0 * attractor.m), MOST_PERIODS)
            periods = CHAOTIC_PERIODS if attractor.kind == "chaotic" else whole
        found = await self._work.compute(parts.motion, self._gear, tau, v, periods, POINTS, what="The motion")

        def show() -> None:
            if (chosen.attractor, chosen.start) != (self._chosen.attractor, self._chosen.start):
                return  # another one has been chosen meanwhile
            self._panel.motions.show(found, self._gear.beta, shade)
            self._panel.picture.show_chosen(tau, v)
            self._panel.under_motion.html = f'<p class="faint">{escape(motion.caption(found, what, attractor))}</p>'

        await self._work.change(show)

    async def one_diagram(self) -> None:
        """The diagram in the direction that is chosen."""
        direction = self._chosen.direction
        found: DiagramLines = await self._work.compute(
            parts.diagram, self._gear, direction, what="The diagram", slow=True
        )
        at = self._gear.epsilon if direction == "epsilon" else self._gear.delta

        def show() -> None:
            if direction != self._chosen.direction:
                return
            self._panel.diagram.show(found, at)
            said = f'<p class="faint">{escape(diagram.caption(found))}</p>'
            self._panel.under_diagram.html = diagram.legend(found) + said

        await self._work.change(show)

    def _on_tap(self, tau: float, v: float) -> None:
        self._choose_motion(PointState(self._chosen.attractor, (tau, v), self._chosen.direction))

    def _on_motion(self, number: int | None) -> None:
        if number is not None and number != CLICKED:
            self._choose_motion(PointState(number, None, self._chosen.direction))

    def _choose_motion(self, chosen: PointState) -> None:
        self._choose(chosen)
        self._offer_motions()
        self.show_motion()

    def _on_direction(self, direction: str) -> None:
        self._choose(PointState(self._chosen.attractor, self._chosen.start, direction))
        self._panel.under_diagram.html = waiting("the diagram")
        part = self._work.part(self._panel.under_diagram, self.one_diagram)
        self._diagram = self._work.start(part, self._diagram)

    def _choose(self, chosen: PointState) -> None:
        self._chosen = chosen
        self._remember(chosen)
