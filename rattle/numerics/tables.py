"""Tables of numbers from users: CSV with a header."""

import csv
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rattle.errors import ParameterError, RattleError, did_you_mean

MOST_SHOWN = 20  # a message shows at most this many columns, and this many characters of each


def read_columns(path: str | Path, names: Iterable[str], needed: str | None = None) -> dict[str, NDArray[np.float64]]:
    """Return the columns of a CSV file that have these names, each (n,).

    Names are not case-sensitive.

    Returns
    -------
    dict[str, NDArray[np.float64]]
        Columns by name, in the order of the file.

    Raises
    ------
    ParameterError
        If the file lacks the column `needed` or, without `needed`, all of the columns `names`; or if one of the
        columns `names` appears twice or has an entry that is not a number.
    RattleError
        If the file cannot be read.
    """
    try:
        with Path(path).open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise RattleError(f"the table {path} cannot be read: {error}") from None
    header = [name.strip().lower() for name in rows[0]] if rows else []
    table = [(number, row) for number, row in enumerate(rows[1:], 2) if any(cell.strip() for cell in row)]
    wanted = list(names)
    if not set(header).intersection([needed] if needed else wanted):
        hints = {did_you_mean(name, wanted) for name in header[:MOST_SHOWN] if name not in wanted}
        others = ", ".join(name for name in wanted if name != needed)
        columns = f"{needed} is required, and the others may be {others}" if needed else f"at least one of {others}"
        raise ParameterError(
            f"the first line of {path} must name its columns: {columns}; it has {_header_as_text(header)}"
            f"{min(hints - {''}, default='')}"
        )
    for name in wanted:
        if header.count(name) > 1:
            raise ParameterError(f"the table {path} has {header.count(name)} columns named {name!r}: keep one of them")
    return {
        name: np.array([_parse_number(path, line, row, column) for line, row in table])
        for column, name in enumerate(header)
        if name in wanted
    }


def _header_as_text(header: list[str]) -> str:
    """Return the first 20 names of a header as text, each cut to 20 characters."""
    shown = ", ".join(repr(name[:MOST_SHOWN]) for name in header[:MOST_SHOWN])
    return shown or "none: the table is empty"


def _parse_number(path: str | Path, line: int, row: list[str], column: int) -> float:
    try:
        return float(row[column])
    except (ValueError, IndexError):
        cell = row[column] if column < len(row) else ""
        raise ParameterError(
            f"line {line} of {path}: {cell[:MOST_SHOWN]!r} in column {column + 1} is not a number"
        ) from None
