"""Describe the pyramid levels of a store: a group for each level, its arrays, and the relation between levels."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import zarr
from zarr.abc.buffer import Buffer
from zarr.storage import MemoryStore

from gear_rattle.workers.survey.levels.grid import (
    GROUP,
    PyramidLevel,
    block_shape,
    centres_of_level_cells,
    coarsening_factors_of_levels,
    stored_levels_of_shape,
)
from gear_rattle.workers.survey.levels.reduce import STATISTICS, smallest_mask_dtype
from gear_rattle.workers.survey.manifest import ROOT
from gear_rattle.workers.survey.request import SurveyRequest
from gear_rattle.workers.survey.template import (
    CODECS,
    WRITE_ALL_CHUNKS,
    Template,
    dimension_description,
    encode_coordinate_labels,
    file_contents,
    shared_parameters,
    write_array,
)
from gear_rattle.workers.survey.values.quantities import COORDINATES, dimension_labels, variables_of_groups
from gear_rattle.workers.survey.values.schema import CELL, Quantity

#: Dimensions of a level. Their names differ from those of the survey's dimensions, because their coordinates differ.
LEVEL_CELL = ("level_epsilon", "level_delta")
STATISTIC = "statistic"
SHARE, OCCURS = "_share", "_occurs"  # endings of the names of two further arrays, which a variable with codes has
#: Entry of the attribute `zarr_conventions` that names the convention for pyramid levels.
MULTISCALES = {
    "schema_url": "https://raw.githubusercontent.com/zarr-conventions/multiscales/refs/tags/v1/schema.json",
    "spec_url": "https://github.com/zarr-conventions/multiscales/blob/v1/README.md",
    "uuid": "d35379db-88df-4056-af3a-620245f8e347",
    "name": "multiscales",
    "description": "Multiscale layout of zarr datasets",
}


class LevelArrayDescription(NamedTuple):
    """The description of an array of a level. dims: its dimensions except epsilon, delta and a third axis."""

    name: str
    dims: tuple[str, ...]
    dtype: np.dtype[Any]
    attributes: dict[str, Any]


def level_variables(request: SurveyRequest) -> list[Quantity]:
    """Return the variables of a survey that its levels contain: all variables with a value for each cell."""
    return [each for each in variables_of_groups(request.quantities, request.model) if each.is_per_cell]


def code_meanings(quantity: Quantity) -> tuple[str, ...]:
    """Return the meanings of a variable's codes, or () if its values are numbers."""
    return ("no", "yes") if quantity.dtype == "bool" else quantity.flags


def describe_level_arrays(quantity: Quantity) -> tuple[LevelArrayDescription, ...]:
    """Describe the arrays that a level has for one variable: one array of statistics, or three arrays for codes.

    Complex numbers are represented by their moduli.

    Returns
    -------
    tuple[LevelArrayDescription, ...]
        For numbers: the statistics. For codes: the most frequent code, its share, and a bit mask of the codes.
    """
    name, dims, words = quantity.name, quantity.dims[:-2], code_meanings(quantity)
    if not words:
        modulus = np.dtype(quantity.dtype).kind == "c"
        long_name = f"|{quantity.long_name}|" if modulus else quantity.long_name
        numbers = quantity.attributes | {"long_name": long_name}
        return (LevelArrayDescription(name, (STATISTIC, *dims), np.dtype(np.float32), numbers),)
    most = quantity.attributes | {"cell_methods": f"{LEVEL_CELL[0]}: {LEVEL_CELL[1]}: mode"}
    masks = smallest_mask_dtype(len(words))
    flags = {"flag_masks": [1 << code for code in range(len(words))], "flag_meanings": " ".join(words)}
    same = {"units": "1", "references": quantity.reference}
    share = f"share of the cells that have the most frequent {name}"
    occurs = f"which values of {name} occur, a bit each"
    return (
        LevelArrayDescription(name, dims, np.dtype(quantity.dtype), most),
        LevelArrayDescription(name + SHARE, dims, np.dtype(np.float32), {"long_name": share, **same}),
        LevelArrayDescription(name + OCCURS, dims, masks, {"long_name": occurs, **same, **flags}),
    )


