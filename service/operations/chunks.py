"""Decide which keys a store must have: a missing chunk means fill values to zarr."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from gear_rattle.service.database.tables import State
from gear_rattle.service.state import Front
from gear_rattle.workers import Bucket, place_of
from gear_rattle.workers.storage.manifest import manifest_of
from gear_rattle.workers.survey.manifest import MANIFEST, ROOT, Manifest


def is_owed(front: Front, survey_id: str, key: str) -> bool:
    """Return whether the store of this survey, if it is whole, has this key. For a thread: reads the database."""
    try:
        ended = front.database.job(survey_id).state == State.SUCCESSFUL
        manifest = _manifest(front.directory.store(survey_id), ended)
    except LookupError:  # no store yet, or none that says anything
        return False
    if key in manifest.files or key in (ROOT, MANIFEST):
        return True
    tile = manifest.tile_of(key)
    return tile is not None and front.database.has_tile(survey_id, tile)


@lru_cache(maxsize=64)
def _manifest(store: Path | Bucket, ended: bool) -> Manifest:  # noqa: ARG001  # to be kept apart by
    """Return the manifest of a store.

    It does not change as long as there is the store, but that families and levels come at the end of a run.

    Raises LookupError.

    Returns
    -------
    Manifest
        The manifest.

    Raises
    ------
    LookupError
        If the store has none.
    """
    if (manifest := manifest_of(place_of(store))) is None:
        raise LookupError
    return replace(manifest, tiles={})  # the database knows which are computed
