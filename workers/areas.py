"""Prove the blocks of a plane in several processes, and write them to one file, one block in each line."""

from __future__ import annotations

import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from functools import partial
from pathlib import Path

from gear_rattle.workers.errors import storage_error
from rattle.numerics import environment
from rattle.proof.areas.block import ProvedBlock
from rattle.proof.areas.columns import columns, proved
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
    """Divide a plane into `number` columns of δ, prove the blocks of each, and write them to the file `out`.

    The file has a block in each line. After each column, `on_done` is called with the number of finished columns, and
    then `should_stop`.

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
        The file cannot be written.
    """
    found: list[ProvedBlock] = []
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
        refusal = storage_error(f"{out} cannot be written", error)
        raise refusal from error
    return found


def _answers(places: list[Ends], epsilon: Ends, beta: Fraction, processes: int) -> Iterator[list[ProvedBlock]]:
    """Yield the blocks of each column, in the order of the columns."""
    if processes == 1:
        yield from (proved(beta, delta, epsilon) for delta in places)
        return
    pool = ThreadPoolExecutor(processes)
    try:
        yield from pool.map(partial(_proved_apart, beta=beta, epsilon=epsilon), places)
    finally:
        pool.shutdown(cancel_futures=True)


def _proved_apart(delta: Ends, beta: Fraction, epsilon: Ends) -> list[ProvedBlock]:
    """Prove a column in a process of its own, which never imports the main module, and return its blocks."""
    command = [sys.executable, "-c", f"from {__name__} import serve_columns; serve_columns()"]
    asked = pickle.dumps((beta, delta, epsilon))
    answer = subprocess.run(command, input=asked, stdout=subprocess.PIPE, env=environment(), check=True).stdout
    blocks: list[ProvedBlock] | Exception = pickle.loads(answer)
    if isinstance(blocks, Exception):
        raise blocks
    return blocks


def serve_columns() -> None:
    """Prove the column that stdin names, and write its blocks or the error to stdout."""
    asked, answer = pickle.load(sys.stdin.buffer), sys.stdout.buffer
    sys.stdout = sys.stderr  # text that a library prints must not mix with the answer
    try:
        found: list[ProvedBlock] | Exception = proved(*asked)
    except Exception as error:
        found = error
    pickle.dump(found, answer)
