"""Prove claims about blocks (rectangles) of a plane in several processes, and write the proved blocks to a file."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path

from gear_rattle.workers.apart import call_in_subprocess
from gear_rattle.workers.errors import storage_error
from rattle.proof.areas.block import ProvedBlock
from rattle.proof.areas.columns import cut_into_columns, prove_column
from rattle.proof.certificate import Ends


def certify_areas(
    out: Path,
    delta: Ends,
    epsilon: Ends,
    beta: Fraction,
    number: int,
    processes: int = 1,
    on_done: Callable[[int], None] = lambda _: None,
    should_stop: Callable[[], bool] = lambda: False,
) -> list[ProvedBlock]:
    """Prove claims about blocks of the plane `delta` × `epsilon`, and write the proved blocks to the file `out`.

    The plane is divided into `number` columns of δ. Each line of the file is one block. After each column, `on_done` is
    called with the number of finished columns, and then `should_stop`.

    Returns
    -------
    list[ProvedBlock]
        The proved blocks, column by column; after a stop, the blocks of the finished columns.

    Raises
    ------
    StorageError
        The file cannot be written now, for example because the disk is full.
    MissingExtraError
        python-flint is not installed.
    SurveyError
        The file cannot be written at this path, for example because its directory does not exist.
    """
    found: list[ProvedBlock] = []
    try:
        with out.open("w") as file:
            for done, blocks in enumerate(_prove_columns(cut_into_columns(delta, number), epsilon, beta, processes), 1):
                file.writelines(block.json() + "\n" for block in blocks)
                file.flush()
                found += blocks
                on_done(done)
                if should_stop():
                    break
    except OSError as error:
        refusal = storage_error(f"{out} cannot be written", error)
        raise refusal from error
    return found


def _prove_columns(ranges: list[Ends], epsilon: Ends, beta: Fraction, processes: int) -> Iterator[list[ProvedBlock]]:
    """Yield for each column the list of its proved blocks. ranges: the range of δ of each column."""
    if processes == 1:
        yield from (prove_column(beta, delta, epsilon) for delta in ranges)
        return
    pool = ThreadPoolExecutor(processes)
    try:
        yield from pool.map(lambda delta: call_in_subprocess(prove_column, beta, delta, epsilon), ranges)
    finally:
        pool.shutdown(cancel_futures=True)
