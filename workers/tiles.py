"""Tiles: the pieces that a survey is computed in, each by a pure function."""

import time
from dataclasses import dataclass

import numpy as np

from workers.cells import Cells
from workers.evaluate import FAILED, SOME_UNDECIDED
from workers.quantities import shape_of, stored
from workers.request import SurveyRequest
from workers.schema import SAMPLED

LONGEST_MESSAGE = 300

#: Failures of the machine, not of a cell: stored, they would make the survey depend on where it ran.
_MACHINE = (MemoryError, OSError, ImportError)

FailedCell = tuple[int, int, str]  # i_epsilon, i_delta, message


@dataclass(frozen=True)
class Tile:
    """A rectangle of cells that is one chunk of every variable; index counts along δ first."""

    index: int
    delta: slice
    epsilon: slice

    @property
    def n_cells(self) -> int:
        """Cells of the tile."""
        return (self.delta.stop - self.delta.start) * (self.epsilon.stop - self.epsilon.start)


@dataclass(frozen=True)
class TileRecord:
    """What became of a tile. Failed cells are counted from the corner of the grid."""

    index: int
    cells: int
    failed_cells: tuple[FailedCell, ...]
    undecided_cells: int
    seconds: float


def tiles_of(request: SurveyRequest) -> list[Tile]:
    """Return the tiles that cover the grid of the request, in the order of their index."""
    rows, columns = (
        [slice(start, min(start + size, num)) for start in range(0, num, size)]
        for num, size in zip(request.shape, request.tile_shape, strict=True)
    )
    spans = ((epsilon, delta) for epsilon in rows for delta in columns)
    return [Tile(index, delta=delta, epsilon=epsilon) for index, (epsilon, delta) in enumerate(spans)]


def cells_of(request: SurveyRequest, tile: Tile | None = None) -> Cells:
    """Return the cells of a tile, or the whole grid."""
    delta, epsilon = request.delta.values(), request.epsilon.values()
    sample = request.initial_conditions
    return Cells(
        delta=delta if tile is None else delta[tile.delta],
        epsilon=epsilon if tile is None else epsilon[tile.epsilon],
        beta=request.beta,
        count=sample.count if SAMPLED.intersection(request.quantities) else 0,
        v_max=sample.v_max,
        seed=request.seed,
    )


def compute_tile(request: SurveyRequest, tile: Tile) -> tuple[dict[str, np.ndarray], TileRecord]:
    """Compute every per-cell variable of a tile.

    A pure function of the request and the cells: shape and order of the tiles do not show in the values.
    A cell that fails has status 3, fill values elsewhere, and its message in the record; its neighbours are whole.

    Returns:
        The arrays by variable name, in the dims and dtype of the registry, and the tile's record.
    """
    began = time.perf_counter()
    cells = cells_of(request, tile)
    try:
        arrays, failed = _evaluate(request, cells), list[FailedCell]()
    except _MACHINE:
        raise
    except Exception:  # whatever the model raises is that cell's result
        arrays, failed = _evaluate_cell_by_cell(request, cells)
    record = TileRecord(
        index=tile.index,
        cells=tile.n_cells,
        failed_cells=tuple((tile.epsilon.start + i, tile.delta.start + j, message) for i, j, message in failed),
        undecided_cells=int(np.sum(arrays["status"] == SOME_UNDECIDED)),
        seconds=time.perf_counter() - began,
    )
    return arrays, record


def _evaluate(request: SurveyRequest, cells: Cells) -> dict[str, np.ndarray]:
    quantities = [quantity for quantity in stored(request.quantities) if quantity.per_cell]
    return {quantity.name: np.asarray(quantity.evaluate(cells)).astype(quantity.dtype) for quantity in quantities}


def _evaluate_cell_by_cell(request: SurveyRequest, cells: Cells) -> tuple[dict[str, np.ndarray], list[FailedCell]]:
    """Evaluate each cell alone, so that one which fails is the only one lost."""
    arrays = _fills(request, cells.shape)
    failed: list[FailedCell] = []
    for i, j in np.ndindex(cells.shape):
        try:
            values = _evaluate(request, cells.one(i, j))
        except _MACHINE:
            raise
        except Exception as error:
            failed.append((i, j, f"{type(error).__name__}: {error}"[:LONGEST_MESSAGE]))
            arrays["status"][i, j] = FAILED
        else:
            for name, value in values.items():
                arrays[name][..., i, j] = value[..., 0, 0]
    return arrays, failed


def _fills(request: SurveyRequest, shape: tuple[int, int]) -> dict[str, np.ndarray]:
    quantities = [quantity for quantity in stored(request.quantities) if quantity.per_cell]
    return {each.name: np.full(shape_of(each, shape), each.fill, each.dtype) for each in quantities}
