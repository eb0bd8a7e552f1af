"""The zarr store of a survey or population: create it, fill it tile by tile, resume, finish and open it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import zarr
from zarr.buffer import cpu

from gear_rattle.workers.errors import StorageError, SurveyError, storage_error
from gear_rattle.workers.kinds import AnyRequest, AnyTile, create_empty_arrays, template_of, tiles_of
from gear_rattle.workers.storage.bucket import SCHEME
from gear_rattle.workers.storage.encoding import prepare_for_writing
from gear_rattle.workers.storage.integrity import COMPLETED, STATUS, examine_tiles, find_damaged_template_files
from gear_rattle.workers.storage.location import Place, place_of
from gear_rattle.workers.storage.manifest import (
    read_file,
    read_manifest,
    read_required_manifest,
    read_root_attributes,
    read_unchecked_attributes,
    read_undamaged_root,
    replace_attributes,
    replace_root_file,
    require_existing_store,
    set_store_attributes,
    update_metadata,
)
from gear_rattle.workers.survey.levels.grid import GROUP as LEVELS
from gear_rattle.workers.survey.manifest import MANIFEST, ROOT, Manifest, chunk_key, file_digests
from gear_rattle.workers.survey.refined.audit import (
    AUDIT,
    AUDIT_ATTRIBUTES,
    AUDITED,
    DISAGREED,
    LEAF,
    ROUNDS,
    SOURCE_LEVEL,
    values_of_audit_attributes,
)
from gear_rattle.workers.survey.request import SurveyRequest
from gear_rattle.workers.survey.stored_families import FAMILY
from gear_rattle.workers.survey.stored_families import GROUP as FAMILIES
from gear_rattle.workers.survey.template import Template, current_time
from gear_rattle.workers.survey.values.schema import CELL
from gear_rattle.workers.survey.version import code_version

if TYPE_CHECKING:
    import xarray as xr


TemplateMaker = Callable[[AnyRequest, str | None], Template]
KEPT = COMPLETED, ROUNDS  # attributes that a repaired root keeps, because the template does not contain them
_blank = lru_cache(maxsize=16)(create_empty_arrays)


def create_store(request: AnyRequest, where: str | Path | Place, make: TemplateMaker | None = None) -> None:
    """Create the empty store of a survey or population, or accept and repair the store of an earlier, equal request.

    The new store appears complete, in one step. In an earlier store, damaged files that belong to no tile (for
    example metadata) are written again; the values of cells are not touched. Any other content of the path is left
    alone.

    Parameters
    ----------
    make : TemplateMaker | None
        Function that computes the template, by default `template_of`. It may use a cluster, because it may take long.

    Raises
    ------
    StorageError
        The store cannot be written now.
    SurveyError
        The path has other contents, the store cannot be written, or another run writes to the damaged store.
    """
    place, make = place_of(where), make or template_of
    try:
        if not place.is_occupied():
            place.build(make(request, None))
        if _is_damaged(place, _require_same_survey(request, place)):
            with place.lock_for_writing():
                _repair_store(request, place, make)
    except OSError as error:
        refusal = storage_error(f"{place} cannot be created", error)
        raise refusal from error


def _is_damaged(place: Place, manifest: Manifest | None) -> bool:
    return manifest is None or bool(find_damaged_template_files(place, manifest))


def _repair_store(request: AnyRequest, place: Place, make: TemplateMaker) -> None:
    """Write the template over a damaged store, root and manifest last. Families and levels are computed again later."""
    manifest = _require_same_survey(request, place)
    if not _is_damaged(place, manifest):
        return  # another run has repaired the store meanwhile
    said = read_unchecked_attributes(place)
    trusted = said if manifest is None or read_undamaged_root(place, manifest) else {}
    created = manifest.date_created if manifest else trusted.get("date_created")
    template = make(request, created)
    for key in template.keys() - {ROOT, MANIFEST}:
        place.put(key, template[key])
    after = Manifest.from_bytes(template[MANIFEST])
    assert after is not None, "a template is whole"
    if manifest is None:
        for index, files in _digests_of_decodable_tiles(request, place):
            after.record_tile(index, files)
    else:
        after.tiles.update(manifest.tiles)
    attributes = json.loads(template[ROOT])["attributes"]
    kept = {name: trusted[name] for name in KEPT if name in trusted}
    replace_root_file(place, manifest or after, replace_attributes(template[ROOT], attributes | kept), after)


def _digests_of_decodable_tiles(request: AnyRequest, place: Place) -> Iterator[tuple[int, dict[str, str]]]:
    """Yield index and chunk digests of each tile whose chunks decode and which has no uncomputed cell.

    From these entries a lost or damaged manifest of a store is written again.

    Yields
    ------
    tuple[int, dict[str, str]]
        The index of a tile, and the digests of its chunks by key.
    """
    for tile in tiles_of(request):
        contents = _chunk_contents(request, place, tile)
        try:
            is_computed = _decode_tile(request, tile, contents)[STATUS].all()
        except Exception:  # codecs raise errors of several types for damaged chunks
            continue
        if is_computed:
            yield tile.index, file_digests(contents)


def _require_same_survey(request: AnyRequest, place: Place) -> Manifest | None:
    """Require that a store belongs to a request. Return its manifest, or None if the manifest is lost or damaged."""
    manifest = read_manifest(place)
    if manifest is not None and manifest.content_hash == request.content_hash():
        return manifest
    if manifest is None:
        require_existing_store(place)
    attributes = read_unchecked_attributes(place)
    if manifest is None and "content_hash" not in attributes:
        raise SurveyError(f"{place} holds something that is not a survey or population: choose another path")
    if attributes.get("code_version", code_version()) != code_version():
        raise SurveyError(
            f"{place} holds a store computed by version {attributes.get('code_version')}, and this is version "
            f"{code_version()}: choose another path, or finish the store with that version"
        )
    if manifest is None and attributes["content_hash"] == request.content_hash():
        return None
    raise SurveyError(f"{place} holds another survey or population: choose another path, or delete that store first")


def tiles_done(
    request: AnyRequest, where: str | Path | Place, should_stop: Callable[[], bool] | None = None
) -> set[int]:
    """Return the indices of the tiles that are computed and undamaged.

    Every chunk is read to check its digest. should_stop: called at each tile; returns whether to stop.

    Returns
    -------
    set[int]
        Indices as in `tiles_of`.

    Raises
    ------
    SurveyError
        There is no store, its manifest is damaged, or it belongs to another request.
    StorageError
        The store is gone or cannot be read now.
    StoppedError
        `should_stop` returned true.
    """
    place = place_of(where)
    _require_same_survey(request, place)
    return examine_tiles(place, read_required_manifest(place), should_stop)[0]


def require_aligned_tiles(request: AnyRequest, tiles: Iterable[AnyTile]) -> None:
    """Raise SurveyError unless each tile is one whole chunk, because two writers in one chunk lose data silently."""
    sides = list(zip(request.tile_shape, request.shape, strict=True))  # computed once, not for each of 10⁵ tiles
    for tile in tiles:
        for span, (size, num) in zip(tile.spans, sides, strict=True):
            if span.start % size or not 0 <= span.start < num or span.stop != min(span.start + size, num) or span.step:
                raise SurveyError(
                    f"tile {tile.index} ({span}) is not one whole chunk of length {size}: use the tiles of tiles_of"
                )


def write_tile(request: AnyRequest, path: str, tile: AnyTile, values: Mapping[str, np.ndarray]) -> dict[str, str]:
    """Write every variable of a tile.

    The tile counts as computed once the digests of its chunks are in the manifest.

    Returns
    -------
    dict[str, str]
        Digests of the written chunks, by their key.

    Raises
    ------
    SurveyError
        The tile is not a chunk of the store, an array has another shape, or the store belongs to another survey.
    StorageError
        The tile cannot be written now, or the store is gone because it was deleted or its disk is not there.
    """
    require_aligned_tiles(request, [tile])
    place = _checked_store_location(path, request)
    written = _encode_tile(request, tile, values)
    for key, content in written.items():
        if not place.exists():  # writing would recreate parts of a deleted survey
            require_existing_store(place)
            raise StorageError(f"{ROOT} of {place} is gone: compute the same request again to repair it")
        place.put(key, content)
    return file_digests(written)


@lru_cache(maxsize=16)
def _checked_store_location(path: str, request: AnyRequest) -> Place:
    """Return the location of a store. Each process checks once that the store belongs to this survey."""
    _require_same_survey(request, place_of(path))
    return place_of(path)


def read_tile(request: AnyRequest, path: str, tile: AnyTile, known: Mapping[str, str]) -> dict[str, np.ndarray] | None:
    """Read every variable of a computed tile, or return None if it is damaged. known: digests of its chunks, by key.

    Returns
    -------
    dict[str, np.ndarray] | None
        Arrays over the tile, by variable.

    Raises
    ------
    SurveyError
        The store belongs to another survey, or permission to read it is denied.
    StorageError
        The store cannot be read now.
    """
    contents = _chunk_contents(request, _checked_store_location(path, request), tile)
    return _decode_tile(request, tile, contents) if file_digests(contents) == known else None


def _chunk_contents(request: AnyRequest, place: Place, tile: AnyTile) -> dict[str, bytes]:
    """Return the existing chunks of a tile, by their key."""
    found = ((key, read_file(place, key)) for key in _chunk_keys(request, tile).values())
    return {key: content for key, content in found if content is not None}


def _decode_tile(request: AnyRequest, tile: AnyTile, contents: Mapping[str, bytes]) -> dict[str, np.ndarray]:
    """Decode every variable of a tile. Raises KeyError for lost chunks, and the errors of codecs for damaged ones."""
    kept, arrays, _ = _blank(request)
    values = {}
    for name, key in _chunk_keys(request, tile).items():
        kept[key] = cpu.Buffer.from_bytes(contents[key])
        try:
            values[name] = np.asarray(arrays[name][tile.selection])
        finally:
            del kept[key]
    return values


def _encode_tile(request: AnyRequest, tile: AnyTile, values: Mapping[str, np.ndarray]) -> dict[str, bytes]:
    """Encode a tile. Return the contents of its files by key, as zarr writes them."""
    kept, arrays, chunks = _blank(request)
    for name, given in values.items():
        if given.shape != np.broadcast_to(0, arrays[name].shape)[tile.selection].shape:
            raise SurveyError(
                f"tile {tile.index}: {name} has shape {given.shape}, which is not the shape of the tile's chunk: pass "
                "the arrays that compute_tile returned, unchanged"
            )
    if missing := chunks.keys() - values.keys():
        names = ", ".join(sorted(missing))
        raise SurveyError(f"tile {tile.index} lacks {names}: pass all arrays that compute_tile returned")
    contents = {}
    for name, key in _chunk_keys(request, tile).items():
        arrays[name][tile.selection] = values[name]
        contents[key] = kept.pop(key).to_bytes()
    return contents


def _chunk_keys(request: AnyRequest, tile: AnyTile) -> dict[str, str]:
    """Return the key of each chunk of a tile, by variable. `status` is last: a tile with a status is complete."""
    rows, columns = request.tile_grid_shape
    row, column = divmod(tile.index, columns)
    chunks = _blank(request)[2]
    keys = {name: chunk_key(key, row, column, rows // request.n_slices) for name, key in chunks.items()}
    return keys | {STATUS: keys.pop(STATUS)}


def finish_store(where: str | Path | Place) -> None:
    """Finish a survey or population whose tiles are all computed: remove partial files, write the date of completion.

    In a refined survey without a bound on its share of wrong cells, the audited cells are also counted. The call may
    be repeated.

    Raises
    ------
    SurveyError
        There is no survey, tiles are missing, or a run still writes to it.
    StorageError
        The store cannot be written now.
    """
    place = place_of(where)
    manifest = read_required_manifest(place)
    with place.lock_for_writing():
        if missing := manifest.n_tiles - len(manifest.tiles):
            raise SurveyError(
                f"{place} lacks {missing} of its {manifest.n_tiles} tiles: compute the same request again to resume it"
            )
        try:
            place.remove_leftovers()
            attributes = {COMPLETED: read_root_attributes(place).get(COMPLETED) or current_time()}
            # A survey without the variable LEAF has no rounds of audits, which would have counted the audited cells, so
            # these cells are counted here.
            if AUDIT in manifest.chunks and LEAF not in manifest.chunks:
                attributes |= _compute_audit_attributes(place)
            set_store_attributes(place, attributes)
        except OSError as error:
            refusal = storage_error(f"{place} cannot be finished", error)
            raise refusal from error


def has_added_node(where: str | Path | Place, name: str) -> bool:
    """Return whether the group or variable `name` was added to a survey's store after its tiles."""
    manifest = read_manifest(place_of(where))
    return manifest is not None and f"{name}/{ROOT}" in manifest.files


