"""One open page: who looks at it, what it may do, and how its slow work gets into threads and back."""

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
from gear_rattle.service.explorer.common.changes import change_and_wait, change_document
from gear_rattle.service.state import Front
from rattle import RattleError

if TYPE_CHECKING:
    from bokeh.document import Document

#: Who asked for the page that is being built; set by the route.
CALLER: ContextVar[Caller | None] = ContextVar("caller", default=None)

#: Of a page at a time, with those whose work nobody waits for any more.
THREADS = 8

Result = TypeVar("Result")
log = logging.getLogger(__name__)


class Viewer:
    """Viewer of a page, and its document, which only the event loop may touch."""

    def __init__(self, front: Front, caller: Caller | None, document: Document) -> None:
        self.front, self.document = front, document
        self._caller = caller
        self._tasks: set[asyncio.Task[Any]] = set()
        self._threads = asyncio.Semaphore(THREADS)
        self.tell: Callable[[str], None] = log.warning  # the page replaces it by something that can be seen
        self.ended = False

    def require(self, scope: Scope) -> Caller:
        """Return the caller, if it still may. Reads the database: for a thread.

        Returns
        -------
        Caller
            The caller.

        Raises
        ------
        UnauthorizedError
            Its key was revoked, or there is none.
        ForbiddenError
            Its key does not allow this.
        """
        if self._caller is None:
            raise UnauthorizedError("Sign in to see this page.")
        if self._caller.key is None:
            return self._caller
        database, session = self.front.database, self._caller.session
        key = database.key_by_hash(self._caller.key.hash) if session is None else database.key_by_session(session)
        if key is None:
            raise UnauthorizedError("Your API key was revoked, or you have signed out. Sign in again.")
        caller = Caller(key, session)
        if not caller.may(scope):
            raise ForbiddenError(f"Your API key may look only: this needs one with the scope {scope}.")
        return caller

    @property
    def caller(self) -> Caller:
        """Caller that opened the page, whether it still may or not."""
        return self._caller or Caller()

    @property
    def signed_in(self) -> bool:
        """True if a key is the reason that this page is allowed."""
        return self._caller is not None and self._caller.key is not None

    def may_submit(self) -> bool:
        """Return whether the caller may submit surveys."""
        return self._caller is not None and self._caller.may(Scope.SUBMIT)

    async def read(self, work: Callable[[], Result], scope: Scope = Scope.READ) -> Result:
        """Return the result of `work`, from a thread, if the caller may.

        A thread cannot be given up: it has its place until it ends. What is given up while it waits for one never
        begins.

        Returns
        -------
        Result
            The return value of `work`.
        """

        def run() -> Result:
            self.require(scope)
            return work()

        await self._threads.acquire()
        thread = asyncio.ensure_future(run_in_threadpool(run))
        thread.add_done_callback(self._leave)
        return await asyncio.shield(thread)

    def _leave(self, thread: asyncio.Future[Any]) -> None:
        self._threads.release()
        if not thread.cancelled():
            thread.exception()  # nobody asks for that of work that was given up

    def start(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        """Run this beside the page until the page is closed; what it may not or cannot do is told on the page."""
        task = asyncio.get_running_loop().create_task(self._guarded(work))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        task.add_done_callback(lambda _task: work.close())  # given up before it began, it would be complained of
        return task

    async def _guarded(self, work: Awaitable[None]) -> None:
        try:
            await work
        except RattleError as error:
            self.tell(str(error))
        except asyncio.CancelledError:
            raise
        except Exception:
            log.exception("a page of the explorer failed")
            self.tell("This could not be shown: an error of the service, which has been logged.")

    def change(self, what: Callable[[], object]) -> None:
        """Change the document when nothing else does."""
        if not self.ended:
            change_document(self.document, what)

    async def changed(self, what: Callable[[], object]) -> None:
        """Change the document, and wait until that is done."""
        await change_and_wait(self.document, what)

    def end(self) -> None:
        """Release the page's resources once it is closed."""
        self.ended = True
        for task in tuple(self._tasks):
            task.cancel()
