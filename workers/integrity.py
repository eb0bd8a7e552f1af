"""Whether a store still holds what was written to it: every chunk has its file, and every file its checksum."""

import errno
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.codecs import Crc32cCodec

from workers.errors import SurveyError
from workers.location import Place, place_of, read_json
from workers.schema import CELL

STATUS = "status"


@dataclass(frozen=True)
class Integrity:
    """What a look at every chunk of a store found."""

    done: frozenset[int]  # indices of the tiles that are computed and whole
    damaged: dict[int, tuple[str, ...]]  # computed tiles with a lost or damaged chunk, and of which variables
    template: tuple[str, ...]  # arrays and groups that tiles do not write to, such as curves, with damage
    tiles: int
    checksums: bool  # without them, in stores of older versions, only what cannot be decoded is found

    @property
    def whole(self) -> bool:
        """Whether nothing is damaged; tiles may still be missing."""
        return not self.damaged and not self.template


def examine(where: str | Path | Place) -> Integrity:
    """Read every chunk of a survey's store.

    Raises:
        SurveyError: there is no survey, or its `status` cannot be found.
        StorageError: the object store fails.
    """
    place = place_of(where)
    try:
        with place.reaching():
            root = zarr.open_group(place.zarr(), mode="r", zarr_format=3)
        finished = "date_completed" in root.attrs
        per_cell = [array for _, array in root.arrays() if _per_cell(array) and array.name != f"/{STATUS}"]
        status = _Array(place, root[STATUS])  # type: ignore[arg-type]  # an array, or an error below
        arrays = [_Array(place, array) for array in per_cell]
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise SurveyError(f"{place} holds no survey that can be read ({error}): name the store of a survey") from error
    done, damaged = set[int](), dict[int, tuple[str, ...]]()
    rows, columns = status.grid
    for row in range(rows):
        known = {column for column in range(columns) if finished or status.has(row, column)}
        unread = set(status.unreadable(row, known))
        computed = {column for column in known - unread if status.computed(row, column)}
        lost = dict.fromkeys(unread, (STATUS,))
        for array in arrays:
            for column in array.unreadable(row, computed):
                lost[column] = (*lost.get(column, ()), array.name)
        damaged |= {row * columns + column: names for column, names in sorted(lost.items())}
        done |= {row * columns + column for column in computed.difference(lost)}
    return Integrity(frozenset(done), damaged, damaged_template(place), rows * columns, status.checked)


def damaged_template(place: Place) -> tuple[str, ...]:
    """Return the arrays and groups of a survey that cannot be read, but for what tiles write."""
    described: dict[str, Any] = read_json(place, "zarr.json")["consolidated_metadata"]["metadata"]
    with place.reaching():
        members = dict(zarr.open_group(place.zarr(), mode="r", zarr_format=3).members(max_depth=None))
    return tuple(name for name in described if not _template_whole(place, name, described[name], members[name]))


def _template_whole(place: Place, name: str, described: dict[str, Any], member: zarr.Array | zarr.Group) -> bool:
    try:
        own = read_json(place, f"{name}/zarr.json")
        if {**own, "consolidated_metadata": None} != {**described, "consolidated_metadata": None}:
            return False
    except (OSError, ValueError):
        return False
    if isinstance(member, zarr.Group) or _per_cell(member) or not member.size:
        return True
    array = _Array(place, member)
    return (array.has(*[0] * member.ndim) or not array.checked) and array.readable(...)


def _per_cell(array: zarr.Array) -> bool:
    return (getattr(array.metadata, "dimension_names", None) or ())[-2:] == CELL


class _Array:
    """An array of a store, by the rows and columns of its chunks."""

    def __init__(self, place: Place, array: zarr.Array) -> None:
        self._array, self._place, self._is_there = array, place, place.finder(array.path)
        self.name = array.path
        self.checked = any(isinstance(codec, Crc32cCodec) for codec in array.metadata.codecs)  # type: ignore[union-attr]

    @property
    def grid(self) -> tuple[int, int]:
        """Chunks along (epsilon, delta)."""
        rows, columns = (-(-n // size) for n, size in zip(self._array.shape[-2:], self._array.chunks[-2:], strict=True))
        return rows, columns

    def has(self, *chunk: int) -> bool:
        """Whether a chunk, given by its last indices, has a file; older versions wrote none for fill values."""
        where = (0,) * (self._array.ndim - len(chunk)) + chunk
        key = self._array.metadata.encode_chunk_key(where)
        return self._is_there(key)

    def unreadable(self, row: int, columns: set[int]) -> Iterator[int]:
        """Those of the chunks that are lost or damaged."""
        lost = {column for column in columns if self.checked and not self.has(row, column)}
        yield from lost
        there = columns - lost
        if len(there) == self.grid[1] and self.readable((..., self._span(0, row), slice(None))):
            return  # one read for the whole row
        yield from (column for column in there if not self.readable(self._cells(row, column)))

    def computed(self, row: int, column: int) -> bool:
        """Whether no value of a chunk is 0."""
        return bool(np.all(self._array[self._cells(row, column)]))

    def readable(self, selection: Any) -> bool:
        """Whether a part of the array decodes, and matches its checksums."""
        try:
            with self._place.reaching():
                self._array[selection]
        except (MemoryError, SurveyError):
            raise
        except OSError as error:
            if error.errno not in (errno.EIO, errno.ENOENT):  # nobody may take what he is not allowed to read for lost
                raise SurveyError(f"{self._place} cannot be read ({error}): make it readable") from error
            return False
        except Exception:  # whatever a codec raises
            return False
        return True

    def _cells(self, row: int, column: int) -> tuple[Any, ...]:
        return (..., self._span(0, row), self._span(1, column))

    def _span(self, axis: int, index: int) -> slice:
        size = self._array.chunks[axis - 2]
        return slice(index * size, (index + 1) * size)
