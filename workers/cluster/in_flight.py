"""Tasks that are on a cluster: submitted, awaited as they end, and told apart from a cluster that is gone."""

import asyncio
import concurrent.futures
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, Generic, TypeVar, cast
from uuid import uuid4

from dask.typing import Key
from distributed import Client, Future

from gear_rattle.workers.errors import ClusterLostError

if TYPE_CHECKING:
    from tornado.ioloop import IOLoop

CANCELLED = asyncio.CancelledError | concurrent.futures.CancelledError

Work = TypeVar("Work")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Task(Generic[Work]):
    """A piece of work on the cluster."""

    future: Future
    work: Work
    began: float


class InFlight(ABC, Generic[Work, Result]):
    """The tasks of one run that are on a cluster. What is submitted next and what is done about a failure differs."""

    def __init__(self, client: Client, name: str, lost: str) -> None:
        """Take the name that keys begin with, and what is said when the scheduler is gone."""
        self._client, self._lost = client, lost
        self._loop = cast("IOLoop", client.loop)
        self._name = f"{name}-{uuid4().hex}"  # keys of another run must not be taken for this one's
        self._submitted = 0
        self._ended: SimpleQueue[tuple[Future, Any, BaseException | None]] = SimpleQueue()
        self._workers_seen = time.monotonic()
        self.in_flight: dict[Key, Task[Work]] = {}

    @abstractmethod
    def after_error(self, task: Task[Work], error: BaseException) -> None:
        """Go on after a task has failed, or raise."""

    def threads(self, patience: float) -> int:
        """Return how many threads the cluster has; it may be without workers for so many seconds."""
        try:
            threads = sum(self._client.nthreads().values())
        except Exception as error:  # whatever a client says that has been closed meanwhile
            raise self.lost() from error
        now = time.monotonic()
        if threads:
            self._workers_seen = now
        elif now - self._workers_seen > patience:
            raise ClusterLostError(f"the cluster has had no workers for {patience:.0f} s: start some")
        return threads

    def put(self, work: Work, function: Callable[..., Result], *arguments: Any, **options: Any) -> None:
        """Submit a task, with options of dask's."""
        self._submitted += 1
        key = f"{self._name}-{self._submitted}"
        try:
            future = self._client.submit(function, *arguments, key=key, pure=False, **options)
        except Exception as error:
            raise self.lost() from error
        self.in_flight[key] = Task(future, work, time.monotonic())
        future.add_done_callback(partial(self._loop.add_callback, self._bring))

    def next_ended(self, seconds: float) -> tuple[Task[Work], Result] | None:
        """Return the next task that ends and its result; None if none is there in time."""
        try:
            future, result, error = self._ended.get(timeout=seconds)
        except Empty:
            return None
        task = self.in_flight.get(future.key)
        if task is None:  # given up meanwhile
            return None
        if error is None:
            return task, result
        if future.status == "error":
            self.after_error(task, future.exception())
            return None
        if isinstance(error, CANCELLED | OSError):  # nobody else cancels: the scheduler is gone
            raise self.lost() from error
        raise error

    async def _bring(self, future: Future) -> None:
        """Wait for a result for as long as its worker keeps it; if that dies, dask computes it again.

        Asked for once: each question waits at a frozen worker and takes one of the few that the client has at a time.
        """
        result, error = None, None
        try:
            result = await self._client.gather(future, asynchronous=True)
        except (Exception, asyncio.CancelledError) as failed:
            error = failed
        self._ended.put((future, result, error))

    def drop(self, belongs: Callable[[Work], bool]) -> None:
        """Forget tasks: nobody holds them, and the scheduler cancels what has not ended.

        Kept, a dead worker's finished tasks would be computed again.
        """
        for key, task in list(self.in_flight.items()):
            if belongs(task.work):
                del self.in_flight[key]
                task.future.release()

    def lost(self) -> ClusterLostError:
        """Return what is raised when the scheduler is gone."""
        return ClusterLostError(self._lost)
