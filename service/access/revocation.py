"""End long-lived connections soon after their key is revoked or their browser signs out."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from typing import TYPE_CHECKING

from anyio import CancelScope
from sqlalchemy.exc import SQLAlchemyError
from starlette.concurrency import run_in_threadpool

if TYPE_CHECKING:
    from gear_rattle.service.access.keys import Caller
    from gear_rattle.service.database import Database
    from gear_rattle.service.database.keys import Identity

#: Seconds between two checks while a connection is open. The database is read, because another process may revoke keys.
CHECK_SECONDS = 0.5

log = logging.getLogger(__name__)


class RevocationWatcher:
    """A watcher that ends open streams and websockets when their callers lose authorisation.

    The watcher belongs to one event loop.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self._open: dict[CancelScope, Identity] = {}
        self._has_open = asyncio.Event()

    @contextmanager
    def cancel_when_revoked(self, caller: Caller | None) -> Iterator[CancelScope]:
        """Yield a scope that is cancelled when the caller is no longer authorised; never for a caller without a key."""
        with CancelScope() as scope:
            if caller is not None and (identity := caller.identity) is not None:
                self._open[scope] = identity
                self._has_open.set()
            try:
                yield scope
            finally:
                self._open.pop(scope, None)

    @asynccontextmanager
    async def lifespan(self) -> AsyncIterator[None]:
        """Check the callers of open connections during this context, twice a second."""
        looking = asyncio.create_task(self._cancel_revoked_connections())
        try:
            yield
        finally:
            looking.cancel()
            with suppress(asyncio.CancelledError):
                await looking

    async def _cancel_revoked_connections(self) -> None:
        while True:
            await self._has_open.wait()
            await asyncio.sleep(CHECK_SECONDS)
            if not self._open:
                self._has_open.clear()
                continue
            asked = dict(self._open)
            try:
                still = await run_in_threadpool(self._database.live_identities, set(asked.values()))
            except SQLAlchemyError as error:
                log.warning("the database cannot be read to see whether keys were revoked: %s", error)
                continue
            for scope, identity in asked.items():
                if identity not in still:
                    scope.cancel()
