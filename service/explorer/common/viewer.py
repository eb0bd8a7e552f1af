"""One open page: its caller, the permissions of the caller, and slow work in threads whose results change the page."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Coroutine
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any, TypeVar

from starlette.concurrency import run_in_threadpool

from gear_rattle.service.access.keys import Caller
from gear_rattle.service.database.tables import Scope
from gear_rattle.service.errors import ForbiddenError, UnauthorizedError
from gear_rattle.service.explorer.common.changes import change_document
from gear_rattle.service.operations.surveys import current_caller
from gear_rattle.service.state import ApplicationState
from rattle import RattleError

if TYPE_CHECKING:
    from bokeh.document import Document

#: Caller whose request builds the current page. The route sets it.
CALLER: ContextVar[Caller | None] = ContextVar("caller", default=None)

#: Most threads that one page uses at once, including threads whose results are no longer wanted.
THREADS = 8

Result = TypeVar("Result")
log = logging.getLogger(__name__)


class PageSession:
    """Session of one open page: its caller, its tasks, and its document, which only the event loop may change."""

    def __init__(self, front: ApplicationState, caller: Caller | None, document: Document) -> None:
        self.front, self.document = front, document
        self._caller = caller
        self._tasks: set[asyncio.Task[Any]] = set()
        self._threads = asyncio.Semaphore(THREADS)
        # function that shows a message to the viewer; until the page replaces it, messages go to the log
        self.show_message: Callable[[str], None] = log.warning
        self.ended = False

    def require_scope(self, scope: Scope) -> Caller:
        """Return the caller if its API key still has a scope. This method reads the database: call it in a thread.

        Returns
        -------
        Caller
            The caller.

        Raises
        ------
        UnauthorizedError
            The caller's key was revoked, the caller has signed out, or there is no caller.
        ForbiddenError
            The caller's key does not have the scope.
        """
        if self._caller is None:
            raise UnauthorizedError("Sign in to see this page.")
        caller = current_caller(self.front, self._caller)
        if caller is None:
            raise UnauthorizedError("Your API key was revoked, or you have signed out. Sign in again.")
        if not caller.has_scope(scope):
            raise ForbiddenError(f"Your API key can only read. This action needs a key with the scope {scope}.")
        return caller

    @property
    def caller(self) -> Caller:
        """Caller that opened the page, even if its key was revoked since; a caller without a key if there was none."""
        return self._caller or Caller()

    @property
    def is_signed_in(self) -> bool:
        """True if the page was opened with an API key."""
        return self._caller is not None and self._caller.key is not None

    def may_submit(self) -> bool:
        """Return whether the caller may submit surveys."""
        return self._caller is not None and self._caller.has_scope(Scope.SUBMIT)

    async def run_in_thread(self, work: Callable[[], Result], scope: Scope = Scope.READ) -> Result:
        """Run `work` in a thread if the caller's API key has a scope, and return the result.

        A page has at most THREADS threads. A running thread cannot be cancelled, and counts until it ends. Work that is
        cancelled while it waits for a free thread never begins.

        Returns
        -------
        Result
            The return value of `work`.
        """
        return await self.run_as_caller(lambda _caller: work(), scope)

    async def run_as_caller(self, act: Callable[[Caller], Result], scope: Scope) -> Result:
        """Call `act(caller)` in a thread if the caller's API key has a scope, and return the result.

        Returns
        -------
        Result
            The return value of `act`.
        """

        def run() -> Result:
            return act(self.require_scope(scope))

        await self._threads.acquire()
        thread = asyncio.ensure_future(run_in_threadpool(run))
        thread.add_done_callback(self._release_thread)
        return await asyncio.shield(thread)

    def _release_thread(self, thread: asyncio.Future[Any]) -> None:
        self._threads.release()
        if not thread.cancelled():
            thread.exception()  # otherwise asyncio warns that the exception of a cancelled task was never retrieved

    def start(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        """Start a task that is cancelled when the page is closed. An error of the task is shown on the page."""
        task = asyncio.get_running_loop().create_task(self._run_and_report(work))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        # if the task is cancelled before it starts, Python would otherwise warn that the coroutine was never awaited
        task.add_done_callback(lambda _task: work.close())
        return task

    async def _run_and_report(self, work: Awaitable[None]) -> None:
        try:
            await work
        except RattleError as error:
            self.show_message(str(error))
        except asyncio.CancelledError:
            raise
        except Exception:
            log.exception("a page of the explorer failed")
            self.show_message(
                "A part of this page could not be shown because of an error of the service, which is in its log."
            )

    def schedule_document_change(self, act: Callable[[], object]) -> None:
        """Schedule a call of `act`, which changes the document, at a time without another change of the document.

        Nothing is scheduled after the page was closed.
        """
        if not self.ended:
            change_document(self.document, act)

    def end(self) -> None:
        """Cancel the tasks of a page that was closed. No task changes its document any more."""
        self.ended = True
        for task in tuple(self._tasks):
            task.cancel()
