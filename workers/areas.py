"""What is proved of a plane in blocks, by several processes, into one file: a block a line."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from fractions import Fraction
from functools import partial
from pathlib import Path

from rattle.proof.areas.block import Block
from rattle.proof.areas.columns import columns, proved
from rattle.proof.certificate import Ends
from workers.errors import storage_error


def certify_areas(
    out: Path,
    delta: Ends,
    epsilon: Ends,
    beta: Fraction,
    number: int,
    processes: int = 1,
    on_done: Callable[[int], None] = lambda _: None,
    should_stop: Callable[[], bool] = lambda: False,
) -> list[Block]:
    """Prove what can be proved of a plane in so many columns of δ, and write the blocks to the file `out`.

    on_done is told the number of columns that are through, should_stop asked after each. Raises StorageError if the
    file cannot be written, MissingExtraError without python-flint.
    """
    found: list[Block] = []
    try:
        with out.open("w") as file:
            for done, blocks in enumerate(_answers(columns(delta, number), epsilon, beta, processes), 1):
                file.writelines(block.json() + "\n" for block in blocks)
                file.flush()
                found += blocks
                on_done(done)
                if should_stop():
                    break
    except OSError as error:
        raise storage_error(f"{out} cannot be written", error) from error
    return found


def _answers(places: list[Ends], epsilon: Ends, beta: Fraction, processes: int) -> Iterator[list[Block]]:
    """The blocks of each column, in order."""
    of = partial(_of_column, beta=beta, epsilon=epsilon)
    if processes == 1:
        yield from map(of, places)
        return
    pool = ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"))
    try:
        yield from pool.map(of, places)
    finally:
        pool.shutdown(cancel_futures=True)


def _of_column(delta: Ends, beta: Fraction, epsilon: Ends) -> list[Block]:
    return proved(beta, delta, epsilon)