def create_level_array(
    root: zarr.Group, request: SurveyRequest, level: PyramidLevel, array: LevelArrayDescription
) -> zarr.Array:
    """Create an array of a level in its group, with a chunk for each block."""
    axes = request.third_axis
    beside = [len(_dimension_labels(request, dim)) for dim in array.dims]
    sides = [
        min(size // cells, most)
        for size, cells, most in zip(block_shape(request), level.covered_cells, level.shape, strict=True)
    ]
    return root.create_array(
        f"{level.path}/{array.name}",
        shape=(*(axis.num for axis in axes.values()), *beside, *level.shape),
        chunks=(*(1 for _ in axes), *beside, *sides),
        dtype=array.dtype,
        fill_value=float("nan") if array.dtype.kind == "f" else array.dtype.type(0).item(),
        compressors=CODECS,
        config=WRITE_ALL_CHUNKS,
        dimension_names=(*axes, *array.dims, *LEVEL_CELL),
        attributes=array.attributes,
    )


def _dimension_labels(request: SurveyRequest, dim: str) -> tuple[int, ...] | tuple[str, ...]:
    return STATISTICS if dim == STATISTIC else dimension_labels(dim, request.n_slots)


def files_of_levels(request: SurveyRequest) -> Template:
    """Return the files of a store's levels by key, except the chunks of their arrays."""
    kept: dict[str, Buffer] = {}
    root = zarr.create_group(MemoryStore(kept), zarr_format=3)
    levels = stored_levels_of_shape(request.shape)
    attributes = {
        "long_name": "the survey in less and less resolution; level 0 is the survey itself",
        "zarr_conventions": [MULTISCALES],
        "multiscales": {
            "layout": list(_multiscales_layout_entries(levels)),
            "resampling_method": "mode of codes, average of numbers",
        },
    }
    root.create_group(GROUP, attributes=attributes)
    for level in levels:
        cells = dict(zip((f"cells_{name}" for name in CELL), level.covered_cells, strict=True))
        long_name = f"level {level.number}: {' x '.join(map(str, level.covered_cells))} cells of the survey in each"
        group = root.create_group(level.path, attributes={"long_name": long_name, **cells})
        arrays = [array for quantity in level_variables(request) for array in describe_level_arrays(quantity)]
        _write_level_coordinates(group, request, level, {dim for array in arrays for dim in array.dims})
        for array in arrays:
            create_level_array(root, request, level, array)
    return {key: content for key, content in file_contents(kept).items() if key != ROOT}


def _multiscales_layout_entries(levels: tuple[PyramidLevel, ...]) -> Iterator[dict[str, Any]]:
    """Yield the description of each level as the multiscales convention of zarr requires it.

    Yields
    ------
    dict[str, Any]
        Name of the level, name of the next finer level, and scale and translation relative to that level, along
        (epsilon, delta).
    """
    for level, step in zip(levels, coarsening_factors_of_levels(levels), strict=True):
        before = {"derived_from": str(level.number - 1)} if level.number > 1 else {}
        translation = [(each - 1) / 2 for each in step]
        transform = {"scale": [float(each) for each in step], "translation": translation}
        yield {"asset": str(level.number), **before, "transform": transform}


def _write_level_coordinates(group: zarr.Group, request: SurveyRequest, level: PyramidLevel, dims: set[str]) -> None:
    axes = (request.epsilon, request.delta)
    for name, dim, axis, cells in zip(CELL, LEVEL_CELL, axes, level.covered_cells, strict=True):
        long_name = f"{COORDINATES[name].long_name}, middle of the cells"
        write_array(
            group, dim, (dim,), centres_of_level_cells(axis.values(), cells), {"long_name": long_name, "units": "1"}
        )
    for dim in sorted(dims):
        words = "statistic of the covered cells' numbers" if dim == STATISTIC else dimension_description(request, dim)
        values = encode_coordinate_labels(_dimension_labels(request, dim))
        write_array(group, dim, (dim,), values, {"long_name": words, "units": "1"})
    for name, axis in request.third_axis.items():
        write_array(
            group, name, (name,), axis.values(), {"long_name": shared_parameters(request)[name][1], "units": "1"}
        )
