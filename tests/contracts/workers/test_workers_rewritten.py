"""A dataset that was opened from a store is written again, in other chunks and formats, without a word of encodings."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from gear_rattle import split_complex
from gear_rattle.workers import SurveyRequest, create_store, open_survey, run_tiles_in_this_process, tiles_of
from gear_rattle.workers.storage.export import table_bands, write_netcdf, write_parquet
from gear_rattle.workers.survey.values.schema import RowForm

REQUEST = SurveyRequest(
    delta=(0.1, 0.7, 4),  # from complex multipliers to real ones
    epsilon=(0.05, 0.2, 4),
    quantities=("region", "orbits", "grazing"),
    tile={"delta": 2, "epsilon": 2},
)
PARTS: dict[str, Callable[[xr.Dataset], xr.Dataset]] = {
    "as it is": lambda survey: survey,
    "other chunks": lambda survey: survey.chunk({"delta": 3, "epsilon": 4}),
    "a part": lambda survey: survey.isel(delta=slice(1, 4)),
    "in memory": lambda survey: survey.load(),
}


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rewritten") / "survey.zarr"
    create_store(REQUEST, path)
    run_tiles_in_this_process(REQUEST, path, tiles_of(REQUEST), lambda _: None, lambda: False)
    return path


def opened(store: Path, how: str) -> xr.Dataset:
    """Open a store with our function, or as xarray recommends for stores that are written in other chunks."""
    return open_survey(store) if how == "ours" else xr.open_zarr(store, chunks=None).drop_encoding()


@pytest.mark.filterwarnings("ignore::zarr.errors.ZarrUserWarning")
@pytest.mark.filterwarnings("ignore::zarr.errors.UnstableSpecificationWarning")
@pytest.mark.parametrize("zarr_format", [2, 3])
@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("how", ["ours", "plain"])
def test_zarr(store: Path, tmp_path: Path, how: str, part: str, zarr_format: Any) -> None:
    with opened(store, how) as survey:
        meant = PARTS[part](survey)
        meant.to_zarr(tmp_path / "again.zarr", zarr_format=zarr_format)
        with xr.open_zarr(tmp_path / "again.zarr") as again:
            xr.testing.assert_equal(again.load(), meant.load())


@pytest.mark.parametrize("part", PARTS)
def test_netcdf_keeps_complex_numbers_and_types(store: Path, tmp_path: Path, part: str) -> None:
    """The imaginary part was lost: the encoding of a part said float64."""
    with open_survey(store) as survey:
        meant = PARTS[part](survey)
        meant.to_netcdf(tmp_path / "again.nc", engine="h5netcdf")
        with xr.open_dataset(tmp_path / "again.nc", engine="h5netcdf") as again:
            xr.testing.assert_equal(again.load(), meant.load())
            assert np.nanmax(np.abs(again["orbit_multiplier"].values.imag)) > 0
            assert again["region"].attrs["flag_values"].dtype == again["region"].dtype == np.int8
            assert "_FillValue" not in again["delta"].encoding


def test_complex_numbers_in_two_parts_are_those_of_the_store(store: Path) -> None:
    with open_survey(store) as survey, open_survey(store, as_stored=True) as stored:
        split = split_complex(survey)
        assert set(split.variables) == set(stored.variables)
        xr.testing.assert_equal(split.load(), stored.load())
        assert split.attrs == stored.attrs
        assert split["orbit_multiplier_imag"].attrs["long_name"] == stored["orbit_multiplier_imag"].attrs["long_name"]
        assert "Conventions" not in survey.attrs  # CF knows no complex numbers


@pytest.mark.parametrize("form", [RowForm.ORBITS, RowForm.CELLS])
def test_a_store_with_complex_numbers_is_a_table_too(store: Path, form: RowForm) -> None:
    """Older versions stored them: Parquet of these was an error of the service."""
    parquet = pytest.importorskip("pyarrow.parquet")
    with open_survey(store) as old, open_survey(store, as_stored=True) as stored:
        with write_parquet(old, form) as file:
            found = parquet.read_table(file).to_pydict()
        for columns in table_bands(stored, form):
            assert set(columns) == set(found)
            for name in columns:
                np.testing.assert_array_equal(columns[name], np.array(found[name])[: len(columns[name])])
            break
        with write_netcdf(old) as file, xr.open_dataset(file, engine="h5netcdf") as whole:
            np.testing.assert_array_equal(whole["orbit_multiplier_imag"], stored["orbit_multiplier_imag"])
