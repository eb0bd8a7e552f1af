"""Run the tasks that complete a survey on a cluster: its families, levels and certificates."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from distributed import Client, KilledWorker

from gear_rattle.workers.cluster.cluster import end_tasks_and_wait
from gear_rattle.workers.cluster.in_flight import ClusterTask, SubmittedTasks
from gear_rattle.workers.cluster.submission import LOST, WORKERLESS_SECONDS
from gear_rattle.workers.errors import StoppedError, SurveyError
from gear_rattle.workers.survey.request import SurveyRequest
from gear_rattle.workers.survey.tiles import POLL_SECONDS

#: A task is attempted at most this many times; an attempt fails when two workers have died during it.
ATTEMPTS = 3
#: A batch has this many tasks for each thread. The next batch begins when all tasks of the batch have ended.
TASKS_PER_THREAD = 8


@dataclass(frozen=True)
class _TaskAttempt:
    """An attempt at a task. number: index of the task's item in the list of items. attempt: 1 for the first attempt."""

    number: int
    attempt: int


class CompletionTasks(SubmittedTasks[_TaskAttempt, Any]):
    """The tasks that complete a survey, run on a cluster. `complete` calls the method `run_for_each`."""

    def __init__(self, client: Client, should_stop: Callable[[], bool]) -> None:
        """Store the client. should_stop: returns whether to stop; it is called several times a second."""
        super().__init__(client, "join", LOST)
        self._should_stop = should_stop
        self._waiting = deque[_TaskAttempt]()

    def run_for_each(
        self, task: Callable[..., Any], request: SurveyRequest, path: str, items: Sequence[tuple[Any, ...]]
    ) -> list[Any]:
        """Run `task(request, path, *item)` for each item, as `map` does, and return the results in their order."""
        return self.map(task, [(request, path, *item) for item in items])

    def map(self, task: Callable[..., Any], items: Sequence[tuple[Any, ...]]) -> list[Any]:
        """Run `task(*item)` for each item, as many at a time as the cluster has threads.

        Returns
        -------
        list[Any]
            Results in the order of the items.

        Raises
        ------
        ClusterLostError
            The cluster is gone.
        StoppedError
            `should_stop` returned true. No process computes any of the tasks any more.
        SurveyError
            A task failed, or killed its worker repeatedly.
        """
        found = [None] * len(items)
        self._waiting = deque(_TaskAttempt(number, 1) for number in range(len(items)))
        try:
            while self._waiting or self.in_flight:
                if self._should_stop():
                    raise StoppedError("stopped after the tiles, during the steps that complete the survey")
                room = self.count_threads(WORKERLESS_SECONDS) - len(self.in_flight)
                for _ in range(min(room, len(self._waiting))):
                    item = self._waiting.popleft()
                    self.submit_task(item, task, *items[item.number])
                if ended := self.next_result(POLL_SECONDS):
                    done, result = ended
                    found[done.work.number] = result
                    self.forget_tasks(done.work.__eq__)
        finally:
            if futures := [task.future for task in self.in_flight.values()]:
                self.in_flight.clear()
                end_tasks_and_wait(self._client, futures)
        return found

    def count_batch_tasks(self) -> int:
        """Return the number of tasks of a batch: several for each thread, so that the threads are seldom idle."""
        return TASKS_PER_THREAD * max(self.count_threads(WORKERLESS_SECONDS), 1)

    def handle_error(self, task: ClusterTask[_TaskAttempt], error: BaseException) -> None:
        """Queue a task again if it killed its worker, for at most ATTEMPTS attempts. Raise any other error."""
        self.forget_tasks(task.work.__eq__)
        if not isinstance(error, KilledWorker):
            raise error
        if task.work.attempt == ATTEMPTS:
            raise SurveyError(
                "a task that completes the survey killed its worker repeatedly: see the log of the workers"
            ) from error
        self._waiting.append(_TaskAttempt(task.work.number, task.work.attempt + 1))
