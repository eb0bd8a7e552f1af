"""Show the basins and motions of other points on the line of the diagram, which a slider chooses."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial

import rattle
from gear_rattle.service.explorer.common.address import Pair
from gear_rattle.service.explorer.point import basins, parts
from gear_rattle.service.explorer.point.panel import PLACES, PointPanel
from gear_rattle.service.explorer.point.state import PointState, diagram_line, point_on_line
from gear_rattle.service.explorer.point.work import PointTasks
from rattle.models import AnyGear, model_at
from rattle.plot import Palette

# (cells along each axis, method) of the basins, first and after the slider has stopped
FINENESS = ((100, "cells"), (300, "refined"))


class DiagramSlider:
    """Follow the slider along the line of a diagram, the line in the (δ, ε) plane along which the diagram is computed.

    Parameters
    ----------
    gear : AnyGear
        Gear at the clicked point.
    looked : Callable[[float | None], None]
        Called when another place is shown, with its position on the line from 0 to 1; None for the clicked point.

    Attributes
    ----------
    gear : AnyGear
        Gear at the place that is shown.
    attractors : tuple[rattle.Attractor, ...]
        Attractors at this place; empty if it is the point itself.
    """

    def __init__(
        self,
        panel: PointPanel,
        work: PointTasks,
        gear: AnyGear,
        palette: Palette,
        looked: Callable[[float | None], None],
    ) -> None:
        self._panel, self._work, self._palette, self._looked = panel, work, palette, looked
        self._own = self.gear = gear
        self.attractors: tuple[rattle.Attractor, ...] = ()
        self._chosen = PointState()
        self._home: int | None = None  # slider position of the point itself; None before `set_diagram`
        self._wanted: tuple[PointState, int] = self._chosen, 0
        self._shown = self._wanted
        self._task: asyncio.Task[None] | None = None

    @property
    def is_away(self) -> bool:
        """True if another place than the point is shown."""
        return self.gear is not self._own

    def set_diagram(self, chosen: PointState) -> None:
        """Let the slider run along the line of this diagram, from the place in the address or from the point itself."""
        self._chosen = chosen
        (begin, end), here = diagram_line(self._own, chosen), (self._own.delta, self._own.epsilon)
        axis = max((0, 1), key=lambda each: abs(end[each] - begin[each]))
        length = end[axis] - begin[axis]
        self._home = round(PLACES * (here[axis] - begin[axis]) / length) if length else 0
        self.go_to_stop(self._home if chosen.at is None else round(PLACES * chosen.at))

    def go_to_stop(self, stop: int) -> None:
        """Show the place at a slider position; if a computation runs, only the newest position is shown after it."""
        if self._home is None:
            return
        self._wanted = self._chosen, stop
        self._panel.show_place(stop, self._shown_point)
        if not self.is_away and stop == self._home:
            self._shown = self._wanted
        if self._wanted != self._shown and (self._task is None or self._task.done()):
            self._task = self._work.start(self._work.run_part(self._panel.under_basins, self._show_wanted))

    @property
    def _shown_point(self) -> Pair:
        """The point (δ, ε) at the newest slider position."""
        chosen, stop = self._wanted
        here = self._own.delta, self._own.epsilon
        return here if stop == self._home else point_on_line(diagram_line(self._own, chosen), stop / PLACES)

    async def _show_wanted(self) -> None:
        while (wanted := self._wanted) != self._shown:
            if wanted[1] == self._home:
                await self._work.change(self._show_point_itself)
            else:
                gear = model_at(self._own).gear(*self._shown_point)
                for side, method in FINENESS:
                    slow = method != "cells"
                    found = await self._work.compute(
                        parts.basins_at_other_point, gear, side, method, what="The basins", slow=slow
                    )
                    await self._work.change(partial(self._show_place, gear, found, wanted))
                    if wanted != self._wanted:
                        break
            self._shown = wanted

    def _show_place(self, gear: AnyGear, found: parts.BasinsAndOrbits, wanted: tuple[PointState, int]) -> None:
        if wanted[0] is not self._wanted[0]:  # another diagram was chosen meanwhile
            return
        picture, is_new = self._panel.picture, gear is not self.gear
        self.gear, self.attractors = gear, found.basins.attractors
        picture.remove_lines()
        picture.show_cells(found.basins, self._palette)
        picture.show_orbits(found.orbits)
        self._panel.under_basins.html = basins.basins_caption(found.basins, (), self._palette)
        self._panel.about_lines.html = ""
        if is_new:
            self._looked(wanted[1] / PLACES)

    def _show_point_itself(self) -> None:
        self.gear, self.attractors = self._own, ()
        self._looked(None)
