"""Surveys of the inelastic gear store its regions, its motions A to D, its curves and the points where these meet."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from pydantic import ValidationError
from written import compute_and_write_tile

from gear_rattle.workers import Axis, SurveyRequest, create_store, finish_store, open_survey, tiles_of
from rattle import inelastic
from rattle.models import Inelastic

FIELDS = {
    "model": "inelastic",
    "restitution": 0.9,
    "load": 0.2,
    "delta": Axis(start=0.45, stop=0.9, num=4),
    "epsilon": Axis(start=0.02, stop=0.3, num=5),
    "initial_conditions": {"count": 8},
}


def test_what_a_survey_stores_of_its_plane(tmp_path: Path) -> None:
    request = SurveyRequest.model_validate(FIELDS | {"quantities": ["region", "orbits"]})
    path = tmp_path / "survey.zarr"
    create_store(request, path)
    for tile in tiles_of(request):
        assert not compute_and_write_tile(request, str(path), tile).failed_cells
    finish_store(path)
    survey = open_survey(path).load()
    delta, epsilon = survey.delta.values, survey.epsilon.values[:, None]
    found = inelastic.period_one(delta, epsilon, 0.6, 0.9, 0.2)
    assert np.array_equal(survey["region"].values, inelastic.regions(delta, epsilon, 0.6, 0.9, 0.2))
    assert np.array_equal(survey["orbit_exists"].transpose("orbit", "epsilon", "delta").values, found.exists)
    assert len(np.unique(survey["region"])) > 2
    tree = xr.open_datatree(path, engine="zarr")
    for name in inelastic.NAMES:
        stored = tree[f"curves/{name}"]
        traced = Inelastic(0.6, 0.9, 0.2).trace(name, *_window(tree))
        assert np.array_equal(stored["point_delta"].values, traced.delta), name
        assert np.array_equal(stored["point_epsilon"].values, traced.epsilon), name
    assert len(tree["curves/SN1"]["point_delta"]) > 5
    assert set(tree["codimension_two"]["point"].values) == {"COD20", "COD21", "COD22", "COD23"}


def _window(tree: xr.DataTree) -> list[tuple[float, float]]:
    return [tuple(tree["curves"].attrs[f"window_{name}"]) for name in ("delta", "epsilon")]


def test_what_harmonics_leave_of_a_survey() -> None:
    """A to D are those of one cosine: by default left out, and refused where they are named."""
    more = FIELDS | {"harmonics": [(3, 0.1, 0.0)]}
    assert "region" in SurveyRequest.model_validate(FIELDS).quantities
    assert not {"region", "orbits"} & {*SurveyRequest.model_validate(more).quantities}
    with pytest.raises(ValidationError, match="the inelastic model with harmonics has no region: choose from"):
        SurveyRequest.model_validate(more | {"quantities": ["region"]})
