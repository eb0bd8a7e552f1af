"""Check that a store still holds the written bytes: every file in its place and unchanged.

The manifest has the digest of every file by its key, because a chunk's own checksum knows no position.
"""

import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.errors import ZarrUserWarning

from gear_rattle.workers.errors import StoppedError, SurveyError
from gear_rattle.workers.storage.location import Place, place_of
from gear_rattle.workers.storage.manifest import manifest_of, read_file, said_by_root, whole_root
from gear_rattle.workers.survey.manifest import MANIFEST, ROOT, Manifest, digest
from gear_rattle.workers.survey.version import code_version

STATUS = "status"
COMPLETED = "date_completed"  # what the root of a completed survey says
READERS = 8  # of files at a time: a bucket answers each after a while


@dataclass(frozen=True)
class Integrity:
    """Findings of a check of every file of a store.

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
        """True if nothing is damaged; tiles of a survey that is not completed may still be missing."""
        return not self.damaged and not self.template

    @property
    def decoded(self) -> bool:
        """True if the store has no manifest that this version can read."""
        return not self.tiles


def examine(where: str | Path | Place) -> Integrity:
    """Read every file of a survey's store. A chunk that is not there is lost once the survey was completed.

    Returns
    -------
    Integrity
        The findings.

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
    done, damaged = examine_tiles(place, manifest)
    if completed:
        for index in set(range(manifest.n_tiles)) - manifest.tiles.keys():
            damaged[index] = tuple(manifest.chunks)
    files = 2 + len(manifest.files) + len(manifest.chunks) * len(manifest.tiles)
    template, damaged = damaged_template(place, manifest), dict(sorted(damaged.items()))
    return Integrity(frozenset(done), damaged, template, manifest.n_tiles, files, version, completed)


def _undecodable(place: Place, attributes: Mapping[str, Any]) -> tuple[int, tuple[str, ...]]:
    """Return how many chunks were decoded, and which files are lost or cannot be decoded.

    Of a store without a manifest that this version can read.

    Returns
    -------
    tuple[int, tuple[str, ...]]
        The number, and the names of files.

    Raises
    ------
    SurveyError
        Its metadata cannot be read.
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
                is_lost = (name == STATUS and not values.all()) or (is_ours and read_file(place, key) is None)
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

    Parameters
    ----------
    should_stop : Callable[[], bool] | None
        Asked at each tile.

    Returns
    -------
    tuple[set[int], dict[int, tuple[str, ...]]]
        Tiles that are computed and whole; variables of the damaged ones.

    Raises
    ------
    StoppedError
        Because `should_stop` said so.
    SurveyError, StorageError
        As `examine`.
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


def _lost(place: Place, manifest: Manifest, index: int) -> tuple[str, ...]:
    """Return the variables of a computed tile that are lost or damaged."""
    keys, known = manifest.keys(index), manifest.digests_of(index)
    return tuple(name for name, key in keys.items() if not _is_whole(place, key, known.get(key)))


def _is_whole(place: Place, key: str, known: str | None) -> bool:
    content = read_file(place, key)
    return content is not None and digest(key, content) == known


def damaged_template(place: Place, manifest: Manifest) -> tuple[str, ...]:
    """Return the files of a survey that are lost or damaged, but for what tiles write."""
    lost = [ROOT] if whole_root(place, manifest) is None else []
    with ThreadPoolExecutor(READERS) as readers:
        whole = readers.map(lambda key: _is_whole(place, key, manifest.files[key]), manifest.files)
        return (*lost, *(key for key, is_whole in zip(manifest.files, whole, strict=True) if not is_whole))
