"""The zarr store of a survey: created once, filled tile by tile, resumed, finished and opened."""

import fcntl
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
import xarray as xr
import zarr

from workers.errors import SurveyError, storage_error
from workers.integrity import damaged_template, examine
from workers.quantities import stored
from workers.request import SurveyRequest
from workers.template import consolidate, now, write_template
from workers.tiles import Tile
from workers.version import code_version


def create_store(request: SurveyRequest, path: str | Path) -> None:
    """Create the empty store of a survey, or accept the one that an earlier run of the same survey left.

    Whatever else is at the path is left as it is. The store appears at once and whole: it is built beside the path
    and renamed. Of a survey's own store, what tiles do not write to is mended if it is damaged.

    Raises:
        StorageError: it cannot be written now.
        SurveyError: the path holds something else, or cannot be written.
    """
    path = Path(path).resolve()
    try:
        if not _occupied(path):
            _build(request, path)
        _require_same(request, path)
        if damaged := damaged_template(path):
            _mend(request, path, damaged)
    except OSError as error:
        raise storage_error(f"{path} cannot be created", error) from error


def _occupied(path: Path) -> bool:
    return path.exists() and not (path.is_dir() and next(path.iterdir(), None) is None)


@contextmanager
def _template_beside(request: SurveyRequest, path: Path) -> Iterator[Path]:
    path.parent.mkdir(parents=True, exist_ok=True)
    sibling = path.with_name(f".{path.name}.{uuid4().hex}")
    try:
        write_template(request, sibling)
        yield sibling
    finally:
        shutil.rmtree(sibling, ignore_errors=True)


def _build(request: SurveyRequest, path: Path) -> None:
    try:
        with _template_beside(request, path) as sibling:
            os.rename(sibling, path)
    except OSError:
        if not _occupied(path):  # otherwise another run was first, and its store is judged like any other
            raise


def _mend(request: SurveyRequest, path: Path, damaged: Iterable[str]) -> None:
    """Replace every file of these arrays and groups by the one of a new template: the same request, the same bytes."""
    with _template_beside(request, path) as sibling:
        for name in damaged:
            for file in [file for file in (sibling / name).rglob("*") if file.is_file()]:
                target = path / file.relative_to(sibling)
                target.parent.mkdir(parents=True, exist_ok=True)
                os.replace(file, target)


def _require_same(request: SurveyRequest, path: Path) -> None:
    attributes = _survey_attributes(path)
    if attributes["content_hash"] == request.content_hash():
        return
    if attributes.get("code_version") != code_version():
        raise SurveyError(
            f"{path} holds a survey computed by version {attributes.get('code_version')}, and this is {code_version()}:"
            " choose another path, or finish it with that version"
        )
    raise SurveyError(f"{path} holds another survey: choose another path, or delete that one first")


def _survey_attributes(path: Path) -> dict[str, Any]:
    try:
        attributes = dict(zarr.open_group(path, mode="r", zarr_format=3).attrs)
    except (OSError, ValueError, KeyError, TypeError):  # no group, unreadable, or other people's metadata
        attributes = {}
    if "content_hash" not in attributes:
        raise SurveyError(f"{path} holds something that is not a survey: choose another path")
    return attributes


def tiles_done(request: SurveyRequest, path: str | Path) -> set[int]:
    """Return the indices of the tiles that are computed and undamaged. Raises SurveyError if this survey is not there.

    Every chunk is read, for its checksum.
    """
    path = Path(path).resolve()
    _require_same(request, path)
    return set(examine(path).done)


@contextmanager
def writing(path: str | Path) -> Iterator[None]:
    """Hold a store for one run; the system releases it even if the process is killed.

    Raises:
        StorageError: it cannot be written now.
        SurveyError: another run holds it: two would sweep each other's files. Or it is not there.
    """
    path = Path(path).resolve()
    try:
        held = (path / "status" / "zarr.json").open("rb+")  # a file that nobody replaces
    except OSError as error:
        raise storage_error(f"{path} cannot be written", error) from error
    with held:
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise SurveyError(f"{path} is being computed by another run: wait for it, or choose another path") from None
        except OSError:
            pass  # a file system without locks
        yield


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
    arrays = _arrays(path, request)
    cells = (tile.epsilon.stop - tile.epsilon.start, tile.delta.stop - tile.delta.start)
    for name in sorted(values, key=lambda name: name == "status"):
        if values[name].shape != (*arrays[name].shape[:-2], *cells):
            raise SurveyError(f"tile {tile.index}: {name} has shape {values[name].shape}, not that of its chunk")
        if not Path(path, "zarr.json").exists():  # zarr would bring a deleted survey back, in pieces
            raise SurveyError(f"the store {path} is gone")
        arrays[name][..., tile.epsilon, tile.delta] = values[name]


@lru_cache(maxsize=16)
def _arrays(path: str, request: SurveyRequest) -> dict[str, zarr.Array]:
    """Open the arrays that tiles write to, once a process: opening costs more than writing."""
    _require_same(request, Path(path))
    with zarr.config.set({"array.write_empty_chunks": True}):  # see template.WHOLE
        arrays = dict(zarr.open_group(path, mode="r+", zarr_format=3).arrays())
    return {quantity.name: arrays[quantity.name] for quantity in stored(request.quantities) if quantity.per_cell}


def finish_store(path: str | Path) -> None:
    """Finish a survey whose tiles are all done: sweep what killed writers left, date it, consolidate. Idempotent.

    Raises:
        StorageError: it cannot be written now.
        SurveyError: there is no survey, cells are missing, or a run still writes to it.
    """
    path = Path(path).resolve()
    _survey_attributes(path)
    with writing(path):
        if missing := _missing_cells(path):
            raise SurveyError(f"{path} lacks {missing} cells: run the survey again to resume it")
        try:
            for stray in path.rglob("*.partial"):
                stray.unlink(missing_ok=True)
            root = zarr.open_group(path, mode="r+", zarr_format=3)
            if "date_completed" not in root.attrs:
                root.attrs["date_completed"] = now()  # keeps the consolidated metadata, in one atomic replacement
                consolidate(path)
        except OSError as error:
            raise storage_error(f"{path} cannot be finished", error) from error


def _missing_cells(path: Path) -> int:
    try:
        return int(np.sum(np.asarray(zarr.open_array(path / "status", mode="r")[...]) == 0))
    except Exception as error:  # what a codec raises of a damaged chunk
        raise SurveyError(f"{path} is damaged ({error}): run the survey again to repair it") from error


def open_survey(path_or_url: str | Path) -> xr.Dataset:
    """Open a survey from disk or over HTTP, finished or not; values are read when asked for.

    `xarray.open_zarr(path_or_url)` shows the same; this one says what is wrong when there is no survey.

    Raises:
        SurveyError: there is no survey, or it cannot be read.
    """
    try:
        dataset = xr.open_zarr(str(path_or_url), chunks=None, consolidated=True)
    except Exception as error:  # what the disk, the network or a foreign format raises
        raise SurveyError(f"no survey can be opened at {path_or_url}: {error}") from error
    if "content_hash" not in dataset.attrs:
        dataset.close()
        raise SurveyError(f"{path_or_url} is not a survey")
    return dataset
