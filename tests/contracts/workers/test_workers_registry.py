"""Every variable of a store: the published schema, attributes that others can read, and values from the registry."""

import warnings
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from written import compute_and_write_tile

import rattle
from gear_rattle.workers import QUANTITIES, Axis, Group, Quantity, SurveyRequest, create_store, open_survey
from gear_rattle.workers.survey.tiles import tiles_of
from gear_rattle.workers.survey.values.quantities import COORDINATES

CELL = ("epsilon", "delta")
ORBIT, SLOT, CURVE = ("orbit", *CELL), ("attractor", *CELL), ("grazing_curve", "delta")

#: The schema that readers rely on: a change here breaks their notebooks.
SCHEMA = {
    "region": (CELL, "int8"),
    "orbit_exists": (ORBIT, "bool"),
    "orbit_stable": (ORBIT, "bool"),
    "orbit_phase": (ORBIT, "float64"),
    "orbit_velocity": (ORBIT, "float64"),
    "orbit_multiplier": (("orbit", "multiplier", *CELL), "complex128"),
    "attractor_kind": (SLOT, "int8"),
    "attractor_m": (SLOT, "int32"),
    "attractor_n_plus": (SLOT, "int32"),
    "attractor_n_minus": (SLOT, "int32"),
    "attractor_contacts": (SLOT, "int32"),
    "attractor_fraction": (SLOT, "float32"),
    "attractor_fraction_upper": (SLOT, "float32"),
    "attractor_lyapunov": (("attractor", "exponent", *CELL), "float64"),
    "attractor_phase": (SLOT, "float64"),
    "attractor_velocity": (SLOT, "float64"),
    "n_attractors": (CELL, "int16"),
    "unlisted_fraction": (CELL, "float32"),
    "watched_periods": (CELL, "float32"),
    "sampled_speed": (CELL, "float64"),
    "quiet_fraction": (CELL, "float32"),
    "periodic_fraction": (CELL, "float32"),
    "chaotic_fraction": (CELL, "float32"),
    "undecided_fraction": (CELL, "float32"),
    "fraction_error": (CELL, "float32"),
    "lyapunov_max": (CELL, "float64"),
    "sum_rule_error": (CELL, "float64"),
    "impulse_balance_error": (CELL, "float64"),
    "basin_entropy": (CELL, "float64"),
    "boundary_basin_entropy": (CELL, "float64"),
    "boundary_distance": (CELL, "float64"),
    "boundary_distance_phase": (CELL, "float64"),
    "crisis_side": (CELL, "int8"),
    **{
        f"{of}_{name}": (dims, "float64")
        for of, dims in (("attractor", SLOT), ("sample", CELL), ("worst", CELL))
        for name in ("impacts_plus", "impacts_minus", "mean_speed", "largest_speed", "energy", "level", "contact")
    },
    **{
        f"attractor_{name}_error": (SLOT, "float64")
        for name in ("impacts_plus", "impacts_minus", "mean_speed", "energy", "contact")
    },
    "sample_energy_error": (CELL, "float64"),
    "worst_energy_error": (CELL, "float64"),
    "status": (CELL, "int8"),
    "grazing_epsilon": (CURVE, "float64"),
    "grazing_phase": (CURVE, "float64"),
    "grazing_multiplier": (("grazing_curve", "multiplier", "delta"), "complex128"),
    "robust_chaos": (("delta",), "bool"),
}
SIZES = {"orbit": 4, "multiplier": 2, "attractor": 8, "exponent": 2, "grazing_curve": 2, "delta": 5, "epsilon": 4}


@pytest.fixture(scope="module")
def request_() -> SurveyRequest:
    return SurveyRequest(
        name="registry",
        delta=Axis(start=0.55, stop=0.765, num=5),
        epsilon=Axis(start=0.05, stop=0.1, num=4),
        quantities=tuple(Group),
        initial_conditions={"count": 6},
        tile={"delta": 2, "epsilon": 3},
    )


