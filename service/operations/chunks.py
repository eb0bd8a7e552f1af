"""Which keys a store must have: of what is not computed yet there is none, and zarr takes that for fill values."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from service.state import Front
from workers import Bucket, place_of
from workers.storage.integrity import Manifest, manifest_of
from workers.survey.seals import SEALED


def is_owed(front: Front, survey_id: str, key: str) -> bool:
    """Whether the store of this survey, if it is whole, has this key. For a thread: reads the database."""
    try:
        manifest = _manifest(front.directory.store(survey_id))
    except LookupError:  # no store yet, or none that says anything
        return False
    if key in manifest.files or key in SEALED:
        return True
    tile = manifest.tile_of(key)
    return tile is not None and front.database.has_tile(survey_id, tile)


@lru_cache(maxsize=64)
def _manifest(store: Path | Bucket) -> Manifest:
    """What does not change as long as there is the store. Raises LookupError."""
    if (manifest := manifest_of(place_of(store))) is None:
        raise LookupError
    return manifest
