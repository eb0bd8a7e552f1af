"""Compute a tile that killed its workers, or did not end, cell by cell in a separate process.

A cell that kills this process, or takes too long, fails alone; all other cells of the tile are computed.
"""

import os
import pickle
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from typing import IO

from gear_rattle.workers.kinds import AnyRequest, AnyTile, compute_tile, evaluate_cells_one_by_one
from gear_rattle.workers.survey.tiles import CellOutcome, TileArrays, TileRecord
from rattle.numerics import child_process_environment

#: A cell fails after this many deaths of its process, because a single death may have another cause.
ATTEMPTS = 2
#: The most processor time of a cell, in seconds: a hundred times the time of the slowest known cell.
CELL_SECONDS = 600
_START = f"from {__name__} import compute_cells_from_stdin; compute_cells_from_stdin()"


def compute_tile_isolated(request: AnyRequest, tile: AnyTile, memory: int | None) -> tuple[TileArrays, TileRecord]:
    """Compute a tile in a process that may be killed; values are equal to the bit to those of `compute_tile`.

    A cell that kills the process ATTEMPTS times, or needs more than CELL_SECONDS of processor time, fails: it gets
    status 3 and a message.

    Parameters
    ----------
    memory : int | None
        Bytes of data that the process may have; a cell that needs more fails. None for no limit.

    Returns
    -------
    tuple[TileArrays, TileRecord]
        Arrays of the tile, and its record.
    """
    return compute_tile(request, tile, outcomes=_compute_outcomes(request, tile, memory))


def _compute_outcomes(request: AnyRequest, tile: AnyTile, memory: int | None) -> Iterator[CellOutcome]:
    first, deaths = 0, 0
    while first < tile.n_cells:
        child = subprocess.Popen(
            [sys.executable, "-c", _START],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=child_process_environment(),
        )
        assert child.stdin is not None
        assert child.stdout is not None
        try:
            pickle.dump((request, tile, first, memory), child.stdin)
            child.stdin.flush()
            for outcome in _receive_outcomes(child.stdout):
                yield outcome
                first, deaths = first + 1, 0
        finally:
            child.kill()
            child.communicate()
        if first < tile.n_cells and child.returncode == -signal.SIGXCPU:
            yield f"took more than {CELL_SECONDS} s of processor time"
            first, deaths = first + 1, 0
        elif first < tile.n_cells:
            deaths += 1
            if deaths == ATTEMPTS:
                yield f"killed its process {ATTEMPTS} times ({_describe_process_death(child.returncode)})"
                first, deaths = first + 1, 0


def _receive_outcomes(stream: IO[bytes]) -> Iterator[CellOutcome]:
    """Yield the outcomes of cells until the process that computes them ends.

    Yields
    ------
    CellOutcome
        A cell's values, or the message of its failure.

    Raises
    ------
    RuntimeError
        The process did not start.
    Exception
        The error that the process sent before it ended.
    """
    try:
        pickle.load(stream)
    except (EOFError, pickle.UnpicklingError):
        raise RuntimeError(
            "the process that computes the cells of a tile does not start: see the worker's log"
        ) from None
    while True:
        try:
            received = pickle.load(stream)
        except (EOFError, pickle.UnpicklingError):  # the process ended, perhaps while it wrote
            return
        if isinstance(received, Exception):
            raise received
        yield received


def _describe_process_death(code: int) -> str:
    return signal.Signals(-code).name if code < 0 else f"exit status {code}"


def compute_cells_from_stdin() -> None:
    """Compute the cells that stdin names, and write each outcome to stdout: the main function of the process."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # text that a library prints goes to stderr, so that stdout has outcomes only
    request, tile, first, memory = pickle.load(sys.stdin.buffer)
    # When the worker ends, stdin closes and this thread ends the process, even in a kernel: kernels release the GIL.
    threading.Thread(target=lambda: (sys.stdin.buffer.read(), os._exit(1)), daemon=True).start()
    if memory:
        resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
    _send_pickled(out, None)
    try:
        _limit_processor_time_of_cell()
        for outcome in evaluate_cells_one_by_one(request, tile, first, failing=(MemoryError,)):
            _send_pickled(out, outcome)
            _limit_processor_time_of_cell()
    except Exception as error:
        _send_pickled(out, error)
    os._exit(0)


def _limit_processor_time_of_cell() -> None:
    """Let the system kill this process after CELL_SECONDS more of processor time; nothing else interrupts a kernel."""
    _, most = resource.getrlimit(resource.RLIMIT_CPU)
    limit = int(time.process_time()) + CELL_SECONDS
    resource.setrlimit(resource.RLIMIT_CPU, (limit if most == resource.RLIM_INFINITY else min(limit, most), most))


def _send_pickled(out: IO[bytes], item: object) -> None:
    pickle.dump(item, out)
    out.flush()
