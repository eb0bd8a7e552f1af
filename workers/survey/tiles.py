"""Compute a survey tile by tile. A tile is a rectangle of cells, and a pure function of the request computes it."""

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from types import EllipsisType

import numpy as np

from gear_rattle.workers.survey.plane_curves import cell_pairs_crossed_by_curves
from gear_rattle.workers.survey.refined.fill import FillingPlan, RefinedCells, refine_cells
from gear_rattle.workers.survey.refined.rounds import AuditRound, create_first_audit_round
from gear_rattle.workers.survey.request import Along, SurveyRequest
from gear_rattle.workers.survey.values.cells import Cells
from gear_rattle.workers.survey.values.evaluate import FAILED, SOME_UNDECIDED
from gear_rattle.workers.survey.values.quantities import shape_of_variable
from gear_rattle.workers.survey.values.schema import SAMPLED, Quantity

LONGEST_MESSAGE = 300  # characters of a failed cell's message that are kept
POLL_SECONDS = 0.2  # seconds between two checks whether a run must stop
GRACE_SECONDS = 2.0  # seconds for which a stopped run waits for tiles that are being computed

#: Exceptions that are failures of the computer, not of a cell. They are not stored as failures of cells, because
#: results must not depend on the computer, unless `evaluate_cells_one_by_one` gets them as its argument `failing`.
MACHINE_FAILURES = (MemoryError, OSError, ImportError)

FailedCell = tuple[int, int, str]  # indices of the cell along ε and along δ, and the message of its failure
TileArrays = dict[str, np.ndarray]
CellOutcome = TileArrays | str  # the values of a cell, or the message of its failure


@dataclass(frozen=True)
class Tile:
    """A rectangle of cells: one chunk of every variable.

    index: the number of the tile, counted along δ first, then along ε, then along a third axis. delta, epsilon: the
    ranges of the tile's cells in the grid. along: the index of its slice; () without a third axis. rounds: in a refined
    survey with a bound, the rounds of audits after the first round.
    """

    index: int
    delta: slice
    epsilon: slice
    along: Along = ()
    rounds: tuple[AuditRound, ...] = ()

    @property
    def n_cells(self) -> int:
        """Number of cells of the tile."""
        return (self.delta.stop - self.delta.start) * (self.epsilon.stop - self.epsilon.start)

    @property
    def spans(self) -> tuple[slice, slice]:
        """Ranges of the tile's cells in the grid, along (epsilon, delta)."""
        return self.epsilon, self.delta

    @property
    def selection(self) -> tuple[int | EllipsisType | slice, ...]:
        """The index that selects the tile's cells in the array of a variable."""
        return *self.along, ..., self.epsilon, self.delta


@dataclass(frozen=True)
class TileRecord:
    """Summary of a computed tile.

    failed_cells: (row, column, message) of each failed cell; rows are counted through all slices. seconds: the time of
    the computation.
    """

    index: int
    cells: int
    failed_cells: tuple[FailedCell, ...]
    undecided_cells: int
    seconds: float
    impacts: int = 0  # impacts on Σ⁺ of all samples; 0 without samples, or if the cells were computed one by one
    filled_cells: int = 0  # number of cells of a refined tile that were filled instead of computed
    files: dict[str, str] = field(default_factory=dict, compare=False)  # {key: digest} of the tile's written chunks


def tiles_of(request: SurveyRequest) -> list[Tile]:
    """Return the tiles that cover the grid of the request, in the order of their index."""
    rows, columns = (
        [slice(start, min(start + size, num)) for start in range(0, num, size)]
        for num, size in zip(request.shape, request.tile_shape, strict=True)
    )
    spans = ((delta, epsilon, along) for along in request.slices for epsilon in rows for delta in columns)
    return [Tile(index, *span) for index, span in enumerate(spans)]


def tiles_of_slice(request: SurveyRequest, along: Along) -> list[Tile]:
    """Return the tiles of one slice of the request."""
    return [tile for tile in tiles_of(request) if tile.along == along]


def cells_of_tile(request: SurveyRequest, tile: Tile | None = None) -> Cells:
    """Return the cells of a tile. Without a tile, return all cells of a survey without a third axis."""
    request = request if tile is None else request.slice_request(tile.along)
    delta, epsilon = request.delta.values(), request.epsilon.values()
    return Cells(
        delta=delta if tile is None else delta[tile.delta],
        epsilon=epsilon if tile is None else epsilon[tile.epsilon],
        model=request.gear_model,
        sample_spec=request.sample_spec,
        is_sampled=bool(SAMPLED.intersection(request.quantities)),
        slots=request.n_slots,
    )


