"""Compute a population tile by tile. A tile is a range of gears (rows of the store)."""

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from types import EllipsisType

import numpy as np

from gear_rattle.workers.populations.request import PopulationRequest
from gear_rattle.workers.populations.variables import PopulationVariable, variables_of_population
from gear_rattle.workers.survey.tiles import (
    LONGEST_MESSAGE,
    MACHINE_FAILURES,
    CellOutcome,
    FailedCell,
    TileArrays,
    TileRecord,
)
from gear_rattle.workers.survey.values.evaluate import FAILED, SOME_UNDECIDED
from rattle.populations import ComputedGears, compute_gears


@dataclass(frozen=True)
class GearTile:
    """A tile of a population: a range of rows (each row is a gear). It is one chunk of every variable.

    index: the number of the tile. gear: the range of its rows.
    """

    index: int
    gear: slice

    @property
    def n_cells(self) -> int:
        """Number of rows of the tile."""
        return int(self.gear.stop - self.gear.start)

    @property
    def spans(self) -> tuple[slice]:
        """The rows of the tile, in a tuple with one entry for each axis."""
        return (self.gear,)

    @property
    def selection(self) -> tuple[slice, EllipsisType]:
        """The index that selects the tile's rows in the array of a variable."""
        return self.gear, ...


def tiles_of(request: PopulationRequest) -> list[GearTile]:
    """Return the tiles that cover the rows of the request, in the order of their index."""
    (size,), rows = request.tile_shape, request.n_cells
    return [GearTile(i, slice(start, min(start + size, rows))) for i, start in enumerate(range(0, rows, size))]


def compute_tile(
    request: PopulationRequest, tile: GearTile, outcomes: Iterable[CellOutcome] | None = None
) -> tuple[TileArrays, TileRecord]:
    """Compute every variable of a tile. The gears of a population take the place of a survey's cells.

    A gear that fails has status 3, fill values in all other variables, and a message in the record.

    Parameters
    ----------
    outcomes : Iterable[CellOutcome] | None
        The outcome of each gear, if the gears are computed elsewhere; None to compute them here.

    Returns
    -------
    tuple[TileArrays, TileRecord]
        The arrays of the tile by variable, and its record.

    Raises
    ------
    MACHINE_FAILURES
        One of these exceptions, which are failures of the computer and not of a gear.
    """
    began = time.perf_counter()
    if outcomes is not None:
        arrays, failed = _gather_gear_outcomes(request, tile, outcomes)
    else:
        try:
            arrays, failed = _evaluate_gears(request, tile.gear), list[FailedCell]()
        except MACHINE_FAILURES:
            raise
        except Exception:  # the model failed for some gear: compute the gears one by one to find out which
            arrays, failed = _gather_gear_outcomes(request, tile, evaluate_cells_one_by_one(request, tile))
    undecided = int(np.sum(arrays["status"] == SOME_UNDECIDED))
    record = TileRecord(tile.index, tile.n_cells, tuple(failed), undecided, time.perf_counter() - began)
    return arrays, record


def evaluate_cells_one_by_one(
    request: PopulationRequest, tile: GearTile, first: int = 0, failing: tuple[type[Exception], ...] = ()
) -> Iterator[CellOutcome]:
    """Evaluate each gear of a tile alone, so that a failing gear does not affect the others.

    first: the position in the tile of the first gear to evaluate. Exceptions in MACHINE_FAILURES end the tile, except
    those in `failing`, which count as failures of the gear.

    Yields
    ------
    CellOutcome
        A gear's values, or the message of its failure.
    """
    for row in range(tile.gear.start + first, tile.gear.stop):
        try:
            yield _evaluate_gears(request, slice(row, row + 1))
        except Exception as error:
            if isinstance(error, MACHINE_FAILURES) and not isinstance(error, failing):
                raise
            yield f"{type(error).__name__}: {error}"


def tile_name(request: PopulationRequest, tile: GearTile) -> str:
    """Return the name of a tile for messages: its number, and its gears."""
    numbers = ", ".join(request.plan.tolerances.names)
    return f"tile {tile.index} (gears {tile.gear.start} to {tile.gear.stop - 1} of a population that varies {numbers})"


def _evaluate_gears(request: PopulationRequest, rows: slice) -> TileArrays:
    found = compute_gears(request.plan, rows.start, rows.stop)
    return {each.name: _evaluate_variable(each, request, found) for each in variables_of_population(request)}


def _evaluate_variable(variable: PopulationVariable, request: PopulationRequest, found: ComputedGears) -> np.ndarray:
    return np.asarray(variable.evaluate(request, found)).astype(variable.dtype)


def _gather_gear_outcomes(
    request: PopulationRequest, tile: GearTile, outcomes: Iterable[CellOutcome]
) -> tuple[TileArrays, list[FailedCell]]:
    """Return the arrays of a tile, and the failed gears, from the outcome of each gear of the tile."""
    variables = variables_of_population(request)
    arrays = {each.name: np.full(each.shape(request, tile.n_cells), each.fill_value, each.dtype) for each in variables}
    failed: list[FailedCell] = []
    for i, outcome in zip(range(tile.n_cells), outcomes, strict=True):
        if isinstance(outcome, str):
            failed.append((0, tile.gear.start + i, outcome[:LONGEST_MESSAGE]))
            arrays["status"][i] = FAILED
        else:
            for name, value in outcome.items():
                arrays[name][i] = value[0]
    return arrays, failed
