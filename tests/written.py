"""Tiles of a store that is written without a run: what workers write, and what the process that leads a run notes."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gear_rattle.workers.cluster import runner
from gear_rattle.workers.storage import store
from gear_rattle.workers.storage.location import Place, place_of
from gear_rattle.workers.storage.manifest import tile_recorder
from gear_rattle.workers.survey.tiles import TileRecord


def write_tile(request: Any, path: str | Path | Place, tile: Any, values: Mapping[str, np.ndarray]) -> None:
    files = store.write_tile(request, str(path), tile, values)
    with tile_recorder(place_of(path)) as note:
        note({tile.index: files})


def compute_and_write_tile(request: Any, path: str, tile: Any) -> TileRecord:
    record = runner.compute_and_write_tile(request, path, tile)
    with tile_recorder(place_of(path)) as note:
        note({tile.index: record.files})
    return record
