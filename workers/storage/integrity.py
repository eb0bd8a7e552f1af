"""Whether a store still holds what was written to it: every file is where it was put, and as it was put there.

`zarr.json` of the root and of the group `checksums` carry a checksum of themselves. The group has one of every other
file of the template; its array has one of every chunk of every tile, over the chunk's key and bytes, because a chunk's
own checksum knows no position. Any zarr reader reads all that as numbers and text.
"""

import errno
import json
import math
import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.errors import ZarrUserWarning

from gear_rattle.workers.errors import StoppedError, StorageError, SurveyError
from gear_rattle.workers.storage.location import Place, place_of
from gear_rattle.workers.survey.seals import (
    GROUP,
    OWN,
    ROOT,
    SEAL,
    SEALED,
    SLICE,
    TILE_KEY,
    TILES,
    checksum,
    checksums_in,
    chunk_key,
    seal_of,
    tile_key,
)
from gear_rattle.workers.survey.version import code_version

STATUS = "status"
COMPLETED = "date_completed"  # what the root of a completed survey says
READERS = 8  # of files at a time: a bucket answers each after a while
KNOWN = 8  # documents of which it is remembered whether they are whole: two of a store, of some 100 kB


@dataclass(frozen=True)
class Integrity:
    """What a look at every file of a store found.

    A store without checksums that this version can read is one of another version: its chunks are decoded, each of
    which ends in a checksum of its own, and it has no tiles here.
    """

    done: frozenset[int]  # indices of the tiles that are computed and whole
    damaged: dict[int, tuple[str, ...]]  # computed tiles with a lost or damaged chunk, and of which variables
    template: tuple[str, ...]  # damaged files that tiles do not write to: metadata, coordinates, curves
    tiles: int
    files: int  # that were looked at
    version: str  # of the code that computed it; empty if its root is damaged
    completed: str  # when all of it was computed; empty if it was not

    @property
    def whole(self) -> bool:
        """Whether nothing is damaged; tiles of a survey that is not completed may still be missing."""
        return not self.damaged and not self.template

    @property
    def decoded(self) -> bool:
        """Whether there are no checksums of the store that this version can read."""
        return not self.tiles


@dataclass(frozen=True)
class Manifest:
    """What a store's checksums say about it, from the group of that name."""

    content_hash: str
    date_created: str
    grid: tuple[int, int]  # tiles along (epsilon, delta), rows of all slices
    chunks: dict[str, str]  # of each variable that tiles write: its key, with {row} and {column}
    files: dict[str, str]  # checksum of every file of the template, by its key
    slices: int = 1  # along a third axis

    @classmethod
    def of(cls, attributes: Mapping[str, Any]) -> "Manifest":
        """From the group's attributes. Raises KeyError, TypeError, ValueError."""
        rows, columns = attributes["grid"]
        return cls(
            attributes["content_hash"],
            attributes["date_created"],
            (int(rows), int(columns)),
            dict(attributes["chunks"]),
            dict(attributes["files"]),
            int(attributes.get("slices", 1)),
        )

    @property
    def rows(self) -> int:
        """Rows of tiles of a slice."""
        return self.grid[0] // self.slices

    def keys(self, row: int, column: int) -> dict[str, str]:
        """Where the chunks of a tile are, by variable."""
        return {name: chunk_key(key, row, column, self.rows) for name, key in self.chunks.items()}

    def tile_of(self, key: str) -> int | None:
        """Return the index of the tile that has this chunk; None if it is no chunk of a tile."""
        name = key.rpartition("/c/")[0]
        pattern = TILE_KEY if name == TILES else self.chunks.get(name, "")
        places = dict(zip(pattern.split("/"), key.split("/"), strict=False))
        along, row, column = (places.get(part, "0") for part in (SLICE, "{row}", "{column}"))
        if not all(part.isdecimal() and len(part) < 10 for part in (along, row, column)):
            return None
        i, j = int(along) * self.rows + int(row), int(column)
        known = i < self.grid[0] and j < self.grid[1] and chunk_key(pattern, i, j, self.rows) == key
        return i * self.grid[1] + j if known else None


