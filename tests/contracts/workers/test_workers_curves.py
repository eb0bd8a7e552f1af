"""The groups of a store beside its cells: every curve as the library traces it, and the points where curves meet."""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import zarr
from depth import deep

from gear_rattle.workers import Axis, SurveyRequest, create_store
from gear_rattle.workers.survey.plane_curves import CURVE_VARIABLES, POINT_VARIABLES
from rattle import curves
from rattle.continuation import arclength
from rattle.numerics.complex_step import Array, Function

REQUEST = SurveyRequest(
    delta=Axis(start=0.45, stop=0.85, num=9),
    epsilon=Axis(start=0.05, stop=0.25, num=6),
    quantities=("region", "orbits"),
)


def template(path: Path, **changes: object) -> xr.DataTree:
    request = SurveyRequest.model_validate(REQUEST.model_dump() | changes)
    create_store(request, path / "survey.zarr")
    return xr.open_datatree(path / "survey.zarr", engine="zarr")


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("survey")


@pytest.fixture(scope="module")
def tree(path: Path) -> xr.DataTree:
    return template(path)


def test_every_curve_of_the_library_is_a_group(tree: xr.DataTree) -> None:
    assert set(tree["curves"].children) == set(curves.NAMES)
    assert tree["curves"].attrs["beta"] == 0.6
    assert tree["curves"].attrs["window_delta"] == pytest.approx([0.425, 0.875])  # half a cell around the axes
    assert tree["curves"].attrs["window_epsilon"] == pytest.approx([0.03, 0.27])


def test_readers_without_text_find_every_text_in_an_attribute(tmp_path: Path) -> None:
    create_store(REQUEST, tmp_path / "survey.zarr")
    members = dict(zarr.open_group(tmp_path / "survey.zarr", mode="r").members(max_depth=None))
    texts = {path: each for path, each in members.items() if isinstance(each, zarr.Array) and each.dtype.kind == "T"}
    assert {path.rpartition("/")[2] for path in texts} >= {"point", "meaning", "end_reason", "pair_first", "orbit"}
    for path, each in texts.items():
        assert json.loads(str(each.attrs["texts"])) == np.asarray(each[...]).tolist(), path


@pytest.mark.parametrize("name", curves.NAMES)
def test_a_group_is_what_the_library_traces(tree: xr.DataTree, name: str) -> None:
    group, window = tree["curves"][name], tree["curves"].attrs
    curve = curves.trace(name, 0.6, tuple(window["window_delta"]), tuple(window["window_epsilon"]))
    assert len(curve)
    assert curves.describe(name) in group.attrs["long_name"]
    assert "comment" not in group.attrs
    expected = {
        "point_delta": curve.delta,
        "point_epsilon": curve.epsilon,
        "phase": curve.tau,
        "velocity": curve.v,
        "point_multiplier_real": curve.multipliers.real,
        "point_multiplier_imag": curve.multipliers.imag,
        "arclength": curve.arclength,
        "piece": curve.piece,
        "fold": np.isin(np.arange(len(curve)), curve.folds),
        "end_point": [end.index for end in curve.ends],
        "end_reason": [end.reason for end in curve.ends],
    }
    assert set(group.data_vars) == set(expected)
    for variable, values in expected.items():
        np.testing.assert_array_equal(group[variable], values)
    assert group["point_multiplier_real"].dims == ("multiplier", "point")
    assert group["point_multiplier_imag"].sel(multiplier=1).dims == ("point",)


@pytest.mark.parametrize("group", [*(f"curves/{name}" for name in curves.NAMES), "codimension_two"])
def test_a_group_can_be_read_alone_and_its_names_hide_no_coordinate(tree: xr.DataTree, path: Path, group: str) -> None:
    alone = xr.open_zarr(path / "survey.zarr", group=group).load()
    assert not {"delta", "epsilon", "multiplier"} & set(alone.data_vars)
    for name, variable in alone.data_vars.items():
        assert variable.attrs["long_name"]
        assert variable.attrs["units"] == "1"
        np.testing.assert_array_equal(variable, tree[group][name])
    assert alone["point_delta"].dims == ("point",)


def test_a_curve_goes_through_the_cells_on_the_border(tree: xr.DataTree) -> None:
    quiet = tree["curves/quiet_limit"]
    assert float(quiet["point_delta"].min()) == pytest.approx(0.425)
    assert str(quiet["end_reason"][0].item()).startswith("window")
    g1 = tree["curves/G1"]
    assert float(g1["point_epsilon"].max()) > 0.25
    assert "COD22" in str(g1["end_reason"][-1].item())


