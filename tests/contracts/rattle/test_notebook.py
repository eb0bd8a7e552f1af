"""The display of results in a notebook, as a line and a table, and in pandas and xarray, against the arrays."""

import inspect
import pickle
import sys
import xml.etree.ElementTree as ElementTree
from typing import Any

import pytest

import rattle
from rattle import stiff

GEAR = rattle.Gear(0.6, 0.089)
A, B, C, D = GEAR.orbits()
BRANCH = rattle.branch(D, "epsilon", (0.088, 0.09), resolution=8)
BASINS = GEAR.basins(20)
TABLE = rattle.attractors_of([0.6, 0.7], [0.1, 0.1], count=8)
G1 = rattle.curves.trace("G1", 0.6, (0.58, 0.6))
STIFF = stiff.StiffGear(0.6, 0.089)
RESULTS = {
    "gear": GEAR,
    "stiff gear": STIFF,
    "orbit": D,
    "motion": GEAR.orbit(D.tau, D.v),
    "branch": BRANCH,
    "basins": BASINS,
    "table": TABLE,
    "curve": G1,
    "attractor": BASINS.attractors[0],
}


def cells_of(html: str) -> list[list[str]]:
    rows = ElementTree.fromstring(html).findall("tbody/tr")
    return [[cell.text or "" for cell in row] for row in rows]


@pytest.mark.parametrize("name", RESULTS)
def test_a_result_is_a_line_and_a_table_of_whole_rows(name: str) -> None:
    result: Any = RESULTS[name]
    assert len(repr(result)) < 350
    assert "\n" not in repr(result)
    rows = cells_of(result._repr_html_())
    assert rows
    assert len({len(row) for row in rows}) == 1


def test_a_gear_shows_its_orbits() -> None:
    rows = cells_of(GEAR._repr_html_())
    assert [row[0] for row in rows] == ["A", "B", "C", "D"]
    assert [row[-1] for row in rows] == ["no", "no", "yes", "no"]
    assert float(rows[3][3]) == pytest.approx(D.v, rel=1e-5)
    assert "region IV" in GEAR._repr_html_()


def test_a_long_table_shows_both_ends() -> None:
    branch = rattle.branch(D, "epsilon", (0.08, 0.1), resolution=20)
    rows = cells_of(branch._repr_html_())
    assert len(branch) > len(rows) == 13
    assert set(rows[6]) == {"…"}
    for shown, point in ((rows[0], 0), (rows[-1], -1)):
        assert float(shown[1]) == pytest.approx(branch.epsilon[point], rel=1e-5)


@pytest.mark.parametrize("branch", [BRANCH, stiff.stiff_branch(STIFF.orbits()[-1], "epsilon", (0.0885, 0.0895), 4)])
def test_a_branch_becomes_a_table_and_labelled_arrays(branch: Any) -> None:
    table, arrays = branch.to_dataframe(), branch.to_xarray()
    assert len(table) == len(branch) == arrays.sizes["point"]
    for name in ("delta", "epsilon", "stable", "admissible"):
        assert (table[name] == getattr(branch, name)).all()
        assert (arrays[name].values == getattr(branch, name)).all()
    assert (arrays.multiplier.values == branch.multipliers).all()
    assert (table.multiplier_2 == branch.multipliers[1]).all()
    assert arrays.speed.shape == branch.speeds.shape == (len(branch), arrays.wall.size)
    orbit = branch.orbit(3)
    assert table.tau[3] == pytest.approx(orbit.tau, abs=1e-12)
    assert table.v[3] == pytest.approx(orbit.v, abs=1e-12)
    assert [*branch.added] == (["kappa"] if isinstance(branch, stiff.StiffBranch) else [])
    for name, values in branch.added.items():
        assert (table[name] == values).all()
        assert (arrays[name].values == values).all()


def test_basins_become_a_labelled_picture() -> None:
    arrays = BASINS.to_xarray()
    assert (arrays.labels.values == BASINS.labels).all()
    assert arrays.labels.dims == ("v", "tau")
    quiet = arrays.labels.attrs["flag_meanings"].split().index("quiet")
    assert float((arrays.labels == quiet).mean()) == pytest.approx(BASINS.attractors[quiet].fraction)
    assert BASINS.to_dataframe().fraction.sum() == pytest.approx(1.0)


def test_a_table_of_attractors_names_their_kinds() -> None:
    table = TABLE.to_dataframe()
    assert set(table.kind) <= set(rattle.KINDS)
    assert table.samples.groupby(table.cell).sum().tolist() == [8, 8]


