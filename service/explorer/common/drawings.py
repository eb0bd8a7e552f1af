"""Drawings of one part of a page, one after the other."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Hashable, Sequence

from gear_rattle.service.database.tables import JobRow, State
from gear_rattle.service.explorer.common.viewer import Viewer

PAUSE = 1.0  # between two drawings of a survey that runs

Show = Callable[[], object]


class Drawings:
    """One at a time: its thread would go on if it was given up.

    What is wanted meanwhile is drawn after it, only the newest, and of a survey that runs not before a pause.
    """

    def __init__(self, viewer: Viewer) -> None:
        self._viewer = viewer
        self._wanted: tuple[Hashable, ...] = ()
        self._drawn: tuple[Hashable, ...] = ()
        self._draw: Callable[[], Awaitable[Show]] | None = None
        self._pause = 0.0
        self._task: asyncio.Task[None] | None = None

    def want(self, what: Hashable, jobs: Sequence[JobRow], draw: Callable[[], Awaitable[Show]]) -> None:
        """Draw this of these surveys, unless it is drawn or is being drawn.

        What `draw` returns shows it, and is called only while the same is wanted, if of fewer cells.
        """
        self._wanted = what, tuple((job.id, job.state, job.cells_done) for job in jobs)
        self._draw, self._pause = draw, 0.0 if all(State(job.state).final for job in jobs) else PAUSE
        if self._wanted != self._drawn and (self._task is None or self._task.done()):
            self._task = self._viewer.start(self._keep_drawing())

    def stop(self) -> None:
        """Nothing is wanted."""
        if self._task is not None:
            self._task.cancel()
        self._wanted, self._drawn, self._draw, self._task = (), (), None, None

    async def _keep_drawing(self) -> None:
        while self._draw is not None and self._wanted != self._drawn:
            self._drawn = self._wanted
            self._show(self._wanted[0], await self._draw())
            await asyncio.sleep(self._pause)

    def _show(self, what: Hashable, show: Show) -> None:
        self._viewer.change(lambda: show() if self._wanted[:1] == (what,) else None)
