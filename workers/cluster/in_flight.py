"""Tasks on a cluster: submit them, wait until they end, and distinguish a failed task from a lost cluster."""

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
class ClusterTask(Generic[Work]):
    """A submitted task. work: the item to compute, such as a tile. submitted_at: time.monotonic() at submission."""

    future: Future
    work: Work
    submitted_at: float


class SubmittedTasks(ABC, Generic[Work, Result]):
    """The submitted tasks of one run. Subclasses decide the order of submission and the response to failures."""

    def __init__(self, client: Client, name: str, lost: str) -> None:
        """Store the client. name: prefix of the tasks' keys in dask. lost: message for a lost scheduler."""
        self._client, self._lost_message = client, lost
        self._loop = cast("IOLoop", client.loop)
        self._name = f"{name}-{uuid4().hex}"  # unique, so that dask does not confuse the tasks of two runs
        self._submitted = 0
        self._ended: SimpleQueue[tuple[Future, Any, BaseException | None]] = SimpleQueue()
        self._workers_seen = time.monotonic()
        self.in_flight: dict[Key, ClusterTask[Work]] = {}

    @abstractmethod
    def handle_error(self, task: ClusterTask[Work], error: BaseException) -> None:
        """Respond to a failed task, for example submit its work again, or raise an error."""

    def count_threads(self, patience: float) -> int:
        """Return the number of the cluster's threads.

        Returns
        -------
        int
            0 while the cluster has no workers.

        Raises
        ------
        ClusterLostError
            The scheduler is gone, or the cluster has had no workers for `patience` seconds.
        """
        try:
            threads = sum(self._client.nthreads().values())
        except Exception as error:  # a client that was closed meanwhile raises errors of several types
            raise self.lost_scheduler_error() from error
        now = time.monotonic()
        if threads:
            self._workers_seen = now
        elif now - self._workers_seen > patience:
            raise ClusterLostError(f"the cluster has had no workers for {patience:.0f} s: start workers")
        return threads

    def submit_task(self, work: Work, function: Callable[..., Result], *arguments: Any, **options: Any) -> None:
        """Submit a task that calls `function(*arguments)`.

        work: item that the task computes. options: arguments of dask's `Client.submit`.
        """
        self._submitted += 1
        key = f"{self._name}-{self._submitted}"
        try:
            future = self._client.submit(function, *arguments, key=key, pure=False, **options)
        except Exception as error:
            raise self.lost_scheduler_error() from error
        self.in_flight[key] = ClusterTask(future, work, time.monotonic())
        future.add_done_callback(partial(self._loop.add_callback, self._queue_result))

    def next_result(self, seconds: float) -> tuple[ClusterTask[Work], Result] | None:
        """Wait until a task ends, and return the task with its result. A failed task is passed to `handle_error`.

        Returns
        -------
        tuple[ClusterTask[Work], Result] | None
            None if no task ends within `seconds`, if `forget_tasks` has removed the ended task, or if it failed and
            `handle_error` raised no error.

        Raises
        ------
        ClusterLostError
            The scheduler is gone. `handle_error` may raise other errors.
        """
        try:
            future, result, error = self._ended.get(timeout=seconds)
        except Empty:
            return None
        task = self.in_flight.get(future.key)
        if task is None:  # `forget_tasks` has removed the task
            return None
        if error is None:
            return task, result
        if future.status == "error":
            self.handle_error(task, future.exception())
            return None
        if isinstance(error, CANCELLED | OSError):  # no other code cancels tasks, so the scheduler is gone
            raise self.lost_scheduler_error() from error
        raise error

    async def _queue_result(self, future: Future) -> None:
        """Wait for a task, and queue its result or error.

        If the worker dies before it has sent the result, dask computes the task again. Each result is requested once
        only, because a client has few requests open at a time, and requests to a frozen worker stay open.
        """
        result, error = None, None
        try:
            result = await self._client.gather(future, asynchronous=True)
        except (Exception, asyncio.CancelledError) as failed:
            error = failed
        self._ended.put((future, result, error))

    def forget_tasks(self, condition: Callable[[Work], bool]) -> None:
        """Remove the tasks whose work meets `condition`. The scheduler cancels them, or drops their results.

        Finished tasks must be removed, too: otherwise, if a worker died, dask would compute its finished tasks again.
        """
        for key, task in list(self.in_flight.items()):
            if condition(task.work):
                del self.in_flight[key]
                task.future.release()

    def lost_scheduler_error(self) -> ClusterLostError:
        """Return the error for a lost scheduler."""
        return ClusterLostError(self._lost_message)
