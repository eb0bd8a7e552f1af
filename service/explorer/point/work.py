"""Run the tasks of the view of one point. Other processes compute its parts. Tasks end soon after their view."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Awaitable, Callable, Coroutine
from contextlib import nullcontext
from html import escape
from typing import TYPE_CHECKING, Any, TypeVar, TypeVarTuple

import anyio

import rattle
from gear_rattle.service.explorer.common.changes import change_and_wait
from gear_rattle.service.explorer.common.text import TextPane, alert_html
from gear_rattle.service.explorer.point import parts
from gear_rattle.service.operations.processes import compute_in_process
from gear_rattle.service.state import ApplicationState
from rattle import RattleError
from rattle.models import DEFAULT_MODEL

if TYPE_CHECKING:
    from bokeh.document import Document

GRACE_SECONDS = 15.0  # seconds before an abandoned task is cancelled; the cancellation ends the process that runs it

Result = TypeVar("Result")
Arguments = TypeVarTuple("Arguments")
log = logging.getLogger(__name__)


async def prepare_processes(front: ApplicationState) -> None:
    """Start the processes that compute points, and load their kernels, so that the first click is not a slow one."""
    async with anyio.create_task_group() as tasks:
        for _ in range(front.settings.max_points):
            tasks.start_soon(_load_kernels_in_process, front)


async def _load_kernels_in_process(front: ApplicationState) -> None:
    try:
        await compute_in_process(
            front,
            parts.load_point_kernels,
            rattle.Gear(0.6, 0.1),
            model=DEFAULT_MODEL,
            what="The kernels",
            advice="",
        )
    except RattleError as error:  # no harm: the first clicked point then loads the kernels in its process
        log.info("no process is ready for points yet: %s", error)


def waiting_html(what: str) -> str:
    """Return an HTML message which says that `what`, a noun such as "the diagram", is being computed."""
    return f'<p class="faint" role="status">computing {escape(what)} …</p>'


class PointTasks:
    """The tasks that the view of one point runs in the event loop. document: None if no page shows the view."""

    def __init__(self, front: ApplicationState, document: Document | None, model: str) -> None:
        self._front, self._document = front, document
        self._model = model
        self.tasks: set[asyncio.Task[None]] = set()
        self.stopped = False

    def start(self, work: Coroutine[Any, Any, None], replaced: asyncio.Task[None] | None = None) -> asyncio.Task[None]:
        """Start a task, and give up the task `replaced`, if there is one."""
        self.cancel_after_grace(replaced)
        task = asyncio.get_running_loop().create_task(work)
        self.tasks.add(task)
        task.add_done_callback(self.tasks.discard)
        return task

    def stop(self) -> None:
        """Give up all tasks: no new computation begins, and running ones are cancelled after GRACE_SECONDS."""
        self.stopped = True
        for task in tuple(self.tasks):
            self.cancel_after_grace(task)

    def cancel_after_grace(self, task: asyncio.Task[None] | None) -> None:
        """Cancel a task, if there is one, unless it ends within GRACE_SECONDS."""
        if task is not None:
            task.get_loop().call_later(GRACE_SECONDS, task.cancel)

    async def wait_for_kernels(self) -> None:
        """Wait, as long as it takes, until the kernels of the model are compiled."""
        await self._front.kernels.wait_until_compiled(self._model, patience=math.inf)
        self._require_open()

    async def compute(
        self, compute: Callable[[*Arguments], Result], *arguments: *Arguments, what: str, slow: bool = False
    ) -> Result:
        """Return the result of a function, computed in another process.

        what: the result in words, for messages. slow: True for a function that takes long. Slow functions leave one
        process free for quick ones, unless the service has only one process for points.

        Returns
        -------
        Result
            The return value of the function.

        Raises
        ------
        UnavailableError
            Too many computations wait, or the function takes too long.
        """
        await self.wait_for_kernels()
        async with self._front.slow_point_limiter.foreground_slot() if slow else nullcontext():
            self._require_open()
            found = await compute_in_process(
                self._front,
                compute,
                *arguments,
                model=self._model,
                what=what,
                advice="Choose another point, or try again later.",
            )
        self._require_open()
        return found

    def _require_open(self) -> None:
        """Raise CancelledError, which ends the calling task, if the view has ended."""
        if self.stopped:
            raise asyncio.CancelledError

    async def run_part_or_show_error(self, text: TextPane, work: Callable[[], Awaitable[None]]) -> None:
        """Run `work`, which computes and shows one part of a view. If it fails, `text` shows the error."""
        try:
            await work()
        except RattleError as error:
            await self._show_error(text, str(error))
        except Exception:
            log.exception("a part of the view of a point failed")
            await self._show_error(
                text, "This part could not be shown because of an error of the service, which is in its log."
            )

    async def _show_error(self, text: TextPane, message: str) -> None:
        await self.set_text(text, alert_html(message, "wrong"))

    async def set_text(self, text: TextPane, html: str) -> None:
        """Set the HTML of a text of the page. Raises CancelledError if the view has ended."""

        def change() -> None:
            text.html = html

        await self.apply_document_change(change)

    async def apply_document_change(self, action: Callable[[], object]) -> None:
        """Run `action`, which changes the document, and wait for it. Raises CancelledError if the view has ended."""
        self._require_open()
        if self._document is None or self._document.session_context is None:
            action()
            return
        await change_and_wait(self._document, lambda: None if self.stopped else action())
