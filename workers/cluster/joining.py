"""On a cluster, the tasks by which a survey is completed: those of its join, of its levels and of its certificates."""

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

#: At a task, of two deaths each, as at a template.
ATTEMPTS = 3
SEVERAL = 8  # tasks of each thread, where the next are submitted when all have ended


@dataclass(frozen=True)
class _Item:
    """One of those that a task is done for, and the attempt at it."""

    number: int
    attempt: int


class Joining(InFlight[_Item, Any]):
    """Tasks for each part of a survey on a cluster: `each` is that of `complete`."""

    def __init__(self, client: Client, should_stop: Callable[[], bool]) -> None:
        """Take what is asked several times a second whether this shall stop."""
        super().__init__(client, "join", LOST)
        self._should_stop = should_stop
        self._waiting = deque[_Item]()

    def each(
        self, task: Callable[..., Any], request: SurveyRequest, path: str, items: Sequence[tuple[Any, ...]]
    ) -> list[Any]:
        """Do a task for each of these; as `map`."""
        return self.map(task, [(request, path, *item) for item in items])

    def map(self, task: Callable[..., Any], items: Sequence[tuple[Any, ...]]) -> list[Any]:
        """Do a task with each of these arguments, as many as the cluster has threads at a time; results in order.

        Returns
        -------
        list[Any]
            Results, in order.

        Raises
        ------
        StoppedError
            Because `should_stop` said so; no process computes any of it then.
        SurveyError
            It cannot be done.
        ClusterLostError
            The cluster is gone.
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
        """Return how many tasks keep every thread busy for long, whatever each takes."""
        return SEVERAL * max(self.threads(WORKERLESS_SECONDS), 1)

    def after_error(self, task: Task[_Item], error: BaseException) -> None:
        """Go on after a worker's death, raise anything else."""
        self.drop(task.work.__eq__)
        if not isinstance(error, KilledWorker):
            raise error
        if task.work.attempt == ATTEMPTS:
            raise SurveyError(
                "the survey killed the process that completed it, block by block: look at the log"
            ) from error
        self._waiting.append(_Item(task.work.number, task.work.attempt + 1))
