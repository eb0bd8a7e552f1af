"""The view of one parameter point: what runs there, how likely, how safe; basins, one motion, a diagram."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from functools import partial
from html import escape
from typing import Any

import panel as pn
import param

import rattle
from rattle.models import AnyGear, AnyModel
from rattle.plot.colours import Palette, name_of
from service.explorer.common.text import Text
from service.explorer.point import basins, diagram, motion, parts, words
from service.explorer.point.panel import PointPanel
from service.explorer.point.parts import Chances, DiagramLines, Lines
from service.explorer.point.state import PointState
from service.explorer.point.work import Work
from service.kernels import Part
from service.state import Front

COUNT = 1024  # initial conditions of the probabilities
RESOLUTIONS = (300, 600)  # cells a side of the basins, at first and in the end
POINTS = 3000  # of a motion
PAINT_SECONDS = 0.05  # for a browser to put words on the screen before it lays out pictures
CLICKED = -1  # among the motions to choose from
COMPILING = "Kernels are being compiled, once after the service was installed or updated. This takes a minute or so …"


class PointView(param.Parameterized):
    """Everything about one (δ, ε), in a panel; slow parts fill in from processes of their own until `stop` is called.

    `state` is what a URL keeps to reproduce the view, all of it text: the attractor (its place by falling share) or the
    initial condition (tau, v) whose motion is shown, and the direction of the diagram. What of it cannot be read is
    as by default.
    """

    state = param.Dict(default={})

    def __init__(
        self, panel: PointPanel, front: Front, delta: float, epsilon: float, model: AnyModel, **state: str
    ) -> None:
        possible = delta > 0 and epsilon >= 0  # else there is no gear, which is told below
        self._chosen = PointState.read(state, parts.highest_speed(delta, epsilon, model.beta) if possible else 0.0)
        super().__init__(state=self._chosen.text())
        self.panel, self._model = panel, model
        self._front, self._work = front, Work(front, pn.state.curdoc, model.name)
        self._motion: asyncio.Task[None] | None = None
        self._diagram: asyncio.Task[None] | None = None
        self._found: Chances | None = None
        self._orbits: tuple[rattle.Orbit, ...] = ()
        self._lines: Lines | None = None
        self._basins: rattle.Basins | None = None
        self._palette = Palette()  # one for all pictures and tables of the point
        self._quiet = False  # a widget that changes says what is shown, not what to show
        panel.on_tap, panel.on_choice, panel.on_direction = self._on_tap, self._on_choice, self._on_direction
        panel.clear()
        try:
            self._gear = model.gear(delta, epsilon)
        except rattle.RattleError as error:
            panel.where.html = f'<p class="wrong">{escape(str(error))}</p>'
            return
        panel.where.html = f"<p>{escape(words.where(self._gear))}</p>"
        for text, what in (
            (panel.orbits, "the period-one orbits"),
            (panel.likely, "how likely quiet running is"), (panel.under_basins, "the basins"),
            (panel.under_motion, "a motion"), (panel.under_diagram, "the diagram"),
        ):  # fmt: skip
            text.html = _waiting(what)
        if not front.kernels.has(model.name, Part.POINT):
            panel.likely.html = f'<p class="faint">{COMPILING}</p>'
        if model.in_closed_form:
            if front.kernels.has(model.name, Part.ORBITS):
                self._tell_orbits(parts.period_one(self._gear))  # in closed form
            else:
                self._work.start(self._part(panel.orbits, partial(self._closed_form, self._gear)))
        self._work.start(self._fill())

    # What is computed, and in what order

    async def _fill(self) -> None:
        """What is quick first; one slow part after the other, so that the next click is answered at once.

        Pictures come after the words: to make them takes the service, and to lay them out a browser, a while.
        """
        await self._part(self.panel.likely, self._chances)
        await asyncio.sleep(PAINT_SECONDS)
        await self._part(self.panel.under_basins, partial(self._some_basins, 100, "cells"))
        self._show_motion()
        if self._model.has_margin:
            await self._part(self.panel.safe, partial(self._margin, self._gear))
        else:
            await self._work.change(partial(_tell, self.panel.safe, f"<p>{words.NO_MARGIN}</p>"))
        if not self._model.in_closed_form:
            await self._part(self.panel.orbits, self._continued)
        await self._part(self.panel.about_lines, self._some_lines)
        await self._part(self.panel.under_basins, partial(self._some_basins, RESOLUTIONS[0], "refined"))
        await self._part(self.panel.under_diagram, self._one_diagram)
        await self._part(self.panel.under_basins, partial(self._some_basins, RESOLUTIONS[1], "refined"))

    async def _part(self, text: Text, work: Callable[[], Awaitable[None]]) -> None:
        await self._work.part(partial(_tell, text), work)

    async def _chances(self) -> None:
        count = min(COUNT, self._front.settings.max_point_count)
        found = await self._work.compute(parts.chances, self._gear, count, what="The attractors")

        def show() -> None:
            self._found = found
            self.panel.likely.html = f"<p><strong>{escape(words.how_likely(self._gear, found))}</strong></p>"
            self.panel.table.html = words.attractors_table(found, self._palette)
            self._offer_motions()
            self._set(self.panel.direction, value=self._chosen.direction)

        await self._work.change(show)

    async def _closed_form(self, gear: AnyGear) -> None:
        await self._work.kernels(Part.ORBITS)
        await self._work.change(lambda: self._tell_orbits(parts.period_one(gear)))

    async def _continued(self) -> None:
        found = await self._work.compute(parts.period_one, self._gear, what="The period-one orbits", slow=True)

        def show() -> None:
            self._tell_orbits(found)
            self.panel.picture.show_orbits(found.orbits)

        await self._work.change(show)

    def _tell_orbits(self, found: parts.PeriodOne) -> None:
        self._orbits = found.orbits
        self.panel.orbits.html = words.orbits_table(found)

    async def _margin(self, gear: AnyGear) -> None:
        found = await self._work.compute(parts.margin, gear, what="The margin", slow=True)
        said = f"<p>{escape(words.how_safe(gear, found))}</p>"
        await self._work.change(partial(_tell, self.panel.safe, said))

    async def _some_basins(self, side: int, method: str) -> None:
        slow = method != "cells"
        found = await self._work.compute(parts.basins, self._gear, side, method, what="The basins", slow=slow)

        def show() -> None:
            self._basins = found
            self.panel.picture.show_cells(found, self._palette)
            self.panel.picture.show_orbits(self._orbits)
            self._show_legend()

        await self._work.change(show)

    async def _some_lines(self) -> None:
        found = await self._work.compute(parts.lines, self._gear, what="The manifolds", slow=True)

        def show() -> None:
            self._lines = found
            self.panel.picture.show_lines(found.lines)
            notes = "".join(f"<li>{escape(each)}</li>" for each in found.missing)
            self.panel.about_lines.html = f'<ul class="faint">{notes}</ul>' if notes else ""
            self._show_legend()

        await self._work.change(show)

    def _show_legend(self) -> None:
        if self._basins is not None:
            lines = self._lines.lines if self._lines is not None else ()
            side = self._basins.tau.size
            how = f'<p class="faint">{side} × {side} cells. Click one to see its motion.</p>'
            self.panel.under_basins.html = basins.legend(self._basins, lines, self._palette) + how

    # The motion

    def _offer_motions(self) -> None:
        """The attractors, and what was clicked, as choices."""
        names = [f"{i + 1}. {name_of(each)}" for i, each in enumerate(self._found.attractors)] if self._found else []
        options = {name: i for i, name in enumerate(names)}
        if self._chosen.start is not None:
            tau, v = self._chosen.start
            options[f"from τ = {tau:.4f}, v = {v:.4g}"] = CLICKED
        value = CLICKED if self._chosen.start is not None else self._attractor if names else None
        self._set(self.panel.choice, options=options, value=value)

    def _set(self, control: Any, **values: Any) -> None:
        self._quiet = True
        control.param.update(values)
        self._quiet = False

    @property
    def _attractor(self) -> int:
        """The attractor that is shown: the first one that rattles, unless another one is chosen."""
        found = self._found.attractors if self._found else ()
        if self._chosen.attractor is not None and self._chosen.attractor < len(found):
            return self._chosen.attractor
        return next((i for i, each in enumerate(found) if each.kind != "quiet"), 0)

    def _show_motion(self) -> None:
        self._motion = self._work.start(self._part(self.panel.under_motion, self._one_motion), self._motion)

    async def _one_motion(self) -> None:
        chosen, periods, shade = self._chosen, 12.0, "#8a96a3"
        if self._chosen.start is not None:
            (tau, v), what = self._chosen.start, "From the chosen initial condition"
        elif self._found is None or not self._found.attractors:
            raise rattle.RattleError("There is no attractor to show: click in the basins for a motion.")
        else:
            attractor = self._found.attractors[self._attractor]
            tau, v, shade, what = attractor.tau, attractor.v, self._palette.colour(attractor), name_of(attractor)
            periods = float(min(max(periods, 3 * attractor.m), 60)) if attractor.kind != "chaotic" else 30.0
        found = await self._work.compute(parts.motion, self._gear, tau, v, periods, POINTS, what="The motion")

        def show() -> None:
            if (chosen.attractor, chosen.start) != (
                self._chosen.attractor,
                self._chosen.start,
            ):
                return  # another one has been chosen meanwhile
            self.panel.motions.show(found, self._gear.beta, shade)
            self.panel.picture.show_chosen(tau, v)
            self.panel.under_motion.html = f'<p class="faint">{escape(motion.caption(found, what))}</p>'

        await self._work.change(show)

    # The diagram

    def _show_diagram(self) -> None:
        self._diagram = self._work.start(self._part(self.panel.under_diagram, self._one_diagram), self._diagram)

    async def _one_diagram(self) -> None:
        direction = self._chosen.direction
        found: DiagramLines = await self._work.compute(
            parts.diagram, self._gear, direction, what="The diagram", slow=True
        )
        at = self._gear.epsilon if direction == "epsilon" else self._gear.delta

        def show() -> None:
            if direction != self._chosen.direction:
                return
            self.panel.diagram.show(found, at)
            self.panel.under_diagram.html = f'<p class="faint">{escape(diagram.caption(found))}</p>'

        await self._work.change(show)

    # What the viewer does

    def _on_tap(self, tau: float, v: float) -> None:
        self._choose(PointState(self._chosen.attractor, (tau, v), self._chosen.direction))
        self._offer_motions()
        self._show_motion()

    def _on_choice(self, event: Any) -> None:
        if self._quiet or event.new is None or event.new == CLICKED:
            return
        self._choose(PointState(int(event.new), None, self._chosen.direction))
        self._offer_motions()
        self._show_motion()

    def _on_direction(self, event: Any) -> None:
        if self._quiet:
            return
        self._choose(PointState(self._chosen.attractor, self._chosen.start, event.new))
        self.panel.under_diagram.html = _waiting("the diagram")
        self._show_diagram()

    def _choose(self, chosen: PointState) -> None:
        self._chosen = chosen
        self.state = chosen.text()

    def stop(self) -> None:
        """Give up what is still being computed: another point is looked at."""
        self._work.stop()


def _tell(text: Text, html: str) -> None:
    text.html = html


def _waiting(what: str) -> str:
    return f'<p class="faint" role="status">computing {escape(what)} …</p>'
