"""Tables of arrays: rows taken, joined and sorted as a plain list of rows would be, and kernels' view of them."""

import pickle
from dataclasses import dataclass

import numba
import numpy as np
import pytest

import rattle
from rattle.attractors.samples import Outcome, copy_with_double_capacity, create_orbit_tables
from rattle.numerics import StructOfArrays


@dataclass(frozen=True, eq=False)
class Table(StructOfArrays):
    number: np.ndarray
    weight: np.ndarray


def rows(table: Table) -> list[tuple[int, float]]:
    return list(zip(table.number.tolist(), table.weight.tolist(), strict=True))


@pytest.fixture
def table() -> Table:
    rng = np.random.default_rng(58)
    return Table(rng.integers(0, 4, 50), rng.integers(0, 3, 50) / 2)


def test_rows_are_taken_joined_and_sorted_as_a_list_of_rows(table: Table) -> None:
    chosen = np.array([4, 1, 1, 30])
    assert rows(table.take(chosen)) == [rows(table)[i] for i in chosen]
    assert rows(table.take(table.number == 2)) == [row for row in rows(table) if row[0] == 2]
    assert rows(Table.concat([table, table.take(chosen)])) == rows(table) + [rows(table)[i] for i in chosen]
    assert rows(table.sort("number", "weight")) == sorted(rows(table))
    assert rows(table.sort("weight")) == sorted(rows(table), key=lambda row: row[1])
    assert rows(table.replace(weight=-table.weight)) == [(number, -weight) for number, weight in rows(table)]
    assert list(table.columns()) == ["number", "weight"]


def test_a_table_of_attractors_without_rows_has_the_types_of_one_with_rows() -> None:
    found = rattle.attractors_of([0.6, 0.6], [0.05, 0.1], count=16)
    empty = rattle.AttractorTable.empty()
    assert {name: x.dtype for name, x in empty.columns().items()} == {
        name: x.dtype for name, x in found.columns().items()
    }
    both = rattle.AttractorTable.concat([empty, found])
    assert all(
        np.array_equal(x, y, equal_nan=True)
        for x, y in zip(both.columns().values(), found.columns().values(), strict=True)
    )
    assert set(found.kind.tolist()) <= set(Outcome)
    periodic = np.flatnonzero(found.kind == Outcome.PERIODIC)
    assert all(found.label(i) == (found.m[i], found.n_plus[i], found.n_minus[i]) for i in periodic)


def test_kernels_take_a_table_over_the_same_memory_as_a_type_that_another_process_knows() -> None:
    for known in create_orbit_tables(3, 8, 4):
        taken = known.to_kernel_tuple()
        assert taken._asdict().keys() == known.columns().keys()
        assert all(getattr(taken, name) is x for name, x in known.columns().items())
        kind = numba.typeof(taken)
        assert pickle.loads(pickle.dumps(kind)) == kind
        wider = copy_with_double_capacity(known)
        assert wider.n is known.n
        assert {x.shape[1] / known.columns()[name].shape[1] for name, x in wider.columns().items() if name != "n"} == {
            2.0
        }
