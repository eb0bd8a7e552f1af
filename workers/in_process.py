"""Run a survey of a few seconds in this process, because starting a cluster would take longer."""

import math
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from queue import Empty, SimpleQueue

from gear_rattle.workers.kinds import AnyRequest, AnyTile, compute_tile, tile_error
from gear_rattle.workers.populations.request import PopulationRequest
from gear_rattle.workers.storage.location import Place, place_of
from gear_rattle.workers.storage.manifest import tile_recorder
from gear_rattle.workers.storage.store import remove_outdated_results, require_aligned_tiles, write_tile
from gear_rattle.workers.survey.tiles import GRACE_SECONDS, POLL_SECONDS, TileRecord
from gear_rattle.workers.survey.values.schema import SAMPLED, Group
from rattle.models import MODELS

#: Milliseconds for a cell in closed form, for a sample, and for the basins of a cell. These are round constants instead
#: of measured times, so that a command behaves alike on all machines.
CLOSED_FORM, SAMPLE, BASINS = 0.05, 1 / 64, 40.0
SLOW_BELOW = 0.3  # damping δ below which the time of a sample grows like 1/δ
FEW_SECONDS = 3.0  # a survey is short if it takes at most this many seconds


def takes_few_seconds(request: AnyRequest, cells: int) -> bool:
    """Return whether the computation of a number of cells takes at most FEW_SECONDS, by a rough estimate."""
    groups, whole = set(request.quantities), MODELS[request.model].cell_milliseconds
    if isinstance(request, PopulationRequest):
        samples = SAMPLE * request.samples / request.n_cells if whole is None else whole
        return cells * samples * max(1.0, SLOW_BELOW / request.least_damping) <= 1000 * FEW_SECONDS
    if whole is not None:
        each = whole
    elif SAMPLED & groups:
        each = SAMPLE * request.initial_conditions.count * max(1.0, SLOW_BELOW / request.delta.start)
    else:
        each = CLOSED_FORM
    return cells * (each + (BASINS if Group.BASINS in groups else 0.0)) <= 1000 * FEW_SECONDS


def run_tiles_in_this_process(
    request: AnyRequest,
    where: str | Path | Place,
    tiles: Iterable[AnyTile],
    on_tile: Callable[[TileRecord], None],
    should_stop: Callable[[], bool],
) -> None:
    """Compute tiles in this process, one after the other, and write them to an existing store.

    The results are equal to the bit to those of `run_tiles`. A cell that would kill a worker kills this process.

    Parameters
    ----------
    on_tile : Callable[[TileRecord], None]
        Called in this thread with the record of each written tile.
    should_stop : Callable[[], bool]
        Called several times a second. The run ends within seconds after this returns true, even during a slow tile.

    Raises
    ------
    StorageError
        A tile cannot be written now (the disk is full or read-only); the message names the tile.
    SurveyError
        A tile cannot be computed, or another run has locked the store.
    """
    tiles = list(tiles)
    require_aligned_tiles(request, tiles)
    place = place_of(where)
    stopping, run_ended = threading.Event(), threading.Event()
    ended: SimpleQueue[TileRecord | Exception | None] = SimpleQueue()

    def compute_tiles() -> None:
        for tile in tiles:
            if stopping.is_set():
                break
            try:
                values, record = compute_tile(request, tile)
                if run_ended.is_set():  # the store is not locked any more, so nothing may be written
                    break
                record = replace(record, files=write_tile(request, str(place), tile, values))
            except Exception as error:
                ended.put(tile_error(request, tile, error).with_traceback(error.__traceback__))
                break
            ended.put(record)
        ended.put(None)

    with place.lock_for_writing():
        if tiles:
            remove_outdated_results(request, place)
        with tile_recorder(place) as note:
            threading.Thread(target=compute_tiles, name="tiles", daemon=True).start()
            try:
                deadline = math.inf
                while time.monotonic() < deadline:
                    if deadline == math.inf and should_stop():
                        stopping.set()
                        deadline = time.monotonic() + GRACE_SECONDS
                    try:
                        found = ended.get(timeout=POLL_SECONDS)
                    except Empty:
                        continue
                    if found is None:
                        return
                    if isinstance(found, Exception):
                        raise found
                    note({found.index: found.files})
                    on_tile(found)
            finally:
                run_ended.set()