def compute_tile(
    request: SurveyRequest, tile: Tile, outcomes: Iterable[CellOutcome] | None = None
) -> tuple[TileArrays, TileRecord]:
    """Compute every per-cell variable of a tile.

    Values are a pure function of the request and the cell; they do not depend on the shape or order of tiles. A cell
    that fails has status 3, fill values in all other variables, and a message in the record; its neighbours are
    unaffected. A refined tile has no filled cells if one of its cells fails, or if `outcomes` are given.

    Parameters
    ----------
    outcomes : Iterable[CellOutcome] | None
        The outcome of each cell, row by row, if the cells are computed elsewhere, for example in another process.

    Returns
    -------
    tuple[TileArrays, TileRecord]
        The arrays by variable name, in the dims and dtype of the registry, and the tile's record.
    """
    began = time.perf_counter()
    cells = cells_of_tile(request, tile)
    impacts = 0
    if outcomes is not None:
        arrays, failed = _gather_outcomes(request, cells, outcomes)
    else:
        try:
            cells = cells if request.refine is None else _refined_tile_cells(request, tile)
            arrays, failed = _evaluate_cells_of_survey(request, cells), list[FailedCell]()
            impacts = int(cells.attractors.impacts.sum()) if cells.sample_count else 0
        except MACHINE_FAILURES:
            raise
        except Exception:  # the model failed in some cell: compute the cells one by one to find out which
            arrays, failed = _gather_outcomes(request, cells, evaluate_cells_one_by_one(request, tile))
    first_row = sum(tile.along) * request.shape[0] + tile.epsilon.start
    record = TileRecord(
        index=tile.index,
        cells=tile.n_cells,
        failed_cells=tuple((first_row + i, tile.delta.start + j, message) for i, j, message in failed),
        undecided_cells=int(np.sum(arrays["status"] == SOME_UNDECIDED)),
        seconds=time.perf_counter() - began,
        impacts=impacts,
        filled_cells=int(np.count_nonzero(cells.source_level)) if not failed else 0,
    )
    return arrays, record


def _refined_tile_cells(request: SurveyRequest, tile: Tile) -> RefinedCells:
    """Return the cells of a refined tile, of which only some are computed."""
    whole = cells_of_tile(request.slice_request(tile.along))
    # If a model has no closed form, its curves take minutes to trace, so its tiles are refined without curves.
    curves = (
        cell_pairs_crossed_by_curves(whole.model, request.delta, request.epsilon)
        if whole.model.has_closed_forms
        else ()
    )
    # An upper bound of the share of wrong cells combines the audits of all slices, so no two slices audit the same
    # positions of the grid. Without such a bound, a slice audits the same cells as a survey of its plane alone, and so
    # has the same values.
    seed = request.seed + (sum(tile.along) << 32) * request.has_wrong_share_bound
    plan = FillingPlan((first_audit_round(request), *tile.rounds), request.quantities, curves, seed)
    return refine_cells(whole, *tile.spans, plan)


def first_audit_round(request: SurveyRequest) -> AuditRound:
    """Return the first round of audits of a refined survey."""
    assert request.refine is not None
    return create_first_audit_round(request.refine.audit, request.refine.bound, request.n_cells)


def _evaluate_cells_of_survey(request: SurveyRequest, cells: Cells) -> TileArrays:
    quantities = [quantity for quantity in request.variables if quantity.is_per_cell]
    return {each.name: np.asarray(_evaluate_quantity(each, cells)).astype(each.dtype) for each in quantities}


def _evaluate_quantity(quantity: Quantity, cells: Cells) -> np.ndarray:
    return cells.values_of(quantity) if isinstance(cells, RefinedCells) else quantity.evaluate(cells)


def evaluate_cells_one_by_one(
    request: SurveyRequest, tile: Tile, first: int = 0, failing: tuple[type[Exception], ...] = ()
) -> Iterator[CellOutcome]:
    """Evaluate each cell alone, row by row from number `first`, so that a failing cell does not affect the others.

    Parameters
    ----------
    failing : tuple[type[Exception], ...]
        Some of the types in MACHINE_FAILURES, such as MemoryError. After an error of such a type only the cell counts
        as failed. Errors of the other types in MACHINE_FAILURES are raised, and no further cell is evaluated.

    Yields
    ------
    CellOutcome
        A cell's values, or the message of its failure.
    """
    cells = cells_of_tile(request, tile)
    for number in range(first, cells.delta.size * cells.epsilon.size):
        try:
            yield _evaluate_cells_of_survey(request, cells.single_cell(*divmod(number, cells.delta.size)))
        except Exception as error:
            if isinstance(error, MACHINE_FAILURES) and not isinstance(error, failing):
                raise
            yield f"{type(error).__name__}: {error}"


def _gather_outcomes(
    request: SurveyRequest, cells: Cells, outcomes: Iterable[CellOutcome]
) -> tuple[TileArrays, list[FailedCell]]:
    arrays = _arrays_of_fill_values(request, cells.shape)
    failed: list[FailedCell] = []
    for (i, j), outcome in zip(np.ndindex(cells.shape), outcomes, strict=True):
        if isinstance(outcome, str):
            failed.append((i, j, outcome[:LONGEST_MESSAGE]))
            arrays["status"][i, j] = FAILED
        else:
            for name, value in outcome.items():
                arrays[name][..., i, j] = value[..., 0, 0]
    return arrays, failed


def _arrays_of_fill_values(request: SurveyRequest, shape: tuple[int, int]) -> TileArrays:
    """Return an array of fill values for each per-cell variable. shape: the numbers of cells along (epsilon, delta)."""
    quantities = [quantity for quantity in request.variables if quantity.is_per_cell]
    return {
        each.name: np.full(shape_of_variable(each, shape, request.n_slots), each.fill_value, each.dtype)
        for each in quantities
    }


def tile_name(request: SurveyRequest, tile: Tile) -> str:
    """Return the name of a tile for messages: its number, and its ranges of δ and ε."""
    delta, epsilon = request.delta.values()[tile.delta], request.epsilon.values()[tile.epsilon]
    third = "".join(f", {name} {getattr(request.slice_request(tile.along), name)}" for name in request.third_axis)
    return f"tile {tile.index} (delta {delta[0]} to {delta[-1]}, epsilon {epsilon[0]} to {epsilon[-1]}{third})"
