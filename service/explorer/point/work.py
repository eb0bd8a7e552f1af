"""The work of one view of a parameter point: parts computed in processes, shown in its document, given up together."""

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
from gear_rattle.service.explorer.common.text import Text
from gear_rattle.service.explorer.point import parts
from gear_rattle.service.operations.turns import in_turn
from gear_rattle.service.state import Front
from rattle import RattleError
from rattle.models import DEFAULT_MODEL

if TYPE_CHECKING:
    from bokeh.document import Document

GRACE_SECONDS = 15.0  # what is at work when the view is put away may end by itself: its process stays warm

Result = TypeVar("Result")
Arguments = TypeVarTuple("Arguments")
log = logging.getLogger(__name__)


async def prepare(front: Front) -> None:
    """Start the processes that compute points, with their kernels loaded: the first click is as quick as any."""
    async with anyio.create_task_group() as tasks:
        for _ in range(front.settings.max_points):
            tasks.start_soon(_prepare_one, front)


async def _prepare_one(front: Front) -> None:
    try:
        await in_turn(
            front,
            parts.warm_up,
            rattle.Gear(0.6, 0.1),
            model=DEFAULT_MODEL,
            what="The kernels",
            advice="",
        )
    except RattleError as error:  # the first click will do it
        log.info("no process is ready for points yet: %s", error)


def waiting(what: str) -> str:
    """HTML in the place of what is being computed."""
    return f'<p class="faint" role="status">computing {escape(what)} …</p>'


class Work:
    """Tasks of the view of a model's point in the event loop; `document` is None where nobody looks, as in a test."""

    def __init__(self, front: Front, document: Document | None, model: str) -> None:
        self._front, self._document = front, document
        self._model = model
        self.tasks: set[asyncio.Task[None]] = set()
        self.stopped = False

    def start(
        self, work: Coroutine[Any, Any, None], instead_of: asyncio.Task[None] | None = None
    ) -> asyncio.Task[None]:
        """Begin something, and give up what it replaces."""
        if instead_of is not None:
            self._give_up(instead_of)
        task = asyncio.get_running_loop().create_task(work)
        self.tasks.add(task)
        task.add_done_callback(self.tasks.discard)
        return task

    def stop(self) -> None:
        """Give up everything: what is not begun at once, what is at work after a moment."""
        self.stopped = True
        for task in tuple(self.tasks):
            self._give_up(task)

    def _give_up(self, task: asyncio.Task[None]) -> None:
        task.get_loop().call_later(GRACE_SECONDS, task.cancel)

    async def kernels(self) -> None:
        """Wait, as long as it takes, until the kernels of the model are there."""
        await self._front.kernels.require(self._model, patience=math.inf)
        self._require()

    async def compute(
        self, compute: Callable[[*Arguments], Result], *arguments: *Arguments, what: str, slow: bool = False
    ) -> Result:
        """Return the result of a function, from a process of its own. Slow ones never take all processes.

        Raises UnavailableError.

        Returns
        -------
        Result
            The return value of the function.
        """
        await self.kernels()
        async with self._front.slow_points.one() if slow else nullcontext():
            self._require()
            found = await in_turn(
                self._front,
                compute,
                *arguments,
                model=self._model,
                what=what,
                advice="Choose another point, or try again later.",
            )
        self._require()
        return found

    def _require(self) -> None:
        """End the task that asks, if the view has been put away."""
        if self.stopped:
            raise asyncio.CancelledError

    async def part(self, text: Text, work: Callable[[], Awaitable[None]]) -> None:
        """Do one part of a view; why it cannot be shown is told in its text, and the other parts go on."""
        try:
            await work()
        except RattleError as error:
            await self._refuse(text, str(error))
        except Exception:
            log.exception("a part of the view of a point failed")
            await self._refuse(text, "This could not be shown: an error of the service, which has been logged.")

    async def _refuse(self, text: Text, message: str) -> None:
        await self.tell(text, f'<p class="wrong" role="alert">{escape(message)}</p>')

    async def tell(self, text: Text, html: str) -> None:
        """Change a text."""

        def change() -> None:
            text.html = html

        await self.change(change)

    async def change(self, what: Callable[[], object]) -> None:
        """Change the document when nothing else does, and wait until that is done; not if the view is put away."""
        self._require()
        if self._document is None or self._document.session_context is None:
            what()
            return
        await change_and_wait(self._document, lambda: None if self.stopped else what())
