"""Read the manifest and the root of a store, and write them. Only the process that leads a run writes them."""

from __future__ import annotations

import errno
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from typing import Any

import zarr
from zarr.abc.buffer import Buffer
from zarr.buffer import cpu
from zarr.storage import MemoryStore

from gear_rattle.workers.errors import StorageError, SurveyError, storage_error
from gear_rattle.workers.storage.location import Place
from gear_rattle.workers.survey.manifest import MANIFEST, ROOT, Manifest, digest, file_digests
from gear_rattle.workers.survey.template import COMPACT, Template, consolidate_metadata

#: During a run the manifest is written again when more than 1/SHARE of its tiles are new, and not after each tile,
#: because a large manifest takes long to write.
SHARE = 200
CACHED_SMALL = 8  # at most this many parsed small manifests are cached; each is needed repeatedly
#: A manifest with more bytes is large. The cache keeps only the latest large one: that of a survey of 10⁹ cells takes
#: 250 MB.
LARGE = 4 * 2**20

RecordTiles = Callable[[Mapping[int, Mapping[str, str]]], None]


def read_file(place: Place, key: str) -> bytes | None:
    """Return the content of a file, or None if there is no such file or the disk has a read error.

    Returns
    -------
    bytes | None
        Content of the file.

    Raises
    ------
    StorageError
        The object store fails.
    SurveyError
        Permission is denied, which does not mean that the file is lost.
    """
    try:
        return place.read(key)
    except StorageError:
        raise
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError):
        return None
    except OSError as error:
        if error.errno != errno.EIO:
            raise SurveyError(
                f"{place} cannot be read ({error}): check its disk and your permission to read it"
            ) from error
        return None


def read_manifest(place: Place) -> Manifest | None:
    """Return the manifest of a store; None if there is no manifest that this version can read.

    The result is also None once the deletion of the store has begun.

    Returns
    -------
    Manifest | None
        The manifest, from a cache if its file is unchanged.

    Raises
    ------
    StorageError, SurveyError
        See `read_file`.
    """
    content = read_file(place, MANIFEST)
    if content is None or place.has_deletion_begun():
        return None
    return (_parsed_large if len(content) > LARGE else _parsed_small)(content)


_parsed_small = lru_cache(maxsize=CACHED_SMALL)(Manifest.from_bytes)
_parsed_large = lru_cache(maxsize=1)(Manifest.from_bytes)


def read_required_manifest(place: Place) -> Manifest:
    """Return the manifest of a store.

    Returns
    -------
    Manifest
        Digests of all files, by key, and the computed tiles.

    Raises
    ------
    StorageError
        The store is gone.
    SurveyError
        There is no survey, or its manifest is damaged.
    """
    if (manifest := read_manifest(place)) is None:
        require_existing_store(place)
        if "content_hash" not in read_unchecked_attributes(place):
            raise SurveyError(f"{place} holds something that is not a survey or population: choose another path")
        raise SurveyError(f"{MANIFEST} of {place} is lost or damaged: compute the same request again to repair it")
    return manifest


def require_existing_store(place: Place) -> None:
    """Raise StorageError if a store is gone. Its disk may come back, so the store does not count as damaged."""
    if not place.is_occupied():
        raise StorageError(
            f"{place} is gone: it was moved or deleted, or its disk is not mounted. Restore it, or compute it again"
        )


def read_unchecked_attributes(place: Place) -> dict[str, Any]:
    """Return the attributes in a store's root without checking its digest; empty if there is no readable root."""
    try:
        attributes = json.loads(read_file(place, ROOT) or b"{}").get("attributes", {})
    except (ValueError, AttributeError, RecursionError):
        attributes = {}
    return attributes if isinstance(attributes, dict) else {}


def read_undamaged_root(place: Place, manifest: Manifest) -> bytes | None:
    """Return the content of a store's root file zarr.json, or None if this file is lost or damaged."""
    content = read_file(place, ROOT)
    return content if content is not None and digest(content) in manifest.root else None


def read_root_attributes(place: Place) -> dict[str, Any]:
    """Return the attributes in a store's root after checking its digest.

    Returns
    -------
    dict[str, Any]
        Values by name.

    Raises
    ------
    SurveyError
        There is no survey, or it is damaged.
    StorageError
        The root cannot be read now.
    """
    return dict(json.loads(_read_root(place, read_required_manifest(place)))["attributes"])