def read_sealed(place: Place, key: str) -> dict[str, Any] | None:
    """Return a sealed document, or None if it is lost or damaged. Raises StorageError, and SurveyError."""
    content = read(place, key) or b""
    try:
        return json.loads(content) if _is_sealed(content) else None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None


@lru_cache(maxsize=KNOWN)
def _is_sealed(content: bytes) -> bool:
    """Whether a document holds its own checksum: each tile that is written asks it of the same two again."""
    document = json.loads(content)
    return bool(document["attributes"][SEAL] == seal_of(document))


def read(place: Place, key: str) -> bytes | None:
    """Return a file; None if it is not there, or the disk cannot read it.

    Raises:
        SurveyError: it may not be read: nobody may take that for lost.
        StorageError: the object store fails.
    """
    try:
        return place.read(key)
    except StorageError:
        raise
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError):
        return None
    except OSError as error:
        if error.errno != errno.EIO:
            raise SurveyError(f"{place} cannot be read ({error}): make it readable") from error
        return None


def manifest_of(place: Place) -> Manifest | None:
    """Return what the checksums of a store say; None if there are none that can be trusted, or no store."""
    root = read_sealed(place, ROOT)
    try:
        if root is not None:
            return Manifest.of(root["consolidated_metadata"]["metadata"][GROUP]["attributes"])
        if not place.deletion_begun() and (own := read_sealed(place, OWN)) is not None:
            return Manifest.of(own["attributes"])
    except (KeyError, TypeError, ValueError):
        pass
    return None


def require_there(place: Place) -> None:
    """Raise StorageError if a store that was there is gone, which is no damage: it may come back."""
    if not place.occupied():
        raise StorageError(
            f"{place} is gone: it was moved or deleted. Bring it back, or run the survey again to compute it anew"
        )


def examine(where: str | Path | Place) -> Integrity:
    """Read every file of a survey's store. A chunk that is not there is lost once the survey was completed.

    Raises:
        SurveyError: there is no survey, or too much of it is damaged to know which it was.
        StorageError: the object store fails.
    """
    place = place_of(where)
    manifest, attributes = manifest_of(place), said_by_root(place)
    version, completed = (str(attributes.get(name, "")) for name in ("code_version", COMPLETED))
    if manifest is None and version in ("", code_version()):
        raise SurveyError(
            f"{place} holds no survey that can be read: name the store of a survey, a population or certificates; of"
            f" one that is damaged, take its {ROOT} and {OWN} from a copy"
        )
    if manifest is None:
        number, lost = _undecodable(place, attributes)
        return Integrity(frozenset(), {}, lost, 0, number, version, completed)
    done, damaged = examine_tiles(place, manifest)
    tiles = math.prod(manifest.grid)
    if completed:
        for index in set(range(tiles)) - done - damaged.keys():
            keys = manifest.keys(*divmod(index, manifest.grid[1]))
            damaged[index] = tuple(name for name, key in keys.items() if read(place, key) is None)
    files = len(SEALED) + len(manifest.files) + (len(manifest.chunks) + 1) * (len(done) + len(damaged))
    template = damaged_template(place, manifest)
    return Integrity(frozenset(done), dict(sorted(damaged.items())), template, tiles, files, version, completed)


def said_by_root(place: Place) -> dict[str, Any]:
    """Return the attributes of a store's root, damaged or not; empty without one."""
    try:
        attributes = json.loads(read(place, ROOT) or b"{}").get("attributes", {})
    except (ValueError, AttributeError, RecursionError):
        attributes = {}
    return attributes if isinstance(attributes, dict) else {}