def add_to_store(where: str | Path | Place, added: Template, written: Mapping[str, str]) -> None:
    """Add files to a store. added: contents of files to write, by key. written: digests of chunks already written.

    The root is written last, and all additions become visible with it.

    Raises
    ------
    SurveyError
        There is no survey, or it is damaged.
    OSError
        A file cannot be written now.
    """
    update_metadata(place_of(where), added, written, lambda _: False)


def remove_outdated_results(request: AnyRequest, place: Place) -> None:
    """Remove from a store the results that would no longer fit its tiles, before some tiles are computed again.

    The counts of audits are removed, because new tiles have only the first round of audits. If slots follow families,
    families and levels are removed too, because new tiles have their slots in the order of basin fractions. The caller
    holds the lock of the store.

    Raises
    ------
    SurveyError
        The store is damaged.
    StorageError
        The store cannot be written now.
    """
    try:
        if AUDIT_ATTRIBUTES[-1] in read_unchecked_attributes(place):
            set_store_attributes(place, dict.fromkeys(AUDIT_ATTRIBUTES))
        if isinstance(request, SurveyRequest) and request.slots_follow_families and has_added_node(place, FAMILY):
            update_metadata(place, {}, {}, _is_file_of_families_or_levels)
    except OSError as error:
        refusal = storage_error(f"{place} cannot be written", error)
        raise refusal from error