@contextmanager
def tile_recorder(place: Place) -> Iterator[RecordTiles]:
    """Yield a function that records written tiles in the manifest.

    The caller holds the lock of the store, and changes nothing else in the manifest in this context. If the process is
    killed, up to 1/SHARE of the written tiles are missing from the manifest on disk, and are computed again.

    Yields
    ------
    RecordTiles
        The function. Its argument is {index of a written tile: {key of a chunk: digest}}.

    Raises
    ------
    SurveyError
        There is no survey, or its manifest is damaged.
    StorageError
        The manifest cannot be written now, or the store is gone.
    """
    before = read_required_manifest(place)
    manifest, waiting = replace(before, tiles=dict(before.tiles)), 0

    def write_manifest() -> None:
        nonlocal waiting
        try:
            if not place.exists():  # writing would recreate a part of a deleted survey
                require_existing_store(place)
            place.put(MANIFEST, manifest.to_bytes())
        except OSError as error:
            refusal = storage_error(f"{place} cannot be written", error)
            raise refusal from error
        waiting = 0

    def record_tiles(tiles: Mapping[int, Mapping[str, str]]) -> None:
        nonlocal waiting
        for index, files in tiles.items():
            manifest.record_tile(index, files)
        waiting += len(tiles)
        if waiting > len(manifest.tiles) // SHARE:
            write_manifest()

    try:
        yield record_tiles
    finally:
        if waiting:
            write_manifest()


def set_store_attributes(place: Place, attributes: Mapping[str, Any]) -> None:
    """Set attributes of the store's root; the value None removes an attribute. The caller holds the lock of the store.

    Raises
    ------
    SurveyError
        There is no survey, or it is damaged.
    OSError
        The root cannot be written now.
    """
    manifest = read_required_manifest(place)
    root = _read_root(place, manifest)
    known = json.loads(root)["attributes"]
    changed = {name: value for name, value in {**known, **attributes}.items() if value is not None}
    if changed != known:
        replace_root_file(place, manifest, replace_attributes(root, changed), manifest)


def replace_attributes(root: bytes, attributes: Mapping[str, Any]) -> bytes:
    """Return the content of a store's root file zarr.json with `attributes` in place of its own attributes."""
    kept: dict[str, Buffer] = {ROOT: cpu.Buffer.from_bytes(root)}
    with zarr.config.set(COMPACT):
        zarr.open_group(MemoryStore(kept), mode="r+").attrs.put(dict(attributes))
    return kept[ROOT].to_bytes()


def update_metadata(
    place: Place, added: Template, written: Mapping[str, str], is_removed: Callable[[str], bool]
) -> None:
    """Add files to a store's metadata, and remove others from it. All changes become visible with the new root.

    Parameters
    ----------
    added : Template
        Contents of the files to write, by key.
    written : Mapping[str, str]
        Digests of chunks that tasks have already written, by key.
    is_removed : Callable[[str], bool]
        Returns whether a file of the manifest, by its key, is removed from the metadata.

    Raises
    ------
    SurveyError
        There is no survey, or it is damaged.
    OSError
        A file cannot be written now.
    """
    manifest = read_required_manifest(place)
    root = _read_root(place, manifest)
    files = {key: known for key, known in manifest.files.items() if not is_removed(key)}
    nodes = {key: read_file(place, key) for key in files if key.endswith(f"/{ROOT}")} | {ROOT: root}
    if any(content is None or digest(content) != files[key] for key, content in nodes.items() if key != ROOT):
        raise SurveyError(f"the metadata of {place} is damaged: compute the same request again to repair it")
    described = nodes | {key: content for key, content in added.items() if key.endswith(f"/{ROOT}")}
    for key, content in added.items():
        place.put(key, content)
    kept: dict[str, Buffer] = {
        key: cpu.Buffer.from_bytes(content) for key, content in described.items() if content is not None
    }
    consolidate_metadata(MemoryStore(kept))
    after = replace(manifest, files=files | file_digests(added) | dict(written))
    replace_root_file(place, manifest, kept[ROOT].to_bytes(), after)


def replace_root_file(place: Place, before: Manifest, root: bytes, after: Manifest) -> None:
    """Replace the root file of a store. before, after: the manifests that belong to the old and to the new root.

    At every instant the manifest on disk has the digest of the root on disk. Raises OSError.
    """
    new = digest(root)
    place.put(MANIFEST, replace(before, root=(*before.root, new)).to_bytes())
    place.put(ROOT, root)
    place.put(MANIFEST, replace(after, root=(new,)).to_bytes())


def _read_root(place: Place, manifest: Manifest) -> bytes:
    """Return the content of a store's root. Raises SurveyError if it is damaged, StorageError if the store is gone."""
    if (root := read_undamaged_root(place, manifest)) is None:
        require_existing_store(place)
        raise SurveyError(f"{ROOT} of {place} is lost or damaged: compute the same request again to repair it")
    return root
