"""Families of a survey's attractors: read attractors from slots, assign slots to families, write the stored group."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import zarr
from zarr.abc.buffer import Buffer
from zarr.storage import MemoryStore

from gear_rattle.workers.survey.manifest import ROOT
from gear_rattle.workers.survey.plane_curves import TEXT, CurveVariable
from gear_rattle.workers.survey.request import Along, SurveyRequest
from gear_rattle.workers.survey.template import (
    CODECS,
    WRITE_ALL_CHUNKS,
    Template,
    create_slice_group,
    file_contents,
    write_variables,
)
from gear_rattle.workers.survey.values.schema import CELL, SLOT
from rattle import KINDS, Attractors, FamilyTable
from rattle.families import NO_FAMILY, argsort_attractors

#: Names of the stored variables from which a survey's attractors are read.
ATTRACTOR_VARIABLES = (
    "attractor_kind", "attractor_m", "attractor_n_plus", "attractor_n_minus", "attractor_fraction", "attractor_phase",
    "attractor_velocity", "attractor_lyapunov",
)  # fmt: skip
FAMILY, GROUP = "attractor_family", "families"
ROW, ENTERED = ("family",), ("entered",)
REFERENCE = "docs/families.md"

FAMILY_VARIABLES: tuple[CurveVariable, ...] = (
    CurveVariable("family", ROW, np.int32, "number of the family; 0: quiet", lambda x: range(x.table.cells.size)),
    CurveVariable("kind", ROW, np.int8, f"kind of attractor: {', '.join(KINDS)}", lambda x: x.table.kind),
    CurveVariable("m", ROW, np.int32, "m of P(m, n+, n-); 0 unless periodic", lambda x: x.table.m),
    CurveVariable("n_plus", ROW, np.int32, "n+ of P(m, n+, n-); 0 unless periodic", lambda x: x.table.n_plus),
    CurveVariable("n_minus", ROW, np.int32, "n- of P(m, n+, n-); 0 unless periodic", lambda x: x.table.n_minus),
    CurveVariable("cells", ROW, np.int64, "cells that have it", lambda x: x.table.cells),
    CurveVariable(
        "unsampled", ROW, np.int64, "attractors in its cells that no sample reaches", lambda x: x.table.unsampled
    ),
    CurveVariable("delta_low", ROW, float, "least damping of its cells", lambda x: x.table.delta_low),
    CurveVariable("delta_high", ROW, float, "largest damping of its cells", lambda x: x.table.delta_high),
    CurveVariable("epsilon_low", ROW, float, "least eccentricity of its cells", lambda x: x.table.epsilon_low),
    CurveVariable("epsilon_high", ROW, float, "largest eccentricity of its cells", lambda x: x.table.epsilon_high),
    CurveVariable(
        "largest_fraction", ROW, float, "largest share of a cell's sample", lambda x: x.table.largest_fraction
    ),
    CurveVariable("mean_fraction", ROW, float, "mean share over its cells", lambda x: x.table.mean_fraction),
    CurveVariable("delta_at", ROW, float, "damping where its share is largest", lambda x: x.table.delta_at),
    CurveVariable("epsilon_at", ROW, float, "eccentricity where its share is largest", lambda x: x.table.epsilon_at),
    CurveVariable("exponent", ROW, float, "largest Lyapunov exponent of its cells", lambda x: x.table.exponent),
    CurveVariable("monodromy", ROW, bool, "whether a cell has two attractors of it", lambda x: x.table.monodromy),
    CurveVariable(
        "entered_family", ENTERED, np.int32, "family of an orbit that no slot has", lambda x: x.entered_family
    ),
    CurveVariable(
        "entered_row",
        ENTERED,
        np.int32,
        "number of its cell along epsilon, from 0",
        lambda x: _cells_of_continued_orbits(x)[0],
    ),
    CurveVariable(
        "entered_column",
        ENTERED,
        np.int32,
        "number of its cell along delta, from 0",
        lambda x: _cells_of_continued_orbits(x)[1],
    ),
    CurveVariable("entered_phase", ENTERED, float, "phase τ of its fastest impact", lambda x: x.entered.tau),
    CurveVariable("entered_velocity", ENTERED, float, "speed v of its fastest impact", lambda x: x.entered.v),
    CurveVariable(
        "entered_lyapunov",
        ("entered", "exponent"),
        float,
        "Lyapunov exponent per forcing period, natural logarithm",
        lambda x: np.column_stack([x.entered.first, x.entered.second]),
    ),
)


#: Variables about the edges of families; their values come from `gear_rattle.workers.boundaries.edges.FamilyEdges`.
EDGE_VARIABLES: tuple[CurveVariable, ...] = (
    CurveVariable("curve", ("curve",), TEXT, "curve of the period-one motions, a group of /curves", lambda x: x.names),
    CurveVariable("edges", ROW, np.int64, "pairs of neighbouring cells of which one has it", lambda x: x.n_edges),
    CurveVariable(
        "edges_on",
        ("family", "curve"),
        np.int64,
        "pairs of these between which a curve passes that makes or ends motions of its label",
        lambda x: x.n_edges_on_curve,
    ),
)


class ListedAttractors(NamedTuple):
    """The attractors that a survey lists in slots. slot (attractors,): the number of each attractor's slot."""

    attractors: Attractors
    slot: np.ndarray


