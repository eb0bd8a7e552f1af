"""The families of a survey's attractors: from its cells to what is stored of them."""

from typing import Any, NamedTuple

import numpy as np
import zarr
from zarr.core.buffer import Buffer
from zarr.storage import MemoryStore

from rattle import KINDS, Attractors, Families
from rattle.families.table import NO_FAMILY
from workers.survey.curves import Variable
from workers.survey.request import SurveyRequest
from workers.survey.template import CODECS, WHOLE, Template, consolidate, contents, write_variables
from workers.survey.values.schema import CELL

#: What a survey's attractors are read from.
STORED = (
    "attractor_kind", "attractor_m", "attractor_n_plus", "attractor_n_minus", "attractor_fraction", "attractor_phase",
    "attractor_velocity", "attractor_lyapunov",
)  # fmt: skip
FAMILY, GROUP = "attractor_family", "families"
LARGEST_CHUNK = 512  # cells a side: files do not become many
ROW, ENTERED = ("family",), ("entered",)
REFERENCE = "docs/families.md"

FAMILY_VARIABLES: tuple[Variable, ...] = (
    Variable("family", ROW, np.int32, "number of the family; 0: quiet", lambda x: range(x.table.cells.size)),
    Variable("kind", ROW, np.int8, f"kind of attractor: {', '.join(KINDS)}", lambda x: x.table.kind),
    Variable("m", ROW, np.int32, "m of P(m, n+, n-); 0 unless periodic", lambda x: x.table.m),
    Variable("n_plus", ROW, np.int32, "n+ of P(m, n+, n-); 0 unless periodic", lambda x: x.table.n_plus),
    Variable("n_minus", ROW, np.int32, "n- of P(m, n+, n-); 0 unless periodic", lambda x: x.table.n_minus),
    Variable("cells", ROW, np.int64, "cells that have it", lambda x: x.table.cells),
    Variable("unsampled", ROW, np.int64, "cells where no sample goes to it", lambda x: x.table.unsampled),
    Variable("delta_low", ROW, float, "least damping of its cells", lambda x: x.table.delta_low),
    Variable("delta_high", ROW, float, "largest damping of its cells", lambda x: x.table.delta_high),
    Variable("epsilon_low", ROW, float, "least eccentricity of its cells", lambda x: x.table.epsilon_low),
    Variable("epsilon_high", ROW, float, "largest eccentricity of its cells", lambda x: x.table.epsilon_high),
    Variable("largest_fraction", ROW, float, "largest share of a cell's sample", lambda x: x.table.largest_fraction),
    Variable("mean_fraction", ROW, float, "mean share over its cells", lambda x: x.table.mean_fraction),
    Variable("delta_at", ROW, float, "damping where its share is largest", lambda x: x.table.delta_at),
    Variable("epsilon_at", ROW, float, "eccentricity where its share is largest", lambda x: x.table.epsilon_at),
    Variable("exponent", ROW, float, "largest Lyapunov exponent of its cells", lambda x: x.table.exponent),
    Variable("monodromy", ROW, bool, "whether a cell has two attractors of it", lambda x: x.table.monodromy),
    Variable("entered_family", ENTERED, np.int32, "family of an orbit that no slot has", lambda x: x.family[x.entered]),
    Variable("entered_row", ENTERED, np.int32, "number of its cell along epsilon, from 0", lambda x: _places(x)[0]),
    Variable("entered_column", ENTERED, np.int32, "number of its cell along delta, from 0", lambda x: _places(x)[1]),
    Variable("entered_phase", ENTERED, float, "phase τ of its fastest impact", lambda x: x.attractors.tau[x.entered]),
    Variable("entered_velocity", ENTERED, float, "speed v of its fastest impact", lambda x: x.attractors.v[x.entered]),
)


class Slots(NamedTuple):
    """The attractors that a survey lists, and the slots (attractors,) that they are in."""

    attractors: Attractors
    slot: np.ndarray


def _places(families: Families) -> tuple[np.ndarray, np.ndarray]:
    return np.divmod(families.attractors.cell[families.entered], families.delta.size)


def listed(values: dict[str, np.ndarray], count: int, first_cell: int = 0) -> Slots:
    """Return the attractors in the slots of some rows of cells, from the variables of STORED (slots, …, rows, n)."""
    kind = np.moveaxis(values["attractor_kind"], 0, -1)
    flat = kind.reshape(-1, kind.shape[-1])
    cell, slot = np.nonzero(flat)

    def of(name: str) -> np.ndarray:
        return np.moveaxis(values[f"attractor_{name}"], 0, -1).reshape(flat.shape)[cell, slot]

    first, second = (
        np.moveaxis(values["attractor_lyapunov"][:, i], 0, -1).reshape(flat.shape)[cell, slot] for i in (0, 1)
    )
    samples = np.rint(of("fraction").astype(float) * count).astype(np.int64)
    nothing, unknown = np.zeros(cell.size, np.int64), np.full(cell.size, np.nan)
    table = Attractors(
        cell=cell + first_cell,
        kind=flat[cell, slot].astype(np.int64),
        m=of("m").astype(np.int64),
        n_plus=of("n_plus").astype(np.int64),
        n_minus=of("n_minus").astype(np.int64),
        samples=samples,
        tau=of("phase"),
        v=of("velocity"),
        first=first,
        second=second,
        error=unknown,
        impacts=nothing,
        watched=unknown,
    )
    return Slots(table, slot)


def joined_slots(request: SurveyRequest, found: Slots) -> tuple[Families, np.ndarray]:
    """Return the families of a whole survey, and the number of each slot, (slots, n_epsilon, n_delta)."""
    count = request.initial_conditions.count
    families = request.gear_model.families(request.delta.values(), request.epsilon.values(), count, found.attractors)
    numbers = np.full((request.n_slots, request.n_cells), NO_FAMILY, np.int32)
    numbers[found.slot, found.attractors.cell] = families.family[~families.entered]
    return families, numbers.reshape(request.n_slots, *request.shape)


def files_of_families(request: SurveyRequest, families: Families, numbers: np.ndarray) -> Template:
    """Return the files that families add to a store, by their key, with a root that describes them."""
    kept: dict[str, Buffer] = {}
    store = MemoryStore(kept)
    root = zarr.create_group(store, zarr_format=3)
    described: dict[str, Any] = {
        "long_name": "number of the family of the attractor, a row of the group families; 0: quiet, -1: none",
        "units": "1",
        "references": REFERENCE,
    }
    root.create_array(
        FAMILY,
        data=numbers,
        chunks=(request.n_slots, *(min(size, LARGEST_CHUNK) for size in request.shape)),
        compressors=CODECS,
        config=WHOLE,
        fill_value=NO_FAMILY,
        dimension_names=("attractor", *CELL),
        attributes=described,
    )
    group = root.create_group(GROUP, attributes={"long_name": "families of attractors", "references": REFERENCE})
    write_variables(group, FAMILY_VARIABLES, families)
    consolidate(store)
    return contents(kept)
