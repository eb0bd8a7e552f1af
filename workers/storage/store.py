"""The zarr store of a survey: created once, filled tile by tile, resumed, finished and opened."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import zarr
from zarr.core.buffer import cpu

from gear_rattle.workers.errors import StorageError, SurveyError, storage_error
from gear_rattle.workers.kinds import AnyRequest, AnyTile, blank, template_of
from gear_rattle.workers.populations.request import PopulationRequest
from gear_rattle.workers.storage.bucket import SCHEME
from gear_rattle.workers.storage.encoding import prepare_for_writing
from gear_rattle.workers.storage.integrity import (
    COMPLETED,
    STATUS,
    Manifest,
    damaged_template,
    examine_tiles,
    manifest_of,
    read_sealed,
    require_there,
    said_by_root,
    whole_tile,
)
from gear_rattle.workers.storage.location import Place, place_of
from gear_rattle.workers.storage.root import attributes_of, tell
from gear_rattle.workers.survey.families import FAMILY
from gear_rattle.workers.survey.families import GROUP as FAMILIES
from gear_rattle.workers.survey.levels.grid import GROUP as LEVELS
from gear_rattle.workers.survey.refined.audit import (
    AUDIT,
    AUDITED,
    DISAGREED,
    LEAF,
    ROUNDS,
    SOURCE_LEVEL,
    TOLD,
    told_of_audit,
)
from gear_rattle.workers.survey.request import SurveyRequest
from gear_rattle.workers.survey.seals import (
    GROUP,
    OWN,
    ROOT,
    SLICES,
    TILES,
    checksums_of,
    chunk_key,
    files_of,
    sealed,
    tile_key,
)
from gear_rattle.workers.survey.template import Template, now
from gear_rattle.workers.survey.tiles import Tile
from gear_rattle.workers.survey.values.schema import CELL, SLOT
from gear_rattle.workers.survey.version import code_version

if TYPE_CHECKING:
    import xarray as xr


Make = Callable[[AnyRequest, str | None], Template]
KEPT = COMPLETED, ROUNDS  # what tiles were made by, or that they were, when the rest of the root is made again
_blank = lru_cache(maxsize=16)(blank)


def create_store(request: AnyRequest, where: str | Path | Place, make: Make | None = None) -> None:
    """Create the empty store of a survey, or accept the one that an earlier run of the same survey left.

    Whatever else is there is left as it is. The store appears at once and whole. Of a survey's own store, what tiles do
    not write to, its metadata first of all, is made again if any of it is damaged. Numbers of cells are not touched.

    Args:
        make: as `template_of`, which is the default: to compute elsewhere what takes long.

    Raises:
        StorageError: it cannot be written now.
        SurveyError: something else is there, or it cannot be written, or another run writes to what is damaged.
    """
    place, make = place_of(where), make or template_of
    try:
        if not place.occupied():
            place.build(make(request, None))
        manifest = _require_same(request, place)
        if not _template_whole(request, place, manifest):
            with place.writing():
                _mend(place, make(request, manifest.date_created))
    except OSError as error:
        raise storage_error(f"{place} cannot be created", error) from error


def _template_whole(request: AnyRequest, place: Place, manifest: Manifest) -> bool:
    if damaged_template(place, manifest):
        return False
    described = (read_sealed(place, ROOT) or {})["consolidated_metadata"]["metadata"]
    kept, arrays, _ = _blank(request)
    return all(described.get(name) == json.loads(kept[f"{name}/{ROOT}"].to_bytes()) for name in arrays)


def _mend(place: Place, template: Template) -> None:
    """Write the template over what is there, the root last."""
    root, before = json.loads(template[ROOT]), read_sealed(place, ROOT)
    if before is not None:
        root["attributes"] |= {name: before["attributes"][name] for name in KEPT if name in before["attributes"]}
    for key in template.keys() - {ROOT}:
        place.put(key, template[key])
    place.put(ROOT, sealed(root))


def _require_same(request: AnyRequest, place: Place) -> Manifest:
    manifest = manifest_of(place)
    if manifest is not None and manifest.content_hash == request.content_hash():
        return manifest
    if manifest is None:
        require_there(place)
    attributes = said_by_root(place)
    if manifest is None and "content_hash" not in attributes:
        raise SurveyError(f"{place} holds something that is not a survey: choose another path")
    if attributes.get("code_version", code_version()) != code_version():
        raise SurveyError(
            f"{place} holds a survey computed by version {attributes.get('code_version')}, and this is {code_version()}"
            ": choose another path, or finish it with that version"
        )
    if manifest is None:
        raise SurveyError(
            f"{place} is damaged: neither {ROOT} nor {OWN} says what it was. Take one of them from a copy of the"
            " survey, or choose another path"
        )
    raise SurveyError(f"{place} holds another survey: choose another path, or delete that one first")


def tiles_done(
    request: AnyRequest, where: str | Path | Place, should_stop: Callable[[], bool] | None = None
) -> set[int]:
    """Return the indices of the tiles that are computed and undamaged.

    Every chunk is read, for its checksum; `should_stop` is asked at each tile.

    Raises:
        SurveyError: this survey is not there.
        StoppedError: because `should_stop` said so.
    """
    place = place_of(where)
    return examine_tiles(place, _require_same(request, place), should_stop)[0]


def require_aligned(request: AnyRequest, tile: AnyTile) -> None:
    """Raise SurveyError unless the tile is one whole chunk: two writers inside one chunk lose data silently."""
    axes = zip(tile.spans, request.tile_shape, request.shape, strict=True)
    for span, size, num in axes:
        if span.start % size or not 0 <= span.start < num or span.stop != min(span.start + size, num) or span.step:
            raise SurveyError(f"tile {tile.index} ({span}) is not a chunk of {size}: use the tiles of tiles_of")


def write_tile(request: AnyRequest, path: str, tile: AnyTile, values: Mapping[str, np.ndarray]) -> None:
    """Write every variable of a tile, `status` last: a tile that was interrupted is not done.

    Raises:
        StorageError: it cannot be written now, or the store is gone: with its disk, or by a deletion.
        SurveyError: the tile or a shape is not a chunk of the store, or the store is of another survey.
    """
    require_aligned(request, tile)
    place = _place(path, request)
    for key, content in _encoded(request, tile, values):
        if not place.exists():  # a deleted survey would come back, in pieces
            require_there(place)
            raise StorageError(f"{ROOT} of {place} is gone: run the survey again to repair it")
        place.put(key, content)


@lru_cache(maxsize=16)
def _place(path: str, request: AnyRequest) -> Place:
    """Look once a process whether the store is this survey's."""
    _require_same(request, place_of(path))
    return place_of(path)


