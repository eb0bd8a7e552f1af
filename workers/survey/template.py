"""Create the empty store of a survey: all its arrays, coordinates and attributes."""

import json
import warnings
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from typing import Any

import numpy as np
import zarr
from zarr.abc.buffer import Buffer
from zarr.codecs import Crc32cCodec, ZstdCodec
from zarr.errors import ZarrUserWarning
from zarr.storage import MemoryStore, StoreLike

import rattle
from gear_rattle.workers.survey.axes import Axis
from gear_rattle.workers.survey.machine import AXES
from gear_rattle.workers.survey.manifest import MANIFEST, ROOT, SLICE, SLICES, Manifest, file_digests, group_path
from gear_rattle.workers.survey.plane_curves import (
    CURVE_VARIABLES,
    POINT_VARIABLES,
    CurveVariable,
    curve_attributes,
    trace_curve_in_window,
    window_around,
)
from gear_rattle.workers.survey.request import Along, SurveyRequest
from gear_rattle.workers.survey.tiles import cells_of_tile
from gear_rattle.workers.survey.values.quantities import COORDINATES, DOI, dimension_labels, shape_of_variable
from gear_rattle.workers.survey.values.schema import SLOT, Quantity
from gear_rattle.workers.survey.version import code_version
from rattle.models import MODELS

#: Every chunk ends in a checksum, so that readers fail on a damaged chunk instead of showing wrong numbers.
CODECS = (ZstdCodec(level=0), Crc32cCodec())
#: Every chunk has a file, even if it has fill values only, so that a missing file is a lost chunk.
WRITE_ALL_CHUNKS: Any = {"write_empty_chunks": True}
#: Setting of zarr that writes JSON without white space. It makes the root, which each reader loads, a third smaller.
COMPACT = {"json_indent": None}


Template = dict[str, bytes]  # {key: content} of every file that a store has before its first tile is written


def template_of(request: SurveyRequest, created: str | None = None) -> Template:
    """Return the files of a survey's store before its first tile. created: the date of creation; None: now.

    The root already has the metadata of all arrays, and tiles never change these metadata. So a running survey can be
    opened from disk and over HTTP.

    Returns
    -------
    Template
        Contents by key.
    """
    kept: dict[str, Buffer] = {}
    created = created or current_time()
    root = zarr.create_group(MemoryStore(kept), zarr_format=3, attributes=_survey_attributes(request, created))
    quantities = request.variables
    _write_coordinates(root, request, {dim for quantity in quantities for dim in quantity.dims} | {"delta"})
    for quantity in quantities:
        _create_or_write_variable(root, request, quantity)
    for along, each in request.slices.items():
        _write_curves(create_slice_group(root, request, along), each)
    return complete_template(kept, request, created, _chunk_key_patterns(request, quantities))


def complete_template(files: dict[str, Buffer], request: Any, created: str, chunks: dict[str, str]) -> Template:
    """Consolidate the metadata of a store in memory, add a manifest, and return all files as a template.

    Parameters
    ----------
    files : dict[str, Buffer]
        The files of the store by key; this function changes them.
    chunks : dict[str, str]
        The pattern of each variable's chunk keys, with placeholders such as {row} and {column}.

    Returns
    -------
    Template
        Contents by key.
    """
    consolidate_metadata(MemoryStore(files))
    template = file_contents(files)
    digests = file_digests(template)
    root = (digests.pop(ROOT),)
    manifest = Manifest(
        request.content_hash(), created, request.tile_grid_shape, chunks, root, digests, slices=request.n_slices
    )
    return template | {MANIFEST: manifest.to_bytes()}


def create_empty_arrays(request: SurveyRequest) -> tuple[dict[str, Buffer], dict[str, zarr.Array], dict[str, str]]:
    """Create the per-cell arrays of a store in memory, without values.

    Writing a tile to these arrays encodes its chunks as the store has them, without reading the store's metadata.

    Returns
    -------
    tuple[dict[str, Buffer], dict[str, zarr.Array], dict[str, str]]
        The files in memory by key, the arrays by variable, and the patterns of chunk keys by variable.
    """
    kept: dict[str, Buffer] = {}
    root = zarr.create_group(MemoryStore(kept), zarr_format=3)
    quantities = [quantity for quantity in request.variables if quantity.is_per_cell]
    arrays = {quantity.name: _create_cell_array(root, request, quantity) for quantity in quantities}
    return kept, arrays, _chunk_key_patterns(request, quantities)


def _chunk_key_patterns(request: SurveyRequest, quantities: Iterable[Quantity]) -> dict[str, str]:
    """Return {variable: pattern of its chunk keys}, with {row}, {column} and, if there is a third axis, {slice}."""
    first = ["c", *(SLICE for _ in request.third_axis)]
    return {
        quantity.name: "/".join([quantity.name, *first, *"0" * (len(quantity.dims) - 2), "{row}", "{column}"])
        for quantity in quantities
        if quantity.is_per_cell
    }


