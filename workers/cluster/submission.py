"""The tiles of one run that are on the cluster: submitted, repeated where that helps, awaited and given up."""

import time
from collections.abc import Callable, Iterable
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from uuid import uuid4

from dask.typing import Key
from distributed import Client, Future, KilledWorker

from workers.cluster.cluster import end_tasks
from workers.errors import ClusterLostError, SurveyError
from workers.survey.request import SurveyRequest
from workers.survey.tiles import Tile, TileRecord, described, tile_error

#: A tile is late after this time, and after ten times the longest tile of the run: its worker may be frozen.
LATE_SECONDS, LATE_FACTOR = 30.0, 10
#: A tile may take so long on a worker; a usual one takes seconds.
TILE_SECONDS = 900.0
#: Between two tiles that are ended so: a process starts again meanwhile.
RESTART_SECONDS = 60.0
#: A cluster may be without workers for so long: they are being restarted.
WORKERLESS_SECONDS = 60.0


@dataclass(frozen=True)
class Attempt:
    """A tile on the cluster; more than one attempt may be at the same tile, and they write the same bytes."""

    future: Future
    tile: Tile
    apart: bool
    began: float


class Submission:
    """The tiles of one run that are on the cluster."""

    def __init__(self, task: Callable[..., TileRecord], request: SurveyRequest, path: str, client: Client) -> None:
        """Take the task: of the request, the path, a tile, and whether it is computed apart."""
        self._task, self._request, self._path, self._client = task, request, path, client
        self._run = uuid4().hex  # keys of another run must not be taken for this one's
        self._ended: SimpleQueue[Future] = SimpleQueue()
        self._attempts = 0
        self._longest = 0.0
        self._next_end = 0.0
        self._workers_seen = time.monotonic()
        self.in_flight: dict[Key, Attempt] = {}

    def room(self) -> int:
        """Return how many more tiles keep every thread busy.

        None waits at a worker: dask counts a worker's death against everything that is there, and would blame it.
        """
        try:
            threads = sum(self._client.nthreads().values())
        except OSError as error:
            raise _lost() from error
        now = time.monotonic()
        if threads:
            self._workers_seen = now
        elif now - self._workers_seen > WORKERLESS_SECONDS:
            raise ClusterLostError(f"the cluster has had no workers for {WORKERLESS_SECONDS:.0f} s: start some")
        return max(threads - len(self.in_flight), 0)

    def submit(self, tile: Tile, apart: bool = False, workers: Iterable[str] | None = None) -> None:
        """Put a tile on the cluster, apart from others in a process of its own if it kills its workers."""
        self._attempts += 1
        key = f"tile-{self._run}-{tile.index}-{self._attempts}"
        future = self._client.submit(
            self._task, self._request, self._path, tile, apart, key=key, pure=False, workers=workers
        )
        self.in_flight[key] = Attempt(future, tile, apart, time.monotonic())
        future.add_done_callback(self._ended.put)

    def repeat_late_tiles(self) -> None:
        """Submit tiles that take far longer than any before to workers with nothing to do: the first result counts."""
        late_since = time.monotonic() - max(LATE_SECONDS, LATE_FACTOR * self._longest)
        latest = {attempt.tile.index: attempt for attempt in self.in_flight.values()}.values()
        late = [attempt for attempt in latest if attempt.began < late_since]
        if late:
            idle = [address for address, keys in self._processing().items() if not keys]
            for attempt, address in zip(late, idle, strict=False):
                self.submit(attempt.tile, attempt.apart, workers=[address])

    def set_endless_tile_apart(self) -> None:
        """End the process of a tile that has taken too long: apart, each of its cells has a limit of its own.

        One at a time: a process that is being ended may still be given a tile, which dask counts as a death of it.
        """
        now = time.monotonic()
        endless = (each for each in self.in_flight.values() if not each.apart and each.began < now - TILE_SECONDS)
        if now >= self._next_end and (attempt := next(endless, None)):
            self._next_end = now + RESTART_SECONDS
            end_tasks(self._client, [attempt.future])
            self._drop(attempt.tile)
            self.submit(attempt.tile, apart=True)

    def next_record(self, seconds: float) -> TileRecord | None:
        """Return the record of the next tile that ends, None if none does in this time."""
        try:
            future = self._ended.get(timeout=seconds)
        except Empty:
            return None
        attempt = self.in_flight.get(future.key)
        if attempt is None:  # another attempt at the tile was first
            return None
        if future.status == "cancelled":  # nobody else cancels: the scheduler is gone
            raise _lost()
        if future.status == "error":
            self._after_error(attempt, future.exception())
            return None
        try:
            record: TileRecord = future.result(timeout=seconds)
        except TimeoutError:  # its worker died holding the record, and dask computes the tile again
            future.add_done_callback(self._ended.put)
            return None
        except (CancelledError, OSError) as error:
            raise _lost() from error
        self._longest = max(self._longest, time.monotonic() - attempt.began)
        self._drop(attempt.tile)
        return record

    def _after_error(self, attempt: Attempt, error: BaseException) -> None:
        """Go on after a worker's death, raise anything else."""
        if not isinstance(error, KilledWorker):
            raise tile_error(self._request, attempt.tile, error) from error
        if attempt.apart:
            what, attempts = described(self._request, attempt.tile), error.allowed_failures + 1
            raise SurveyError(
                f"{what} killed its worker (attempts: {attempts}), although its cells were computed in another process"
                ": look at the workers' logs"
            ) from error
        self._drop(attempt.tile)
        self.submit(attempt.tile, apart=True)

    def _drop(self, tile: Tile) -> None:
        """Forget every attempt at a tile. Kept, a dead worker's finished tiles would be computed again."""
        for key, attempt in list(self.in_flight.items()):
            if attempt.tile.index == tile.index:
                del self.in_flight[key]
                attempt.future.release()  # nobody holds it: the scheduler cancels what has not ended

    def cut_off(self) -> None:
        """Give up what is in flight, and end the processes that compute nothing else."""
        futures = [attempt.future for attempt in self.in_flight.values()]
        self.in_flight.clear()
        end_tasks(self._client, futures)

    def cancel(self) -> None:
        """Give up what is in flight."""
        if self.in_flight and self._client.status == "running":
            with suppress(OSError):  # the scheduler is gone: nothing to cancel
                self._client.cancel([attempt.future for attempt in self.in_flight.values()])

    def _processing(self) -> dict[str, tuple[Key, ...]]:
        try:
            processing: dict[str, tuple[Key, ...]] = self._client.processing()
        except OSError as error:
            raise _lost() from error
        return processing


def _lost() -> ClusterLostError:
    return ClusterLostError("the dask scheduler is gone: start one and run the survey again, which resumes it")
