"""Decide which files a store must have, so that a lost chunk is an error: zarr alone would read it as fill values."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from gear_rattle.service.database.tables import State
from gear_rattle.service.state import ApplicationState
from gear_rattle.workers import StoreInBucket, place_of
from gear_rattle.workers.storage.manifest import read_manifest
from gear_rattle.workers.survey.manifest import MANIFEST, ROOT, Manifest


def is_expected_file(front: ApplicationState, survey_id: str, key: str) -> bool:
    """Return whether a survey's store must have the file `key` now, so that its absence means damage.

    The store need not have the files of tiles that are not computed yet. The function blocks: call it in a thread.

    Returns
    -------
    bool
        False also while the survey has no store.
    """
    try:
        ended = front.database.job(survey_id).state == State.SUCCESSFUL
        manifest = _cached_manifest(front.directory.store(survey_id), ended)
    except LookupError:  # there is no store yet, or its manifest cannot be read
        return False
    if key in manifest.files or key in (ROOT, MANIFEST):
        return True
    tile = manifest.tile_index_of(key)
    return tile is not None and front.database.has_tile(survey_id, tile)


@lru_cache(maxsize=64)
def _cached_manifest(store: Path | StoreInBucket, has_ended: bool) -> Manifest:  # noqa: ARG001  # a part of the cache's key
    """Return the manifest of a store without its tiles.

    The manifest is cached. It is read again when `has_ended` becomes True: a survey gets its families and levels
    when it ends.

    Returns
    -------
    Manifest
        The manifest; its tiles are left out, because the database records them.

    Raises
    ------
    LookupError
        The store has no manifest that this version can read.
    """
    if (manifest := read_manifest(place_of(store))) is None:
        raise LookupError
    return replace(manifest, tiles={})
