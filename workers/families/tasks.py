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

from gear_rattle.workers.boundaries.edges import FamilyEnds, ends_in
from gear_rattle.workers.families.blocks import (
    COMPONENTS,
    TARGETS,
    Block,
    attractors_in,
    numbered_in,
    numbered_over,
    place_in_cell,
    read_components,
    with_rim,
    within,
)
from gear_rattle.workers.storage.location import Place, place_of
from gear_rattle.workers.survey.crossings import Crossings
from gear_rattle.workers.survey.families import ListedAttractors, create_family_array, slots_in_cells
from gear_rattle.workers.survey.manifest import digest
from gear_rattle.workers.survey.request import SurveyRequest
from rattle import Attractors
from rattle.families import NO_FAMILY, QUIET_FAMILY, Rectangle, Sums, connected, entering, in_order, sums_of, together
from rattle.numerics import StructOfArrays

PLACES = 1 << 16  # larger than the number of attractors of any cell


@dataclass(frozen=True, eq=False)
class Border(StructOfArrays):
    """The attractors (k,) on the border of a block.

    cell: the cell of each attractor. place: its position among the attractors of the cell. component: the number of the
    connected part of a family to which it belongs.
    """

    cell: np.ndarray
    place: np.ndarray
    component: np.ndarray

    @property
    def key(self) -> np.ndarray:
        """A number for each attractor, which follows from cell and place and differs for different attractors."""
        found: np.ndarray = self.cell * PLACES + self.place
        return found


class Connected(NamedTuple):
    """The components (connected parts of families) of a block.

    number: how many components there are; component 0 is quiet running. first: the attractors in the block's first row
    and column. beyond: those attractors in the cells after the block's last row and column that are connected with a
    component of the block. entered: the component of each orbit that was continued into the block.
    """

    number: int
    first: Border
    beyond: Border
    entered: np.ndarray


class Told(NamedTuple):
    """Summary of the components in a block: their sums, their edges, and the pairs that occur in the same cell."""

    sums: Sums
    ends: FamilyEnds
    pairs: np.ndarray


def enter_block(
    request: SurveyRequest, path: str, block: Block, entered: Attractors, beside: Attractors | None
) -> Attractors:
    """Continue orbits into the cells of a block, from cell to cell.

    entered: the orbits that were continued into the block before. beside: the orbits in the cells around the block that
    are new since the last call; None: continue all attractors of the block and of the cells around it.

    Returns
    -------
    Attractors
        The new orbits in the block; their cells are numbered in the grid.
    """
    columns = request.shape[1]
    cells, frame, tried = block.cells, with_rim(block.cells, request.shape), beside is not None
    table = attractors_in(request, place_of(path), cells if tried else frame, block.along).attractors
    inside = within(table.cell, cells, columns)
    beside = beside or table.take(~inside)
    table = together(table.take(inside), entered)
    order = in_order(table)
    tables = table.take(order), beside
    here, there = (numbered_in(each, frame, columns) for each in tables)
    top, left = frame.top, frame.left
    piece = Rectangle(cells.top - top, cells.bottom - top, cells.left - left, cells.right - left)
    new = entering(here, there, tried, frame.right - left, piece, _cells(request, frame))
    return numbered_over(new, frame, columns)


def connect_block(
    request: SurveyRequest, path: str, block: Block, entered: Attractors, beside: Attractors
) -> Connected:
    """Connect the attractors of a block with each other, and with attractors just after its last row and column.

    entered: the orbits that were continued into the block. beside: the orbits that were continued into the cells after
    its last row and column. The component of each attractor is written to a temporary file.

    Returns
    -------
    Connected
        The components of the block, and their connections to other blocks.
    """
    place, columns = place_of(path), request.shape[1]
    frame = with_rim(block.cells, request.shape, before=0)
    found = attractors_in(request, place, frame, block.along).attractors
    n = found.cell.size
    table = together(found, entered, beside)
    order = in_order(table)
    table = table.take(order)
    shape = frame.bottom - frame.top, frame.right - frame.left
    component = connected(numbered_in(table, frame, columns), shape, _cells(request, frame))
    inside, where = within(table.cell, block.cells, columns), place_in_cell(table.cell)
    mine = np.unique(component[inside & (component > QUIET_FAMILY)])
    numbers = np.full(int(component.max(initial=QUIET_FAMILY)) + 2, NO_FAMILY)  # the last entry is for component −1
    numbers[QUIET_FAMILY], numbers[mine] = QUIET_FAMILY, 1 + np.arange(mine.size)
    component = numbers[component]
    place.put(block.kept(COMPONENTS), component[inside].astype(np.int32).tobytes())
    row, column = np.divmod(table.cell, columns)
    first = inside & ((row == block.cells.top) | (column == block.cells.left))
    beyond = ~inside & (component > QUIET_FAMILY)
    on_first, on_beyond = (Border(table.cell[of], where[of], component[of]) for of in (first, beyond))
    given = np.empty_like(component)
    given[order] = component
    return Connected(1 + mine.size, on_first, on_beyond, given[n : n + entered.cell.size])


