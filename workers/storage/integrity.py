"""Check that every file of a store is in its place and unchanged.

The manifest lists each file's digest under its key, so that exchanged chunks are found too: a chunk's own checksum does
not show an exchange.
"""

import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import zarr
from zarr.errors import ZarrUserWarning

from gear_rattle.workers.apart import CalledProcessError, call_in_subprocess
from gear_rattle.workers.errors import StoppedError, SurveyError
from gear_rattle.workers.storage.location import Place, place_of
from gear_rattle.workers.storage.manifest import (
    read_file,
    read_manifest,
    read_unchecked_attributes,
    read_undamaged_root,
)
from gear_rattle.workers.survey.manifest import MANIFEST, ROOT, Manifest, digest
from gear_rattle.workers.survey.version import code_version

STATUS = "status"
COMPLETED = "date_completed"  # attribute of the root of a completed survey
READERS = 8  # number of files that are read at the same time, because a bucket answers slowly
BATCH = 1024  # most tasks that wait at the same time, because each waiting task takes 1.6 kB of memory

Item = TypeVar("Item")
Answer = TypeVar("Answer")
#: The indices of the undamaged tiles, and {index of a damaged tile: its damaged variables}.
TileFindings = tuple[set[int], dict[int, tuple[str, ...]]]


@dataclass(frozen=True)
class StoreIntegrity:
    """Result of checking every file of a store.

    If this version cannot read the store's manifest, the chunks were decoded instead. Decoding finds damaged chunks
    by the checksum at their end. In this case `tiles` is 0, `done` and `damaged` are empty, and `template` has the keys
    of all lost or damaged files.
    """

    done: frozenset[int]  # indices of the tiles that are computed and whole
    damaged: dict[int, tuple[str, ...]]  # by index of a computed tile: variables with a lost or damaged chunk
    template: tuple[str, ...]  # lost or damaged files that belong to no tile: metadata, coordinates, curves
    tiles: int  # number of tiles of the survey
    files: int  # number of checked files
    version: str  # code version of the store; empty if its root cannot be read
    completed: str  # date of completion; empty if the survey is not complete

    @property
    def is_whole(self) -> bool:
        """True if nothing is damaged; an incomplete survey may still lack tiles."""
        return not self.damaged and not self.template

    @property
    def was_checked_by_decoding(self) -> bool:
        """True if the chunks were checked by decoding, because this version cannot read a manifest of the store."""
        return not self.tiles


def examine(where: str | Path | Place, processes: int = 1) -> StoreIntegrity:
    """Check every file of the store of a survey or population.

    In a completed survey a missing chunk counts as lost; in another survey its tile may not be computed yet.

    Parameters
    ----------
    where : str | Path | Place
        Path or s3:// URL of the store.
    processes : int
        Number of processes that read tiles; the result does not depend on it.

    Returns
    -------
    StoreIntegrity
        Whole and damaged tiles, other damaged files, and the code version.

    Raises
    ------
    StorageError
        The object store fails.
    SurveyError
        There is no store, or it is too damaged to be identified; or a process that reads tiles was killed.
    """
    place = place_of(where)
    if not place.is_occupied():
        raise SurveyError(f"{place} does not exist or is empty: give the path of a store")
    manifest, attributes = read_manifest(place), read_unchecked_attributes(place)
    version, completed = (str(attributes.get(name, "")) for name in ("code_version", COMPLETED))
    if manifest is None and (not version or "content_hash" not in attributes):
        raise SurveyError(
            f"{place} holds no store that can be read: name the store of a survey, a population or certificates; if it"
            f" is damaged, restore its {ROOT} and {MANIFEST} from a copy"
        )
    if manifest is None:
        number, lost = _check_by_decoding(place, attributes)
        return StoreIntegrity(frozenset(), {}, lost, 0, number, version, completed)
    done, damaged = (
        examine_tiles(place, manifest) if processes == 1 else _examine_tiles_in_processes(place, manifest, processes)
    )
    if completed:
        for index in set(range(manifest.n_tiles)) - manifest.tiles.keys():
            damaged[index] = tuple(manifest.chunks)
    files = 2 + len(manifest.files) + len(manifest.chunks) * len(manifest.tiles)
    template, damaged = find_damaged_template_files(place, manifest), dict(sorted(damaged.items()))
    return StoreIntegrity(frozenset(done), damaged, template, manifest.n_tiles, files, version, completed)


