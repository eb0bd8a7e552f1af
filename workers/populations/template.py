"""Create the empty store of a population: all its arrays and attributes."""

import json
from typing import Any

import zarr
from zarr.abc.buffer import Buffer
from zarr.storage import MemoryStore

from gear_rattle.workers.populations.request import PopulationRequest
from gear_rattle.workers.populations.variables import SAMPLE, PopulationVariable, variables_of_population
from gear_rattle.workers.survey.template import CODECS, WRITE_ALL_CHUNKS, Template, complete_template, current_time
from gear_rattle.workers.survey.values.quantities import DOI
from gear_rattle.workers.survey.version import code_version

KIND = "population"  # value of the attribute `kind` by which readers recognize the store of a population


def template_of(request: PopulationRequest, created: str | None = None) -> Template:
    """Return the files of a population's store before its first tile. created: the date of creation; None: now."""
    kept: dict[str, Buffer] = {}
    created = created or current_time()
    root = zarr.create_group(MemoryStore(kept), zarr_format=3, attributes=_root_attributes(request, created))
    variables = variables_of_population(request)
    for variable in variables:
        _create_array(root, request, variable)
    return complete_template(kept, request, created, _chunk_key_patterns_of_population(variables))


def create_empty_arrays(request: PopulationRequest) -> tuple[dict[str, Buffer], dict[str, zarr.Array], dict[str, str]]:
    """Create the arrays of a population's store in memory, without values. They serve to encode tiles.

    Returns
    -------
    tuple[dict[str, Buffer], dict[str, zarr.Array], dict[str, str]]
        The files in memory by key, the arrays by variable, and the patterns of chunk keys by variable.
    """
    kept: dict[str, Buffer] = {}
    root = zarr.create_group(MemoryStore(kept), zarr_format=3)
    variables = variables_of_population(request)
    arrays = {each.name: _create_array(root, request, each) for each in variables}
    return kept, arrays, _chunk_key_patterns_of_population(variables)


def _chunk_key_patterns_of_population(variables: tuple[PopulationVariable, ...]) -> dict[str, str]:
    """Return {variable: pattern of its chunk keys}, with {column} for the number of the chunk."""
    return {each.name: "/".join([each.name, "c", "{column}", *"0" * (len(each.dims) - 1)]) for each in variables}


def _create_array(root: zarr.Group, request: PopulationRequest, variable: PopulationVariable) -> zarr.Array:
    return root.create_array(
        variable.name,
        shape=variable.shape(request, request.n_cells),
        chunks=variable.shape(request, *request.tile_shape),
        dtype=variable.dtype,
        fill_value=variable.fill_value,
        compressors=CODECS,
        config=WRITE_ALL_CHUNKS,
        dimension_names=variable.dims,
        attributes=variable.attributes,
    )


def _root_attributes(request: PopulationRequest, created: str) -> dict[str, Any]:
    names = request.plan.tolerances.names
    return {
        "Conventions": "CF-1.11",
        "title": request.name or f"Population of gears of the {request.model} model that differ in {', '.join(names)}",
        "source": f"gear-rattle {code_version()}",
        "references": f"https://doi.org/{DOI}",
        "doi": DOI,
        "date_created": created,
        "kind": KIND,
        "request": json.dumps(request.model_dump(mode="json")),
        "content_hash": request.content_hash(),
        "code_version": code_version(),
        "model": str(request.model),
        "dimensions": f"gear: rows of all parts, {SAMPLE}: states that each begins from",
    }