class JoinedFamilies(NamedTuple):
    """The families of a survey.

    table: the families, a row each. entered: the orbits that no sample reached and that only continuation from
    neighbouring cells found, sorted by cell; no slot lists them. entered_family: the family of each of these orbits.
    columns: the number of cells of the grid along δ.
    """

    table: FamilyTable
    entered: Attractors
    entered_family: np.ndarray
    columns: int


def _cells_of_continued_orbits(joined: JoinedFamilies) -> tuple[np.ndarray, np.ndarray]:
    """Return the row and the column of the cell of each orbit in `joined.entered`."""
    return np.divmod(joined.entered.cell, joined.columns)


def attractors_in_slots(values: Mapping[str, np.ndarray], count: int) -> ListedAttractors:
    """Return the attractors in the slots of a rectangle of cells.

    values: the arrays of ATTRACTOR_VARIABLES for these cells, by name, with axes (slots, …, rows, columns). count: the
    number of samples of a cell. The attractors are sorted by cell, and within a cell in an order that does not depend
    on their slots. Cells are numbered row by row.

    Returns
    -------
    ListedAttractors
        One attractor for each occupied slot.
    """
    kind = np.moveaxis(values["attractor_kind"], 0, -1)
    flat = kind.reshape(-1, kind.shape[-1])
    cell, slot = np.nonzero(flat)

    def slot_values(name: str) -> np.ndarray:
        return np.moveaxis(values[f"attractor_{name}"], 0, -1).reshape(flat.shape)[cell, slot]

    first, second = (
        np.moveaxis(values["attractor_lyapunov"][:, i], 0, -1).reshape(flat.shape)[cell, slot] for i in (0, 1)
    )
    samples = np.rint(slot_values("fraction").astype(float) * count).astype(np.int64)
    nothing, unknown = np.zeros(cell.size, np.int64), np.full(cell.size, np.nan)
    table = Attractors(
        cell=cell,
        kind=flat[cell, slot].astype(np.int64),
        m=slot_values("m").astype(np.int64),
        n_plus=slot_values("n_plus").astype(np.int64),
        n_minus=slot_values("n_minus").astype(np.int64),
        samples=samples,
        tau=slot_values("phase"),
        v=slot_values("velocity"),
        first=first,
        second=second,
        error=unknown,
        impacts=nothing,
        watched=unknown,
    )
    order = argsort_attractors(table)
    return ListedAttractors(table.take(order), slot[order])


def complete_slot_sources(source: np.ndarray) -> np.ndarray:
    """Complete a rearrangement of the slots of each cell, so that every slot is the source of exactly one slot.

    source (slots, m, n): for each slot of a cell its source, which is the slot whose content moves into it, or −1 for
    none. A slot that is the source of no slot is empty. In ascending order, the empty slots become the sources of the
    slots with −1.

    Returns
    -------
    np.ndarray
        The source of each slot; all sources in a cell are different.
    """
    taken = np.zeros((source.shape[0] + 1, *source.shape[1:]), bool)
    # `taken` has one row more than there are slots: index −1 (no source) sets the last row, which `taken[:-1]` drops.
    np.put_along_axis(taken, source.astype(np.int64), True, 0)
    to, of = (np.argsort(used, axis=0, kind="stable") for used in (source >= 0, taken[:-1]))
    free = np.arange(source.shape[0])[:, None, None] < (source < 0).sum(axis=0)
    moved = np.take_along_axis(source, to, 0)
    whole = source.copy()
    np.put_along_axis(whole, to, np.where(free, of, moved).astype(source.dtype), 0)
    return whole


