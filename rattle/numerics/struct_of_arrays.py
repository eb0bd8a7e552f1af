"""Tables whose columns are arrays: dataclasses, taken, joined and sorted as a whole."""

from __future__ import annotations

from collections import namedtuple
from dataclasses import fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray


class StructOfArrays:
    """A dataclass whose fields are arrays with one row for each thing: what such tables have in common.

    Nothing unpacks a table by the order of its fields. Kernels take single columns, or all of them by their names:
    `for_kernels`, of a class for which there is a `kernel_columns`.
    """

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return the arrays by their names."""
        mine: Any = self
        return {field.name: getattr(self, field.name) for field in fields(mine)}

    def for_kernels(self) -> Any:
        """Return the arrays as kernels take them: a named tuple over the same memory."""
        return _FOR_KERNELS[type(self)](**self.columns())

    def take(self, rows: Any) -> Self:
        """Return some of the rows, in their order: anything that indexes an array."""
        return type(self)(**{name: values[rows] for name, values in self.columns().items()})

    def replace(self, **changes: NDArray[Any]) -> Self:
        """Return the table with other columns of these names."""
        mine: Any = self
        return replace(mine, **changes)

    def sort(self, *names: str) -> Self:
        """Return the table sorted by these columns, the first before the others; equal rows keep their order."""
        return self.take(np.lexsort([self.columns()[name] for name in reversed(names)]))

    @classmethod
    def concat(cls, tables: list[Self]) -> Self:
        """Return the rows of one table after those of another."""
        each = [table.columns() for table in tables]
        return cls(**{name: np.concatenate([columns[name] for columns in each]) for name in each[0]})


_FOR_KERNELS: dict[type, Any] = {}


def kernel_columns(name: str, table: type, module: str) -> Any:
    """Return the class of named tuples, to be found under this name in its module, as which kernels take a table."""
    columns: Any = namedtuple(name, [field.name for field in fields(table)], module=module)  # type: ignore[misc]
    _FOR_KERNELS[table] = columns
    return columns
