"""Run tiles on a cluster: decide the order of submission, and wait for results."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING
from uuid import uuid4

from distributed import Client, Future, KilledWorker, get_worker

from gear_rattle.workers.certificates import (
    AttractorClaim,
    ProofResults,
    certify_claims,
    certify_survey,
    require_proof_extra,
)
from gear_rattle.workers.cluster.cluster import end_tasks, end_tasks_and_wait
from gear_rattle.workers.cluster.costs import RunState
from gear_rattle.workers.cluster.isolation import compute_tile_isolated
from gear_rattle.workers.cluster.joining import CompletionTasks
from gear_rattle.workers.cluster.partial import PART_SECONDS, PartialTile, compute_tile_partly, is_tile_divisible
from gear_rattle.workers.cluster.submission import SubmittedTiles
from gear_rattle.workers.completion import complete
from gear_rattle.workers.errors import ClusterLostError, StoppedError, SurveyError
from gear_rattle.workers.kinds import AnyRequest, AnyTile, compute_tile, template_of
from gear_rattle.workers.populations.tiles import GearTile
from gear_rattle.workers.storage.location import Place, place_of
from gear_rattle.workers.storage.manifest import tile_recorder
from gear_rattle.workers.storage.store import remove_outdated_results, require_aligned_tiles, write_tile
from gear_rattle.workers.survey.request import SurveyRequest
from gear_rattle.workers.survey.template import Template
from gear_rattle.workers.survey.tiles import GRACE_SECONDS, POLL_SECONDS, Tile, TileRecord

if TYPE_CHECKING:
    from xarray import Dataset

#: The computation of a template is attempted this many times, because dask may send it to a worker that is just
#: ending. An attempt fails when more workers have died during it than the scheduler allows
#: (`allowed_failures`).
ATTEMPTS = 3


def compute_and_write_tile(request: AnyRequest, path: str, tile: AnyTile, isolated: bool = False) -> TileRecord:
    """Compute a tile and write it to the store. isolated: compute it in a process of its own."""
    if isolated:
        values, record = compute_tile_isolated(request, tile, get_worker().memory_manager.memory_limit)
    else:
        values, record = compute_tile(request, tile)
    return replace(record, files=write_tile(request, path, tile, values))


def advance_tile(
    request: AnyRequest,
    path: str,
    tile: AnyTile,
    isolated: bool,
    before: PartialTile | None,
    expected: float,
    seconds: float,
) -> TileRecord | PartialTile:
    """Compute a tile and write it to the store, or compute a part of the tile for some seconds.

    This is the task that the cluster runs, and repeats if necessary. isolated: compute the whole tile in a process of
    its own. before: the tile with the cells computed so far, or None. expected: seconds per cell of the slowest part of
    the survey so far. seconds: after this time no further group of cells begins.

    Returns
    -------
    TileRecord | PartialTile
        The record if the tile is written, else its computed part.
    """
    if isolated or not is_tile_divisible(request, tile.n_cells):
        return compute_and_write_tile(request, path, tile, isolated)
    if not (loaded := _kernel_loading_note(request)):
        compute_tile_partly(
            request, tile, None, 0.0
        )  # computes one cell, so that no measured time includes loading kernels
        loaded.append(True)
    part = compute_tile_partly(request, tile, before, seconds, expected)
    if not part.is_whole:
        return part
    return replace(part.record, files=write_tile(request, path, tile, part.values))


@lru_cache(maxsize=16)
def _kernel_loading_note(_request: AnyRequest) -> list[bool]:
    """Return the list in which this process notes that it has loaded the kernels of a request.

    Returns
    -------
    list[bool]
        At first empty; the caller appends True after loading the kernels. For equal requests it is the same list.
    """
    return []


def _always_false() -> bool:
    return False


def compute_template_on_cluster(
    client: Client, request: AnyRequest, created: str | None, should_stop: Callable[[], bool]
) -> Template:
    """Compute the files of an empty store with `template_of` on a cluster, because some curves take minutes to trace.

    Parameters
    ----------
    should_stop : Callable[[], bool]
        Called several times a second; when it returns true, the process that computes the template is killed.

    Returns
    -------
    Template
        Files of the empty store, by key.

    Raises
    ------
    ClusterLostError
        The cluster is gone.
    StoppedError
        `should_stop` returned true.
    SurveyError
        The template cannot be computed.
    """
    for _ in range(ATTEMPTS):
        with suppress(KilledWorker):
            return _compute_template(client, request, created, should_stop)
    raise SurveyError("the process that creates the empty store was killed repeatedly: see the log of the workers")


def _compute_template(
    client: Client, request: AnyRequest, created: str | None, should_stop: Callable[[], bool]
) -> Template:
    future = client.submit(template_of, request, created, key=f"template-{uuid4().hex}", pure=False)
    ended: SimpleQueue[Future] = SimpleQueue()
    future.add_done_callback(ended.put)
    try:
        while not should_stop():
            with suppress(Empty):
                # Wait on a queue, because dask's `future.result(timeout)` sometimes misses its timeout on Python 3.12.
                ended.get(timeout=POLL_SECONDS)
                template: Template = future.result()
                return template
        end_tasks(client, [future])
        raise StoppedError("stopped while the empty store was created")
    except (CancelledError, OSError) as error:
        raise ClusterLostError(
            "the dask scheduler has ended or cannot be reached: start a scheduler and compute the same request again"
        ) from error
    finally:
        future.release()


def complete_on_cluster(
    client: Client,
    request: AnyRequest,
    where: str | Path | Place,
    should_stop: Callable[[], bool],
    on_proved: Callable[[int, int], None] = lambda _done, _number: None,
    should_pause: Callable[[], bool] = _always_false,
) -> None:
    """Complete a survey on a cluster with `complete`, while holding the lock of the store.

    Parameters
    ----------
    should_stop : Callable[[], bool]
        Called several times a second. After it returns true, the tasks are ended, and StoppedError is raised.
    on_proved, should_pause
        Arguments of `complete`.

    Raises
    ------
    ClusterLostError
        The cluster is gone.
    StoppedError
        `should_stop` returned true. No process continues the work.
    SurveyError
        The survey cannot be completed.
    """
    place, joining = place_of(where), CompletionTasks(client, should_stop)
    with place.lock_for_writing():
        complete(request, place, joining.run_for_each, joining.count_batch_tasks(), on_proved, should_pause)


def certify_on_cluster(
    client: Client,
    survey: Dataset,
    out: Path,
    on_done: Callable[[int, int], None] = lambda _done, _number: None,
    should_stop: Callable[[], bool] = _always_false,
) -> Dataset:
    """Prove the attractors of a survey on a cluster with `certify_survey`. Raises StoppedError after a stop."""
    joining = CompletionTasks(client, should_stop)

    def prove(parts: Sequence[list[AttractorClaim]]) -> list[ProofResults]:
        return joining.map(certify_claims, [(part,) for part in parts])

    return certify_survey(survey, out, prove, joining.count_batch_tasks(), on_done)


def run_tiles(
    request: AnyRequest,
    where: str | Path | Place,
    tiles: Iterable[AnyTile],
    client: Client,
    on_tile: Callable[[TileRecord], None],
    should_stop: Callable[[], bool],
    should_kill: Callable[[], bool] = _always_false,
    should_pause: Callable[[], bool] = _always_false,
    run_state: RunState | None = None,
    on_left: Callable[[float], None] = lambda _: None,
) -> None:
    """Compute tiles on a cluster and write them to an existing store, until all are written or the run must stop.

    If tiles may take long, some cells of many tiles are computed first to predict costs, and the most expensive tiles
    come first. A tile that kills its workers, or takes a quarter of an hour (longer if it is large), is computed cell
    by cell in a process of its own. Then only those cells fail that kill the process or take too much processor time.

    Parameters
    ----------
    on_tile : Callable[[TileRecord], None]
        Called in this thread with the record of each written tile.
    should_stop : Callable[[], bool]
        Called several times a second. The run ends within seconds after this returns true. Tiles that end in that time
        are reported; all others are left to the next run.
    should_kill : Callable[[], bool]
        Called after a stop. It returns true if nobody needs the running tiles; then their processes are killed at once.
    should_pause : Callable[[], bool]
        Called several times a second. After it returns true, no more tasks begin. Running tasks end within
        PART_SECONDS, unless one cell takes longer.
    run_state : RunState | None
        State of earlier runs, before a pause; updated in place.
    on_left : Callable[[float], None]
        Called in this thread with the predicted seconds until all tiles have ended, whenever the prediction changes.

    Raises
    ------
    StorageError
        A tile cannot be written now (the disk is full or read-only); the message names the tile.
    SurveyError
        A tile cannot be computed, or another run has locked the store.
    ClusterLostError
        The cluster is gone. Tiles that were not reported can be computed on another cluster.
    MissingExtraError
        The request asks for certificates, but the workers lack the extra packages for proofs.
    """
    tiles = list(tiles)
    require_aligned_tiles(request, tiles)
    place = place_of(where)
    with place.lock_for_writing():
        if tiles:
            remove_outdated_results(request, place)
            if isinstance(request, SurveyRequest) and request.certify:
                with suppress(StoppedError):
                    CompletionTasks(client, should_stop).map(require_proof_extra, [()])
        run_state, columns = run_state or RunState(), request.tile_grid_shape[1]
        run_state.predict_costs(tiles, columns)
        submission = SubmittedTiles(advance_tile, request, str(place), client, run_state.partial)
        left = {tile.index: tile for tile in tiles}

        with tile_recorder(place) as note:

            def on_ended(record: TileRecord) -> None:
                note({record.index: record.files})
                run_state.record_finished_tile(record)
                del left[record.index]
                on_tile(record)
                report_time_left()

            def report_time_left() -> None:
                if (seconds := run_state.seconds_left(submission.n_threads)) is not None:
                    on_left(seconds)

            asked = should_stop, should_kill, should_pause
            try:
                if is_tile_divisible(request, math.prod(request.tile_shape)):
                    measuring = deque(run_state.tiles_to_measure(tiles, columns))

                    def on_measured(tile: AnyTile) -> None:
                        if run_state.record_measured_cell(tile):
                            measuring.append(tile)

                    submission.task_seconds = 0.0  # with 0 seconds, a task computes just one cell
                    _run_submission(submission, measuring, on_ended, *asked, on_measured)
                    submission.task_seconds = PART_SECONDS
                    run_state.predict_costs(list(left.values()), columns)
                    report_time_left()
                waiting = deque(run_state.sort_by_cost(list(left.values()), columns))

                def requeue_partial_tile(tile: AnyTile) -> None:
                    waiting.appendleft(tile)
                    report_time_left()

                if not should_stop():
                    _run_submission(submission, waiting, on_ended, *asked, requeue_partial_tile)
                if (
                    submission.superseded_futures
                    and isinstance(request, SurveyRequest)
                    and request.has_wrong_share_bound
                ):
                    # Later rounds of audits write some tiles again; an old attempt still running would overwrite them.
                    end_tasks_and_wait(client, submission.superseded_futures)
            finally:
                submission.cancel()


def _run_submission(
    submission: SubmittedTiles,
    waiting: deque[AnyTile],
    on_tile: Callable[[TileRecord], None],
    should_stop: Callable[[], bool],
    should_kill: Callable[[], bool],
    should_pause: Callable[[], bool],
    on_part: Callable[[AnyTile], None],
) -> None:
    """Submit the tiles `waiting` in their order and report ended tasks, until no tile is left or the run must stop."""

    def report(result: TileRecord | AnyTile | None) -> None:
        if isinstance(result, Tile | GearTile):
            on_part(result)
        elif result:
            on_tile(result)

    has_begun = False  # at least one tile begins before a pause, so that a run that pauses often still ends
    while (waiting or submission.in_flight) and not should_stop():
        if waiting and has_begun and should_pause():
            waiting.clear()
        # Late tiles are repeated before new tiles begin. If there are no new tiles, late tiles are repeated once more,
        # because the first repetition may have gone to a frozen worker, too.
        room = submission.count_free_threads()
        room -= submission.repeat_late_tiles(again=not waiting or not room)
        for _ in range(min(room, len(waiting))):
            submission.submit(waiting.popleft())
            has_begun = True
        submission.isolate_endless_tile()
        report(submission.next_record(POLL_SECONDS))
    if submission.in_flight and should_kill():
        submission.kill_tasks()
    deadline = time.monotonic() + GRACE_SECONDS
    while submission.in_flight and (left := deadline - time.monotonic()) > 0:
        report(submission.next_record(left))