def _undecodable(place: Place, attributes: Mapping[str, Any]) -> tuple[int, tuple[str, ...]]:
    """Return how many chunks were decoded, and which of them cannot be, of a store of another version.

    Raises:
        SurveyError: its metadata cannot be read.
    """
    lost = [ROOT] if SEAL in attributes and read_sealed(place, ROOT) is None else []
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ZarrUserWarning)  # the lock is no part of a zarr hierarchy
            group = zarr.open_group(place.zarr(), mode="r")
            arrays = [(name, each) for name, each in group.members(max_depth=None) if isinstance(each, zarr.Array)]
    except Exception as error:  # what a foreign format raises
        version = attributes["code_version"]
        raise SurveyError(
            f"{place} was computed by version {version} and cannot be read ({error}): verify it with that version"
        ) from error
    number = 0
    for name, array in arrays:
        for chunk in np.ndindex(*array.cdata_shape):
            number += 1
            at = tuple(slice(i * size, (i + 1) * size) for i, size in zip(chunk, array.chunks, strict=True))
            try:
                values = np.asarray(array[at])
            except Exception:
                lost.append(f"{name}/{array.metadata.encode_chunk_key(chunk)}")
            else:
                if name == STATUS and COMPLETED in attributes and not values.all():
                    lost.append(f"{name}/{array.metadata.encode_chunk_key(chunk)}")
    return number, tuple(lost)


def examine_tiles(
    place: Place, manifest: Manifest, should_stop: Callable[[], bool] | None = None
) -> tuple[set[int], dict[int, tuple[str, ...]]]:
    """Return which tiles are computed and whole, and which are damaged, with the variables.

    Args:
        should_stop: asked at each tile.

    Raises:
        StoppedError: because `should_stop` said so.
        SurveyError, StorageError: as `examine`.
    """
    rows, columns = manifest.grid
    done, damaged = set[int](), dict[int, tuple[str, ...]]()
    with ThreadPoolExecutor(READERS) as readers:
        for row in range(rows):
            found = readers.map(lambda column, row=row: _damage(place, manifest, row, column), range(columns))
            for column, lost in enumerate(found):
                if should_stop and should_stop():
                    readers.shutdown(cancel_futures=True)  # the rest of a long row is not waited for
                    raise StoppedError(f"stopped while {place} was read")
                if lost:
                    damaged[row * columns + column] = lost
                elif lost is not None:
                    done.add(row * columns + column)
    return done, damaged


def _damage(place: Place, manifest: Manifest, row: int, column: int) -> tuple[str, ...] | None:
    """Return the variables of a tile that are lost or damaged; None if it is not computed."""
    return _examined(place, manifest.keys(row, column), row, column)[1]


def whole_tile(place: Place, keys: Mapping[str, str], row: int, column: int) -> dict[str, bytes] | None:
    """Return the chunks of a tile, by variable; None if it is not computed, or damaged. keys: where they are.

    Raises:
        SurveyError, StorageError: as `read`.
    """
    contents, lost = _examined(place, keys, row, column)
    return {name: content for name, content in contents.items() if content is not None} if lost == () else None


def _examined(
    place: Place, keys: Mapping[str, str], row: int, column: int
) -> tuple[dict[str, bytes | None], tuple[str, ...] | None]:
    """Return what is in a tile's files, and which variables are lost or damaged; None if it is not computed."""
    noted = read(place, tile_key(row, column))
    if noted is None and read(place, keys[STATUS]) is None:
        return {}, None
    known = checksums_in(noted or b"", tile_key(row, column), len(keys))
    if known is None:
        return {}, (GROUP,)
    contents = {name: read(place, key) for name, key in keys.items()}
    lost = tuple(
        name
        for (name, content), expected in zip(contents.items(), known, strict=True)
        if content is None or checksum(keys[name], content) != expected
    )
    # The status comes last: a tile that was interrupted before it is not computed, and not damaged.
    return contents, None if lost == (STATUS,) and contents[STATUS] is None else lost


def damaged_template(place: Place, manifest: Manifest) -> tuple[str, ...]:
    """Return the files of a survey that are lost or damaged, but for what tiles write."""
    lost = [key for key in SEALED if read_sealed(place, key) is None]
    with ThreadPoolExecutor(READERS) as readers:
        contents = readers.map(lambda key: read(place, key), manifest.files)
        for (key, known), content in zip(manifest.files.items(), contents, strict=True):
            if content is None or checksum(key, content).hex() != known:
                lost.append(key)
    return tuple(lost)