def read_tile(request: SurveyRequest, path: str, tile: Tile) -> dict[str, np.ndarray] | None:
    """Read every variable of a tile; None if it is not computed, or damaged.

    Raises:
        StorageError: it cannot be read now.
        SurveyError: the store is of another survey, or may not be read.
    """
    kept, arrays, _ = _blank(request)
    row, column, keys = _keys(request, tile)
    if (contents := whole_tile(_place(path, request), keys, row, column)) is None:
        return None
    values = {}
    for name, content in contents.items():
        kept[keys[name]] = cpu.Buffer.from_bytes(content)
        values[name] = np.asarray(arrays[name][tile.at])
        del kept[keys[name]]
    return values


def rewrite_tile(request: SurveyRequest, place: Place, tile: Tile, values: Mapping[str, np.ndarray]) -> None:
    """Write the slots of a computed tile anew; values: all of its variables. One that was interrupted is damaged.

    Raises:
        OSError: it cannot be written now.
    """
    quantities = request.variables
    same = tuple(f"{each.name}/" for each in quantities if each.dims[0] != SLOT)
    for key, content in _encoded(request, tile, values):
        if not key.startswith(same):
            place.put(key, content)


def _encoded(request: AnyRequest, tile: AnyTile, values: Mapping[str, np.ndarray]) -> list[tuple[str, bytes]]:
    """Return the files of a tile, in the order in which they are to be written."""
    kept, arrays, chunks = _blank(request)
    for name, given in values.items():
        if given.shape != np.broadcast_to(0, arrays[name].shape)[tile.at].shape:
            raise SurveyError(f"tile {tile.index}: {name} has shape {given.shape}, not that of its chunk")
    if missing := chunks.keys() - values.keys():
        raise SurveyError(f"tile {tile.index} lacks {', '.join(sorted(missing))}")
    row, column, keys = _keys(request, tile)
    contents = {}
    for name, key in keys.items():
        arrays[name][tile.at] = values[name]
        contents[name] = kept.pop(key).to_bytes()
    sums = tile_key(row, column)
    arrays[TILES][:, row : row + 1, column : column + 1] = checksums_of(row, column, keys, contents)
    first = [(key, contents[name]) for name, key in keys.items() if name != STATUS]
    return [*first, (sums, kept.pop(sums).to_bytes()), (keys[STATUS], contents[STATUS])]


