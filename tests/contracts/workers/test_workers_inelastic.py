"""Surveys of the inelastic model: restitution as third axis, harmonics and contact phases in the store."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from written import write_tile

from gear_rattle.workers import SurveyError, SurveyRequest, compute_tile, create_store, run_survey, tiles_of
from gear_rattle.workers.survey.slices import surveyed_model
from rattle.attractors import SampleSpec

FIELDS: dict[str, Any] = {
    "delta": (0.5, 0.7, 3),
    "epsilon": (0.2, 0.3, 2),
    "model": "inelastic",
    "load": 0.3,
    "harmonics": [[3, 0.12, 0.3]],
    "initial_conditions": {"count": 8},
    "quantities": ("attractors", "lyapunov", "intensity"),
    "tile": {"delta": 2, "epsilon": 2},
}
REQUEST = SurveyRequest(**FIELDS, restitution=(0.5, 0.7, 2))

pytestmark = pytest.mark.usefixtures("templates_once")


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("inelastic") / "survey.zarr"
    run_survey(REQUEST, out=path)
    return path


def test_plain_xarray_reads_restitution_load_harmonics_and_contacts(store: Path) -> None:
    with xr.open_zarr(store) as survey:
        assert survey.restitution.values.tolist() == [0.5, 0.7]
        assert survey["attractor_contacts"].dims == ("restitution", "attractor", "epsilon", "delta")
        assert (survey.attrs["model"], survey.attrs["load"], float(survey["load"])) == ("inelastic", 0.3, 0.3)
        assert json.loads(survey.attrs["harmonics"]) == [[3, 0.12, 0.3]]
        held = survey["attractor_contacts"].values > 0
        assert held.any()
        exponents = np.moveaxis(survey["attractor_lyapunov"].values, 2, -1)
        assert (exponents[held] == -np.inf).all()
        balance = survey["impulse_balance_error"].values
        assert (balance[np.isfinite(balance)] < 1e-9).all()
        assert np.isfinite(balance).any()
        assert "sum_rule_error" not in survey


def test_a_cell_is_that_of_the_library(store: Path) -> None:
    with xr.open_zarr(store) as whole:
        for number in range(2):
            survey = whole.isel(restitution=number)
            model = surveyed_model(survey)
            assert model == REQUEST.slice_request((number,)).gear_model
            assert model.numbers["load"] == 0.3
            table = model.attractors_of(survey.delta.values, survey.epsilon.values[:, None], SampleSpec(8))
            rattles = model.intensities_of(survey.delta.values, survey.epsilon.values[:, None], table)
            first = np.searchsorted(table.cell, np.arange(6))
            np.testing.assert_array_equal(survey["attractor_contacts"][0].values.ravel(), table.contacts[first])
            np.testing.assert_array_equal(survey["attractor_energy"][0].values.ravel(), rattles.energy[first])


def test_a_survey_resumes_with_its_own_harmonics_only(store: Path, tmp_path: Path) -> None:
    path = tmp_path / "resumed.zarr"
    create_store(REQUEST, path)
    tile = tiles_of(REQUEST)[2]
    write_tile(REQUEST, str(path), tile, compute_tile(REQUEST, tile)[0])
    other = SurveyRequest(**FIELDS | {"harmonics": [[3, 0.12, 0.31]]}, restitution=(0.5, 0.7, 2))
    with pytest.raises(SurveyError):
        run_survey(other, out=path)
    run_survey(REQUEST, out=path)
    with xr.open_zarr(path) as found, xr.open_zarr(store) as expected:
        for name, values in expected.variables.items():
            assert found[name].values.tobytes() == values.values.tobytes(), name
