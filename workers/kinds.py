"""Functions for surveys and populations alike. The type of the request decides which code handles tiles and stores."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from types import ModuleType
from typing import Any

import zarr
from zarr.abc.buffer import Buffer

import rattle
from gear_rattle.workers.errors import StorageError, SurveyError, storage_error
from gear_rattle.workers.populations import template as population_template
from gear_rattle.workers.populations import tiles as population_tiles
from gear_rattle.workers.populations.request import PopulationRequest
from gear_rattle.workers.populations.tiles import GearTile
from gear_rattle.workers.survey import template as survey_template
from gear_rattle.workers.survey import tiles as survey_tiles
from gear_rattle.workers.survey.request import SurveyRequest
from gear_rattle.workers.survey.template import Template
from gear_rattle.workers.survey.tiles import CellOutcome, Tile, TileArrays, TileRecord
from gear_rattle.workers.survey.values.schema import OPTIONAL, SAMPLED

AnyRequest = SurveyRequest | PopulationRequest
AnyTile = Tile | GearTile


def parse_request_document(document: Any) -> AnyRequest:
    """Return the request that a job or a store keeps as JSON. Raises ValidationError. document: the decoded JSON."""
    kind = PopulationRequest if isinstance(document, dict) and "gear" in document else SurveyRequest
    return kind.model_validate(document)


def tiles_of(request: AnyRequest) -> list[Any]:
    """Return the tiles that cover all cells, in the order of their index."""
    found: list[Any] = _tile_module(request).tiles_of(request)
    return found


def compile_kernels_for_request(request: AnyRequest) -> None:
    """Compile the kernels that the tiles of a request need, unless the cache already has these kernels."""
    if SAMPLED & set(request.quantities) or isinstance(request, PopulationRequest):
        by_request = bool(OPTIONAL.intersection(request.quantities))
        rattle.precompile(preload=False, optional=by_request, **request.added_parameter_values)


def compute_tile(
    request: AnyRequest, tile: AnyTile, outcomes: Iterable[CellOutcome] | None = None
) -> tuple[TileArrays, TileRecord]:
    """Compute every variable of a tile. The result is a pure function of the request and the tile's cells.

    Parameters
    ----------
    outcomes : Iterable[CellOutcome] | None
        The outcomes of the cells in their order, if they are computed elsewhere; None to compute them here.

    Returns
    -------
    tuple[TileArrays, TileRecord]
        The arrays of the tile by variable, and its record.
    """
    compile_kernels_for_request(request)
    found: tuple[TileArrays, TileRecord] = _tile_module(request).compute_tile(request, tile, outcomes)
    return found


def evaluate_cells_one_by_one(
    request: AnyRequest, tile: AnyTile, first: int = 0, failing: tuple[type[Exception], ...] = ()
) -> Iterator[CellOutcome]:
    """Evaluate each cell of a tile alone, so that a failing cell does not affect the others.

    first: the number of the first cell to evaluate. An error of the model fails only the cell in which it occurs. An
    error of the computer, such as MemoryError, is raised, unless its type is in `failing`; then only the cell fails.

    Returns
    -------
    Iterator[CellOutcome]
        A cell's values, or the message of its failure, for each cell in order.
    """
    compile_kernels_for_request(request)
    found: Iterator[CellOutcome] = _tile_module(request).evaluate_cells_one_by_one(request, tile, first, failing)
    return found


def template_of(request: AnyRequest, created: str | None = None) -> Template:
    """Return the files that a store has before its first tile. created: the date of creation; None: now."""
    found: Template = _template_module(request).template_of(request, created)
    return found


def create_empty_arrays(request: AnyRequest) -> tuple[dict[str, Buffer], dict[str, zarr.Array], dict[str, str]]:
    """Create a store's per-cell arrays in memory, without values. Writing a tile to them encodes its chunks.

    Returns
    -------
    tuple[dict[str, Buffer], dict[str, zarr.Array], dict[str, str]]
        The files in memory by key, the arrays by variable, and the patterns of chunk keys by variable.
    """
    found: tuple[dict[str, Buffer], dict[str, zarr.Array], dict[str, str]] = _template_module(
        request
    ).create_empty_arrays(request)
    return found


def tile_name(request: AnyRequest, tile: AnyTile) -> str:
    """Return the name of a tile for messages: its number, and the cells or gears that it has."""
    return str(_tile_module(request).tile_name(request, tile))


def position_of_failed_cell(request: AnyRequest, i: int, j: int) -> dict[str, int]:
    """Return the position of a failed cell: {axis: index} of a survey's cell, or {"gear": row} in a population.

    i: row of the cell, counted through all slices; ignored in a population. j: column of the cell, or row of the gear.

    Returns
    -------
    dict[str, int]
        Indices from 0.
    """
    if isinstance(request, PopulationRequest):
        return {"gear": j}
    along, i = divmod(i, request.shape[0])
    return {**dict.fromkeys(request.third_axis, along), "epsilon": i, "delta": j}


def tile_error(request: AnyRequest, tile: AnyTile, error: BaseException) -> SurveyError:
    """Return the exception with which a run ends if a tile cannot be computed or written. error: the cause."""
    what = tile_name(request, tile)
    if isinstance(error, StorageError):
        return StorageError(f"{what} cannot be written: {error}")
    if isinstance(error, OSError):
        return storage_error(f"{what} cannot be written", error)
    return SurveyError(f"{what} failed: {type(error).__name__}: {error}")


def _tile_module(request: AnyRequest) -> ModuleType:
    return population_tiles if isinstance(request, PopulationRequest) else survey_tiles


def _template_module(request: AnyRequest) -> ModuleType:
    return population_template if isinstance(request, PopulationRequest) else survey_template
