"""The tiles of one run on the cluster: submit them, repeat late ones, wait for them, and cancel them."""

import math
import time
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass

from dask.typing import Key
from distributed import Client, Future, KilledWorker

from gear_rattle.workers.cluster.cluster import end_tasks
from gear_rattle.workers.cluster.in_flight import ClusterTask, SubmittedTasks
from gear_rattle.workers.cluster.partial import PART_SECONDS, PartialTile
from gear_rattle.workers.errors import SurveyError
from gear_rattle.workers.kinds import AnyRequest, AnyTile, tile_error, tile_name
from gear_rattle.workers.survey.tiles import TileRecord

#: A task is late if it takes longer than LATE_SECONDS and than LATE_FACTOR times the longest finished task of the run.
#: The worker of a late task may be frozen.
LATE_SECONDS, LATE_FACTOR = 30.0, 10
#: The task of a tile may take TILE_SECONDS on a worker. If the tile has more than TILE_CELLS cells, its task may take
#: proportionally longer, but at most LONGEST_FACTOR times as long. A usual task takes seconds.
TILE_CELLS, TILE_SECONDS, LONGEST_FACTOR = 4096, 900.0, 8.0
#: If the tasks of several tiles take too long, their workers are killed one after the other, at intervals of at least
#: this many seconds. A killed worker restarts within this time.
RESTART_SECONDS = 60.0
#: A cluster counts as lost after this many seconds without workers. Workers that restart are back sooner.
WORKERLESS_SECONDS = 60.0
LOST = "the dask scheduler is gone: start one and compute the same request again, which resumes the computation"


TileResult = TileRecord | PartialTile


@dataclass(frozen=True)
class TileAttempt:
    """An attempt to compute a tile. All attempts at the same tile write the same bytes.

    isolated: whether a process of its own computes the tile, so that the worker survives a cell that kills a process.
    """

    tile: AnyTile
    isolated: bool


