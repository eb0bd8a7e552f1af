"""Tables whose columns are arrays: dataclasses whose rows are selected, joined and sorted together."""

from __future__ import annotations

from collections import namedtuple
from dataclasses import fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray


class StructOfArrays:
    """A dataclass whose fields are arrays with one row for each item.

    Code accesses columns by name, never by the order of fields. Kernels take single columns, or the named tuple of
    `to_kernel_tuple` if the class has `define_kernel_columns`.
    """

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return the arrays by their names."""
        mine: Any = self
        return {field.name: getattr(self, field.name) for field in fields(mine)}

    def to_kernel_tuple(self) -> Any:
        """Return the arrays as a named tuple over the same memory, for kernels."""
        return _FOR_KERNELS[type(self)](**self.columns())

    def take(self, rows: Any) -> Self:
        """Return the rows that an index, slice or mask selects, in that order."""
        return type(self)(**{name: values[rows] for name, values in self.columns().items()})

    def replace(self, **changes: NDArray[Any]) -> Self:
        """Return the table with these columns replaced."""
        mine: Any = self
        return replace(mine, **changes)

    def sort(self, *names: str) -> Self:
        """Return the table sorted by these columns, the first most significant; equal rows keep their order."""
        return self.take(np.lexsort([self.columns()[name] for name in reversed(names)]))

    @classmethod
    def concat(cls, tables: list[Self]) -> Self:
        """Return the rows of all tables as one table, in the order of the tables."""
        each = [table.columns() for table in tables]
        return cls(**{name: np.concatenate([columns[name] for columns in each]) for name in each[0]})


_FOR_KERNELS: dict[type, Any] = {}


def define_kernel_columns(name: str, table: type, module: str) -> Any:
    """Return a new named-tuple class in which kernels take the columns of `table`.

    The module `module` must hold the class under the name `name`, because numba's cache stores it by these names.

    Returns
    -------
    type
        The class, with the fields of `table` in order.
    """
    columns: Any = namedtuple(name, [field.name for field in fields(table)], module=module)  # type: ignore[misc]
    _FOR_KERNELS[table] = columns
    return columns
