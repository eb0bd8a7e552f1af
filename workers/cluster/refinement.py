"""Compute the map of a window on a cluster, level by level; its tasks have priority over the tiles of all surveys."""

import time
from collections.abc import Callable, Generator, Iterator

from distributed import Client, KilledWorker

from gear_rattle.workers.cluster.in_flight import ClusterTask, SubmittedTasks
from gear_rattle.workers.cluster.window import (
    WindowFrame,
    WindowGrid,
    WindowPart,
    WindowPartValues,
    compute_window_part,
    quantity_of_map,
)
from gear_rattle.workers.errors import SurveyError
from gear_rattle.workers.survey.request import SurveyRequest

PRIORITY = 10  # dask runs tasks of higher priority first; tasks of tiles have priority 0
PART_SECONDS = 0.3  # intended duration of a part; a running part cannot be interrupted
FIRST_CELLS = 64  # number of cells of a part on the coarsest level, where the time of a cell is not known yet
SINGLE_LEVEL_CELLS = 16_384  # number of cells of a part if the grid has one level only, as for closed forms
FRAME_SECONDS = 0.4  # seconds between two frames of a level
POLL_SECONDS = 0.1  # seconds between two checks whether to stop
WORKERLESS_SECONDS = 20.0  # the cluster counts as lost when it has had no workers for so long
PARTS_PER_THREAD = 2  # number of submitted parts for each thread: one runs, and one waits
LOST = "the workers are gone, or are being restarted: try again in a few seconds"


def refined_frames(
    client: Client, survey: SurveyRequest, variable: str, index: int, should_stop: Callable[[], bool]
) -> Generator[WindowFrame, None, None]:
    """Compute a map of a window on a cluster, and yield frames of increasing resolution.

    survey: the window's request, from `request_for_window`. index: number of the map, from 0, if the variable has a map
    for each orbit or slot; else 0. The generator blocks between frames, so it needs a thread of its own. When it ends
    or is closed, parts that already run may remain on the cluster for about half a second.

    Parameters
    ----------
    should_stop : Callable[[], bool]
        Called several times a second; no frames follow after it returns true.

    Yields
    ------
    WindowFrame
        The map so far; the last one is complete.

    Raises
    ------
    ClusterLostError
        The cluster is gone.
    SurveyError
        The survey has no such map, or a part of the map cannot be computed.
    """
    work = _WindowTasks(client, survey, variable, index)
    quantity = quantity_of_map(variable, index, survey)
    grid = WindowGrid(survey, quantity)
    try:
        for level in grid.levels:
            shown = time.monotonic()
            parts = work.divide_level_into_parts(
                grid, level, FIRST_CELLS if len(grid.levels) > 1 else SINGLE_LEVEL_CELLS
            )
            unseen = True
            for part, values in work.compute_parts(parts, should_stop):
                grid.store_part(part, values)
                unseen = True
                if level != grid.levels[0] and time.monotonic() - shown > FRAME_SECONDS and not grid.known.all():
                    shown, unseen = time.monotonic(), False
                    yield grid.frame_at_level(level)
            if should_stop():
                return
            if unseen:
                yield grid.frame_at_level(level)
    finally:
        work.forget_tasks(lambda _: True)


class _WindowTasks(SubmittedTasks[WindowPart, WindowPartValues]):
    """The parts of a window that are submitted to the cluster and have not ended."""

    def __init__(self, client: Client, survey: SurveyRequest, variable: str, index: int) -> None:
        super().__init__(client, "window", LOST)
        self._map = survey, variable, index
        self._delta, self._epsilon = survey.delta.values(), survey.epsilon.values()
        self._cells, self._seconds = 0, 0.0

    def divide_level_into_parts(self, grid: WindowGrid, level: int, first_cells: int) -> Iterator[WindowPart]:
        """Divide a level into parts that take about PART_SECONDS each.

        The time of a cell is known from the next coarser level. On the coarsest level parts have `first_cells` cells.

        Yields
        ------
        WindowPart
            A part; together the parts have all cells of the level that no coarser level has.
        """
        cells = max(1, int(PART_SECONDS * self._cells / self._seconds)) if self._seconds else first_cells
        for block in grid.parts_of_level(level):
            yield from grid.divide_into_parts(block, cells)

    def compute_parts(
        self, parts: Iterator[WindowPart], should_stop: Callable[[], bool]
    ) -> Iterator[tuple[WindowPart, WindowPartValues]]:
        """Compute parts on the cluster, and yield each part with its values as soon as its task ends."""
        left = next(parts, None)
        self._cells, self._seconds = 0, 0.0  # counted anew on each level, because its cells may take longer
        while (left or self.in_flight) and not should_stop():
            room = PARTS_PER_THREAD * self.count_threads(WORKERLESS_SECONDS) - len(self.in_flight)
            while left and room > 0:
                axes = self._delta[left.delta], self._epsilon[left.epsilon]
                self.submit_task(left, compute_window_part, *self._map, *axes, priority=PRIORITY)
                left, room = next(parts, None), room - 1
            if ended := self.next_result(POLL_SECONDS):
                task, values = ended
                del self.in_flight[task.future.key]
                self._cells += values.values.size
                self._seconds += values.seconds
                yield task.work, values

    def handle_error(self, _: ClusterTask[WindowPart], error: BaseException) -> None:
        """Raise an error for the failed part. No part is repeated, because viewers of a window would wait too long."""
        if isinstance(error, KilledWorker):
            raise SurveyError("a worker died while it computed this window: choose another window") from error
        raise SurveyError(
            f"a part of this window cannot be computed ({str(error) or type(error).__name__}): choose another window"
        ) from error
