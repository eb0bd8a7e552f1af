"""Run the drawings of one picture of a page one by one. A new request replaces an earlier one that still waits."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Callable, Hashable, Sequence
from contextlib import aclosing
from functools import partial

from gear_rattle.service.database.tables import JobRow, State
from gear_rattle.service.explorer.common.viewer import PageSession
from rattle import RattleError

PAUSE = 1.0  # seconds between two drawings of a running survey

Show = Callable[[], object]


class DrawingRunner:
    """Runner of drawings, one at a time. A new drawing waits until the running drawing ends or pauses.

    If several requests arrive while a drawing runs, only the newest is drawn. While a survey runs, PAUSE seconds pass
    between two drawings.

    Parameters
    ----------
    show_error : Callable[[RattleError], object]
        Shows an error of a drawing. Errors of a drawing are not shown after another drawing was requested.
    """

    def __init__(self, viewer: PageSession, show_error: Callable[[RattleError], object]) -> None:
        self._viewer, self._show_error = viewer, show_error
        self._wanted: tuple[Hashable, ...] = ()
        self._drawn: tuple[Hashable, ...] = ()
        self._draw: Callable[[], AsyncGenerator[Show, None]] | None = None
        self._pause = 0.0
        self._task: asyncio.Task[None] | None = None

    def request(
        self, identity: Hashable, jobs: Sequence[JobRow], draw: Callable[[], AsyncGenerator[Show, None]]
    ) -> None:
        """Request a drawing of surveys, unless the same drawing is finished or under way.

        Parameters
        ----------
        identity : Hashable
            Value that identifies the drawing. It stays the same when a survey has computed more cells.
        jobs : Sequence[JobRow]
            Surveys of the drawing. If the state or the number of computed cells of a survey has changed, the drawing is
            made again.
        draw : Callable[[], AsyncGenerator[Show, None]]
            Yields functions that show the drawing so far. No function is called after a request for another drawing.
        """
        self._wanted = identity, tuple((job.id, job.state, job.cells_done) for job in jobs)
        self._draw, self._pause = draw, 0.0 if all(State(job.state).is_final for job in jobs) else PAUSE
        if self._wanted != self._drawn and (self._task is None or self._task.done()):
            self._task = self._viewer.start(self._draw_latest_request())

    def stop(self) -> None:
        """Cancel the drawing that is under way, and forget the requested one."""
        if self._task is not None:
            self._task.cancel()
        self._wanted, self._drawn, self._draw, self._task = (), (), None, None

    async def _draw_latest_request(self) -> None:
        while self._draw is not None and self._wanted != self._drawn:
            drawn = self._drawn = self._wanted
            try:
                async with aclosing(self._draw()) as shows:
                    async for show in shows:
                        self._show_unless_outdated(drawn[0], show)
                        await asyncio.sleep(self._pause)
                        if self._wanted != drawn:
                            break
            except RattleError as error:
                self._show_unless_outdated(drawn[0], partial(self._show_error, error))
                await asyncio.sleep(self._pause)

    def _show_unless_outdated(self, identity: Hashable, show: Show) -> None:
        self._viewer.schedule_document_change(lambda: show() if self._wanted[:1] == (identity,) else None)
