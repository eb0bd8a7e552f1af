"""Surveys with a third axis: each slice is, bit for bit, the survey of its plane, wherever a survey is taken."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from depth import deep
from pydantic import ValidationError
from written import write_tile

from gear_rattle.workers import (
    Axis,
    SurveyError,
    SurveyRequest,
    compute_tile,
    create_store,
    examine,
    finish_store,
    join_attractors_of_survey,
    open_family,
    open_survey,
    run_survey,
    tiles_done,
    tiles_of,
)
from gear_rattle.workers.boundaries.explain import explain
from gear_rattle.workers.certificates import IDENTITY_ATTRIBUTE, certify_survey
from gear_rattle.workers.kinds import position_of_failed_cell
from gear_rattle.workers.pictures.figure import survey_figure
from gear_rattle.workers.pictures.maps import render_map_picture
from gear_rattle.workers.storage.export import csv_lines, require_readable_variables, table_bands, write_netcdf
from gear_rattle.workers.storage.integrity import read_manifest
from gear_rattle.workers.storage.location import place_of
from gear_rattle.workers.storage.store import open_groups
from gear_rattle.workers.survey import tiles as computing
from gear_rattle.workers.survey.request import MAX_SLICES
from gear_rattle.workers.survey.slices import select_slice, slices_of, surveyed_model
from gear_rattle.workers.survey.values.schema import RowForm
from rattle.models import Stiff

AXES: dict[str, Any] = {"delta": (0.5, 0.8, 4), "epsilon": (0.05, 0.15, 3)}
FIELDS: dict[str, Any] = {
    **AXES,
    "initial_conditions": {"count": 4},
    "quantities": ("region", "orbits", "attractors", "lyapunov", "grazing", "families"),
    "tile": {"delta": 3, "epsilon": 2},
}
BETAS = (0.6, 0.7, 2)
REQUEST = SurveyRequest(**FIELDS, beta=BETAS)

pytestmark = pytest.mark.usefixtures("templates_once")


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("third") / "survey.zarr"
    run_survey(REQUEST, out=path)
    return path


@pytest.fixture(scope="module")
def planes(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The surveys of the planes, each by itself."""
    paths = [tmp_path_factory.mktemp("plane") / "survey.zarr" for _ in range(BETAS[2])]
    for path, beta in zip(paths, np.linspace(*BETAS), strict=True):
        run_survey(**FIELDS, beta=float(beta), out=path)
    return paths


def assert_same_bits(found: xr.Dataset, expected: xr.Dataset) -> None:
    assert set(found.variables) == set(expected.variables)
    for name, values in expected.variables.items():
        assert (found[name].dims, found[name].dtype) == (values.dims, values.dtype), name
        xr.testing.assert_identical(found[name].variable, values)
        if values.dtype.kind == "T":
            assert found[name].values.tolist() == values.values.tolist(), name
        else:
            assert found[name].values.tobytes() == values.values.tobytes(), name


def test_a_slice_is_the_survey_of_its_plane(store: Path, planes: list[Path]) -> None:
    with open_survey(store) as whole:
        assert whole.sizes["beta"] == BETAS[2]
        assert whole.beta.values.tolist() == np.linspace(*BETAS).tolist()
        assert whole["orbit_phase"].dims == ("beta", "orbit", "epsilon", "delta")
        assert whole["robust_chaos"].dims == ("beta", "delta")
        for number, path in enumerate(planes):
            with open_survey(path) as plane:
                assert_same_bits(whole.isel(beta=number), plane)
                assert surveyed_model(whole.isel(beta=number)) == surveyed_model(plane)
            groups, own = open_groups(store), open_groups(path)
            assert {"curves/SN1", "codimension_two", "families"} <= own.keys()
            for name, group in own.items():
                assert_same_bits(groups[f"slices/{number}/{name}"], group)


def test_stiffness_may_be_the_third_axis() -> None:
    fields = AXES | {"model": "stiff", "quantities": ("orbits",)}
    request = SurveyRequest(**fields, kappa=(1e3, 1e4, 2))
    assert [each.gear_model for each in request.slices.values()] == [Stiff(0.6, 1e3), Stiff(0.6, 1e4)]
    (last,) = (tile for tile in tiles_of(request) if tile.along == (1,))
    plain = SurveyRequest(**fields, kappa=1e4)
    found, expected = compute_tile(request, last)[0], compute_tile(plain, tiles_of(plain)[0])[0]
    assert found.keys() == expected.keys()
    assert all(values.tobytes() == expected[name].tobytes() for name, values in found.items())
    assert "kappa 10000.0" in computing.tile_name(request, last)