def assign_slots_to_families(pairs: np.ndarray, families: int, slots: int) -> np.ndarray:
    """Assign to each family one slot for all its cells.

    pairs (k, 2): the numbers of each two families that occur in the same cell, the smaller number first. families,
    slots: how many families and how many slots there are. The families get their slots in the order of their numbers;
    each family gets the lowest slot that is free in all its cells.

    Returns
    -------
    np.ndarray
        The slot of each family (families,), int8; −1 for a family without a slot that is free in all its cells.
    """
    order = np.argsort(pairs[:, 1], kind="stable")
    begin = np.searchsorted(pairs[order, 1], np.arange(families + 1)).tolist()
    before = pairs[order, 0].tolist()
    found: list[int] = []
    for number in range(families):
        used = 0
        for other in before[begin[number] : begin[number + 1]]:
            if found[other] >= 0:
                used |= 1 << found[other]
        free = _lowest_free_slot(used)
        found.append(free if free < slots else -1)
    return np.array(found, np.int8)


def assign_slots_in_cells(family: np.ndarray, cell: np.ndarray, slot_of_family: np.ndarray) -> np.ndarray:
    """Return the slots of attractors (k,) within their cells.

    family, cell (k,): the family and the cell of each attractor; the attractors of a cell are sorted by falling basin
    fraction. slot_of_family (k,): the slot of each attractor's family, −1 for none. The first attractor of a family in
    a cell gets the family's slot. Each other attractor, and each attractor whose family has no slot, gets the lowest
    free slot of the cell.

    Returns
    -------
    np.ndarray
        Slot of each attractor.
    """
    slot = np.full(family.size, -1)
    used = np.zeros(int(cell.max(initial=-1)) + 1, np.uint64)  # bit i of a cell is set if its slot i is taken
    named = np.flatnonzero(family != NO_FAMILY)
    _, first = np.unique(family[named].astype(np.int64) * used.size + cell[named], return_index=True)
    first = named[first]  # the first attractor of each family in each cell
    first = first[slot_of_family[first] >= 0]
    slot[first] = slot_of_family[first]
    np.bitwise_or.at(used, cell[first], np.uint64(1) << slot[first].astype(np.uint64))
    for i in np.flatnonzero(slot < 0):
        slot[i] = _lowest_free_slot(int(used[cell[i]]))
        used[cell[i]] |= np.uint64(1 << int(slot[i]))
    return slot


def _lowest_free_slot(used: int) -> int:
    """Return the number of the lowest bit of `used` that is 0; bit i says whether slot i is taken."""
    return (~used & (used + 1)).bit_length() - 1


def create_family_array(root: zarr.Group, request: SurveyRequest, side: int) -> zarr.Array:
    """Create the array of family numbers, one for each slot of each cell, in chunks of `side` × `side` cells."""
    described: dict[str, Any] = {
        "long_name": "number of the family of the attractor, a row of the group families; 0: quiet, -1: none",
        "units": "1",
        "references": REFERENCE,
    }
    lengths = [axis.num for axis in request.third_axis.values()]
    return root.create_array(
        FAMILY,
        shape=(*lengths, request.n_slots, *request.shape),
        dtype=np.int32,
        chunks=(*(1 for _ in lengths), request.n_slots, *(min(side, size) for size in request.shape)),
        compressors=CODECS,
        config=WRITE_ALL_CHUNKS,
        fill_value=NO_FAMILY,
        dimension_names=(*request.third_axis, SLOT, *CELL),
        attributes=described,
    )


def files_of_families(
    request: SurveyRequest, side: int, joined_slices: Mapping[Along, tuple[JoinedFamilies, Any]]
) -> Template:
    """Return the files of the families in a store by key, except the chunks of the array of family numbers.

    Parameters
    ----------
    side : int
        Number of cells along a side of a chunk of the family numbers.
    joined_slices : Mapping[Along, tuple[JoinedFamilies, Any]]
        For each slice, by its index, the families and the `FamilyEdges` with the values of EDGE_VARIABLES.

    Returns
    -------
    Template
        Contents by key.
    """
    kept: dict[str, Buffer] = {}
    root = zarr.create_group(MemoryStore(kept), zarr_format=3)
    create_family_array(root, request, side)
    for along, (joined, edges) in joined_slices.items():
        attributes = {"long_name": "families of attractors", "references": REFERENCE}
        group = create_slice_group(root, request, along).create_group(GROUP, attributes=attributes)
        write_variables(group, FAMILY_VARIABLES, joined)
        write_variables(group, EDGE_VARIABLES, edges)
    return {key: content for key, content in file_contents(kept).items() if key != ROOT}
