"""A window of the (δ, ε) plane at screen resolution: its grid, the order of its cells, and its frames.

A window's cells are computed like the cells of a survey with the window's grid. The grid is computed level by level:
each level has every second row and column of the next finer level, and the last level is the whole grid.
"""

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydantic import ValidationError

from gear_rattle.workers.errors import SurveyError, missing_map_message
from gear_rattle.workers.survey.axes import Axis, Window, message_of_first_error
from gear_rattle.workers.survey.request import SurveyRequest, TileShape
from gear_rattle.workers.survey.tiles import MACHINE_FAILURES
from gear_rattle.workers.survey.values.cells import Cells
from gear_rattle.workers.survey.values.evaluate import FAILED
from gear_rattle.workers.survey.values.quantities import QUANTITIES, shape_of_variable, stored_variables
from gear_rattle.workers.survey.values.schema import SAMPLED, Group, Quantity
from rattle.errors import require_integer, require_pair

HALVINGS = 5  # the coarsest level has every 2⁵-th row and column of the grid; a small grid has fewer levels
MOST_PIXELS = 4096  # the most pixels along an axis
LEAST_ULPS = 4  # neighbouring values of an axis differ by at least this many units in the last place (ulp)
#: Groups of variables that are computed at once at full resolution, if the model has closed forms of them.
CLOSED_FORM = frozenset({Group.REGION, Group.ORBITS})


class WindowPart(NamedTuple):
    """Some cells of a window's grid: the rows and the columns in which they lie, as slices with a step."""

    epsilon: slice
    delta: slice


class WindowPartValues(NamedTuple):
    """A computed part of a window: values (n_epsilon, n_delta), number of failed cells, seconds of the computation."""

    values: np.ndarray
    failed: int
    seconds: float


@dataclass(frozen=True)
class WindowFrame:
    """The values of a window on one level of its grid, which may be partly computed.

    delta (n,), epsilon (m,): the centres of the level's cells. values (m, n): their values, in the dtype of the map. A
    cell that is not computed yet has the value of a nearby cell of the next coarser level. done: the computed share of
    the cells of the whole grid, 1 in the last frame. failed: the number of cells whose computation failed.
    """

    delta: np.ndarray
    epsilon: np.ndarray
    values: np.ndarray
    done: float
    failed: int


def quantity_of_map(variable: str, index: int, request: SurveyRequest) -> Quantity:
    """Return the variable of a map. Raises SurveyError if a survey of this model has no such variable or index."""
    per_cell = [quantity for quantity in QUANTITIES if quantity.is_per_cell and quantity.is_in_model(request.model)]
    maps = {quantity.name: quantity for quantity in per_cell}
    if variable not in maps:
        raise SurveyError(missing_map_message(variable, maps))
    count, *_ = (*shape_of_variable(maps[variable], (1, 1), request.n_slots)[:-2], 1)
    if not 0 <= index < count:
        raise SurveyError(f"{variable} has no map {index}: use an index from 0 to {count - 1}")
    return maps[variable]


def request_for_window(request: SurveyRequest, window: Window, pixels: tuple[int, int]) -> SurveyRequest:
    """Return the request for a survey of the window, with about `pixels` cells along (delta, epsilon).

    Parts of the window outside the plane (δ ≤ 0, ε < 0) are cut off, and no axis is finer than double precision can
    resolve. Each axis has k·2ᵖ + 1 values, so that the coarsest level includes both ends. All other fields are those of
    `request`, except that the tile has its default shape and nothing is proved.

    Returns
    -------
    SurveyRequest
        The request.

    Raises
    ------
    SurveyError
        The window is empty, outside the plane or too narrow.
    ParameterError
        The window or its pixels are not numbers, or out of range.
    """
    axes = {}
    try:
        for name, span, number in zip(("delta", "epsilon"), window, pixels, strict=True):
            low, high = require_pair(name, span)
            axes[name] = _window_axis(name, low, high, require_integer(f"pixels along {name}", number, 2, MOST_PIXELS))
        sample = request.initial_conditions.model_copy(update={"v_max": request.v_max})
        same = {"initial_conditions": sample, "slots": request.n_slots, "tile": TileShape(), "certify": False}
        return SurveyRequest.model_validate(request.model_dump() | axes | same)
    except ValidationError as error:
        raise SurveyError(f"the window cannot be computed: {message_of_first_error(error)}") from error


