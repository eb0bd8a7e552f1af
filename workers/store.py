"""The zarr store of a survey: created once, filled tile by tile, resumed, finished and opened."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import zarr

from workers.bucket import SCHEME
from workers.errors import SurveyError, storage_error
from workers.integrity import damaged_template, examine
from workers.location import Place, place_of
from workers.quantities import stored
from workers.request import SurveyRequest
from workers.template import consolidate, now, template_of
from workers.tiles import Tile
from workers.version import code_version

if TYPE_CHECKING:
    import xarray as xr


def create_store(request: SurveyRequest, where: str | Path | Place) -> None:
    """Create the empty store of a survey, or accept the one that an earlier run of the same survey left.

    Whatever else is there is left as it is. The store appears at once and whole. Of a survey's own store, what tiles do
    not write to is mended if it is damaged.

    Raises:
        StorageError: it cannot be written now.
        SurveyError: something else is there, or it cannot be written.
    """
    place = place_of(where)
    try:
        if not place.occupied():
            place.build(template_of(request))
        _require_same(request, place)
        if damaged := damaged_template(place):
            template = template_of(request)
            place.mend(
                {key: template[key] for key in template if key.startswith(tuple(f"{name}/" for name in damaged))}
            )
    except OSError as error:
        raise storage_error(f"{place} cannot be created", error) from error


def _require_same(request: SurveyRequest, place: Place) -> None:
    attributes = _survey_attributes(place)
    if attributes["content_hash"] == request.content_hash():
        return
    if attributes.get("code_version") != code_version():
        raise SurveyError(
            f"{place} holds a survey computed by version {attributes.get('code_version')}, and this is {code_version()}"
            ": choose another path, or finish it with that version"
        )
    raise SurveyError(f"{place} holds another survey: choose another path, or delete that one first")


def _survey_attributes(place: Place) -> dict[str, Any]:
    try:
        with place.reaching():
            attributes = dict(zarr.open_group(place.zarr(), mode="r", zarr_format=3).attrs)
    except (OSError, ValueError, KeyError, TypeError):  # no group, unreadable, or other people's metadata
        attributes = {}
    if "content_hash" not in attributes:
        raise SurveyError(f"{place} holds something that is not a survey: choose another path")
    return attributes


def tiles_done(request: SurveyRequest, where: str | Path | Place) -> set[int]:
    """Return the indices of the tiles that are computed and undamaged. Raises SurveyError if this survey is not there.

    Every chunk is read, for its checksum.
    """
    place = place_of(where)
    _require_same(request, place)
    return set(examine(place).done)


def require_aligned(request: SurveyRequest, tile: Tile) -> None:
    """Raise SurveyError unless the tile is one whole chunk: two writers inside one chunk lose data silently."""
    axes = zip((tile.epsilon, tile.delta), request.tile_shape, request.shape, strict=True)
    for span, size, num in axes:
        if span.start % size or not 0 <= span.start < num or span.stop != min(span.start + size, num) or span.step:
            raise SurveyError(f"tile {tile.index} ({span}) is not a chunk of {size}: use the tiles of tiles_of")


def write_tile(request: SurveyRequest, path: str, tile: Tile, values: Mapping[str, np.ndarray]) -> None:
    """Write a tile, `status` last: a tile that was interrupted is not done.

    Raises:
        SurveyError: the tile or a shape is not a chunk of the store, or the store is gone or of another survey.
    """
    require_aligned(request, tile)
    place = place_of(path)
    arrays = _arrays(path, request)
    cells = (tile.epsilon.stop - tile.epsilon.start, tile.delta.stop - tile.delta.start)
    for name in sorted(values, key=lambda name: name == "status"):
        if values[name].shape != (*arrays[name].shape[:-2], *cells):
            raise SurveyError(f"tile {tile.index}: {name} has shape {values[name].shape}, not that of its chunk")
        if not place.exists():  # zarr would bring a deleted survey back, in pieces
            raise SurveyError(f"the store {path} is gone")
        with place.reaching():
            arrays[name][..., tile.epsilon, tile.delta] = values[name]


@lru_cache(maxsize=16)
def _arrays(path: str, request: SurveyRequest) -> dict[str, zarr.Array]:
    """Open the arrays that tiles write to, once a process: opening costs more than writing."""
    place = place_of(path)
    _require_same(request, place)
    with zarr.config.set({"array.write_empty_chunks": True}), place.reaching():  # see template.WHOLE
        arrays = dict(zarr.open_group(place.zarr(), mode="r+", zarr_format=3).arrays())
    return {
        quantity.name: arrays[quantity.name]
        for quantity in stored(request.quantities, request.model)
        if quantity.per_cell
    }


def finish_store(where: str | Path | Place) -> None:
    """Finish a survey whose tiles are all done: sweep what killed writers left, date it, consolidate. Idempotent.

    Raises:
        StorageError: it cannot be written now.
        SurveyError: there is no survey, cells are missing, or a run still writes to it.
    """
    place = place_of(where)
    _survey_attributes(place)
    with place.writing():
        if missing := _missing_cells(place):
            raise SurveyError(f"{place} lacks {missing} cells: run the survey again to resume it")
        try:
            place.sweep()
            with place.reaching():
                root = zarr.open_group(place.zarr(), mode="r+", zarr_format=3)
                if "date_completed" not in root.attrs:
                    root.attrs["date_completed"] = now()  # keeps the consolidated metadata, in one atomic replacement
                    consolidate(place.zarr())
        except OSError as error:
            raise storage_error(f"{place} cannot be finished", error) from error


def _missing_cells(place: Place) -> int:
    try:
        with place.reaching():
            status = zarr.open_array(place.zarr(), path="status", mode="r")
            rows = range(0, status.shape[0], status.chunks[0])  # of tiles: whole, it takes 2 KiB for each of them
            return sum(int(np.sum(np.asarray(status[row : row + status.chunks[0]]) == 0)) for row in rows)
    except SurveyError:
        raise
    except Exception as error:  # what a codec raises of a damaged chunk
        raise SurveyError(f"{place} is damaged ({error}): run the survey again to repair it") from error


def open_survey(path_or_url: str | Path | Place) -> xr.Dataset:
    """Open a survey from disk, a bucket or over HTTP, finished or not; values are read when asked for.

    `xarray.open_zarr(path_or_url)` shows the same; this one says what is wrong when there is no survey.

    Raises:
        SurveyError: there is no survey, or it cannot be read.
    """
    import xarray as xr  # a third of a second, which no process that only computes has to wait for

    try:
        dataset = xr.open_zarr(_readable(path_or_url), chunks=None, consolidated=True)
    except Exception as error:  # what the disk, the network or a foreign format raises
        raise SurveyError(f"no survey can be opened at {path_or_url}: {error}") from error
    if "content_hash" not in dataset.attrs:
        dataset.close()
        raise SurveyError(f"{path_or_url} is not a survey")
    return dataset


def _readable(path_or_url: str | Path | Place) -> Any:
    if str(path_or_url).startswith(SCHEME):
        return place_of(path_or_url).zarr().with_read_only(True)  # type: ignore[union-attr]  # a bucket
    return str(path_or_url)
