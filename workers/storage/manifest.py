"""The manifest and the root of a store: what is read of them, and what the process that leads a run writes to them."""

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
from gear_rattle.workers.survey.manifest import MANIFEST, ROOT, Manifest, digest, digests
from gear_rattle.workers.survey.template import COMPACT, Template, consolidate

#: The manifest is written once a two-hundredth of its tiles are new: one of many megabytes is written less often.
SHARE = 200
KNOWN = 8  # manifests that are remembered as they were parsed: each is asked for again and again

Note = Callable[[Mapping[int, Mapping[str, str]]], None]


def read_file(place: Place, key: str) -> bytes | None:
    """Return a file; None if it is not there, or the disk cannot read it.

    Returns
    -------
    bytes | None
        Bytes of the file, or None.

    Raises
    ------
    SurveyError
        It may not be read: nobody may take that for lost.
    StorageError
        The object store fails.
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
    """Return the manifest of a store; None if it is damaged, of another version, or not there."""
    content = read_file(place, MANIFEST)
    return None if content is None or place.deletion_begun() else _parsed(content)


_parsed = lru_cache(maxsize=KNOWN)(Manifest.of_bytes)


def known_manifest(place: Place) -> Manifest:
    """Return the manifest of a store.

    Returns
    -------
    Manifest
        The manifest.

    Raises
    ------
    StorageError
        The store is gone.
    SurveyError
        There is no survey, or its manifest is damaged.
    """
    if (manifest := manifest_of(place)) is None:
        require_there(place)
        if "content_hash" not in said_by_root(place):
            raise SurveyError(f"{place} holds something that is not a survey: choose another path")
        raise SurveyError(f"{MANIFEST} of {place} is damaged: run the survey again to repair it")
    return manifest


def require_there(place: Place) -> None:
    """Raise StorageError if a store that was there is gone, which is no damage: it may come back."""
    if not place.occupied():
        raise StorageError(
            f"{place} is gone: it was moved or deleted. Bring it back, or run the survey again to compute it anew"
        )


def said_by_root(place: Place) -> dict[str, Any]:
    """Return the attributes of a store's root, damaged or not; empty without one."""
    try:
        attributes = json.loads(read_file(place, ROOT) or b"{}").get("attributes", {})
    except (ValueError, AttributeError, RecursionError):
        attributes = {}
    return attributes if isinstance(attributes, dict) else {}


def whole_root(place: Place, manifest: Manifest) -> bytes | None:
    """Return the metadata of a store's root; None if it is lost or damaged."""
    content = read_file(place, ROOT)
    return content if content is not None and digest(ROOT, content) in manifest.root else None


def attributes_of(place: Place) -> dict[str, Any]:
    """Return what the root says.

    Returns
    -------
    dict[str, Any]
        Attributes of the root.

    Raises
    ------
    StorageError
        It cannot be read now.
    SurveyError
        There is no survey, or it is damaged.
    """
    return dict(json.loads(_root(place, known_manifest(place)))["attributes"])


@contextmanager
def noting(place: Place) -> Iterator[Note]:
    """Give a function that notes the digests of written tiles, by their index.

    The caller holds the store, and changes nothing else of its manifest meanwhile. A kill loses the tiles that the
    manifest on the disk does not have yet, a two-hundredth at most; they are computed again.

    Yields
    ------
    Note
        The function.

    Raises
    ------
    StorageError
        It cannot be written now, or the store is gone.
    SurveyError
        There is no survey, or its manifest is damaged.
    """
    before = known_manifest(place)
    manifest, waiting = replace(before, tiles=dict(before.tiles)), 0

    def write() -> None:
        nonlocal waiting
        try:
            if not place.exists():  # a deleted survey would come back
                require_there(place)
            place.put(MANIFEST, manifest.to_bytes())
        except OSError as error:
            refusal = storage_error(f"{place} cannot be written", error)
            raise refusal from error
        waiting = 0

    def note(tiles: Mapping[int, Mapping[str, str]]) -> None:
        nonlocal waiting
        for index, files in tiles.items():
            manifest.note(index, files)
        waiting += len(tiles)
        if waiting > len(manifest.tiles) // SHARE:
            write()

    try:
        yield note
    finally:
        if waiting:
            write()


def tell(place: Place, told: Mapping[str, Any]) -> None:
    """Let the root say this besides; None: it says no more of it. The caller holds the store.

    Raises
    ------
    OSError
        It cannot be written now.
    SurveyError
        There is no survey, or it is damaged.
    """
    manifest = known_manifest(place)
    root = _root(place, manifest)
    known = json.loads(root)["attributes"]
    changed = {name: value for name, value in {**known, **told}.items() if value is not None}
    if changed != known:
        replace_root(place, manifest, with_attributes(root, changed), manifest)


def with_attributes(root: bytes, attributes: Mapping[str, Any]) -> bytes:
    """Return the metadata of a root that says this instead."""
    kept: dict[str, Buffer] = {ROOT: cpu.Buffer.from_bytes(root)}
    with zarr.config.set(COMPACT):
        zarr.open_group(MemoryStore(kept), mode="r+").attrs.put(dict(attributes))
    return kept[ROOT].to_bytes()


def update_metadata(place: Place, added: Template, there: Mapping[str, str], is_removed: Callable[[str], bool]) -> None:
    """Add files to a store, and take others from its metadata: they appear and vanish with the root.

    Parameters
    ----------
    added : Template
        The files to write, by their key.
    there : Mapping[str, str]
        The digests of chunks that are there already.
    is_removed : Callable[[str], bool]
        Whether a file that the manifest knows is no longer part of the store.

    Raises
    ------
    OSError
        It cannot be written now.
    SurveyError
        There is no survey, or it is damaged.
    """
    manifest = known_manifest(place)
    root = _root(place, manifest)
    files = {key: known for key, known in manifest.files.items() if not is_removed(key)}
    nodes = {key: read_file(place, key) for key in files if key.endswith(f"/{ROOT}")} | {ROOT: root}
    if any(content is None or digest(key, content) != files[key] for key, content in nodes.items() if key != ROOT):
        raise SurveyError(f"the metadata of {place} is damaged: run the survey again to repair it")
    described = nodes | {key: content for key, content in added.items() if key.endswith(f"/{ROOT}")}
    for key, content in added.items():
        place.put(key, content)
    kept: dict[str, Buffer] = {
        key: cpu.Buffer.from_bytes(content) for key, content in described.items() if content is not None
    }
    consolidate(MemoryStore(kept))
    after = replace(manifest, files=files | digests(added) | dict(there))
    replace_root(place, manifest, kept[ROOT].to_bytes(), after)


def replace_root(place: Place, before: Manifest, root: bytes, after: Manifest) -> None:
    """Write a root, and the manifest that is true with it: `before` is true until then.

    At every instant the root is one that the manifest knows. Raises OSError.
    """
    new = digest(ROOT, root)
    place.put(MANIFEST, replace(before, root=(*before.root, new)).to_bytes())
    place.put(ROOT, root)
    place.put(MANIFEST, replace(after, root=(new,)).to_bytes())


def _root(place: Place, manifest: Manifest) -> bytes:
    if (root := whole_root(place, manifest)) is None:
        require_there(place)
        raise SurveyError(f"{ROOT} of {place} is damaged: run the survey again to repair it")
    return root
