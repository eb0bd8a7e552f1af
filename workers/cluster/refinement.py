"""Windows on a cluster: the maps of a window, ever finer, before the tiles of any survey."""

import time
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import CancelledError
from queue import Empty, SimpleQueue
from uuid import uuid4

from distributed import Client, Future, KilledWorker

from workers.cluster.window import Frame, Grid, Part, PartValues, compute_part, map_quantity
from workers.errors import ClusterLostError, SurveyError
from workers.survey.request import SurveyRequest

PRIORITY = 10  # of dask; tiles have 0
PART_SECONDS = 0.3  # aimed at: a part that is begun is not interrupted
FIRST_CELLS = 64  # of a part, until it is known how long a cell takes
FIRST_CLOSED_FORM = 16_384
FRAME_SECONDS = 0.4  # between frames of one level
POLL_SECONDS = 0.1
WORKERLESS_SECONDS = 20.0
AHEAD = 2  # parts of each thread: one at work, one that waits


def refined(
    client: Client, survey: SurveyRequest, variable: str, index: int, should_stop: Callable[[], bool]
) -> Generator[Frame, None, None]:
    """Compute a map of a window, as `window_survey` has it, on a cluster: frames ever finer, the last one complete.

    Blocks between frames; for a thread of its own. Nothing of it is left on the cluster when it ends or is closed, but
    for parts at work, of half a second or so.

    Args:
        should_stop: asked several times a second; after a stop there are no more frames.

    Raises:
        SurveyError: there is no such map, or a part of it cannot be computed.
        ClusterLostError: the cluster is gone.
    """
    work = _Work(client, survey, variable, index)
    quantity = map_quantity(variable, index, survey)
    grid = Grid(survey, quantity)
    try:
        for level in grid.levels:
            shown = time.monotonic()
            parts = work.parts(grid, level, FIRST_CELLS if len(grid.levels) > 1 else FIRST_CLOSED_FORM)
            for part, values in work.run(parts, should_stop):
                grid.put(part, values)
                if level != grid.levels[0] and time.monotonic() - shown > FRAME_SECONDS and not grid.known.all():
                    shown = time.monotonic()
                    yield grid.frame(level)
            if should_stop():
                return
            yield grid.frame(level)
    finally:
        work.cancel()


class _Work:
    """The parts of one window that are on the cluster."""

    def __init__(self, client: Client, survey: SurveyRequest, variable: str, index: int) -> None:
        self._client, self._survey, self._variable, self._index = client, survey, variable, index
        self._delta, self._epsilon = survey.delta.values(), survey.epsilon.values()
        self._run, self._submitted = uuid4().hex, 0
        self._ended: SimpleQueue[Future] = SimpleQueue()
        self._in_flight: dict[str, tuple[Future, Part]] = {}
        self._cells, self._seconds = 0, 0.0
        self._workers_seen = time.monotonic()

    def parts(self, grid: Grid, level: int, first_cells: int) -> Iterator[Part]:
        """The parts of a level, of so many cells as take the time of a part by what was measured before it."""
        cells = max(1, int(PART_SECONDS * self._cells / self._seconds)) if self._seconds else first_cells
        for block in grid.blocks(level):
            yield from grid.parts(block, cells)

    def run(self, parts: Iterator[Part], should_stop: Callable[[], bool]) -> Iterator[tuple[Part, PartValues]]:
        """Compute parts, each as soon as a thread is free for it, in any order."""
        left = next(parts, None)
        self._cells, self._seconds = 0, 0.0  # cells of a finer level are elsewhere, and may take longer
        while (left or self._in_flight) and not should_stop():
            room = self._room()
            while left and room > 0:
                self._submit(left)
                left, room = next(parts, None), room - 1
            if ended := self._next_ended():
                yield ended

    def _room(self) -> int:
        try:
            threads = sum(self._client.nthreads().values())
        except Exception as error:  # whatever a client says that has been closed meanwhile
            raise _lost() from error
        if threads:
            self._workers_seen = time.monotonic()
        elif time.monotonic() - self._workers_seen > WORKERLESS_SECONDS:
            raise ClusterLostError(f"the cluster has had no workers for {WORKERLESS_SECONDS:.0f} s: start some")
        return AHEAD * threads - len(self._in_flight)

    def _submit(self, part: Part) -> None:
        self._submitted += 1
        key = f"window-{self._run}-{self._submitted}"
        delta, epsilon = self._delta[part.delta], self._epsilon[part.epsilon]
        try:
            future = self._client.submit(
                compute_part,
                self._survey,
                self._variable,
                self._index,
                delta,
                epsilon,
                key=key,
                pure=False,
                priority=PRIORITY,
            )
        except Exception as error:
            raise _lost() from error
        self._in_flight[key] = future, part
        future.add_done_callback(self._ended.put)

    def _next_ended(self) -> tuple[Part, PartValues] | None:
        try:
            future = self._ended.get(timeout=POLL_SECONDS)
        except Empty:
            return None
        if future.key not in self._in_flight:
            return None
        if future.status == "cancelled":  # nobody else cancels: the scheduler is gone
            raise _lost()
        if future.status == "error":
            error = future.exception()
            if isinstance(error, KilledWorker):
                raise SurveyError("a part of this window kills its worker: choose another window") from error
            raise SurveyError(f"a part of this window failed: {type(error).__name__}: {error}") from error
        try:
            values: PartValues = future.result(timeout=WORKERLESS_SECONDS)
        except TimeoutError:  # its worker died holding the result, and dask computes the part again
            future.add_done_callback(self._ended.put)
            return None
        except (CancelledError, OSError) as error:
            raise _lost() from error
        _, part = self._in_flight.pop(future.key)
        self._cells += values.values.size
        self._seconds += values.seconds
        return part, values

    def cancel(self) -> None:
        """Give up what is in flight: nobody holds it, and the scheduler forgets what is not begun."""
        for future, _ in self._in_flight.values():
            future.release()
        self._in_flight.clear()


def _lost() -> ClusterLostError:
    return ClusterLostError("the workers are gone, or being replaced: try again in a few seconds")