def file_contents(files: Mapping[str, Buffer]) -> Template:
    """Return {key: bytes} of all files of a store in memory."""
    return {key: value.to_bytes() for key, value in files.items()}


def consolidate_metadata(store: StoreLike) -> None:
    """Copy the metadata of all arrays and groups into the root.

    Without this copy, opening the store over HTTP gives an empty dataset and no error.
    """
    with warnings.catch_warnings(), zarr.config.set(COMPACT):
        # zarr warns that other libraries may ignore consolidated metadata, which is harmless.
        warnings.simplefilter("ignore", ZarrUserWarning)
        zarr.consolidate_metadata(store)


def _survey_attributes(request: SurveyRequest, created: str) -> dict[str, Any]:
    """Return the attributes of the whole survey. They are texts and numbers, so that NetCDF can hold them too."""
    return {
        "Conventions": "CF-1.11",
        "history": f"{created}: computed by gear-rattle {code_version()}",
        "institution": "not stated",
        "creator_name": "gear-rattle, at the request of its user",
        "license": "CC0-1.0: these numbers may be used without restriction; gear-rattle itself is BSD-3-Clause",
        "citation": f"gear-rattle {rattle.__version__}; J. F. Mason and P. T. Piiroinen, doi:{DOI}",
        "title": request.name or _survey_title(request),
        "source": f"gear-rattle {code_version()}",
        "references": f"https://doi.org/{DOI}",
        "doi": DOI,
        "date_created": created,
        "request": json.dumps(request.model_dump(mode="json")),
        "content_hash": request.content_hash(),
        "code_version": code_version(),
        **{f"computed_with_{name}": value for name, value in rattle.toolchain().items()},
        **_model_attributes(request),
        **_machine_attributes(request),
        **({"refined_bound_asked": request.refine.bound} if request.refine and request.refine.bound else {}),
    }


def _survey_title(request: SurveyRequest) -> str:
    planes = f"planes at {request.n_slices} values of {request.third_axis_name}" if request.third_axis_name else "plane"
    return f"Survey of the (delta, epsilon) {planes} of the {request.model} gear model"


def _machine_attributes(request: SurveyRequest) -> dict[str, Any]:
    """Return a machine's numbers as attributes, if the survey has a machine, and the CF attribute `coordinates`.

    `coordinates` lists the names of the coordinates that are not dimensions.

    Returns
    -------
    dict[str, Any]
        Values by name.
    """
    machine = {} if request.machine is None else request.machine.model_dump()
    names = [
        *(name for name in shared_parameters(request) if name != request.third_axis_name),
        *(AXES if machine else ()),
    ]
    return {"coordinates": " ".join(names), **{f"machine_{name}": value for name, value in machine.items()}}


def shared_parameters(request: SurveyRequest) -> dict[str, tuple[float | Axis, str]]:
    """Return the parameters that all cells of a slice share, each with its description.

    In the store they are coordinates without a dimension, except for a third axis.

    Returns
    -------
    dict[str, tuple[float | Axis, str]]
        Value and description by name.
    """
    return {
        each.name: (request.beta_and_added_parameters[each.name], each.long_name)
        for each in MODELS[request.model].parameters()
    }


def _model_attributes(request: SurveyRequest) -> dict[str, Any]:
    """Return attributes with the model's name, its numbers and harmonics. No value is None: NetCDF cannot hold null."""
    numbers = {name: value for name, value in request.beta_and_added_parameters.items() if isinstance(value, float)}
    harmonics = {"harmonics": json.dumps(request.harmonics)} if request.harmonics else {}
    return {"model": str(request.model), **numbers, **harmonics}


