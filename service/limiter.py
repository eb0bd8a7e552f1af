"""Limit the number of concurrent computations. Foreground computations pre-empt background ones."""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import TypeVar

from anyio import CancelScope, CapacityLimiter, Event

Result = TypeVar("Result")


class PriorityLimiter:
    """A limiter of concurrent computations. Foreground computations pre-empt background ones."""

    def __init__(self, number: int) -> None:
        self._limiter = CapacityLimiter(number)
        self._background_scopes: list[
            CancelScope
        ] = []  # scopes of the running background computations, the newest last
        self._waiting = 0
        self._nobody_waits = Event()
        self._nobody_waits.set()

    @asynccontextmanager
    async def foreground_slot(self) -> AsyncIterator[None]:
        """Wait until the limit allows another computation, and count this context as a foreground computation.

        If the limit is reached, the newest background computation is cancelled, and begins again later.
        """
        self._waiting += 1
        if self._waiting == 1:
            self._nobody_waits = Event()
        try:
            if self._limiter.available_tokens < 1 and self._background_scopes:
                self._background_scopes.pop().cancel()
            await self._limiter.acquire_on_behalf_of(slot := object())
        finally:
            self._waiting -= 1
            if not self._waiting:
                self._nobody_waits.set()
        try:
            yield
        finally:
            self._limiter.release_on_behalf_of(slot)

    async def run_in_background(self, compute: Callable[[], Awaitable[Result]]) -> Result:
        """Run `compute` when the limit allows it and no foreground computation waits, and return the result.

        Returns
        -------
        Result
            The result of the first call of `compute` that is not pre-empted; a pre-empted call is repeated.
        """
        while True:
            await self._nobody_waits.wait()
            async with self._limiter:
                if self._waiting:
                    continue
                with CancelScope() as scope:
                    self._background_scopes.append(scope)
                    try:
                        return await compute()
                    finally:
                        if scope in self._background_scopes:
                            self._background_scopes.remove(scope)