def _is_file_of_families_or_levels(key: str) -> bool:
    """Return whether the file with this key belongs to the families or the levels of a survey."""
    return not {FAMILY, FAMILIES, LEVELS}.isdisjoint(key.split("/"))


def _compute_audit_attributes(place: Place) -> dict[str, int | float]:
    """Count the filled, audited and wrong cells of a stored refined survey; return AUDIT_ATTRIBUTES for its root."""
    counts: dict[int, list[int]] = {}
    for i, (source, audit) in enumerate(
        zip(read_variable_in_bands(place, SOURCE_LEVEL), read_variable_in_bands(place, AUDIT), strict=True)
    ):
        found = np.bincount(audit.ravel(), minlength=DISAGREED + 1)
        of = counts.setdefault(i if source.ndim > len(CELL) else 0, [0, 0, 0])
        for j, more in enumerate((np.count_nonzero(source), found[AUDITED:].sum(), found[DISAGREED])):
            of[j] += int(more)
    return values_of_audit_attributes(list(counts.values()))


def read_variable_in_bands(place: Place, name: str) -> Iterator[np.ndarray]:
    """Yield the values of a per-cell variable in parts, because all values may not fit in memory.

    Yields
    ------
    np.ndarray
        Values of a row of tiles, or of one slice if the survey has a third axis.

    Raises
    ------
    SurveyError
        The survey is damaged.
    """
    try:
        with place.translate_errors():
            array = zarr.open_array(place.zarr(), path=name, mode="r")
            for row in range(0, array.shape[0], array.chunks[0]):
                yield np.asarray(array[row : row + array.chunks[0]])
    except SurveyError:
        raise
    except Exception as error:  # codecs raise errors of several types for damaged chunks
        require_existing_store(place)
        raise SurveyError(
            f"{name} of {place} cannot be read ({error}): if it is damaged, run the survey again to repair it"
        ) from error


