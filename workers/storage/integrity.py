"""Whether a store still holds what was written to it: every file is where it was put, and as it was put there.

The manifest has the digest of every file by its key, because a chunk's own checksum knows no position.
"""

import pickle
import subprocess
import sys
import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.errors import ZarrUserWarning

from gear_rattle.workers.errors import StoppedError, SurveyError
from gear_rattle.workers.storage.location import Place, place_of
from gear_rattle.workers.storage.manifest import manifest_of, read, said_by_root, whole_root
from gear_rattle.workers.survey.manifest import MANIFEST, ROOT, Manifest, digest
from gear_rattle.workers.survey.version import code_version
from rattle.numerics import environment

STATUS = "status"
COMPLETED = "date_completed"  # what the root of a completed survey says
READERS = 8  # of files at a time: a bucket answers each after a while


@dataclass(frozen=True)
class Integrity:
    """What a look at every file of a store found.

    Without a manifest that this version can read, the store's chunks are decoded, each of which ends in a checksum of
    its own, and it has no tiles here.
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
        """Whether the store has no manifest that this version can read."""
        return not self.tiles


def examine(where: str | Path | Place, processes: int = 1) -> Integrity:
    """Read every file of a survey's store. A chunk that is not there is lost once the survey was completed.

    Parameters
    ----------
    where
        Path or s3:// URL of the store.
    processes
        Number of processes that read tiles.

    Returns
    -------
    Integrity
        The same with any number of processes.

    Raises
    ------
    SurveyError
        There is no survey, or too much of it is damaged to know which it was.
    StorageError
        The object store fails.
    """
    place = place_of(where)
    if not place.occupied():
        raise SurveyError(f"{place} does not exist or is empty: give the path of a survey")
    manifest, attributes = manifest_of(place), said_by_root(place)
    version, completed = (str(attributes.get(name, "")) for name in ("code_version", COMPLETED))
    if manifest is None and (not version or "content_hash" not in attributes):
        raise SurveyError(
            f"{place} holds no survey that can be read: name the store of a survey, a population or certificates; of"
            f" one that is damaged, take its {ROOT} and {MANIFEST} from a copy"
        )
    if manifest is None:
        number, lost = _undecodable(place, attributes)
        return Integrity(frozenset(), {}, lost, 0, number, version, completed)
    done, damaged = _examine_apart(place, manifest, processes) if processes > 1 else examine_tiles(place, manifest)
    if completed:
        for index in set(range(manifest.n_tiles)) - manifest.tiles.keys():
            damaged[index] = tuple(manifest.chunks)
    files = 2 + len(manifest.files) + len(manifest.chunks) * len(manifest.tiles)
    template, damaged = damaged_template(place, manifest), dict(sorted(damaged.items()))
    return Integrity(frozenset(done), damaged, template, manifest.n_tiles, files, version, completed)


def _undecodable(place: Place, attributes: Mapping[str, Any]) -> tuple[int, tuple[str, ...]]:
    """Return how many chunks were decoded, and which files are lost or cannot be decoded, of a store without a manifest
    that this version can read.

    Raises:
        SurveyError: its metadata cannot be read.
    """
    version = attributes["code_version"]
    is_ours = version == code_version()  # then every chunk has a file
    lost = [MANIFEST] if is_ours else []
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ZarrUserWarning)  # the lock is no part of a zarr hierarchy
            group = zarr.open_group(place.zarr(), mode="r")
            arrays = [(name, each) for name, each in group.members(max_depth=None) if isinstance(each, zarr.Array)]
    except Exception as error:  # what a foreign format raises
        raise SurveyError(
            f"{place} was computed by version {version} and cannot be read ({error}): verify it with that version"
        ) from error
    number = 0
    for name, array in arrays:
        for chunk in np.ndindex(*array.cdata_shape):
            number += 1
            key = f"{name}/{array.metadata.encode_chunk_key(chunk)}"
            at = tuple(slice(i * size, (i + 1) * size) for i, size in zip(chunk, array.chunks, strict=True))
            try:
                values = np.asarray(array[at])
                is_lost = (name == STATUS and not values.all()) or (is_ours and read(place, key) is None)
            except SurveyError:
                raise
            except Exception:  # what a codec raises of a damaged chunk
                lost.append(key)
            else:
                if is_lost and COMPLETED in attributes:
                    lost.append(key)
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
    done, damaged = set[int](), dict[int, tuple[str, ...]]()
    with ThreadPoolExecutor(READERS) as readers:
        found = readers.map(lambda index: _lost(place, manifest, index), manifest.tiles)
        for index, lost in zip(manifest.tiles, found, strict=True):
            if should_stop and should_stop():
                readers.shutdown(cancel_futures=True)  # the others are not waited for
                raise StoppedError(f"stopped while {place} was read")
            if lost:
                damaged[index] = lost
            else:
                done.add(index)
    return done, damaged


def _examine_apart(
    place: Place, manifest: Manifest, processes: int
) -> tuple[set[int], dict[int, tuple[str, ...]]]:
    """Return what `examine_tiles` does, from processes that each read every so many tiles."""
    tiles = list(manifest.tiles.items())
    parts = [replace(manifest, files={}, tiles=dict(tiles[first::processes])) for first in range(processes)]
    done, damaged = set[int](), dict[int, tuple[str, ...]]()
    with ThreadPoolExecutor(processes) as threads:
        for found, lost in threads.map(partial(_examined_apart, str(place)), parts):
            done |= found
            damaged |= lost
    return done, damaged


def _examined_apart(where: str, manifest: Manifest) -> tuple[set[int], dict[int, tuple[str, ...]]]:
    """Return what `examine_tiles` finds in a process of its own, which never imports the main module."""
    command = [sys.executable, "-c", f"from {__name__} import serve; serve()"]
    answer = subprocess.run(
        command, input=pickle.dumps((where, manifest)), stdout=subprocess.PIPE, env=environment(), check=True
    ).stdout
    found: tuple[set[int], dict[int, tuple[str, ...]]] | Exception = pickle.loads(answer)
    if isinstance(found, Exception):
        raise found
    return found


def serve() -> None:
    """Examine the tiles of the store that stdin names, and write what was found, or the error, to stdout."""
    (where, manifest), answer = pickle.load(sys.stdin.buffer), sys.stdout.buffer
    sys.stdout = sys.stderr  # what a library prints is no answer
    try:
        found: object = examine_tiles(place_of(where), manifest)
    except Exception as error:
        found = error
    pickle.dump(found, answer)


def _lost(place: Place, manifest: Manifest, index: int) -> tuple[str, ...]:
    """Return the variables of a computed tile that are lost or damaged."""
    keys, known = manifest.keys(index), manifest.digests_of(index)
    return tuple(name for name, key in keys.items() if not _is_whole(place, key, known.get(key)))


def _is_whole(place: Place, key: str, known: str | None) -> bool:
    content = read(place, key)
    return content is not None and digest(key, content) == known


def damaged_template(place: Place, manifest: Manifest) -> tuple[str, ...]:
    """Return the files of a survey that are lost or damaged, but for what tiles write."""
    lost = [ROOT] if whole_root(place, manifest) is None else []
    with ThreadPoolExecutor(READERS) as readers:
        whole = readers.map(lambda key: _is_whole(place, key, manifest.files[key]), manifest.files)
        return (*lost, *(key for key, is_whole in zip(manifest.files, whole, strict=True) if not is_whole))