@deep
def test_tiles_of_any_shape_and_order_make_the_same_store(store: Path, tmp_path: Path) -> None:
    request = REQUEST.model_copy(update={"tile": SurveyRequest(**FIELDS | {"tile": {"delta": 2, "epsilon": 3}}).tile})
    create_store(request, tmp_path / "s.zarr")
    tiles = tiles_of(request)
    assert [tile.index for tile in tiles] == list(range(request.n_tiles))
    assert request.n_tiles == 4
    assert sum(tile.n_cells for tile in tiles) == request.n_cells == 24
    for tile in reversed(tiles[1:]):
        write_tile(request, str(tmp_path / "s.zarr"), tile, compute_tile(request, tile)[0])
    assert tiles_done(request, tmp_path / "s.zarr") == {1, 2, 3}
    with pytest.raises(SurveyError, match="lacks 1 of its 4 tiles"):
        finish_store(tmp_path / "s.zarr")
    write_tile(request, str(tmp_path / "s.zarr"), tiles[0], compute_tile(request, tiles[0])[0])
    with place_of(tmp_path / "s.zarr").lock_for_writing():
        join_attractors_of_survey(request, tmp_path / "s.zarr")
    finish_store(tmp_path / "s.zarr")
    with open_survey(store) as expected, open_survey(tmp_path / "s.zarr") as found:
        assert_same_bits(found, expected)


def test_what_is_damaged_is_found_in_its_slice_and_repaired(store: Path, tmp_path: Path) -> None:
    copy = tmp_path / "s.zarr"
    with open_survey(store) as expected:
        shutil.copytree(store, copy)
        whole = (copy / "attractor_phase/c/1/0/0/1").read_bytes()
        (copy / "attractor_phase/c/1/0/0/1").write_bytes(
            (copy / "attractor_phase/c/0/0/0/1").read_bytes()
        )  # of another slice
        assert examine(copy).damaged == {5: ("attractor_phase",)}
        (copy / "slices/1/curves/SN1/point_delta/c/0").unlink()
        assert examine(copy).template == ("slices/1/curves/SN1/point_delta/c/0",)
        run_survey(REQUEST, out=copy)
        assert (copy / "attractor_phase/c/1/0/0/1").read_bytes() == whole
        assert examine(copy).is_whole
        with open_survey(copy) as found:
            assert_same_bits(found, expected)


def test_every_file_of_a_tile_is_known_by_its_key(store: Path) -> None:
    manifest = read_manifest(place_of(store))
    assert manifest is not None
    assert (manifest.grid, manifest.slices, manifest.tile_rows_per_slice) == ((4, 2), 2, 2)
    for index in range(8):
        keys = manifest.chunk_keys(index)
        assert all((store / key).exists() for key in keys.values())
        assert {manifest.tile_index_of(key) for key in keys.values()} == {index}
    for key in ("region/c/2/0/0", "region/c/0/2/0", "region/c/0/0", "region/c/-1/0/0"):
        assert manifest.tile_index_of(key) is None, key


def test_a_cell_that_fails_is_named_with_its_slice(monkeypatch: pytest.MonkeyPatch) -> None:
    evaluate = computing._evaluate_cells_of_survey

    def fails(request: SurveyRequest, cells: Any) -> Any:
        if cells.model.beta == 0.7 and 0.15 in cells.epsilon:
            raise ArithmeticError("broken")
        return evaluate(request, cells)

    monkeypatch.setattr(computing, "_evaluate_cells_of_survey", fails)
    request = SurveyRequest(**AXES, beta=BETAS, quantities=("region",))
    *_, last = tiles_of(request)
    _, record = compute_tile(request, last)
    places = [position_of_failed_cell(request, i, j) for i, j, _ in record.failed_cells]
    assert places == [{"beta": 1, "epsilon": 2, "delta": j} for j in range(4)]


def test_tables_and_files_have_all_slices(store: Path, planes: list[Path], tmp_path: Path) -> None:
    with open_survey(store, as_stored=True) as whole:
        require_readable_variables(whole)
        for form in RowForm:
            parts = []
            for path in planes:
                with open_survey(path, as_stored=True) as plane:
                    parts.append(list(csv_lines(plane, form)))
            head, *rows = "".join(csv_lines(whole, form)).splitlines()
            assert [head, *rows] == [head, *(row for part in parts for row in "".join(part).splitlines()[1:])]
        assert np.unique(np.concatenate([band["beta"] for band in table_bands(whole)])).tolist() == [0.6, 0.7]
        groups = {name: group for name, group in open_groups(store).items() if name.endswith("SN1")}
        with write_netcdf(whole, groups) as file:
            (tmp_path / "s.nc").write_bytes(file.read())
        with xr.open_dataset(tmp_path / "s.nc", engine="h5netcdf") as found:
            assert (found["region"].values == whole["region"].values).all()
            assert found["region"].dims == ("beta", "epsilon", "delta")
        with xr.open_dataset(tmp_path / "s.nc", engine="h5netcdf", group="slices/1/curves/SN1") as curve:
            assert curve.point_delta.size > 3


