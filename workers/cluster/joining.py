"""Tasks on a cluster that complete a survey: its join, its levels and its certificates."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from distributed import Client, KilledWorker

from gear_rattle.workers.cluster.cluster import end_tasks_and_wait
from gear_rattle.workers.cluster.in_flight import InFlight, Task
from gear_rattle.workers.cluster.submission import LOST, WORKERLESS_SECONDS
from gear_rattle.workers.errors import StoppedError, SurveyError
from gear_rattle.workers.survey.request import SurveyRequest
from gear_rattle.workers.survey.tiles import POLL_SECONDS

#: Attempts at a task, each of which ends after two dead workers.
ATTEMPTS = 3
SEVERAL = 8  # tasks for each thread, where further ones are submitted only after all have ended


@dataclass(frozen=True)
class _Item:
    """Number of a task's arguments, and the attempt at it."""

    number: int
    attempt: int


class Joining(InFlight[_Item, Any]):
    """Runs the tasks that complete a survey on a cluster; `each` is the argument of `complete`."""

    def __init__(self, client: Client, should_stop: Callable[[], bool]) -> None:
        """Take a function that says, several times a second, whether to stop."""
        super().__init__(client, "join", LOST)
        self._should_stop = should_stop
        self._waiting = deque[_Item]()

    def each(
        self, task: Callable[..., Any], request: SurveyRequest, path: str, items: Sequence[tuple[Any, ...]]
    ) -> list[Any]:
        """Run a task for each of these items, as `map` does."""
        return self.map(task, [(request, path, *item) for item in items])

    def map(self, task: Callable[..., Any], items: Sequence[tuple[Any, ...]]) -> list[Any]:
        """Run a task with each of these arguments, as many at a time as the cluster has threads.

        Returns
        -------
        list[Any]
            Results in the order of the arguments.

        Raises
        ------
        ClusterLostError
            The cluster is gone.
        StoppedError
            `should_stop` returned true; no process computes any of the tasks then.
        SurveyError
            A task cannot be done.
        """
        found = [None] * len(items)
        self._waiting = deque(_Item(number, 1) for number in range(len(items)))
        try:
            while self._waiting or self.in_flight:
                if self._should_stop():
                    raise StoppedError("stopped while the survey was completed")
                room = self.threads(WORKERLESS_SECONDS) - len(self.in_flight)
                for _ in range(min(room, len(self._waiting))):
                    item = self._waiting.popleft()
                    self.put(item, task, *items[item.number])
                if ended := self.next_ended(POLL_SECONDS):
                    done, result = ended
                    found[done.work.number] = result
                    self.drop(done.work.__eq__)
        finally:
            if futures := [task.future for task in self.in_flight.values()]:
                self.in_flight.clear()
                end_tasks_and_wait(self._client, futures)
        return found

    def several(self) -> int:
        """Return a number of tasks that keeps every thread busy for long."""
        return SEVERAL * max(self.threads(WORKERLESS_SECONDS), 1)

    def after_error(self, task: Task[_Item], error: BaseException) -> None:
        """Repeat a task after a worker's death; raise any other error."""
        self.drop(task.work.__eq__)
        if not isinstance(error, KilledWorker):
            raise error
        if task.work.attempt == ATTEMPTS:
            raise SurveyError(
                "the process that joins the blocks of the survey was killed repeatedly: see the log of the workers"
            ) from error
        self._waiting.append(_Item(task.work.number, task.work.attempt + 1))
