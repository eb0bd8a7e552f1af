"""The tasks that join a survey's attractors to families. Each task handles one block of cells.

The result of a task follows from its arguments and the contents of tiles, so a task may be repeated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import zarr
from zarr.abc.buffer import Buffer
from zarr.storage import MemoryStore

from gear_rattle.workers.boundaries.edges import ComponentEdges, find_edges_in_part
from gear_rattle.workers.families.blocks import (
    COMPONENTS,
    TARGETS,
    FamilyBlock,
    are_cells_in_rectangle,
    extend_by_rim,
    ranks_within_cells,
    read_attractors,
    read_components,
    renumber_cells_in_grid,
    renumber_cells_in_rectangle,
)
from gear_rattle.workers.storage.location import Place, place_of
from gear_rattle.workers.survey.crossings import CurveCrossings
from gear_rattle.workers.survey.manifest import digest
from gear_rattle.workers.survey.request import SurveyRequest
from gear_rattle.workers.survey.stored_families import ListedAttractors, assign_slots_in_cells, create_family_array
from rattle import Attractors
from rattle.families import (
    NO_FAMILY,
    QUIET_FAMILY,
    CellRectangle,
    ComponentSums,
    argsort_attractors,
    concat_tables,
    connect_attractors,
    continue_into_piece,
    sum_over_components,
)
from rattle.numerics import StructOfArrays

POSITIONS = 1 << 16  # larger than the number of attractors of any cell, so that `BorderAttractors.key` is unique


@dataclass(frozen=True, eq=False)
class BorderAttractors(StructOfArrays):
    """Attractors (k,) at the border of a block, inside the block or just outside.

    cell: the cell of each attractor. place: how many attractors of the same cell precede the attractor. component: the
    number of the connected part of a family to which the attractor belongs.
    """

    cell: np.ndarray
    place: np.ndarray
    component: np.ndarray

    @property
    def key(self) -> np.ndarray:
        """A number for each attractor, computed from `cell` and `place`. No two attractors have the same number."""
        found: np.ndarray = self.cell * POSITIONS + self.place
        return found


class BlockComponents(NamedTuple):
    """The components (connected parts of families) of a block.

    n_components: how many components the block has; component 0 is quiet running. first_border: the attractors in the
    block's first row and first column. outer_border: the attractors in the cells just after the block's last row and
    column that belong to a component of the block. components_of_continued: the component of each orbit that was
    continued into the block.
    """

    n_components: int
    first_border: BorderAttractors
    outer_border: BorderAttractors
    components_of_continued: np.ndarray


class BlockSummary(NamedTuple):
    """Summary of the components (connected parts of families) in a block.

    sums: properties of the components in this block, to be added up over all blocks. edges: the edges of the components
    (see `ComponentEdges`). component_pairs (k, 2): in each row the numbers of two components that are in slots of the
    same cell.
    """

    sums: ComponentSums
    edges: ComponentEdges
    component_pairs: np.ndarray


def continue_orbits_into_block(
    request: SurveyRequest, path: str, block: FamilyBlock, entered: Attractors, beside: Attractors | None
) -> Attractors:
    """Continue orbits into the cells of a block, from cell to cell.

    entered: the orbits that earlier calls continued into the block. beside: the orbits in the cells around the block
    that are new since the last call; None for the first call, which continues all attractors of the block and of the
    cells around it.

    Returns
    -------
    Attractors
        The new orbits in the block; their cells are numbered in the grid.
    """
    columns = request.shape[1]
    cells, frame, tried = block.cells, extend_by_rim(block.cells, request.shape), beside is not None
    table = read_attractors(request, place_of(path), cells if tried else frame, block.along).attractors
    inside = are_cells_in_rectangle(table.cell, cells, columns)
    beside = beside or table.take(~inside)
    table = concat_tables(table.take(inside), entered)
    order = argsort_attractors(table)
    tables = table.take(order), beside
    here, there = (renumber_cells_in_rectangle(each, frame, columns) for each in tables)
    top, left = frame.top, frame.left
    piece = CellRectangle(cells.top - top, cells.bottom - top, cells.left - left, cells.right - left)
    new = continue_into_piece(here, there, tried, frame.right - left, piece, _kernel_cells(request, frame))
    return renumber_cells_in_grid(new, frame, columns)


def connect_attractors_of_block(
    request: SurveyRequest, path: str, block: FamilyBlock, entered: Attractors, beside: Attractors
) -> BlockComponents:
    """Connect the attractors of a block with each other, and with attractors just after its last row and column.

    entered: the orbits that were continued into the block. beside: the orbits that were continued into the cells after
    the block's last row and column. A temporary file gets the number of each attractor's component.

    Returns
    -------
    BlockComponents
        The components of the block, and their connections to other blocks.
    """
    place, columns = place_of(path), request.shape[1]
    frame = extend_by_rim(block.cells, request.shape, before=0)
    found = read_attractors(request, place, frame, block.along).attractors
    n = found.cell.size
    table = concat_tables(found, entered, beside)
    order = argsort_attractors(table)
    table = table.take(order)
    shape = frame.bottom - frame.top, frame.right - frame.left
    component = connect_attractors(
        renumber_cells_in_rectangle(table, frame, columns), shape, _kernel_cells(request, frame)
    )
    inside, where = are_cells_in_rectangle(table.cell, block.cells, columns), ranks_within_cells(table.cell)
    mine = np.unique(component[inside & (component > QUIET_FAMILY)])
    numbers = np.full(int(component.max(initial=QUIET_FAMILY)) + 2, NO_FAMILY)  # the last entry is for component −1
    numbers[QUIET_FAMILY], numbers[mine] = QUIET_FAMILY, 1 + np.arange(mine.size)
    component = numbers[component]
    place.put(block.temporary_key(COMPONENTS), component[inside].astype(np.int32).tobytes())
    row, column = np.divmod(table.cell, columns)
    first = inside & ((row == block.cells.top) | (column == block.cells.left))
    beyond = ~inside & (component > QUIET_FAMILY)
    on_first, on_beyond = (BorderAttractors(table.cell[of], where[of], component[of]) for of in (first, beyond))
    given = np.empty_like(component)
    given[order] = component
    return BlockComponents(1 + mine.size, on_first, on_beyond, given[n : n + entered.cell.size])


def summarize_block(
    request: SurveyRequest,
    path: str,
    block: FamilyBlock,
    entered: Attractors,
    component: np.ndarray,
    beyond: BorderAttractors,
    crossings: Sequence[CurveCrossings],
) -> BlockSummary:
    """Summarize the survey's components in a block.

    Parameters
    ----------
    entered : Attractors
        The orbits that were continued into the block.
    component : np.ndarray
        Entry i is the number of the survey's component to which the block's component i belongs; the last entry is for
        component −1 (undecided samples).
    beyond : BorderAttractors
        The attractors in the cells after the block's last row and column.
    crossings : Sequence[CurveCrossings]
        For each curve, the pairs of cells of the block between which the curve passes.

    Returns
    -------
    BlockSummary
        The sums, the edges, and the pairs of components that share a cell.
    """
    place = place_of(path)
    found = read_attractors(request, place, block.cells, block.along)
    table, of, is_listed = _attractors_of_block(place, block, found, entered)
    of, columns = component[of], request.shape[1]
    cell, each = np.append(table.cell, beyond.cell), np.append(of, beyond.component)
    edges = find_edges_in_part(block.cells, columns, cell, each, crossings)
    pairs = _component_pairs_in_cells(table.cell[is_listed], of[is_listed])
    return BlockSummary(sum_over_components(table, of, columns), edges, pairs)


def write_families(
    request: SurveyRequest, path: str, block: FamilyBlock, entered: Attractors, family: np.ndarray, slot: np.ndarray
) -> str:
    """Write the family numbers of a block to the store, and the slots of its attractors to a temporary file.

    entered: the orbits that were continued into the block. family: the family of each component of the block; the last
    entry is for component −1 (undecided samples). slot: for each component, the one slot that its family has in all
    cells; −1 if there is no such slot.

    Returns
    -------
    str
        Digest of the written chunk.
    """
    place, cells = place_of(path), block.cells
    found = read_attractors(request, place, cells, block.along)
    _table, component, is_listed = _attractors_of_block(place, block, found, entered)
    component = component[is_listed]
    cell, here = renumber_cells_in_rectangle(found.attractors, cells, request.shape[1]).cell, family[component]
    target = assign_slots_in_cells(here, cell, slot[component]) if request.slots_follow_families else found.slot
    shape = request.n_slots, cells.bottom - cells.top, cells.right - cells.left
    numbers = np.full((request.n_slots, shape[1] * shape[2]), NO_FAMILY, np.int32)
    targets = np.full(numbers.shape, -1, np.int8)
    numbers[target, cell], targets[ranks_within_cells(cell), cell] = here, target
    place.put(block.temporary_key(TARGETS), targets.tobytes())
    kept: dict[str, Buffer] = {}
    array = create_family_array(zarr.create_group(MemoryStore(kept), zarr_format=3), request, block.cells_per_side)
    array[:, cells.top : cells.bottom, cells.left : cells.right] = numbers.reshape(shape)
    # The array in memory has no third axis, so its chunk has another key than the chunk in the store, but the same
    # bytes.
    content = kept[replace(block, along=()).chunk_key].to_bytes()
    place.put(block.chunk_key, content)
    return digest(content)


def _kernel_cells(request: SurveyRequest, cells: CellRectangle) -> object:
    """Return the parameters of the cells of a rectangle of the grid as the record that compiled code takes."""
    delta, epsilon = request.delta.values(), request.epsilon.values()
    return request.gear_model.cells(delta[cells.left : cells.right], epsilon[cells.top : cells.bottom])


def _attractors_of_block(
    place: Place, block: FamilyBlock, found: ListedAttractors, entered: Attractors
) -> tuple[Attractors, np.ndarray, np.ndarray]:
    """Return the listed and the continued attractors of a block, sorted by cell.

    Returns
    -------
    tuple[Attractors, np.ndarray, np.ndarray]
        The attractors; for each attractor the number of its component in the block, and whether a slot lists it.
    """
    table = concat_tables(found.attractors, entered)
    order = argsort_attractors(table)
    listed = order < found.attractors.cell.size
    return table.take(order), read_components(place, block), listed


def _component_pairs_in_cells(cell: np.ndarray, component: np.ndarray) -> np.ndarray:
    """Return each pair (k, 2) of different components that occur in the same cell once, the smaller number first."""
    found = [np.zeros((0, 2), np.int64)]
    for apart in range(1, int(np.bincount(np.unique(cell, return_inverse=True)[1]).max(initial=0))):
        same = cell[apart:] == cell[:-apart]
        pairs = np.column_stack([component[:-apart][same], component[apart:][same]])
        pairs = np.sort(pairs[(pairs[:, 0] != pairs[:, 1]) & (pairs >= 0).all(axis=1)], axis=1)
        found.append(np.unique(pairs, axis=0))
    return np.unique(np.concatenate(found), axis=0)