@pytest.fixture(scope="module")
def template(request_: SurveyRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("template") / "survey.zarr"
    create_store(request_, path)
    return path


@pytest.fixture(scope="module")
def empty(template: Path) -> xr.Dataset:
    return open_survey(template)


@pytest.fixture(scope="module")
def survey(request_: SurveyRequest, tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    path = tmp_path_factory.mktemp("survey") / "survey.zarr"
    create_store(request_, path)
    for tile in tiles_of(request_):
        compute_and_write_tile(request_, str(path), tile)
    return open_survey(path).load()


def test_the_registry_is_the_schema() -> None:
    assert {quantity.name: (quantity.dims, quantity.dtype) for quantity in QUANTITIES} == SCHEMA


#: Those of the impacting model; `test_workers_inelastic` has those of the inelastic one.
OWN = [quantity for quantity in QUANTITIES if quantity.is_in_model("impacting")]


@pytest.mark.parametrize("quantity", OWN, ids=lambda quantity: quantity.name)
def test_variable_of_an_empty_store(empty: xr.Dataset, quantity: Quantity) -> None:
    variable = empty[quantity.name]
    dims, dtype = SCHEMA[quantity.name]
    assert (variable.dims, variable.dtype) == (dims, np.dtype(dtype))
    assert variable.shape == tuple(SIZES[dim] for dim in dims)
    assert {"long_name", "units", "references"} <= set(variable.attrs)
    assert variable.attrs["units"] == "1"
    if quantity.is_per_cell:
        chunks = variable.encoding["preferred_chunks"]
        assert tuple(chunks[dim] for dim in dims) == (*variable.shape[:-2], 3, 2)
        filled = variable.isnull() if variable.dtype.kind in "fc" else variable == 0
        assert bool(filled.all())


@pytest.mark.parametrize("quantity", OWN, ids=lambda quantity: quantity.name)
def test_variable_of_a_filled_store(survey: xr.Dataset, quantity: Quantity) -> None:
    values = survey[quantity.name]
    if "flag_values" in values.attrs:
        assert len(values.attrs["flag_meanings"].split()) == len(values.attrs["flag_values"])
        assert set(np.unique(values)) <= set(values.attrs["flag_values"])
    # each of these happens somewhere on this grid, so that nothing stays at its fill value
    same = {"status", "undecided_fraction", "unlisted_fraction", "sampled_speed"}
    assert np.unique(values).size > (1 if quantity.name not in same else 0)


@pytest.mark.parametrize("name", COORDINATES)
def test_coordinate(empty: xr.Dataset, name: str) -> None:
    coordinate = empty.coords[name]
    assert coordinate.shape == (SIZES[name],)
    assert coordinate.attrs["long_name"]
    assert coordinate.attrs["units"] == "1"


def test_axes_are_the_computed_values(empty: xr.Dataset, request_: SurveyRequest) -> None:
    assert empty.delta.values.tobytes() == request_.delta.values().tobytes()
    assert empty.epsilon.values.tobytes() == request_.epsilon.values().tobytes()
    assert list(empty.orbit.values) == ["A", "B", "C", "D"]
    assert list(empty.grazing_curve.values) == ["G1", "G2"]


@pytest.mark.parametrize("open_it", [xr.open_zarr, lambda path: xr.open_datatree(path, engine="zarr")])
def test_opens_without_a_warning(template: Path, open_it) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        open_it(template).load()


def test_attributes_tell_where_it_comes_from(template: Path, request_: SurveyRequest) -> None:
    with open_survey(template, as_stored=True) as stored:  # with complex numbers it would not keep the CF conventions
        attributes = stored.attrs
    assert SurveyRequest.model_validate_json(attributes["request"]) == request_
    assert attributes["content_hash"] == request_.content_hash()
    assert attributes["doi"] == "10.1137/090759641"
    assert attributes["title"] == "registry"
    assert {"Conventions", "code_version", "date_created", "source"} <= set(attributes)


@pytest.mark.usefixtures("templates_once")
@pytest.mark.parametrize("group", Group)
def test_only_what_is_asked_for_is_stored(tmp_path: Path, request_: SurveyRequest, group: Group) -> None:
    path = tmp_path / "survey.zarr"
    create_store(request_.model_copy(update={"quantities": (group,)}), path)
    dataset = open_survey(path)
    assert set(dataset.data_vars) == {q.name for q in OWN if q.group == group} | {"status"}
    assert set(dataset.coords) == {dim for name in dataset.data_vars for dim in dataset[name].dims} | {"beta"}


def test_no_stored_number_is_complex(survey: xr.Dataset, template: Path, tmp_path: Path) -> None:
    """Any reader can then read all numbers, and plain xarray can write NetCDF."""
    with xr.open_datatree(template, engine="zarr") as tree:
        stored = {array.dtype.kind for node in tree.subtree for array in node.dataset.variables.values()}
    assert stored <= set("biufOUT")
    with xr.open_zarr(template) as plain:
        plain.to_netcdf(tmp_path / "survey.nc", engine="h5netcdf")
    assert survey.orbit_multiplier.dtype == np.complex128
    wrong = survey.orbit_multiplier.prod("multiplier", skipna=False) - np.exp(-survey.delta)
    assert float(abs(wrong).max()) < 1e-12


def test_complex_numbers_are_read_when_asked_for(survey: xr.Dataset, tmp_path: Path, request_: SurveyRequest) -> None:
    path = tmp_path / "survey.zarr"
    create_store(request_, path)
    with open_survey(path) as lazy:
        compute_and_write_tile(request_, str(path), tiles_of(request_)[0])  # after it was opened
        some = tiles_of(request_)[0]
        here = {"epsilon": some.epsilon, "delta": some.delta}
        np.testing.assert_array_equal(lazy.orbit_multiplier.isel(here), survey.orbit_multiplier.isel(here))
        one = lazy.orbit_multiplier.isel(orbit=[3, 0], multiplier=1, epsilon=0, delta=slice(None, None, 2))
        expected = survey.orbit_multiplier.isel(orbit=[3, 0], multiplier=1, epsilon=0, delta=slice(None, None, 2))
        inside = slice(0, len(range(0, some.delta.stop, 2)))
        np.testing.assert_array_equal(one.values[:, inside], expected.values[:, inside])


def test_parameters_that_all_cells_have_are_coordinates(empty: xr.Dataset, request_: SurveyRequest) -> None:
    assert empty.coords["beta"].shape == ()
    assert float(empty.beta) == request_.beta
    other = empty.assign_coords(beta=0.7)
    assert xr.concat([empty.quiet_fraction, other.quiet_fraction], "beta").beta.values.tolist() == [request_.beta, 0.7]


def test_attributes_tell_on_what_the_last_bits_depend(empty: xr.Dataset) -> None:
    toolchain = rattle.toolchain()
    assert {f"computed_with_{name}": value for name, value in toolchain.items()}.items() <= empty.attrs.items()
    assert toolchain["numpy"] == np.__version__
    assert toolchain["processor_features"]
    assert "CC0-1.0" in empty.attrs["license"]
    assert rattle.__version__ in empty.attrs["citation"]


def test_fractions_add_to_one(survey: xr.Dataset) -> None:
    kinds = ("quiet", "periodic", "chaotic", "undecided")
    total = sum(survey[f"{kind}_fraction"] for kind in kinds)
    assert np.allclose(total, 1, atol=1e-6)
    assert np.all(survey.attractor_fraction.sum("attractor") <= 1 + 1e-6)


def test_sum_rule_holds(survey: xr.Dataset) -> None:
    error = survey.attractor_lyapunov.sum("exponent", skipna=False) + survey.delta
    assert float(abs(error).max()) < 1e-6
    assert float(survey.sum_rule_error.max()) == pytest.approx(float(abs(error).max()))


def test_slots_fall_and_are_empty_beyond_the_attractors(survey: xr.Dataset) -> None:
    assert np.all(np.diff(survey.attractor_fraction, axis=0) <= 0)
    assert np.array_equal((survey.attractor_kind > 0).sum("attractor"), np.minimum(survey.n_attractors, 8))
    assert np.array_equal(survey.attractor_kind == 0, survey.attractor_phase.isnull() & (survey.attractor_kind != 1))