def test_what_is_of_a_plane_asks_for_a_slice(store: Path, tmp_path: Path) -> None:
    with open_survey(store) as whole:
        for ask in (
            lambda: render_map_picture(whole, "region"),
            lambda: survey_figure(whole),
            lambda: explain(whole),
            lambda: certify_survey(whole, tmp_path / "c.zarr"),
            lambda: open_family(store, 0),
            lambda: select_slice(whole, 2),
        ):
            with pytest.raises(SurveyError, match="2 values of beta: choose a slice from 0 to 1"):
                ask()
        assert render_map_picture(select_slice(whole, 0), "region") != render_map_picture(
            select_slice(whole, 1), "region"
        )
        assert [each.beta.item() for each in slices_of(whole)] == [0.6, 0.7]
    with pytest.raises(SurveyError, match="choose one of its slices"):
        _ = REQUEST.gear_model


def test_a_plane_has_no_slices(planes: list[Path]) -> None:
    with open_survey(planes[0]) as plane, pytest.raises(SurveyError, match="no third axis: leave slice out"):
        select_slice(plane, 0)


def test_families_are_of_a_slice(store: Path, planes: list[Path]) -> None:
    for number, path in enumerate(planes):
        xr.testing.assert_identical(open_family(store, 0, number), open_family(path, 0))


def test_certificates_of_slices_are_told_apart(store: Path, tmp_path: Path) -> None:
    with open_survey(store) as whole:
        one, other = (select_slice(whole, number).isel(epsilon=slice(2, 3)) for number in (0, 1))
        proved = certify_survey(one, tmp_path / "c.zarr")
        assert (proved["attractor_certificate"].values == (one.attractor_kind == 2).values).all()
        assert proved.attrs[IDENTITY_ATTRIBUTE].endswith(" beta=0.6")
        with pytest.raises(SurveyError, match="no readable certificates of this survey"):
            certify_survey(other, tmp_path / "c.zarr")


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"beta": (0.0, 0.5, 3)}, "beta must be positive: raise start"),
        ({"model": "inelastic", "restitution": 0.9, "load": (-1.0, 1.0, 3)}, "load must not be negative: raise start"),
        ({"beta": (0.5, 0.6, MAX_SLICES + 1)}, f"at most {MAX_SLICES} values: lower num"),
        ({"beta": (0.5, 0.5 + 1e-17, 2)}, "must be below stop"),
        ({"beta": (0.5, 0.5 + 2e-16, 9)}, "not distinct: lower num"),
        ({"beta": {"start": 0.5, "stop": "x", "num": 3}}, "stop: must be a number, got .x."),
        ({"beta": "x"}, "must be a number, got .x."),
        ({"beta": -1.0}, "must be greater than 0.0, got -1.0"),
        ({"kappa": (1e3, 1e4, 2)}, "only the stiff model has kappa"),
        ({"model": "stiff", "beta": (0.5, 0.6, 2), "kappa": (1e3, 1e4, 2)}, "one third axis"),
        ({"model": "stiff", "kappa": (1e3, 1e9, 2)}, "kappa must be at most 1e.08: lower stop"),
    ],
)
def test_third_axes_that_cannot_be_meant(fields: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError) as error:
        SurveyRequest(**AXES, **fields)
    (first,) = error.value.errors()
    with pytest.raises(ValueError, match=said):
        raise ValueError(first["msg"])


def test_a_machine_has_one_half_backlash() -> None:
    machine = {"inertia": 0.003, "drag": 0.0015, "backlash": 0.0003, "radius": 0.05}
    with pytest.raises(ValidationError, match="leave beta out"):
        SurveyRequest(**AXES, machine=machine, beta=BETAS)


def test_all_slices_are_sampled_alike_and_counted() -> None:
    request = SurveyRequest(**AXES, beta=(0.6, 1.3, 8))  # to beyond the paper's plane
    assert request.v_max == "natural"
    assert {each.v_max for each in request.slices.values()} == {"natural"}
    assert (request.n_cells, request.n_slices, request.third_axis_name) == (96, 8, "beta")
    assert SurveyRequest(**AXES).slices == {(): SurveyRequest(**AXES)}
    assert request.content_hash() != SurveyRequest(**AXES).content_hash()
    assert request.model_dump(mode="json")["beta"] == {"start": 0.6, "stop": 1.3, "num": 8}
    assert SurveyRequest.model_validate(request.model_dump(mode="json")) == request
    assert Axis.parse("0.6:1.3:8") == request.beta