def _window_axis(name: str, low: float, high: float, number: int) -> Axis:
    """Return an axis of about `number` values: k·2ᵖ + 1 with p ≤ HALVINGS, so that its ends are on every level."""
    if not low < high:
        raise SurveyError(
            f"the window has no width along {name} ({low} to {high}): give a lower end below its upper end"
        )
    least = (high - low) / number if name == "delta" else 0.0
    if high <= least:
        raise SurveyError(f"the window lies outside the plane ({name} up to {high}): move it to positive {name}")
    low = max(low, least)
    number = min(number, int((high - low) / (LEAST_ULPS * math.ulp(high))))
    if number < 2:
        raise SurveyError(f"the window is too narrow for double precision along {name} ({low} to {high}): zoom out")
    step = 2 ** min(HALVINGS, (number - 1).bit_length() - 1)
    return Axis(start=low, stop=high, num=step * max(1, (number - 1) // step) + 1)


class WindowGrid:
    """The grid of cells of a window, with the values of one variable in the cells that are computed so far."""

    def __init__(self, survey: SurveyRequest, quantity: Quantity) -> None:
        self.delta, self.epsilon = survey.delta.values(), survey.epsilon.values()
        self.values = np.full(survey.shape, quantity.fill_value, quantity.dtype)
        self.known = np.zeros(survey.shape, np.bool_)
        self.failed = 0
        whole = math.gcd(*(number - 1 for number in survey.shape))
        halvings = min(HALVINGS, (whole & -whole).bit_length() - 1)
        at_once = survey.has_closed_forms and quantity.group in CLOSED_FORM
        self.levels = (0,) if at_once else tuple(range(halvings, -1, -1))

    def parts_of_level(self, level: int) -> tuple[WindowPart, ...]:
        """Return the parts with the cells of a level that no coarser level has: one at the coarsest level, else two."""
        step = 2**level
        if level == self.levels[0]:
            return (WindowPart(slice(0, None, step), slice(0, None, step)),)
        odd, even, every = (slice(start, None, by) for start, by in ((step, 2 * step), (0, 2 * step), (0, step)))
        return WindowPart(odd, every), WindowPart(even, odd)

    def divide_into_parts(self, block: WindowPart, cells: int) -> Iterator[WindowPart]:
        """Divide the cells `block` into parts of about `cells` cells each: several whole rows, or a part of one row."""
        rows, columns = range(self.epsilon.size)[block.epsilon], range(self.delta.size)[block.delta]
        band = max(1, cells // max(len(columns), 1))
        piece = len(columns) if cells >= len(columns) else max(1, cells)
        for i in range(0, len(rows), band):
            for j in range(0, len(columns), piece):
                yield WindowPart(*(_slice_of_range(each) for each in (rows[i : i + band], columns[j : j + piece])))

    def store_part(self, part: WindowPart, computed: WindowPartValues) -> None:
        """Store the computed values of a part of the window, and add up the failed cells."""
        self.values[part] = computed.values
        self.known[part] = True
        self.failed += computed.failed

    def frame_at_level(self, level: int) -> WindowFrame:
        """Return the frame of a level; a cell that is not computed yet gets its value from the next coarser level."""
        step = 2**level
        rows, columns = (np.arange(0, number, step) for number in self.values.shape)
        at, known = self.values[np.ix_(rows, columns)], self.known[np.ix_(rows, columns)]
        before = self.values[np.ix_(rows - rows % (2 * step), columns - columns % (2 * step))]
        return WindowFrame(
            self.delta[columns], self.epsilon[rows], np.where(known, at, before), float(self.known.mean()), self.failed
        )


def _slice_of_range(indices: range) -> slice:
    return slice(indices.start, indices.stop, indices.step)


def compute_window_part(
    request: SurveyRequest, variable: str, index: int, delta: np.ndarray, epsilon: np.ndarray
) -> WindowPartValues:
    """Compute a map on the cells epsilon × delta: a task of the cluster.

    A failed cell has the fill value of the map's variable; on the map of `status` it has FAILED.

    Returns
    -------
    WindowPartValues
        The values, the number of failed cells, and the seconds of the computation.

    Raises
    ------
    MACHINE_FAILURES
        An exception of one of these types: the computer failed, and not the model in a cell.
    """
    began = time.perf_counter()
    quantity = quantity_of_map(variable, index, request)
    # The variable `status`, which has no group, needs the computation of all stored variables.
    wanted = (quantity,) if quantity.group else stored_variables(request.quantities, request.model)
    groups = {each.group for each in wanted}
    cells = Cells(
        delta=delta,
        epsilon=epsilon,
        model=request.gear_model,
        sample_spec=request.sample_spec,
        is_sampled=bool(SAMPLED.intersection(groups)),
        slots=request.n_slots,
    )
    failed = 0
    try:
        values = _compute_map(wanted, index, cells)
    except MACHINE_FAILURES:
        raise
    except Exception:  # the model failed in some cell: compute the cells one by one
        values = np.full(cells.shape, quantity.fill_value if quantity.group else FAILED, quantity.dtype)
        for cell in np.ndindex(cells.shape):
            try:
                values[cell] = _compute_map(wanted, index, cells.single_cell(*cell))[0, 0]
            except MACHINE_FAILURES:
                raise
            except Exception:
                failed += 1
    return WindowPartValues(values, failed, time.perf_counter() - began)


def _compute_map(quantities: tuple[Quantity, ...], index: int, cells: Cells) -> np.ndarray:
    """Compute variables of cells, and return a map of the last variable. An error in any variable is passed on.

    index: the number of the map, from 0, if the last variable has a map for each orbit or slot; else 0.

    Returns
    -------
    np.ndarray
        The values of the map.
    """
    for quantity in (each for each in quantities if each.is_per_cell):
        values = np.asarray(quantity.evaluate(cells)).astype(quantity.dtype)
    return values[(index, *(0,) * (values.ndim - 3))] if values.ndim > 2 else values