def open_survey(path_or_url: str | Path | Place, group: str | None = None, as_stored: bool = False) -> xr.Dataset:
    """Open a survey, or a group of it, from disk, a bucket or over HTTP, finished or not.

    Values are read when they are needed. `xarray.open_zarr(path_or_url, group=group)` opens the same dataset, except
    that complex variables are in two parts, `…_real` and `…_imag`. The dataset of this function can be written again in
    any chunks, with `to_netcdf` (under the CF conventions) and `to_zarr`; and its errors say why there is no survey.

    Parameters
    ----------
    as_stored : bool
        Leave complex variables in two parts, as NetCDF requires.

    Returns
    -------
    xr.Dataset
        Variables over the plane; `dataset.rattle.plot` draws one.

    Raises
    ------
    SurveyError
        There is no survey, or it cannot be read.
    """
    import xarray as xr  # imported here, because its import takes a third of a second, and workers do not need it

    try:
        dataset = xr.open_zarr(_zarr_source(path_or_url), chunks=None, consolidated=True, group=group)
    except Exception as error:  # disks, networks and foreign formats raise errors of many types
        raise SurveyError(f"no survey can be opened at {path_or_url}: {error}") from error
    if group is None and "content_hash" not in dataset.attrs:
        dataset.close()
        raise SurveyError(f"{path_or_url} is not a survey: give the path or URL of a survey's store")
    dataset = prepare_for_writing(dataset)
    if as_stored:
        return dataset
    from gear_rattle.workers.storage.complex import join_complex

    return join_complex(dataset)


def open_groups(path_or_url: str | Path | Place) -> dict[str, xr.Dataset]:
    """Open all groups of a survey except its levels: curves, codimension-two points and families, by path.

    Levels are left out, because they have no information of their own.

    Returns
    -------
    dict[str, xr.Dataset]
        Datasets by path.

    Raises
    ------
    SurveyError
        The groups cannot be read.
    """
    import xarray as xr

    try:
        found = xr.open_groups(_zarr_source(path_or_url), engine="zarr", chunks=None, consolidated=True)
    except Exception as error:  # disks, networks and foreign formats raise errors of many types
        raise SurveyError(f"no survey can be opened at {path_or_url}: {error}") from error
    return {
        path.strip("/"): prepare_for_writing(each)
        for path, each in found.items()
        if path.split("/")[1] not in ("", LEVELS)
    }


def _zarr_source(path_or_url: str | Path | Place) -> Any:
    if str(path_or_url).startswith(SCHEME):
        return place_of(path_or_url).zarr().with_read_only(True)  # type: ignore[union-attr]  # a bucket
    if str(path_or_url).endswith(".zip"):
        return zarr.storage.ZipStore(str(path_or_url), mode="r")
    return str(path_or_url)
