"""Build the pyramid levels of a survey when its tiles are computed and its families joined.

Each task handles one block of cells, in this process or on a cluster.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import zarr
from zarr.abc.buffer import Buffer
from zarr.storage import MemoryStore

from gear_rattle.workers.errors import report_damage, storage_error
from gear_rattle.workers.storage.added import RunForEach, run_in_this_process
from gear_rattle.workers.storage.location import Place, place_of
from gear_rattle.workers.storage.store import add_to_store, has_added_node
from gear_rattle.workers.survey.levels import reduce
from gear_rattle.workers.survey.levels.grid import (
    GROUP,
    LevelBlock,
    coarsening_factors_of_levels,
    level_blocks,
    stored_levels_of_shape,
)
from gear_rattle.workers.survey.levels.template import (
    code_meanings,
    create_level_array,
    describe_level_arrays,
    files_of_levels,
    level_variables,
)
from gear_rattle.workers.survey.manifest import digest
from gear_rattle.workers.survey.request import SurveyRequest
from gear_rattle.workers.survey.values.evaluate import FAILED
from gear_rattle.workers.survey.values.schema import OF_PERIODIC, Quantity, is_phase
from rattle.attractors import PERIODIC


def lacks_levels(request: SurveyRequest, where: str | Path | Place) -> bool:
    """Return whether a survey is large enough for levels and has none. Tiles and families must be complete."""
    return bool(stored_levels_of_shape(request.shape)) and not has_added_node(where, GROUP)


def build_pyramid_levels(
    request: SurveyRequest, where: str | Path | Place, each: RunForEach = run_in_this_process
) -> None:
    """Build and store the levels of a survey whose tiles are final.

    The caller holds the lock of the store. The result depends on the cells alone, not on the shape or order of tiles. A
    killed run leaves a survey without levels, and the next call builds them from the beginning.

    Raises
    ------
    SurveyError
        There is no survey, or it is damaged.
    StorageError
        The store cannot be written now.
    """
    place = place_of(where)
    found = each(build_level_block, request, str(place), [(block,) for block in level_blocks(request)])
    try:
        add_to_store(place, files_of_levels(request), {key: of for sums in found for key, of in sums.items()})
    except OSError as error:
        refusal = storage_error(f"the levels of {place} cannot be written", error)
        raise refusal from error


def build_level_block(request: SurveyRequest, path: str, block: LevelBlock) -> dict[str, str]:
    """Write the chunks of a block in all levels, and return {key: digest} of these chunks. The call may be repeated."""
    place = place_of(path)
    found: dict[str, str] = {}
    status = _read_array(place, block, "status")
    for quantity in level_variables(request):
        values = _read_values_of_block(place, block, quantity)
        known = status > 0 if quantity.name == "status" else (status > 0) & (status != FAILED)
        if quantity.name in OF_PERIODIC:
            known = known & (_read_array(place, block, "attractor_kind") == PERIODIC)
        for key, content in _chunks_of_levels(request, block, quantity, values, known):
            place.put(key, content)
            found[key] = digest(content)
    return found


def _read_array(place: Place, block: LevelBlock, name: str) -> np.ndarray:
    with report_damage(f"{name} of {place}"):
        array = zarr.open_array(place.zarr(), path=name, mode="r")
        return np.asarray(array[block.selection])


def _read_values_of_block(place: Place, block: LevelBlock, quantity: Quantity) -> np.ndarray:
    """Read the values of a variable in a block. A complex variable is represented by its moduli."""
    parts = [_read_array(place, block, part.name) for part in quantity.parts]
    found: np.ndarray = np.hypot(*parts) if len(parts) > 1 else parts[0]
    return found


def _chunks_of_levels(
    request: SurveyRequest, block: LevelBlock, quantity: Quantity, values: np.ndarray, known: np.ndarray
) -> Iterator[tuple[str, bytes]]:
    """Reduce the values of a variable in a block to all levels, and yield (key, content) of the resulting chunks.

    known: flags of the cells that have a value.

    Yields
    ------
    tuple[str, bytes]
        Key and content of a chunk.
    """
    levels = stored_levels_of_shape(request.shape)
    arrays = describe_level_arrays(quantity)
    beside = values.shape[:-2]
    found: list[list[tuple[np.ndarray, ...]]] = [[] for _ in levels]  # for each level, the arrays of all maps
    for at in np.ndindex(*beside):
        of = known[at] if known.ndim > 2 else known
        for made, each in zip(found, _reduce_to_level_arrays(quantity, values[at], of, request), strict=True):
            made.append(each)
    for level, made in zip(levels, found, strict=True):
        kept: dict[str, Buffer] = {}
        root = zarr.create_group(MemoryStore(kept), zarr_format=3)
        for number, array in enumerate(arrays):
            stored = create_level_array(root, request, level, array)
            stored[block.selection_at_level(level)] = _stack_maps([each[number] for each in made], beside)
        yield from ((key, kept[key].to_bytes()) for key in sorted(kept) if "/c/" in key)


def _reduce_to_level_arrays(
    quantity: Quantity, values: np.ndarray, known: np.ndarray, request: SurveyRequest
) -> Iterator[tuple[np.ndarray, ...]]:
    """Reduce one map of a variable. Yield for each level its arrays, in the order of `describe_level_arrays`."""
    steps = coarsening_factors_of_levels(stored_levels_of_shape(request.shape))
    if words := code_meanings(quantity):
        yield from reduce.reduce_codes_by_level(values, known, steps, len(words))
    else:
        made = reduce.reduce_phases_by_level if is_phase(quantity.name) else reduce.reduce_numbers_by_level
        yield from ((each,) for each in made(values, known, steps))


def _stack_maps(maps: Sequence[np.ndarray], lengths: tuple[int, ...]) -> np.ndarray:
    """Join the maps of a variable, for example one for each slot, to one array.

    maps: arrays (statistics, rows, columns), or (rows, columns) if the variable's values are codes, such as regions.
    lengths: the lengths of the variable's dimensions other than δ and ε.

    Returns
    -------
    np.ndarray
        Shape (statistics, *lengths, rows, columns), without the first axis for codes.
    """
    statistics = maps[0].shape[:-2]
    return np.stack(maps, axis=len(statistics)).reshape(*statistics, *lengths, *maps[0].shape[-2:])
