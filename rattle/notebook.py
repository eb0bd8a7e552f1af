"""Displays of results: as one line, as a table in a notebook, and as objects of pandas and xarray."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib import import_module
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rattle.errors import MissingExtraError

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame
    from xarray import Dataset
else:
    DataFrame = Dataset = Figure = Any  # at run time these packages are imported on demand only

#: Most rows of a table in a notebook; a longer table shows its first and its last rows.
ROWS = 12

Columns = Mapping[str, Sequence[Any] | NDArray[Any]]


class DisplayedResult(Protocol):
    """A result with a caption and a table."""

    def _caption(self) -> str:
        """Return a description of the result in one line."""

    def _columns(self) -> Columns:
        """Return the table of the result: columns of the same length, by name."""


class TabularResult:
    """Base class of results that are shown as one line, as a table in a notebook, and as a DataFrame."""

    def __repr__(self: DisplayedResult) -> str:
        """Return a one-line description."""
        return repr_text(self)

    def _repr_html_(self: DisplayedResult) -> str:
        return html_of(self)

    def to_dataframe(self: DisplayedResult) -> DataFrame:
        """Return the table of the result.

        Returns
        -------
        DataFrame
            A row for each attractor of basins, event of a diagram, impact of an orbit, or point of a branch or a curve.

        Raises
        ------
        MissingExtraError
            If pandas is not installed.
        """
        return dataframe_of(self)


def repr_text(result: DisplayedResult) -> str:
    """Return the text that `repr` shows for a result."""
    return f"<{result._caption()}>"


def html_of(result: DisplayedResult) -> str:
    """Return the HTML that a notebook shows for a result."""
    return html_table(result._caption(), result._columns())


def dataframe_of(result: DisplayedResult) -> DataFrame:
    """Return the table of a result. Raises MissingExtraError without pandas."""
    try:
        import pandas
    except ModuleNotFoundError as error:
        raise MissingExtraError("tables need pandas: pip install 'gear-rattle[workers]'") from error
    return pandas.DataFrame({name: np.asarray(values) for name, values in result._columns().items()})


def dataset_of(
    variables: Mapping[str, tuple[Any, ...]], coordinates: Mapping[str, Any], attributes: Mapping[str, Any]
) -> Dataset:
    """Return an xarray.Dataset, given the arguments of its constructor. Raises MissingExtraError without xarray."""
    try:
        import xarray
    except ModuleNotFoundError as error:
        raise MissingExtraError("labelled arrays need xarray: pip install 'gear-rattle[workers]'") from error
    return xarray.Dataset(dict(variables), dict(coordinates), dict(attributes))


def figure_of(result: DisplayedResult, drawn_by: str) -> Figure:
    """Return the picture of a result.

    drawn_by: the name of the function of `rattle.plot` that draws the result. The function is loaded by its name,
    because `rattle.plot` imports the modules of all results.

    Returns
    -------
    Figure
        A matplotlib figure.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    """
    drawn: Figure = getattr(import_module("rattle.plot"), drawn_by)(result)
    return drawn


def motion_label(m: int, n_plus: int, n_minus: int) -> str:
    """Return the label P(m, n₊, n₋) of a periodic motion."""
    return f"P({m}, {n_plus}, {n_minus})"


def plain_text_table(columns: Columns) -> str:
    """Return a table as plain text: a line with the names of the columns, then a line for each row."""
    texts = [[name, *map(_value_as_text, values)] for name, values in columns.items()]
    widths = [max(map(len, column)) for column in texts]
    return "\n".join(
        "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()
        for row in zip(*texts, strict=True)
    )


def html_table(caption: str, columns: Columns) -> str:
    """Return a table as HTML. A table with more than ROWS rows shows only its first and its last rows."""
    length = max((len(values) for values in columns.values()), default=0)
    shown: Iterable[int | None] = range(length)
    if length > ROWS:
        shown = [*range(ROWS // 2), None, *range(length - ROWS // 2, length)]
    head = "".join(f"<th>{escape(name)}</th>" for name in columns)
    rows = "".join(f"<tr>{_html_cells(columns, row)}</tr>" for row in shown)
    return f"<table><caption>{escape(caption)}</caption><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"


def _html_cells(columns: Columns, row: int | None) -> str:
    """Return the HTML cells of row number `row`; None stands for the row of dots in the middle of a long table."""
    texts = ("…" if row is None else _value_as_text(values[row]) for values in columns.values())
    return "".join(f"<td>{escape(text)}</td>" for text in texts)


def _value_as_text(value: Any) -> str:
    """Return a value as text: "yes" or "no" for a bool, at most six significant digits for a real or complex number."""
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, complex | np.complexfloating):
        return f"{value.real:.6g}" if value.imag == 0 else f"{value.real:.6g} {value.imag:+.6g}i"
    return f"{value:.6g}" if isinstance(value, float | np.floating) else str(value)
