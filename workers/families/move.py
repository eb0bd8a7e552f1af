"""Move the attractors of a tile to the slots of their families."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gear_rattle.workers.families.blocks import FamilyBlock, ranks_within_cells, read_target_slots
from gear_rattle.workers.kinds import compute_tile
from gear_rattle.workers.storage.location import Place, place_of
from gear_rattle.workers.storage.store import read_tile, write_tile
from gear_rattle.workers.survey.request import SurveyRequest
from gear_rattle.workers.survey.stored_families import attractors_in_slots, complete_slot_sources
from gear_rattle.workers.survey.tiles import Tile, TileArrays
from gear_rattle.workers.survey.values.schema import SLOT
from rattle.families import CellRectangle


def move_attractors_to_slots(
    request: SurveyRequest, path: str, tile: Tile, blocks: Sequence[FamilyBlock], known: Mapping[str, str]
) -> Mapping[str, str]:
    """Move the attractors of a tile to the slots of their families, and write the tile if this changes its values.

    A stored tile that is damaged, for example because a worker died while it moved attractors, is computed again.

    Parameters
    ----------
    blocks : Sequence[FamilyBlock]
        The blocks that cover the tile.
    known : Mapping[str, str]
        Digests of the tile's chunks in the manifest, by key.

    Returns
    -------
    Mapping[str, str]
        Digests of the tile's chunks afterwards, by key.
    """
    values = read_tile(request, path, tile, known)
    computed = values is not None
    if values is None:
        values = compute_tile(request, tile)[0]
    place = place_of(path)
    source = _source_slots(request, place, tile, blocks, values)
    if computed and (source == np.arange(request.n_slots)[:, None, None]).all():
        return known
    for each in request.variables:
        if each.is_per_cell and each.dims[0] == SLOT:
            index = source.reshape(source.shape[0], *(1,) * (len(each.dims) - 3), *source.shape[1:])
            values[each.name] = np.take_along_axis(values[each.name], index, 0)
    return write_tile(request, path, tile, values)


def _source_slots(
    request: SurveyRequest, place: Place, tile: Tile, blocks: Sequence[FamilyBlock], values: TileArrays
) -> np.ndarray:
    """Return for each slot of a tile its source: the slot whose present content must move into it.

    The source of a slot into which no attractor must move is an empty slot.

    Returns
    -------
    np.ndarray
        Shape (slots, m, n); in each cell a permutation of the slots.
    """
    cells = CellRectangle(tile.epsilon.start, tile.epsilon.stop, tile.delta.start, tile.delta.stop)
    target = read_target_slots(request, place, cells, blocks).reshape(request.n_slots, -1)
    found = attractors_in_slots(values, request.initial_conditions.count)
    cell = found.attractors.cell
    source = np.full(target.shape, -1, np.int8)
    source[target[ranks_within_cells(cell), cell], cell] = found.slot
    return complete_slot_sources(source.reshape(request.n_slots, cells.bottom - cells.top, -1))
