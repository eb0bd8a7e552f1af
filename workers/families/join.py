"""Join the attractors of a survey to families after all tiles. A task handles one block, in this process or by dask."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import islice, pairwise, product
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import zarr

from gear_rattle.workers.boundaries.edges import FamilyEdges, count_edges
from gear_rattle.workers.errors import report_damage, storage_error
from gear_rattle.workers.families.blocks import (
    COMPONENTS,
    TARGETS,
    FamilyBlock,
    are_cells_in_rectangle,
    blocks_of_grid,
    extend_by_rim,
)
from gear_rattle.workers.families.move import move_attractors_to_slots
from gear_rattle.workers.families.tasks import (
    BlockComponents,
    BlockSummary,
    BorderAttractors,
    connect_attractors_of_block,
    continue_orbits_into_block,
    summarize_block,
    write_families,
)
from gear_rattle.workers.storage.added import RunForEach, run_in_this_process
from gear_rattle.workers.storage.location import Place, place_of
from gear_rattle.workers.storage.manifest import read_required_manifest, tile_recorder
from gear_rattle.workers.storage.store import add_to_store, has_added_node
from gear_rattle.workers.survey.crossings import CurveCrossings, Polyline, find_curve_crossings
from gear_rattle.workers.survey.manifest import group_path
from gear_rattle.workers.survey.request import Along, SurveyRequest
from gear_rattle.workers.survey.stored_families import (
    FAMILY,
    JoinedFamilies,
    assign_slots_to_families,
    files_of_families,
)
from gear_rattle.workers.survey.tiles import Tile, tiles_of_slice
from gear_rattle.workers.survey.values.schema import Group
from rattle import Attractors
from rattle.families import (
    NO_FAMILY,
    QUIET_FAMILY,
    argsort_attractors,
    assign_family_numbers,
    concat_tables,
    merge_component_sums,
    no_attractors,
    tabulate_families,
)

#: Names of a stored curve's variables: δ and ε of its points, and for each point the number of the curve's piece.
CURVE_POINTS = ("point_delta", "point_epsilon", "piece")

Rows = TypeVar("Rows", Attractors, BorderAttractors)


def lacks_families(request: SurveyRequest, where: str | Path | Place) -> bool:
    """Return whether a survey, whose tiles are all computed, requests families and does not have them yet."""
    return Group.FAMILIES in request.quantities and not has_added_node(where, FAMILY)


def join_attractors_of_survey(
    request: SurveyRequest, where: str | Path | Place, each: RunForEach = run_in_this_process, at_once: int = 1
) -> None:
    """Join the attractors of a survey whose tiles are all computed, slice by slice, and store their families.

    The caller must hold the lock of the store. The result depends on the cells alone, and not on the shape or order of
    tiles. If the process is killed, the survey has no families, and the next call joins it from the beginning.

    Parameters
    ----------
    each : RunForEach
        Function that runs a task for each block or tile, in this process or on a cluster.
    at_once : int
        Number of tiles in a group; the attractors of a group of tiles are moved to their slots at the same time.

    Raises
    ------
    SurveyError
        There is no survey, or it is damaged.
    StorageError
        The store cannot be written now.
    """
    place = place_of(where)
    joins = [_FamilyJoiner(request, place, each, at_once, along) for along in request.slices]
    try:
        found = {join.along: join.run() for join in joins}
        files = files_of_families(
            request, joins[0].blocks[0].cells_per_side, {along: x[:2] for along, x in found.items()}
        )
        add_to_store(place, files, {key: of for _, _, chunks in found.values() for key, of in chunks.items()})
        place.remove(
            [block.temporary_key(what) for join in joins for block in join.blocks for what in (COMPONENTS, TARGETS)]
        )
    except OSError as error:
        refusal = storage_error(f"the families of {place} cannot be written", error)
        raise refusal from error


class _FamilyJoiner:
    """Computation that joins the attractors of one slice to families.

    It keeps only a summary and the border of each block in memory.
    """

    def __init__(self, survey: SurveyRequest, place: Place, each: RunForEach, at_once: int, along: Along) -> None:
        self.along, self._survey, self._request = along, survey, survey.slice_request(along)
        self._place, self._each, self._at_once = place, each, at_once
        self._columns = survey.shape[1]
        self.blocks = blocks_of_grid(self._request, along)
        self._number = {(block.row, block.column): i for i, block in enumerate(self.blocks)}

    def run(self) -> tuple[JoinedFamilies, FamilyEdges, dict[str, str]]:
        """Join the slice and write the family numbers of its cells.

        Returns
        -------
        tuple[JoinedFamilies, FamilyEdges, dict[str, str]]
            The families, their edges, and the digests of the written chunks by key.
        """
        curves = _read_curves(self._request, self._place, self.along)
        entered = self._continue_into_blocks()
        parts: list[BlockComponents] = self._run_on_blocks(
            connect_attractors_of_block, zip(entered, self._attractors_beyond_blocks(entered), strict=True)
        )
        component = self._connect_components(parts)
        summaries = self._summarize_blocks(entered, parts, component, curves)
        sums = merge_component_sums(each.sums for each in summaries)
        family = assign_family_numbers(sums)
        delta, epsilon = self._request.delta.values(), self._request.epsilon.values()
        table = tabulate_families(delta, epsilon, self._request.initial_conditions.count, sums)
        slots = self._slots_of_families(summaries, family, table.cells.size)
        chunks = self._write_families(entered, [family[each] for each in component], slots)
        orbits = concat_tables(*entered)
        order = argsort_attractors(orbits)
        numbers = np.concatenate(
            [family[of[part.components_of_continued]] for of, part in zip(component, parts, strict=True)]
        )
        joined = JoinedFamilies(table, orbits.take(order), numbers[order], self._columns)
        edges = count_edges((each.edges for each in summaries), family, table, list(curves))
        return joined, edges, chunks

    def _run_on_blocks(self, task: Callable[..., Any], arguments: Iterable[tuple[Any, ...]]) -> list[Any]:
        """Run a task for each block, with the block's entry of `arguments`; return the results in the same order."""
        items = [(block, *more) for block, more in zip(self.blocks, arguments, strict=True)]
        return self._each(task, self._request, str(self._place), items)

    def _nearby_blocks(self, block: FamilyBlock) -> list[int]:
        """Return the indices of a block and of the blocks around it."""
        steps = product((-1, 0, 1), repeat=2)
        found = (self._number.get((block.row + i, block.column + j)) for i, j in steps)
        return [i for i in found if i is not None]

    def _attractors_around_block(self, block: FamilyBlock, tables: Sequence[Rows], before: int = 1) -> Rows:
        """Return the attractors in the cells that touch a block from outside, from the tables of the blocks around it.

        tables: a table of attractors for each block. before: 1 for the cells on all sides of the block, 0 for only the
        cells just after its last row and column.

        Returns
        -------
        Rows
            A table of the same type as `tables`.
        """
        frame = extend_by_rim(block.cells, self._request.shape, before)
        near = [tables[i] for i in self._nearby_blocks(block)]
        rim = [
            are_cells_in_rectangle(table.cell, frame, self._columns)
            & ~are_cells_in_rectangle(table.cell, block.cells, self._columns)
            for table in near
        ]
        return type(near[0]).concat([table.take(at) for table, at in zip(near, rim, strict=True)])

    def _blocks_of_tile(self, tile: Tile) -> list[FamilyBlock]:
        """Return the blocks that cover a tile."""
        side = self.blocks[0].cells_per_side
        rows, columns = (range(span.start // side, (span.stop - 1) // side + 1) for span in tile.spans)
        return [self.blocks[self._number[at]] for at in product(rows, columns)]

    def _attractors_beyond_blocks(self, tables: Sequence[Rows]) -> list[Rows]:
        """Return for each block the attractors in the cells just after the block's last row and column of cells."""
        return [self._attractors_around_block(block, tables, before=0) for block in self.blocks]

    def _continue_into_blocks(self) -> list[Attractors]:
        """Continue orbits into each block from its neighbours, in rounds, until no block gets a new orbit.

        Returns
        -------
        list[Attractors]
            The continued orbits of each block.
        """
        nothing = no_attractors()
        new: list[Attractors] = self._run_on_blocks(continue_orbits_into_block, [(nothing, None)] * len(self.blocks))
        entered = list(new)
        while True:
            beside = [self._attractors_around_block(block, new) for block in self.blocks]
            again = [i for i, each in enumerate(beside) if each.cell.size]
            if not again:
                return entered
            items = [(self.blocks[i], entered[i], beside[i]) for i in again]
            new = [nothing] * len(self.blocks)
            for i, found in zip(
                again, self._each(continue_orbits_into_block, self._request, str(self._place), items), strict=True
            ):
                new[i], entered[i] = found, concat_tables(entered[i], found)

    def _connect_components(self, parts: Sequence[BlockComponents]) -> list[np.ndarray]:
        """Connect the components of all blocks to components of the survey.

        Parameters
        ----------
        parts : Sequence[BlockComponents]
            The components of each block.

        Returns
        -------
        list[np.ndarray]
            One array for each block. Entry i is the number of the survey's component to which the block's component i
            belongs. The last entry is NO_FAMILY, so that component −1 (undecided samples) has no family.
        """
        from scipy.sparse import coo_array  # imported here: loading it takes an eighth of a second
        from scipy.sparse.csgraph import connected_components

        begin = np.cumsum([0, *(part.n_components for part in parts)])
        first = _concatenate_borders([part.first_border for part in parts], begin)
        beyond = _concatenate_borders([part.outer_border for part in parts], begin)
        order = np.argsort(first.key)
        other = first.component[order[np.searchsorted(first.key[order], beyond.key)]]
        graph = coo_array((np.ones(other.size, np.int8), (beyond.component, other)), (int(begin[-1]),) * 2)
        component = 1 + connected_components(graph, directed=False)[1].astype(np.int64)
        component[begin[:-1]] = QUIET_FAMILY
        return [np.append(component[i:j], NO_FAMILY) for i, j in pairwise(begin)]

    def _summarize_blocks(
        self,
        entered: Sequence[Attractors],
        parts: Sequence[BlockComponents],
        component: Sequence[np.ndarray],
        curves: Mapping[str, Polyline],
    ) -> list[BlockSummary]:
        """Summarize the survey's components (connected parts of families) in each block.

        Returns
        -------
        list[BlockSummary]
            For each block its components' sums (see `ComponentSums`) and edges (pairs of neighbouring cells of which
            exactly one has the component), and the pairs of components that share a cell.
        """
        delta, epsilon = self._request.delta.values(), self._request.epsilon.values()
        crossings = [find_curve_crossings(curve, delta, epsilon) for curve in curves.values()]
        passed = [
            [
                CurveCrossings._make(x[are_cells_in_rectangle(x, block.cells, self._columns)] for x in each)
                for each in crossings
            ]
            for block in self.blocks
        ]
        first = [
            part.first_border.replace(component=of[part.first_border.component])
            for part, of in zip(parts, component, strict=True)
        ]
        return self._run_on_blocks(
            summarize_block, zip(entered, component, self._attractors_beyond_blocks(first), passed, strict=True)
        )

    def _slots_of_families(self, summaries: Sequence[BlockSummary], family: np.ndarray, families: int) -> np.ndarray:
        """Assign to each family one slot for all its cells.

        Returns
        -------
        np.ndarray
            Shape (families + 1,), int8: the slot of each family, −1 if no slot is free in all its cells. The last entry
            is −1, for NO_FAMILY. If the survey's slots do not follow families, all entries are −1.
        """
        if not self._request.slots_follow_families:
            return np.full(families + 1, -1, np.int8)
        pairs = np.unique(np.sort(np.concatenate([family[each.component_pairs] for each in summaries]), axis=1), axis=0)
        return np.append(assign_slots_to_families(pairs, families, self._request.n_slots), np.int8(-1))

    def _write_families(
        self, entered: Sequence[Attractors], family: Sequence[np.ndarray], slots: np.ndarray
    ) -> dict[str, str]:
        """Write all family numbers, move attractors if slots follow families, and return the digests of the chunks."""
        found = self._run_on_blocks(
            write_families, ((orbits, of, slots[of]) for orbits, of in zip(entered, family, strict=True))
        )
        if self._request.slots_follow_families:
            self._move_attractors_of_tiles()
        return {block.chunk_key: digest for block, digest in zip(self.blocks, found, strict=True)}

    def _move_attractors_of_tiles(self) -> None:
        """Move the attractors of all tiles to their slots.

        If an earlier run rewrote a tile but was killed before it recorded the tile, the tile counts as damaged, and is
        computed again.
        """
        known, tiles = read_required_manifest(self._place), iter(tiles_of_slice(self._survey, self.along))
        with tile_recorder(self._place) as record_tiles:
            while some := list(islice(tiles, self._at_once)):
                items = [(tile, self._blocks_of_tile(tile), known.digests_of_tile(tile.index)) for tile in some]
                moved = self._each(move_attractors_to_slots, self._survey, str(self._place), items)
                record_tiles({tile.index: files for tile, files in zip(some, moved, strict=True)})


def _concatenate_borders(borders: Sequence[BorderAttractors], begin: np.ndarray) -> BorderAttractors:
    """Concatenate the borders of all blocks. The numbers of block i's components are raised by begin[i]."""
    found = BorderAttractors.concat(list(borders))
    return found.replace(component=found.component + np.repeat(begin[:-1], [each.cell.size for each in borders]))


def _read_curves(request: SurveyRequest, place: Place, along: Along) -> dict[str, Polyline]:
    """Read the bifurcation curves of a slice from the store. Return {name of a curve: its points}."""
    found: dict[str, Polyline] = {}
    with report_damage(f"the curves of {place}"):
        for name in request.gear_model.curve_names:
            delta, epsilon, piece = (
                np.asarray(zarr.open_array(place.zarr(), path=group_path(along, f"curves/{name}/{each}"), mode="r")[:])
                for each in CURVE_POINTS
            )
            found[name] = delta, epsilon, piece
    return found
