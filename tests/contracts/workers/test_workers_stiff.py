"""Surveys of the stiff model: each cell holds what the library says of it, and what the model lacks is refused."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from pydantic import ValidationError
from written import compute_and_write_tile

import rattle
from gear_rattle.workers import (
    Axis,
    SurveyRequest,
    Window,
    compute_window_part,
    create_store,
    finish_store,
    open_survey,
    request_for_window,
    tiles_of,
)
from gear_rattle.workers.boundaries.explain import explain
from gear_rattle.workers.errors import SurveyError
from gear_rattle.workers.pictures.figure import survey_figure
from gear_rattle.workers.survey.values.schema import OPTIONAL
from rattle import stiff
from rattle.models import Impacting, Stiff

pytestmark = pytest.mark.usefixtures("templates_once")

KAPPA, COUNT = 1e4, 8
FIELDS = {
    "model": "stiff",
    "kappa": KAPPA,
    # regions I, II, IV and V, and above the quiet limit
    "delta": Axis(start=0.55, stop=0.65, num=2),
    "epsilon": Axis(start=0.05, stop=0.21, num=5),
    "initial_conditions": {"count": COUNT},
}
REQUEST = SurveyRequest.model_validate(FIELDS)


def survey_of(request: SurveyRequest, path: Path) -> xr.Dataset:
    create_store(request, path)
    for tile in tiles_of(request):
        assert not compute_and_write_tile(request, str(path), tile).failed_cells
    finish_store(path)
    return open_survey(path).load()


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("stiff") / "survey.zarr"


@pytest.fixture(scope="module")
def survey(path: Path) -> xr.Dataset:
    return survey_of(REQUEST, path)


def test_a_cell_is_what_the_library_says(survey: xr.Dataset) -> None:
    for i, epsilon in enumerate(survey.epsilon.values):
        for j, delta in enumerate(survey.delta.values):
            gear, cell = stiff.StiffGear(float(delta), float(epsilon), 0.6, KAPPA), survey.isel(epsilon=i, delta=j)
            assert int(cell.region) == gear.region()
            orbits = {orbit.name: orbit for orbit in gear.orbits()}
            for name in "ABCD":
                one = cell.sel(orbit=name)
                assert bool(one.orbit_exists) == (name in orbits)
                if name in orbits:
                    assert float(one.orbit_velocity) == pytest.approx(orbits[name].v, abs=1e-9)
                    assert complex(one.orbit_multiplier[0]) == pytest.approx(orbits[name].multipliers[0], rel=1e-6)
            found = gear.attractors(COUNT)
            assert int(cell.n_attractors) == len(found)
            for slot, each in enumerate(found):
                one = cell.isel(attractor=slot)
                label = tuple(int(one[f"attractor_{name}"]) for name in ("m", "n_plus", "n_minus"))
                assert rattle.KINDS[int(one.attractor_kind)] == each.kind
                assert label == (each.m, each.n_plus, each.n_minus)
                assert float(one.attractor_fraction) == each.fraction
                exponents = [float(value) for value in one.attractor_lyapunov]
                assert exponents == pytest.approx(each.lyapunov, nan_ok=True, abs=1e-12)
    assert np.nanmax(survey.sum_rule_error) < 1e-9
    assert set(np.unique(survey.region)) >= {1, 2, 4, 5}
    assert (survey.quiet_fraction == 0).any()
    assert (survey.quiet_fraction == 1).any()


def test_tiles_do_not_show(survey: xr.Dataset, tmp_path: Path) -> None:
    other = REQUEST.model_copy(update={"tile": REQUEST.tile.model_copy(update={"delta": 1, "epsilon": 3})})
    again = survey_of(other, tmp_path / "survey.zarr")
    for name in survey.data_vars:
        assert survey[name].values.tobytes() == again[name].values.tobytes(), name


def test_it_says_which_model_it_is_of_and_has_its_curves(path: Path, survey: xr.Dataset) -> None:
    assert (survey.attrs["model"], survey.attrs["beta"], survey.attrs["kappa"]) == ("stiff", 0.6, KAPPA)
    assert SurveyRequest.model_validate_json(survey.attrs["request"]) == REQUEST
    assert "stiff" in survey.attrs["title"]
    assert "grazing_epsilon" not in survey
    tree = xr.open_datatree(path, engine="zarr")
    assert set(tree["curves"].children) == set(stiff.NAMES)
    assert tree["codimension_two"].sizes["point"] == 0
    line = tree["curves/quiet_limit"]
    np.testing.assert_allclose(line.point_epsilon, stiff.quiet_limit(line.point_delta.values, KAPPA), rtol=1e-12)
    assert len(tree["curves/SN1"].point_delta) > 1


def test_a_picture_names_the_model(survey: xr.Dataset) -> None:
    figure = survey_figure(survey)
    assert "stiffness κ = 10000" in figure.get_suptitle()
    assert {"SN1", "quiet limit"} <= {line.get_label() for line in figure.axes[0].lines}


def test_a_window_has_the_same_cells(survey: xr.Dataset) -> None:
    window = request_for_window(REQUEST, Window((0.55, 0.65), (0.05, 0.21)), (2, 5))
    assert window.gear_model == Stiff(0.6, KAPPA)
    part = compute_window_part(window, "quiet_fraction", 0, survey.delta.values, survey.epsilon.values)
    np.testing.assert_array_equal(part.values, survey.quiet_fraction)


def test_by_default_all_that_the_model_has_and_is_cheap() -> None:
    assert REQUEST.quantities == ("region", "orbits", "attractors", "lyapunov")
    assert not OPTIONAL.intersection(REQUEST.quantities)


def test_the_stiffness_makes_another_survey() -> None:
    fields = {name: value for name, value in FIELDS.items() if name not in ("model", "kappa")}
    quantities = [str(each) for each in REQUEST.quantities]
    impacting = SurveyRequest.model_validate(fields | {"quantities": quantities})
    assert impacting.model == Impacting.name
    hashes = [REQUEST.model_copy(update={"kappa": kappa}).content_hash() for kappa in (KAPPA, 1.1e4)]
    assert len({*hashes, impacting.content_hash()}) == 3


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"kappa": None}, "needs kappa"),
        ({"model": "impacting"}, "only the stiff model has kappa"),
        ({"kappa": 0.0}, "greater than 0"),
        ({"kappa": 1e11}, "must be at most"),
        ({"kappa": "1e4"}, "number"),
        ({"model": "soft"}, "impacting"),
        ({"quantities": ["region", "grazing"]}, "the stiff model has no grazing: choose from region"),
    ],
)
def test_refused_with_a_reason(fields: dict[str, object], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        SurveyRequest.model_validate(FIELDS | fields)


def test_boundaries_are_not_explained_by_the_curves_of_another_model(survey: xr.Dataset) -> None:
    with pytest.raises(SurveyError, match="only for the impacting model"):
        explain(survey)
