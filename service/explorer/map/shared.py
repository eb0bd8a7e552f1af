"""What all pages of an application have in common."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

from service.database.tables import JobRow
from service.explorer.common.address import View
from service.explorer.common.news import News
from service.explorer.design.limits import DesignLimits
from service.explorer.map.colouring import Colouring, colouring
from service.explorer.map.overlays import Crises
from service.explorer.map.planes import Atlas, Block, Plane, Room
from service.state import Front
from workers import SurveyRequest

EXACT = "exact at β = 0.6, without any survey: click a point to see its motions, basins and diagram"


class WithoutSurvey(Protocol):
    """What is known without any survey, as `Atlas` has the maps of surveys."""

    request: SurveyRequest

    def plane(self, variable: str, index: int) -> Plane:
        """A map of it. Blocks: for a thread."""


@dataclass(frozen=True)
class Shared:
    """What all pages of an application have in common."""

    front: Front
    news: News
    atlas: Atlas
    crises: Crises
    limits: DesignLimits
    exact: WithoutSurvey

    def map_of(self, job: JobRow, view: View, room: Room) -> tuple[Plane, bool, Block, Colouring]:
        """The map of a survey, whether that is all there is by now, and what is drawn of it. Blocks: for a thread."""
        plane, is_whole = self.atlas.plane(job, view.variable, view.index, view.slice)
        block = plane.block(room=room)
        return plane, is_whole, block, colouring(plane, block, view.limits, view.log)

    def plane(self, job: JobRow | None, variable: str, index: int, number: int) -> Plane:
        """A map of a survey, or of what is known without any. Blocks: for a thread. Raises as `Atlas.plane`."""
        if job is None:
            return self.exact.plane(variable, index)
        is_whole = False
        while not is_whole:  # what takes long is read a piece at a time
            plane, is_whole = self.atlas.plane(job, variable, index, number)
        return plane

    def exact_map(self, view: View) -> tuple[Plane, Block, Colouring]:
        """The map without any survey, and what is drawn of it. Blocks: for a thread."""
        plane = self.exact.plane(view.variable, view.index)
        block = plane.block()
        return plane, block, replace(colouring(plane, block, view.limits, view.log), note=EXACT)