def test_curves_and_periodic_motions_become_tables() -> None:
    assert (G1.to_dataframe().epsilon == G1.epsilon).all()
    motion = GEAR.orbit(D.tau, D.v)
    assert motion.to_dataframe().wall.tolist() == [1, -1]
    assert (motion.to_dataframe().departure == motion.times).all()


def test_what_is_virtual_on_a_branch_is_called_so() -> None:
    c = next(orbit for orbit in GEAR.orbits() if orbit.name == "C")
    followed = rattle.branch(c, "epsilon", (GEAR.epsilon, 0.25))  # beyond G1, to where C would flip
    graze, flip = followed.events
    assert (str(graze.kind), graze.admissible, str(flip.kind), flip.admissible) == ("GR", True, "PD", False)
    assert "events: GR, PD (virtual); ends" in repr(followed)
    assert rattle.curves.bifurcation_curve(flip).name == "virtual PD of P(1,1,0)"
    assert rattle.curves.bifurcation_curve(graze).name == "GR of P(1,1,1)"


def test_a_diagram_tells_what_happens_where() -> None:
    diagram = rattle.diagram((0.6, 0.055), (0.6, 0.061), steps=3, count=8)
    assert len(repr(diagram)) < 200
    table = diagram.to_dataframe()
    assert table.curve[table.event == "SN"].tolist()[0] == "SN1"
    assert table.epsilon[table.curve == "SN1"].iloc[0] == pytest.approx(rattle.sn1(0.6), rel=1e-12)
    arrays = diagram.to_xarray()
    assert (arrays.tau.values == diagram.points.tau).all()
    assert cells_of(diagram._repr_html_())


def test_a_branch_begins_at_what_orbits_gives() -> None:
    whole = rattle.branch(rattle.periodic_orbit(0.6, 0.089, D.tau, D.v), "epsilon", (0.088, 0.09), resolution=8)
    assert (whole.epsilon == BRANCH.epsilon).all()
    assert (D.delta, D.epsilon, D.beta, D.added) == (0.6, 0.089, 0.6, {})
    assert rattle.continue_to(C, 0.6, 0.0891).epsilon == 0.0891  # type: ignore[union-attr]
    soft = STIFF.orbits()[0]
    assert (soft.delta, soft.epsilon, soft.beta, soft.added) == (0.6, 0.089, 0.6, {"kappa": 1e4})
    with pytest.raises(rattle.ParameterError, match=r"rattle\.stiff\.stiff_branch"):
        rattle.branch(soft)
    with pytest.raises(rattle.ParameterError, match=r"rattle\.branch"):
        stiff.stiff_branch(A)
    with pytest.raises(rattle.ParameterError, match="must be an Orbit"):
        rattle.branch("D")  # type: ignore[arg-type]


@pytest.mark.parametrize("name", [name for name in rattle.__all__ if inspect.isroutine(getattr(rattle, name))])
def test_signatures_can_be_read(name: str) -> None:
    signature = inspect.signature(getattr(rattle, name))
    assert max([len(str(each)) for each in signature.parameters.values()], default=0) <= 90
    assert "Buffer" not in str(signature)


def test_who_has_no_pandas_or_xarray_is_told_which_extra_has(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    monkeypatch.setitem(sys.modules, "xarray", None)
    for ask in (BRANCH.to_dataframe, BRANCH.to_xarray):
        with pytest.raises(rattle.MissingExtraError, match=r"gear-rattle\[workers\]"):
            ask()


def test_attractors_in_a_plain_prompt_are_a_table() -> None:
    """A line for each below the headings; otherwise a tuple like any other."""
    found = GEAR.attractors(32)
    heading, *lines = repr(found).splitlines()
    assert heading.split()[:2] == ["attractor", "fraction"]
    assert "95 % from" in heading
    assert [line.split()[0] for line in lines] == [each.name for each in found]
    assert float(lines[0].split()[1]) == pytest.approx(found[0].fraction, rel=1e-5)
    assert len(repr(found)) < 150 * (len(found) + 1)
    assert isinstance(found, tuple)
    assert found == tuple(found)
    assert hash(found[1:]) == hash(tuple(found)[1:])
    again = pickle.loads(pickle.dumps(found))
    assert repr(again) == repr(found)
    assert len(cells_of(found._repr_html_())) == len(found)