def test_points_with_their_curves_and_tangencies(tree: xr.DataTree) -> None:
    group = tree["codimension_two"]
    points = curves.codimension_two(0.6)
    assert list(group["point"].values) == [point.name for point in points] == ["COD20", "COD21", "COD23", "COD22"]
    for point in points:
        stored = group.to_dataset(inherit=False).sel(point=point.name)
        assert (stored["point_delta"], stored["point_epsilon"]) == (point.delta, point.epsilon)
        assert stored["curves"].item().split() == list(point.curves)
        assert stored["meaning"] == point.meaning
    pairs = group.to_dataset(inherit=False)[["pair_point", "pair_first", "pair_second", "pair_tangency"]].to_dataframe()
    measured = {(row.pair_point, row.pair_first, row.pair_second): row.pair_tangency for row in pairs.itertuples()}
    assert measured == {(p.name, *pair): order for p in points for pair, order in p.tangency.items()}


def test_another_backlash_has_its_own_curves(tree: xr.DataTree, tmp_path: Path) -> None:
    other = template(tmp_path, beta=0.5)
    cod22 = {point.name: point.delta for point in curves.codimension_two(0.5)}["COD22"]
    assert float(other["curves/SN1/point_delta"].max()) == pytest.approx(cod22, abs=1e-9)
    assert float(tree["curves/SN1/point_delta"].max()) > cod22 + 0.1
    assert list(other["codimension_two/point"].values) == ["COD20", "COD21", "COD23", "COD22"]


def test_the_bytes_of_a_store_follow_from_its_request(path: Path, tree: xr.DataTree, tmp_path: Path) -> None:
    template(tmp_path)

    def content(store: Path) -> dict[str, bytes]:
        files = (file for group in ("curves", "codimension_two") for file in (store / group).rglob("*"))
        return {str(file.relative_to(store)): file.read_bytes() for file in files if file.is_file()}

    assert tree.children
    assert content(tmp_path / "survey.zarr") == content(path / "survey.zarr")


HUGE, TINY = {"start": 0.5, "stop": 1e300, "num": 5}, {"start": 0.1, "stop": 0.1 + 1e-9, "num": 5}
DEGENERATE = {
    "huge": {"delta": HUGE, "epsilon": HUGE},
    "largest": {"delta": HUGE | {"stop": 1.79e308}, "epsilon": HUGE | {"start": 1e307, "stop": 1.79e308}},
    "wide": {"delta": HUGE | {"stop": 1e6 - 1e5}, "epsilon": HUGE | {"stop": 50.0}},
    "tiny": {"delta": {"start": 0.6, "stop": 0.6 + 1e-9, "num": 5}, "epsilon": TINY},
    "nearly undamped": {"delta": {"start": 1e-9, "stop": 2e-9, "num": 5}},
    "from no damping": {"delta": {"start": 5e-324, "stop": 1.0, "num": 5}},
    "small backlash": {"beta": 1e-3},
    "large backlash": {"beta": 1e3},
    "no backlash": {"beta": 5e-324},
    "endless backlash": {"beta": 1.7e308},
}


MOST_EVALUATIONS = 5000  # of a curve's equations: REQUEST needs 3100


#: Of each of these another goes further, or is asked for below.
MILDER = {"huge", "nearly undamped"}


@pytest.mark.parametrize(
    "changes",
    [pytest.param(each, id=name, marks=deep if name in MILDER else ()) for name, each in DEGENERATE.items()],
)
def test_degenerate_requests_cost_no_more_than_others_and_say_what_is_missing(
    tmp_path: Path, changes: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    evaluations, derivatives = 0, arclength.value_and_jacobian

    def counted(equations: Function, x: Array) -> tuple[Array, Array]:
        nonlocal evaluations
        evaluations += x.size // x.shape[-1]
        assert evaluations <= MOST_EVALUATIONS
        return derivatives(equations, x)

    monkeypatch.setattr(arclength, "value_and_jacobian", counted)
    tree = template(tmp_path, **changes)
    for name in curves.NAMES:
        group = tree["curves"][name].load()
        for variable in (part for each in CURVE_VARIABLES for part in each.parts):
            assert group[variable.name].dims == variable.dims
        if not group.sizes["point"]:
            assert "window" in group.attrs["comment"] or "not traced: " in group.attrs["comment"]
        assert np.all(np.isfinite(group["point_epsilon"]))
    points = tree["codimension_two"].load()
    assert {variable.name for variable in POINT_VARIABLES} <= set(points.variables)


def test_a_curve_that_cannot_be_traced_says_why(tmp_path: Path) -> None:
    sn1 = template(tmp_path, **DEGENERATE["huge"])["curves/SN1"]
    assert sn1.sizes["point"] == sn1.sizes["end"] == 0
    assert sn1.attrs["comment"].startswith("not traced: delta must be within")
