"""The edges of families lie on the curves that make or end their motions."""

from functools import cache

import numpy as np
import pytest

import rattle
from gear_rattle.workers.boundaries.edges import FamilyEdges, count_edges, find_edges_in_part
from gear_rattle.workers.survey.crossings import CurveCrossings, find_curve_crossings
from rattle import curves
from rattle.families.family_table import Families
from rattle.families.spread import CellRectangle

DELTA, EPSILON = np.linspace(0.55, 0.65, 19), np.linspace(0.05, 0.08, 23)
WINDOW = (0.54, 0.66), (0.045, 0.085)


@pytest.fixture(scope="module")
def families() -> Families:
    return rattle.families_of(DELTA, EPSILON, count=8)


@cache
def crossings_on(name: str) -> CurveCrossings:
    curve = curves.trace(name, 0.6, *WINDOW)
    return find_curve_crossings((curve.delta, curve.epsilon, curve.piece), DELTA, EPSILON)


def found_in(families: Families, names: tuple[str, ...], side: int) -> FamilyEdges:
    """The edges of families, found in parts of so many cells a side."""
    crossings = [crossings_on(name) for name in names]
    rows = families.attractors
    parts = [
        CellRectangle(i, min(i + side, EPSILON.size), j, min(j + side, DELTA.size))
        for i in range(0, EPSILON.size, side)
        for j in range(0, DELTA.size, side)
    ]
    ends = (find_edges_in_part(part, DELTA.size, rows.cell, families.family, crossings) for part in parts)
    return count_edges(ends, np.arange(families.table.cells.size), families.table, names)


@pytest.fixture(scope="module")
def edges(families: Families) -> FamilyEdges:
    return found_in(families, tuple(curves.NAMES), 64)


def pairs_of(inside: np.ndarray) -> int:
    """Neighbours of which one is inside."""
    return int((inside[1:] != inside[:-1]).sum() + (inside[:, 1:] != inside[:, :-1]).sum())


def number_of(families: Families, label: tuple[int, int, int]) -> int:
    labels = list(zip(families.table.m, families.table.n_plus, families.table.n_minus, strict=True))
    return labels.index(label)


def test_c_is_born_on_sn1_as_the_closed_form_says(families: Families, edges: FamilyEdges) -> None:
    number, above = number_of(families, (1, 1, 0)), EPSILON[:, None] > rattle.sn1(DELTA)
    assert edges.n_edges[number] == pairs_of(above) > 20
    assert dict(zip(edges.names, edges.n_edges_on_curve[number], strict=True)) == {
        name: pairs_of(above) if name == "SN1" else 0 for name in curves.NAMES
    }


def test_d_is_born_on_sn2_and_lost_on_pd1(families: Families, edges: FamilyEdges) -> None:
    number, found = number_of(families, (1, 1, 1)), rattle.period_one(DELTA, EPSILON[:, None])
    on = dict(zip(edges.names, edges.n_edges_on_curve[number], strict=True))
    assert edges.n_edges[number] == pairs_of(found.stable[3]) == on["SN2"] + on["PD1"]
    assert on["SN2"] == pairs_of(found.exists[3])
    doubled = number_of(families, (2, 2, 2))
    assert 0 < edges.n_edges_on_curve[doubled][edges.names.index("PD1")] <= on["PD1"]


def test_chaos_is_on_no_curve_of_periodic_motions(families: Families, edges: FamilyEdges) -> None:
    assert not edges.n_edges_on_curve[families.table.kind == rattle.KINDS.index("chaotic")].any()


def test_cells_that_are_not_known_have_no_edges(families: Families) -> None:
    """A cell that failed lists nothing: its neighbours' families do not end there."""
    rows = families.attractors
    middle = (EPSILON.size // 2) * DELTA.size + DELTA.size // 2
    kept = rows.cell != middle
    attractors = rows.take(kept)
    without = Families(DELTA, EPSILON, 8, attractors, families.entered[kept], families.family[kept], families.table)
    assert np.all(found_in(without, (), 64).n_edges <= found_in(families, (), 64).n_edges)


@pytest.mark.parametrize("side", [3, 8])
def test_parts_do_not_show(families: Families, edges: FamilyEdges, side: int) -> None:
    parts = found_in(families, tuple(curves.NAMES), side)
    assert np.array_equal(parts.n_edges, edges.n_edges)
    assert np.array_equal(parts.n_edges_on_curve, edges.n_edges_on_curve)
