"""`rattle export` writes the files that a service gives for download, and leaves nothing behind where it cannot."""

from pathlib import Path

import numpy as np
import pandas
import pytest
import xarray as xr
from typer.testing import CliRunner

from gear_rattle.service.cli import app
from gear_rattle.workers import SurveyRequest, open_survey, run_survey
from gear_rattle.workers.storage.store import open_groups

REQUEST = SurveyRequest(
    delta={"start": 0.55, "stop": 0.65, "num": 4},
    epsilon={"start": 0.05, "stop": 0.1, "num": 3},
    initial_conditions={"count": 8},
)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("export") / "survey.zarr"
    run_survey(REQUEST, out=path).close()
    return path


def export(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["export", *map(str, arguments)])
    return result.exit_code, result.output + str(result.exception or "")


def test_netcdf_has_every_number_and_the_groups(store: Path, tmp_path: Path) -> None:
    out = tmp_path / "survey.nc"
    code, said = export(store, out)
    assert code == 0, said
    with open_survey(store, as_stored=True) as survey, xr.open_dataset(out, engine="h5netcdf") as found:
        for name, values in survey.data_vars.items():
            np.testing.assert_array_equal(found[name].values, values.values)
    for group in open_groups(store):
        with xr.open_dataset(out, engine="h5netcdf", group=group) as found:
            assert found.variables


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_a_table_has_a_row_for_each_cell(store: Path, tmp_path: Path, ending: str) -> None:
    out = tmp_path / f"survey{ending}"
    code, said = export(store, out)
    assert code == 0, said
    table = pandas.read_csv(out) if ending == ".csv" else pandas.read_parquet(out)
    with open_survey(store) as survey:
        assert len(table) == survey.sizes["delta"] * survey.sizes["epsilon"]
        np.testing.assert_allclose(table.quiet_fraction, survey.quiet_fraction.values.ravel(), rtol=1e-6)
        np.testing.assert_array_equal(table.region, survey.region.values.ravel())


def test_a_row_for_each_attractor(store: Path, tmp_path: Path) -> None:
    out = tmp_path / "attractors.csv"
    assert export(store, out, "--form", "attractors")[0] == 0
    with open_survey(store) as survey:
        assert len(pandas.read_csv(out)) == int((survey.attractor_kind.values > 0).sum())


@pytest.mark.parametrize(
    ("out", "options", "message"),
    [
        ("survey.txt", (), "must end in"),
        ("survey.csv", ("--form", "rows"), "use one of cells"),
        ("no/such/directory/survey.csv", (), "cannot be written"),
    ],
)
def test_what_cannot_be_written_is_refused(
    store: Path, tmp_path: Path, out: str, options: tuple[str, ...], message: str
) -> None:
    code, said = export(store, tmp_path / out, *options)
    assert code != 0
    assert message in said.replace("\n", " ")
    assert not list(tmp_path.iterdir())


def test_what_is_no_survey_leaves_an_older_file_as_it_was(tmp_path: Path) -> None:
    (tmp_path / "survey.csv").write_text("mine")
    code, said = export(tmp_path / "nothing.zarr", tmp_path / "survey.csv")
    assert code != 0
    assert "nothing.zarr" in said
    code, said = export("http://127.0.0.1:8000/v1/surveys/ab/store", tmp_path / "survey.csv")
    assert code != 0
    assert "download" in said
    assert (tmp_path / "survey.csv").read_text() == "mine"