class SubmittedTiles(SubmittedTasks[TileAttempt, TileResult]):
    """The tiles of one run that are submitted to the cluster and have not ended."""

    def __init__(
        self,
        task: Callable[..., TileResult],
        request: AnyRequest,
        path: str,
        client: Client,
        partial: dict[int, PartialTile] | None = None,
    ) -> None:
        """Store the function that tasks run, and its arguments.

        task: function with the arguments of `advance_tile`. path: location of the store. partial: partly computed tiles
        by index, updated in place.
        """
        super().__init__(client, "tile", LOST)
        self._task, self._request, self._path = task, request, path
        self._partial = {} if partial is None else partial
        self._slowest = 0.0  # seconds per cell of the slowest part so far
        self.task_seconds = PART_SECONDS  # intended duration of a task
        self.n_threads = 0
        self._longest = 0.0
        self._next_end = 0.0
        #: Futures that may still run although another attempt at the same tile has ended.
        self.superseded_futures: list[Future] = []

    def count_free_threads(self) -> int:
        """Return the number of threads that have no tile, and so the number of tiles that may be submitted.

        No thread gets a second tile in advance, because dask counts a worker's death against all tasks of the worker.

        Returns
        -------
        int
            0 or more.
        """
        self.n_threads = self.count_threads(WORKERLESS_SECONDS)
        return max(self.n_threads - len(self.in_flight), 0)

    def submit(self, tile: AnyTile, isolated: bool = False, workers: Iterable[str] | None = None) -> None:
        """Submit a tile. isolated: compute it in a process of its own. workers: addresses of allowed workers."""
        known = self._partial.get(tile.index), self._slowest or math.inf, self.task_seconds
        self.submit_task(
            TileAttempt(tile, isolated), self._task, self._request, self._path, tile, isolated, *known, workers=workers
        )

    def repeat_late_tiles(self, again: bool) -> int:
        """Submit late tiles once more, to idle workers. The result that arrives first counts.

        Parameters
        ----------
        again : bool
            Also repeat tiles that were repeated before. Such tiles may just be slow, and would delay new tiles.

        Returns
        -------
        int
            Number of submitted tiles.
        """
        late_since = time.monotonic() - max(LATE_SECONDS, LATE_FACTOR * self._longest)
        attempts = Counter(each.work.tile.index for each in self.in_flight.values())
        latest = {each.work.tile.index: each for each in self.in_flight.values()}
        late = [
            each.work
            for index, each in latest.items()
            if each.submitted_at < late_since and (again or attempts[index] == 1)
        ]
        before = len(self.in_flight)
        if late:
            idle = self._idle_workers()
            for attempt, address in zip(late, idle, strict=False):
                self.submit(attempt.tile, attempt.isolated, workers=[address])
        return len(self.in_flight) - before

    def isolate_endless_tile(self) -> None:
        """Kill the worker of a tile that takes too long, and submit the tile to be computed in a process of its own.

        In this process each cell has a time limit. If several tiles take too long, the others wait RESTART_SECONDS:
        dask may send one of them to the worker that is being killed, and would count the worker's death against it.
        """
        now = time.monotonic()
        endless = (
            each
            for each in self.in_flight.values()
            if not each.work.isolated and now - each.submitted_at > _allowed_seconds(each)
        )
        if now >= self._next_end and (task := next(endless, None)):
            self._next_end = now + RESTART_SECONDS
            end_tasks(self._client, [task.future])
            self._submit_isolated(task.work.tile)

    def next_record(self, seconds: float) -> TileRecord | AnyTile | None:
        """Wait until a task ends. Return the record of its tile, or the tile if some of its cells are still missing.

        Returns
        -------
        TileRecord | AnyTile | None
            None if no task ends within `seconds`. None also for a task that `forget_tasks` has removed, and for a
            failed task whose tile is submitted again.
        """
        if (ended := self.next_result(seconds)) is None:
            return None
        task, found = ended
        tile = task.work.tile
        self._longest = max(self._longest, time.monotonic() - task.submitted_at)
        attempts = [each for each in self.in_flight.values() if each.work.tile.index == tile.index]
        self.superseded_futures += [each.future for each in attempts if each is not task]
        self._forget_tile(tile)
        if isinstance(found, PartialTile):
            self._slowest = max(self._slowest, found.slowest_seconds_per_cell)
            self._partial[tile.index] = found
            return tile
        self._slowest = max(self._slowest, found.seconds / max(found.cells, 1))
        self._partial.pop(tile.index, None)
        return found

    def handle_error(self, task: ClusterTask[TileAttempt], error: BaseException) -> None:
        """If a task killed workers and is not isolated, submit its tile again, isolated. Otherwise raise an error."""
        tile = task.work.tile
        if not isinstance(error, KilledWorker):
            raise tile_error(self._request, tile, error) from error
        if task.work.isolated:
            what, attempts = tile_name(self._request, tile), error.allowed_failures + 1
            raise SurveyError(
                f"the worker of {what} died in each of {attempts} attempts, although a separate process computed the "
                "cells: see the logs of the workers"
            ) from error
        self._submit_isolated(tile)

    def _submit_isolated(self, tile: AnyTile) -> None:
        self._forget_tile(tile)
        self.submit(tile, isolated=True)

    def _forget_tile(self, tile: AnyTile) -> None:
        """Forget (see `forget_tasks`) every attempt at a tile."""
        self.forget_tasks(lambda attempt: attempt.tile.index == tile.index)

    def kill_tasks(self) -> None:
        """Cancel all tasks of this run, and kill the workers that run only these tasks and have a nanny."""
        futures = [task.future for task in self.in_flight.values()]
        self.in_flight.clear()
        end_tasks(self._client, futures)

    def cancel(self) -> None:
        """Cancel all tasks."""
        if self.in_flight and self._client.status == "running":
            with suppress(OSError):  # the scheduler is gone: nothing to cancel
                self._client.cancel([task.future for task in self.in_flight.values()])

    def _idle_workers(self) -> list[str]:
        """Return the idle workers. Workers with an undelivered result come last, because they may be frozen."""
        try:
            processing: dict[str, tuple[Key, ...]] = self._client.processing()
            held: dict[Key, tuple[str, ...]] = self._client.who_has([task.future for task in self.in_flight.values()])
        except OSError as error:
            raise self.lost_scheduler_error() from error
        holding = {address for addresses in held.values() for address in addresses}
        return sorted((address for address, keys in processing.items() if not keys), key=holding.__contains__)


def _allowed_seconds(task: ClusterTask[TileAttempt]) -> float:
    return TILE_SECONDS * min(max(task.work.tile.n_cells / TILE_CELLS, 1.0), LONGEST_FACTOR)