def tell_block(
    request: SurveyRequest,
    path: str,
    block: Block,
    entered: Attractors,
    component: np.ndarray,
    beyond: Border,
    crossings: Sequence[Crossings],
) -> Told:
    """Summarize the survey's components in a block.

    Parameters
    ----------
    entered : Attractors
        The orbits that were continued into the block.
    component : np.ndarray
        For each component of the block the number of the survey's component; the last entry is for component −1.
    beyond : Border
        The attractors in the cells after the block's last row and column.
    crossings : Sequence[Crossings]
        For each curve, where it passes between cells of the block.

    Returns
    -------
    Told
        Sums, edges, and pairs of components that share a cell.
    """
    place = place_of(path)
    found = attractors_in(request, place, block.cells, block.along)
    table, of, is_listed = _known(place, block, found, entered)
    of, columns = component[of], request.shape[1]
    cell, each = np.append(table.cell, beyond.cell), np.append(of, beyond.component)
    ends = ends_in(block.cells, columns, cell, each, crossings)
    pairs = _pairs(table.cell[is_listed], of[is_listed])
    return Told(sums_of(table, of, columns), ends, pairs)


def write_families(
    request: SurveyRequest, path: str, block: Block, entered: Attractors, family: np.ndarray, slot: np.ndarray
) -> str:
    """Write the family numbers of a block to the store, and the slots of its attractors to a temporary file.

    entered: the orbits that were continued into the block. family: the family of each component of the block; the last
    entry is for component −1. slot: the slot of each component's family in all cells, −1 if it has none.

    Returns
    -------
    str
        Digest of the written chunk.
    """
    place, cells = place_of(path), block.cells
    found = attractors_in(request, place, cells, block.along)
    _table, component, is_listed = _known(place, block, found, entered)
    component = component[is_listed]
    cell, here = numbered_in(found.attractors, cells, request.shape[1]).cell, family[component]
    target = slots_in_cells(here, cell, slot[component]) if request.slots_follow_families else found.slot
    shape = request.n_slots, cells.bottom - cells.top, cells.right - cells.left
    numbers = np.full((request.n_slots, shape[1] * shape[2]), NO_FAMILY, np.int32)
    targets = np.full(numbers.shape, -1, np.int8)
    numbers[target, cell], targets[place_in_cell(cell), cell] = here, target
    place.put(block.kept(TARGETS), targets.tobytes())
    kept: dict[str, Buffer] = {}
    array = create_family_array(zarr.create_group(MemoryStore(kept), zarr_format=3), request, block.side)
    array[:, cells.top : cells.bottom, cells.left : cells.right] = numbers.reshape(shape)
    content = kept[replace(block, along=()).chunk].to_bytes()  # a third axis of length 1 changes no byte of a chunk
    place.put(block.chunk, content)
    return digest(content)


def _cells(request: SurveyRequest, cells: Rectangle) -> object:
    delta, epsilon = request.delta.values(), request.epsilon.values()
    return request.gear_model.cells(delta[cells.left : cells.right], epsilon[cells.top : cells.bottom])


def _known(
    place: Place, block: Block, found: ListedAttractors, entered: Attractors
) -> tuple[Attractors, np.ndarray, np.ndarray]:
    """Return the attractors of a block, both listed and continued ones, sorted by cell.

    Returns
    -------
    tuple[Attractors, np.ndarray, np.ndarray]
        The attractors, the component of each in the block, and whether a tile lists it.
    """
    table = together(found.attractors, entered)
    order = in_order(table)
    listed = order < found.attractors.cell.size
    return table.take(order), read_components(place, block), listed


def _pairs(cell: np.ndarray, component: np.ndarray) -> np.ndarray:
    """Return the sorted pairs (k, 2) of components that occur in the same cell, the smaller number first."""
    found = [np.zeros((0, 2), np.int64)]
    for apart in range(1, int(np.bincount(np.unique(cell, return_inverse=True)[1]).max(initial=0))):
        same = cell[apart:] == cell[:-apart]
        pairs = np.column_stack([component[:-apart][same], component[apart:][same]])
        pairs = np.sort(pairs[(pairs[:, 0] != pairs[:, 1]) & (pairs >= 0).all(axis=1)], axis=1)
        found.append(np.unique(pairs, axis=0))
    return np.unique(np.concatenate(found), axis=0)
