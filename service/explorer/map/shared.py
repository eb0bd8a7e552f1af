"""What all pages of an application have in common."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Protocol
from weakref import ReferenceType, ref

from rattle.models import Model
from service.database.tables import JobRow, State
from service.explorer.common.address import Limits, Pair, View
from service.explorer.common.news import News
from service.explorer.map.colouring import Colouring, colouring
from service.explorer.map.planes import Atlas, Block, Plane, Room
from service.operations.overlaid import Overlaid
from service.state import Front
from workers import SurveyRequest, map_quantity
from workers.cluster.window import CLOSED_FORM
from workers.pictures.look import LARGEST

KEPT = 4  # drawings of finished maps, of a few MiB each: whoever opens a page looks at one of few

EXACT = "exact at β = 0.6, without any survey: click a point to see its motions, basins and diagram"

BEFOREHAND = "exact, before the survey has come to it"
WAITING = "exact; the survey waits for its turn"


def in_closed_form(request: SurveyRequest, variable: str) -> bool:
    """Whether a map of a survey is known before it is computed."""
    if variable == LARGEST:
        return False
    found = map_quantity(variable, 0, request)
    return request.model is Model.IMPACTING and found.group in CLOSED_FORM


class WithoutSurvey(Protocol):
    """What is known without any survey, as `Atlas` has the maps of surveys."""

    request: SurveyRequest

    def plane(self, variable: str, index: int) -> Plane:
        """A map of it. Blocks: for a thread."""

    def beforehand(self, job: JobRow, variable: str, index: int, number: int, computed: Callable[[], Plane]) -> Plane:
        """A map of a survey that is in closed form, and what is computed of it. Blocks: for a thread."""


@lru_cache(maxsize=KEPT)
def drawn(plane: ReferenceType[Plane], limits: Limits | Pair, log: bool, room: Room) -> tuple[Block, Colouring]:
    """What is drawn of a map that stays as it is, by reference: the atlas alone keeps maps."""
    there = plane()
    assert there is not None  # whoever asks has it
    return _drawn(there, limits, log, room)


def _drawn(plane: Plane, limits: Limits | Pair, log: bool, room: Room) -> tuple[Block, Colouring]:
    block = plane.block(room=room)
    return block, colouring(plane, block, limits, log, room)


@dataclass(frozen=True)
class Shared:
    """What all pages of an application have in common."""

    front: Front
    news: News
    atlas: Atlas
    overlaid: Overlaid
    exact: WithoutSurvey

    def map_of(self, job: JobRow, view: View, room: Room) -> tuple[Plane, bool, Block, Colouring]:
        """The map of a survey, whether that is all there is by now, and what is drawn of it. Blocks: for a thread."""
        key, how = (view.variable, view.index, view.slice), (view.limits, view.log, room)
        if not State(job.state).final and in_closed_form(SurveyRequest.model_validate(job.request), view.variable):
            plane = self.exact.beforehand(job, *key, lambda: self.atlas.plane(job, *key)[0])
            block, colours = _drawn(plane, *how)
            note = WAITING if job.state == State.ACCEPTED else BEFOREHAND
            return plane, True, block, replace(colours, note=note)
        plane, is_whole = self.atlas.plane(job, *key)
        if not is_whole or job.state != State.SUCCESSFUL:  # more may come
            return plane, is_whole, *_drawn(plane, *how)
        return plane, True, *drawn(ref(plane), *how)

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