def current_time() -> str:
    """Return the present time in UTC in ISO format, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def _write_coordinates(root: zarr.Group, request: SurveyRequest, dims: set[str]) -> None:
    axes = {"delta": request.delta, "epsilon": request.epsilon}
    for dim in COORDINATES:
        if dim in dims:
            values = (
                axes[dim].values() if dim in axes else encode_coordinate_labels(dimension_labels(dim, request.n_slots))
            )
            write_array(root, dim, (dim,), values, {"long_name": dimension_description(request, dim), "units": "1"})
    for name, (value, long_name) in shared_parameters(request).items():
        values = value.values() if isinstance(value, Axis) else np.array(value)
        write_array(root, name, (name,) * values.ndim, values, {"long_name": long_name, "units": "1"})
    if request.machine is not None:
        rpm = request.machine.speed_at_damping(request.delta.values())
        eccentricity = request.machine.eccentricity_in_metres(request.epsilon.values())
        write_array(root, "rpm", ("delta",), rpm, {"long_name": "mean speed", "units": "rpm"})
        described = {"long_name": "amplitude of the transmission error along the line of action", "units": "m"}
        write_array(root, "eccentricity", ("epsilon",), eccentricity, described)


def dimension_description(request: SurveyRequest, dim: str) -> str:
    """Return the description of a dimension, the attribute `long_name` of its coordinate."""
    if dim == SLOT and request.slots_follow_families:
        return "slot of the attractor: that of its family, as far as there are slots"
    return COORDINATES[dim].long_name


def encode_coordinate_labels(values: tuple[int, ...] | tuple[str, ...]) -> np.ndarray:
    """Return the labels of a dimension as int64 or as variable-length text, the only text that zarr v3 specifies."""
    text = isinstance(values[0], str)
    return np.array(values, dtype=np.dtypes.StringDType() if text else np.int64)


def _create_or_write_variable(root: zarr.Group, request: SurveyRequest, quantity: Quantity) -> None:
    if quantity.is_per_cell:
        _create_cell_array(root, request, quantity)
    else:
        found = [np.asarray(quantity.evaluate(cells_of_tile(each))) for each in request.slices.values()]
        values = (np.stack(found) if request.third_axis_name else found[0]).astype(quantity.dtype)
        write_array(root, quantity.name, (*request.third_axis, *quantity.dims), values, quantity.attributes)


def _create_cell_array(root: zarr.Group, request: SurveyRequest, quantity: Quantity) -> zarr.Array:
    lengths = [axis.num for axis in request.third_axis.values()]
    return root.create_array(
        quantity.name,
        shape=(*lengths, *shape_of_variable(quantity, request.shape, request.n_slots)),
        chunks=(*(1 for _ in lengths), *shape_of_variable(quantity, request.tile_shape, request.n_slots)),
        dtype=quantity.dtype,
        fill_value=quantity.fill_value,
        compressors=CODECS,
        config=WRITE_ALL_CHUNKS,
        dimension_names=(*request.third_axis, *quantity.dims),
        attributes=quantity.attributes,
    )


def create_slice_group(root: zarr.Group, request: SurveyRequest, along: Along) -> zarr.Group:
    """Create and return the group for a slice's curves and families; without a third axis, return the root."""
    if not along:
        return root
    if SLICES not in root:
        about = f"curves, points and families of each slice, by its index along {request.third_axis_name}"
        root.create_group(SLICES, attributes={"long_name": about})
    return root.create_group(group_path(along), attributes=_model_attributes(request.slice_request(along)))


def _write_curves(root: zarr.Group, request: SurveyRequest) -> None:
    """Write the curves and codimension-two points of a plane as groups of its store."""
    window = window_around(request.delta.values(), request.epsilon.values())
    attributes = {
        "long_name": "bifurcation curves of the period-one motions, a group each",
        "references": f"https://doi.org/{DOI}",
        **_model_attributes(request),
        "window_delta": window.delta,
        "window_epsilon": window.epsilon,
    }
    groups = root.create_group("curves", attributes=attributes)
    multiplier = COORDINATES["multiplier"]
    described = {"long_name": multiplier.long_name, "units": "1"}
    write_array(groups, "multiplier", ("multiplier",), encode_coordinate_labels(multiplier.values), described)
    model = request.gear_model
    for name in model.curve_names:
        curve = trace_curve_in_window(name, model, window)
        group = groups.create_group(name, attributes=curve_attributes(name, model, curve))
        write_variables(group, CURVE_VARIABLES, curve)
    attributes = {"long_name": "codimension-two points, where curves meet", "references": f"https://doi.org/{DOI}"}
    group = root.create_group("codimension_two", attributes=attributes | _model_attributes(request))
    write_variables(group, POINT_VARIABLES, model.codimension_two())


def write_variables(group: zarr.Group, variables: Iterable[CurveVariable], item: Any) -> None:
    """Write variables with their attributes to a group. item: the object that they describe, such as a curve."""
    for variable in (part for each in variables for part in each.parts):
        write_array(group, variable.name, variable.dims, variable.stored_values(item), variable.attributes)


def write_array(
    group: zarr.Group, name: str, dims: tuple[str, ...], values: np.ndarray, attributes: dict[str, Any]
) -> None:
    """Create an array with these values, as one chunk. Tiles never write to such an array.

    An array of text has its values in the attribute `texts` too, as JSON, because some readers of zarr know no text.
    """
    if isinstance(values.dtype, np.dtypes.StringDType):
        attributes = {**attributes, "texts": json.dumps(values.tolist(), ensure_ascii=False)}
    chunks = tuple(max(size, 1) for size in values.shape)  # zarr requires chunks of at least 1, even for an empty array
    group.create_array(
        name,
        data=values,
        chunks=chunks,
        compressors=CODECS,
        config=WRITE_ALL_CHUNKS,
        dimension_names=dims,
        attributes=attributes,
    )