def _keys(request: AnyRequest, tile: AnyTile) -> tuple[int, int, dict[str, str]]:
    """Return where a tile is among the tiles, and the key of each of its chunks."""
    rows, columns = request.tile_grid
    row, column = divmod(tile.index, columns)
    chunks = _blank(request)[2]
    return row, column, {name: chunk_key(key, row, column, rows // request.n_slices) for name, key in chunks.items()}


def finish_store(where: str | Path | Place) -> None:
    """Finish a survey whose tiles are all done: sweep what killed writers left, date it, consolidate. Idempotent.

    Raises:
        StorageError: it cannot be written now.
        SurveyError: there is no survey, cells are missing, or a run still writes to it.
    """
    place = place_of(where)
    if (manifest := manifest_of(place)) is None:
        require_there(place)
        raise SurveyError(f"{place} holds something that is not a survey: choose another path")
    with place.writing():
        if missing := _missing_cells(place):
            raise SurveyError(f"{place} lacks {missing} cells: run the survey again to resume it")
        try:
            place.sweep()
            told = {COMPLETED: attributes_of(place).get(COMPLETED) or now()}
            if AUDIT in manifest.chunks and LEAF not in manifest.chunks:  # otherwise its rounds have told
                told |= _refined(place)
            tell(place, told)
        except OSError as error:
            raise storage_error(f"{place} cannot be finished", error) from error


def has_added(where: str | Path | Place, name: str) -> bool:
    """Whether a group or a variable was added to a survey's store."""
    manifest = manifest_of(place_of(where))
    return manifest is not None and f"{name}/{ROOT}" in manifest.files


def added_to_store(where: str | Path | Place, added: Template, there: Mapping[str, str]) -> None:
    """Add what follows from all tiles: the files of `added`, whose root describes them, and those that are there
    already, with their checksums. They appear with the root, which comes last, and are sealed as the template's are.

    Raises:
        OSError: it cannot be written now.
        SurveyError: there is no survey, or it is damaged.
    """
    place = place_of(where)
    root, own = read_sealed(place, ROOT), read_sealed(place, OWN)
    if root is None or own is None:
        require_there(place)
        raise SurveyError(f"{place} is damaged: run the survey again to repair it")
    files = {key: content for key, content in added.items() if key != ROOT}
    own["attributes"]["files"] |= files_of(files) | dict(there)
    sums = sealed(own)
    described = json.loads(added[ROOT])["consolidated_metadata"]["metadata"]
    described[GROUP] = root["consolidated_metadata"]["metadata"][GROUP] | {"attributes": json.loads(sums)["attributes"]}
    every = root["consolidated_metadata"]["metadata"] | described
    root["consolidated_metadata"]["metadata"] = dict(sorted(every.items(), key=lambda each: _slice_group(each[0])))
    for key, content in files.items():
        place.put(key, content)
    place.put(OWN, sums)
    place.put(ROOT, sealed(root))


def _slice_group(key: str) -> str:
    """The group that a key of a slice is in: in metadata that zarr reads, members of a group stand together."""
    return key.rpartition("/")[0] if key.startswith(f"{SLICES}/") else ""


def before_tiles(request: AnyRequest, place: Place) -> None:
    """Take from a store what was added to it and would not be true of tiles that are computed anew: their slots are by
    share until they are joined, and they have gone through one round of audits. The caller holds the store.

    Raises:
        StorageError: it cannot be written now.
    """
    try:
        if TOLD[-1] in said_by_root(place):
            tell(place, dict.fromkeys(TOLD))
    except OSError as error:
        raise storage_error(f"{place} cannot be written", error) from error
    if isinstance(request, PopulationRequest) or not (request.slots_follow_families and has_added(place, FAMILY)):
        return
    root, own = read_sealed(place, ROOT), read_sealed(place, OWN)
    if root is None or own is None:
        return
    files, described = own["attributes"]["files"], root["consolidated_metadata"]["metadata"]
    own["attributes"]["files"] = {key: sum_ for key, sum_ in files.items() if not _is_added(key)}
    sums = sealed(own)
    left = {key: of for key, of in described.items() if not _is_added(key)}
    root["consolidated_metadata"]["metadata"] = left | {
        GROUP: left[GROUP] | {"attributes": json.loads(sums)["attributes"]}
    }
    try:
        place.put(OWN, sums)
        place.put(ROOT, sealed(root))
    except OSError as error:
        raise storage_error(f"{place} cannot be written", error) from error


def _is_added(key: str) -> bool:
    return not {FAMILY, FAMILIES, LEVELS}.isdisjoint(key.split("/"))


def _missing_cells(place: Place) -> int:
    return sum(int(np.sum(band == 0)) for band in bands(place, STATUS))


def _refined(place: Place) -> dict[str, int | float]:
    """What the root says of a refined survey: its cells that were filled, and what their audit found."""
    counts: dict[int, list[int]] = {}
    for i, (source, audit) in enumerate(zip(bands(place, SOURCE_LEVEL), bands(place, AUDIT), strict=True)):
        found = np.bincount(audit.ravel(), minlength=DISAGREED + 1)
        of = counts.setdefault(i if source.ndim > len(CELL) else 0, [0, 0, 0])
        for j, more in enumerate((np.count_nonzero(source), found[AUDITED:].sum(), found[DISAGREED])):
            of[j] += int(more)
    return told_of_audit(list(counts.values()))


def bands(place: Place, name: str) -> Iterator[np.ndarray]:
    """The values of a variable of cells, a row of tiles at a time: whole, it takes 2 KiB for each of them.

    Raises:
        SurveyError: the survey is damaged.
    """
    try:
        with place.reaching():
            array = zarr.open_array(place.zarr(), path=name, mode="r")
            for row in range(0, array.shape[0], array.chunks[0]):
                yield np.asarray(array[row : row + array.chunks[0]])
    except SurveyError:
        raise
    except Exception as error:  # what a codec raises of a damaged chunk
        require_there(place)
        raise SurveyError(f"{place} is damaged ({error}): run the survey again to repair it") from error


def open_survey(path_or_url: str | Path | Place, group: str | None = None, as_stored: bool = False) -> xr.Dataset:
    """Open a survey, or a group of it, from disk, a bucket or over HTTP, finished or not; values are read when asked
    for.

    `xarray.open_zarr(path_or_url, group=group)` shows the same, but complex variables as `…_real` and `…_imag`; this
    one says what is wrong when there is no survey, and what it opens can be written again, in any chunks, with
    `to_netcdf` (which keeps the CF conventions) and `to_zarr`.

    Args:
        as_stored: leave complex variables in their two parts, which NetCDF can hold.

    Raises:
        SurveyError: there is no survey, or it cannot be read.
    """
    import xarray as xr  # a third of a second, which no process that only computes has to wait for

    try:
        dataset = xr.open_zarr(_readable(path_or_url), chunks=None, consolidated=True, group=group)
    except Exception as error:  # what the disk, the network or a foreign format raises
        raise SurveyError(f"no survey can be opened at {path_or_url}: {error}") from error
    if group is None and "content_hash" not in dataset.attrs:
        dataset.close()
        raise SurveyError(f"{path_or_url} is not a survey")
    dataset = prepare_for_writing(dataset)
    if as_stored:
        return dataset
    from gear_rattle.workers.storage.complex import joined

    return joined(dataset)


def open_groups(path_or_url: str | Path | Place) -> dict[str, xr.Dataset]:
    """Open what a survey has beside its cells, as it is stored: curves, their points and families, by their paths.

    Levels, which say nothing that cells do not, are opened one by one.

    Raises SurveyError: they cannot be read.
    """
    import xarray as xr

    try:
        found = xr.open_groups(_readable(path_or_url), engine="zarr", chunks=None, consolidated=True)
    except Exception as error:  # what the disk, the network or a foreign format raises
        raise SurveyError(f"no survey can be opened at {path_or_url}: {error}") from error
    return {
        path.strip("/"): prepare_for_writing(each)
        for path, each in found.items()
        if path.split("/")[1] not in ("", GROUP, LEVELS)
    }


def _readable(path_or_url: str | Path | Place) -> Any:
    if str(path_or_url).startswith(SCHEME):
        return place_of(path_or_url).zarr().with_read_only(True)  # type: ignore[union-attr]  # a bucket
    return str(path_or_url)
