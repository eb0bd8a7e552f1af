"""Tiles on a cluster: what to submit next is decided here, what a tile is is decided elsewhere."""

import time
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import CancelledError
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from uuid import uuid4

from dask.typing import Key
from distributed import Client, Future, KilledWorker

from workers.errors import ClusterLostError, SurveyError
from workers.request import SurveyRequest
from workers.store import require_aligned, write_tile, writing
from workers.tiles import Tile, TileRecord, compute_tile

POLL_SECONDS = 0.5
GRACE_SECONDS = 2.0


def compute_and_write(request: SurveyRequest, path: str, tile: Tile) -> TileRecord:
    """Compute a tile and write it to the store: the task that a cluster runs, again if it has to."""
    values, record = compute_tile(request, tile)
    write_tile(request, path, tile, values)
    return record


def run_tiles(
    request: SurveyRequest,
    path: str | Path,
    tiles: Iterable[Tile],
    client: Client,
    on_tile: Callable[[TileRecord], None],
    should_stop: Callable[[], bool],
) -> None:
    """Compute tiles of a created store on a cluster, until all are written or `should_stop` says so.

    Args:
        on_tile: called in this thread, with each tile that has been written.
        should_stop: asked at least every half second. After a stop this returns within seconds: tiles that end
            meanwhile are reported, the others are left for the next run.

    Raises:
        SurveyError: a tile cannot be computed or written (it kills its workers, the disk is full), the message names
            it; or another run holds the store.
        ClusterLostError: the cluster is gone; the tiles not reported can be run on another.
    """
    tiles = list(tiles)
    for tile in tiles:
        require_aligned(request, tile)
    path = Path(path).resolve()
    with writing(path):
        submission = _Submission(request, str(path), client)
        try:
            _run(submission, deque(tiles), on_tile, should_stop)
        finally:
            submission.cancel()


def _run(
    submission: "_Submission",
    waiting: deque[Tile],
    on_tile: Callable[[TileRecord], None],
    should_stop: Callable[[], bool],
) -> None:
    while (waiting or submission.in_flight) and not should_stop():
        for _ in range(min(submission.room(), len(waiting))):
            submission.submit(waiting.popleft())
        if record := submission.next_record(POLL_SECONDS):
            on_tile(record)
    deadline = time.monotonic() + GRACE_SECONDS
    while submission.in_flight and (left := deadline - time.monotonic()) > 0:
        if record := submission.next_record(left):
            on_tile(record)


class _Submission:
    """The tiles of one run that are on the cluster."""

    def __init__(self, request: SurveyRequest, path: str, client: Client) -> None:
        self._request, self._path, self._client = request, path, client
        self._run = uuid4().hex  # keys of another run must not be taken for this one's
        self._ended: SimpleQueue[Future] = SimpleQueue()
        self.in_flight: dict[Key, tuple[Future, Tile]] = {}

    def room(self) -> int:
        """Return how many more tiles keep every thread busy.

        None waits at a worker: dask counts a worker's death against everything that is there, and would blame it.
        """
        try:
            threads = sum(self._client.nthreads().values())
        except OSError as error:
            raise _lost() from error
        return max(threads - len(self.in_flight), 0)

    def submit(self, tile: Tile) -> None:
        """Put a tile on the cluster."""
        key = f"tile-{self._run}-{tile.index}"
        future = self._client.submit(compute_and_write, self._request, self._path, tile, key=key, pure=False)
        self.in_flight[key] = future, tile
        future.add_done_callback(self._ended.put)

    def next_record(self, seconds: float) -> TileRecord | None:
        """Return the record of the next tile that ends, None if none does in this time."""
        try:
            future = self._ended.get(timeout=seconds)
        except Empty:
            return None
        tile = self.in_flight[future.key][1]
        if future.status == "cancelled":  # nobody else cancels: the scheduler is gone
            raise _lost()
        if future.status == "error":
            error = future.exception()
            raise SurveyError(f"{self._describe(tile)} {_what_happened(error)}") from error
        try:
            record: TileRecord = future.result(timeout=seconds)
        except TimeoutError:  # its worker died holding the record, and dask computes the tile again
            future.add_done_callback(self._ended.put)
            return None
        except (CancelledError, OSError) as error:
            raise _lost() from error
        del self.in_flight[future.key]
        future.release()  # kept, a dead worker's finished tiles would be computed again
        return record

    def cancel(self) -> None:
        """Give up what is in flight."""
        if self.in_flight and self._client.status == "running":
            with suppress(OSError):  # the scheduler is gone: nothing to cancel
                self._client.cancel([future for future, _ in self.in_flight.values()])

    def _describe(self, tile: Tile) -> str:
        delta, epsilon = self._request.delta.values()[tile.delta], self._request.epsilon.values()[tile.epsilon]
        return f"tile {tile.index} (delta {delta[0]} to {delta[-1]}, epsilon {epsilon[0]} to {epsilon[-1]})"


def _what_happened(error: BaseException) -> str:
    if isinstance(error, KilledWorker):
        attempts = error.allowed_failures + 1
        return f"killed its worker (attempts: {attempts}): use smaller tiles, or give workers more memory"
    return f"failed: {type(error).__name__}: {error}"


def _lost() -> ClusterLostError:
    return ClusterLostError("the dask scheduler is gone: start one and run the survey again, which resumes it")
