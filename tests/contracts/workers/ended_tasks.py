"""Enough of dask's client and futures for tasks that end as they begin, or never."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any


class Future:
    """A task that has ended, or does not."""

    def __init__(self, key: str, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        self.key, self.status, self._error, self._result = key, "finished", None, None
        try:
            self._result = function(*arguments)
        except Exception as error:
            self.status, self._error = "error", error

    def add_done_callback(self, function: Callable[..., None]) -> None:
        if self._result is not ENDLESS:
            function(self)

    def result(self) -> Any:
        if self._error:
            raise self._error
        return self._result

    def exception(self) -> Any:
        return self._error

    def release(self) -> None:
        pass


ENDLESS = object()


class Client:
    """Enough of dask's for tasks that end as they begin."""

    status = "running"

    def __init__(self, threads: int) -> None:
        self._threads = threads

    def nthreads(self) -> dict[str, int]:
        return {"one": 1, "other": self._threads - 1}

    @property
    def loop(self) -> "Client":
        return self

    def add_callback(self, function: Callable[..., Coroutine[Any, Any, None]], *arguments: Any) -> None:
        asyncio.run(function(*arguments))

    async def gather(self, future: Future, **_: Any) -> Any:
        return future.result()

    def submit(self, function: Callable[..., Any], *arguments: Any, key: str, **_: Any) -> Future:
        return Future(key, function, arguments)