def _check_by_decoding(place: Place, attributes: Mapping[str, Any]) -> tuple[int, tuple[str, ...]]:
    """Decode all chunks of a store without a readable manifest.

    Returns
    -------
    tuple[int, tuple[str, ...]]
        The number of chunks, and the keys of lost or damaged files.

    Raises
    ------
    SurveyError
        The metadata of the store cannot be read.
    """
    version = attributes["code_version"]
    is_this_version = version == code_version()  # this version writes every chunk: a missing chunk is a lost one
    lost = [MANIFEST] if is_this_version else []
    try:
        with warnings.catch_warnings():
            # zarr warns about the lock file, which is not part of a zarr hierarchy.
            warnings.simplefilter("ignore", ZarrUserWarning)
            group = zarr.open_group(place.zarr(), mode="r")
            arrays = [(name, each) for name, each in group.members(max_depth=None) if isinstance(each, zarr.Array)]
    except Exception as error:  # a foreign format raises errors of several types
        advice = (
            "compute the same request again to repair it" if is_this_version else "verify the store with that version"
        )
        raise SurveyError(
            f"{place} was computed by version {version} and cannot be read ({error}): {advice}"
        ) from error
    number = 0
    for name, array in arrays:
        for chunk in np.ndindex(*array.cdata_shape):
            number += 1
            key = f"{name}/{array.metadata.encode_chunk_key(chunk)}"
            at = tuple(slice(i * size, (i + 1) * size) for i, size in zip(chunk, array.chunks, strict=True))
            try:
                values = np.asarray(array[at])
                is_lost = (name == STATUS and not values.all()) or (is_this_version and read_file(place, key) is None)
            except SurveyError:
                raise
            except Exception:  # codecs raise errors of several types for a damaged chunk
                lost.append(key)
            else:
                if is_lost and COMPLETED in attributes:
                    lost.append(key)
    return number, tuple(lost)


def examine_tiles(place: Place, manifest: Manifest, should_stop: Callable[[], bool] | None = None) -> TileFindings:
    """Return the tiles that are computed and whole, and the damaged variables of the damaged tiles.

    Parameters
    ----------
    should_stop : Callable[[], bool] | None
        Called at each tile; returns whether to stop.

    Returns
    -------
    TileFindings
        Indices of whole tiles; damaged variables by index of the tile.

    Raises
    ------
    SurveyError, StorageError
        See `examine`.
    StoppedError
        `should_stop` returned true.
    """
    done, damaged = set[int](), dict[int, tuple[str, ...]]()
    with ThreadPoolExecutor(READERS) as readers:
        found = _apply_in_batches(readers, lambda index: _damaged_variables(place, manifest, index), manifest.tiles)
        for index, lost in zip(manifest.tiles, found, strict=True):
            if should_stop and should_stop():
                readers.shutdown(cancel_futures=True)  # waits only for tiles that a thread is reading
                raise StoppedError(f"stopped while {place} was read")
            if lost:
                damaged[index] = lost
            else:
                done.add(index)
    return done, damaged


def _apply_in_batches(
    threads: ThreadPoolExecutor, function: Callable[[Item], Answer], items: Iterable[Item]
) -> Iterator[Answer]:
    """Yield the results of `threads.map`, submitting the items in batches."""
    left = iter(items)
    while batch := list(islice(left, BATCH)):
        yield from threads.map(function, batch)


def _examine_tiles_in_processes(place: Place, manifest: Manifest, processes: int) -> TileFindings:
    """Examine tiles like `examine_tiles`, in several processes. Each of n processes reads every n-th tile."""
    tiles = list(manifest.tiles.items())
    parts = [replace(manifest, files={}, tiles=dict(tiles[first::processes])) for first in range(processes)]
    done, damaged = set[int](), dict[int, tuple[str, ...]]()
    with ThreadPoolExecutor(processes) as threads:
        for some, lost in threads.map(
            partial(_examine_tiles_in_own_process, str(place)), filter(lambda part: part.tiles, parts)
        ):
            done |= some
            damaged |= lost
    return done, damaged


def _examine_tiles_in_own_process(where: str, manifest: Manifest) -> TileFindings:
    """Run `examine_tiles` in a process of its own. Raises SurveyError if the process is killed."""
    try:
        return call_in_subprocess(_examine_tiles_at, where, manifest)
    except CalledProcessError as error:
        raise SurveyError(
            f"a process that read tiles of {where} ended with status {error.returncode}: verify the store again"
        ) from error


def _examine_tiles_at(where: str, manifest: Manifest) -> TileFindings:
    return examine_tiles(place_of(where), manifest)


def _damaged_variables(place: Place, manifest: Manifest, index: int) -> tuple[str, ...]:
    """Return the variables of a computed tile that are lost or damaged."""
    keys, known = manifest.chunk_keys(index), manifest.digests_of_tile(index)
    return tuple(name for name, key in keys.items() if not _is_file_undamaged(place, key, known.get(key)))


def _is_file_undamaged(place: Place, key: str, known: str | None) -> bool:
    """Return whether a file of a store exists and has the digest `known`."""
    content = read_file(place, key)
    return content is not None and digest(content) == known


def find_damaged_template_files(place: Place, manifest: Manifest) -> tuple[str, ...]:
    """Return the keys of lost or damaged files of a store, except the chunks of tiles."""
    lost = [ROOT] if read_undamaged_root(place, manifest) is None else []
    with ThreadPoolExecutor(READERS) as readers:
        whole = _apply_in_batches(
            readers, lambda key: _is_file_undamaged(place, key, manifest.files[key]), manifest.files
        )
        return (*lost, *(key for key, is_whole in zip(manifest.files, whole, strict=True) if not is_whole))
