"""A survey as a file holds the numbers of its store, whatever program reads it."""

import asyncio
import csv
import io
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas
import pytest
import xarray as xr
from fastapi.testclient import TestClient
from service_support import BODY, assert_problem, compute, front_end, front_of
from written import write_tile

from gear_rattle.service.database import DoneTile
from gear_rattle.service.database.tables import State
from gear_rattle.service.errors import MissingPartError
from gear_rattle.service.explorer.map.colouring import compute_colouring
from gear_rattle.service.explorer.map.planes import MapCache
from gear_rattle.service.explorer.page.form import cost_in_words
from gear_rattle.service.operations.estimate import estimate_cost, measure_cell_seconds, most_similar_survey
from gear_rattle.workers import SurveyRequest, compute_tile, open_survey, tiles_of
from gear_rattle.workers.storage.store import open_groups
from gear_rattle.workers.survey.values.schema import RowForm

pytestmark = pytest.mark.usefixtures("templates_once")

REQUEST = SurveyRequest(**BODY)


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("data")) as client:
        yield client


@pytest.fixture(scope="module")
def running(client: TestClient) -> str:
    """The id of a survey with all tiles but the last."""
    survey_id = str(client.post("/v1/surveys", json=BODY).json()["id"])
    front_of(client).database.set_state(survey_id, State.RUNNING)
    compute(front_of(client), survey_id, REQUEST, slice(-1))
    return survey_id


def test_netcdf_holds_every_number(client: TestClient, running: str, tmp_path: Path) -> None:
    answer = client.get(f"/v1/surveys/{running}/download.nc")
    assert answer.status_code == 200
    assert answer.headers["content-disposition"] == f'attachment; filename="survey-{running}.nc"'
    assert int(answer.headers["content-length"]) == len(answer.content)
    (tmp_path / "survey.nc").write_bytes(answer.content)
    with (
        open_survey(front_of(client).directory.store(running)) as store,
        xr.open_dataset(tmp_path / "survey.nc", engine="h5netcdf") as found,
    ):
        for name, values in store.data_vars.items():
            if np.iscomplexobj(values):
                np.testing.assert_array_equal(found[f"{name}_real"] + 1j * found[f"{name}_imag"], values)
                assert found[f"{name}_imag"].attrs["long_name"].endswith("imaginary part")
            else:
                np.testing.assert_array_equal(found[name], values)
                assert found[name].attrs["long_name"] == values.attrs["long_name"]
        assert np.iscomplexobj(store["orbit_multiplier"])
        assert found.beta == store.beta == 0.6
        assert found["region"].attrs["flag_values"].dtype == np.int8
        assert not [name for name in found.coords if "_FillValue" in found[name].encoding]
        assert {"history", "institution", "license", "citation"} <= set(found.attrs)
        assert found.attrs["content_hash"] == store.attrs["content_hash"]
        assert found["orbit"].values.tolist() == ["A", "B", "C", "D"]
    with xr.open_dataset(tmp_path / "survey.nc", engine="h5netcdf", group="curves/G1") as curve:
        groups = open_groups(front_of(client).directory.store(running))
        np.testing.assert_array_equal(curve.point_epsilon, groups["curves/G1"].point_epsilon)
        assert "codimension_two" in groups
    again = client.get(f"/v1/surveys/{running}/download.nc", headers={"If-None-Match": answer.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")


def test_csv_has_a_row_for_each_cell(client: TestClient, running: str) -> None:
    answer = client.get(f"/v1/surveys/{running}/download.csv")
    assert answer.headers["content-type"].startswith("text/csv")
    rows = list(csv.DictReader(io.StringIO(answer.text)))
    assert len(rows) == REQUEST.n_cells
    with open_survey(front_of(client).directory.store(running)) as store:
        for number, row in enumerate(rows):
            i, j = divmod(number, REQUEST.delta.num)
            cell = store.isel(epsilon=i, delta=j)
            assert float(row["delta"]) == cell["delta"]
            assert float(row["epsilon"]) == cell["epsilon"]
            for name in ("region", "status", "n_attractors", "quiet_fraction", "lyapunov_max"):
                value = np.asarray(row[name] or "nan", cell[name].dtype)
                np.testing.assert_array_equal(value, cell[name])
    assert "attractor_fraction" not in rows[0]


def test_a_tidy_table_has_a_row_for_each_attractor_or_orbit(client: TestClient, running: str) -> None:
    here = f"/v1/surveys/{running}/download.csv"
    attractors, orbits = (
        list(csv.DictReader(io.StringIO(client.get(here, params={"form": form}).text)))
        for form in ("attractors", "orbits")
    )
    with open_survey(front_of(client).directory.store(running)) as store:
        assert len(attractors) == int((store.attractor_kind > 0).sum())
        assert len(orbits) == int(store.orbit_exists.sum())
        for row in attractors:
            one = store.sel(delta=float(row["delta"]), epsilon=float(row["epsilon"]), attractor=int(row["attractor"]))
            assert int(row["attractor_kind"]) == one.attractor_kind
            assert np.float32(row["attractor_fraction"]) == one.attractor_fraction
            second = float(one.attractor_lyapunov.sel(exponent=2))
            assert float(row["attractor_lyapunov_2"] or "nan") == pytest.approx(second, abs=0, nan_ok=True)
            assert float(row["beta"]) == 0.6
        for row in orbits:
            one = store.sel(delta=float(row["delta"]), epsilon=float(row["epsilon"]), orbit=row["orbit"])
            assert float(row["orbit_multiplier_real_1"]) == one.orbit_multiplier.sel(multiplier=1).real


@pytest.mark.parametrize("form", RowForm)
def test_parquet_holds_the_same_table(client: TestClient, running: str, form: RowForm) -> None:
    here = f"/v1/surveys/{running}/download"
    answer = client.get(f"{here}.parquet", params={"form": form})
    assert answer.status_code == 200, answer.text
    binary, text = (
        pandas.read_parquet(io.BytesIO(answer.content)),
        client.get(f"{here}.csv", params={"form": form}).text,
    )
    read = pandas.read_csv(io.StringIO(text))
    assert list(binary) == list(read)
    for name in binary:
        if binary[name].dtype.kind in "iuf":
            np.testing.assert_array_equal(binary[name].to_numpy(), read[name].to_numpy(binary[name].dtype))


def test_who_cannot_write_parquet_says_so(client: TestClient, running: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert_problem(client.get(f"/v1/surveys/{running}/download.parquet"), 404, "gear-rattle[parquet]")


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_survey_without_what_a_row_is_of_says_so(tmp_path: Path, ending: str) -> None:
    request = SurveyRequest(**BODY | {"quantities": ["region"]})
    with front_end(tmp_path) as client:
        survey_id = str(client.post("/v1/surveys", json=request.model_dump(mode="json")).json()["id"])
        compute(front_of(client), survey_id, request)
        path = f"/v1/surveys/{survey_id}/download.{ending}"
        for form in ("attractors", "orbits"):
            assert_problem(client.get(path, params={"form": form}), 422, f"computed without {form}")
        assert client.get(path).status_code == 200


@pytest.mark.parametrize("ending", ["nc", "csv", "parquet"])
def test_what_has_no_numbers_cannot_be_downloaded(client: TestClient, ending: str) -> None:
    assert_problem(client.get(f"/v1/surveys/nothing/download.{ending}"), 404, code="unknown_survey")
    waiting = client.post("/v1/surveys?force=true", json=BODY | {"seed": 9}).json()["id"]
    assert_problem(client.get(f"/v1/surveys/{waiting}/download.{ending}"), 404, code="not_in_survey")


def test_a_store_that_was_moved_away_is_said_to_be_gone(tmp_path: Path) -> None:
    request = SurveyRequest(**BODY | {"quantities": ["region"]})
    with front_end(tmp_path) as client:
        front = front_of(client)
        survey_id = str(client.post("/v1/surveys", json=request.model_dump(mode="json")).json()["id"])
        compute(front, survey_id, request)
        Path(str(front.directory.store(survey_id))).rename(tmp_path / "moved")
        for state in (State.RUNNING, State.SUCCESSFUL):
            front.database.set_state(survey_id, state)
            for ending in ("map.png", "download.nc", "download.csv"):
                refused = client.get(f"/v1/surveys/{survey_id}/{ending}")
                assert_problem(refused, 404, code="not_in_survey")
            with pytest.raises(MissingPartError):
                MapCache(front).plane(front.database.job(survey_id), "region", 0)


def test_a_map_of_a_survey_that_runs_grows_by_the_tiles_that_are_new(client: TestClient, running: str) -> None:
    front = front_of(client)
    atlas, survey = MapCache(front), front.database.job(running)
    plane, whole = atlas.plane(survey, "region", 0)
    assert whole
    last = tiles_of(REQUEST)[-1]
    done = np.ones(REQUEST.shape, bool)
    done[last.epsilon, last.delta] = False
    np.testing.assert_array_equal(plane.status > 0, done)
    shades = {shade.label: shade.share for shade in compute_colouring(plane, plane.block(), "auto", False).shades}
    assert shades["not computed"] == pytest.approx(last.n_cells / REQUEST.n_cells)
    arrays, _ = compute_tile(REQUEST, last)
    write_tile(REQUEST, str(front.directory.store(running)), last, arrays)
    assert plane.update(survey)
    np.testing.assert_array_equal(plane.status > 0, done)  # not before the tile is noted: it may be half written
    front.database.add_tile(running, DoneTile(last.index, last.n_cells, 0.5, 0, []))
    assert atlas.plane(front.database.job(running), "region", 0)[0] is plane
    assert (plane.status > 0).all()
    np.testing.assert_array_equal(plane.values[last.epsilon, last.delta], arrays["region"])


def test_a_cost_is_taken_from_the_survey_most_like(client: TestClient, running: str) -> None:
    front = front_of(client)
    jobs, _ = front.database.jobs(10)
    more = REQUEST.model_copy(update={"seed": 1})
    assert (found := most_similar_survey(more, jobs)) is not None
    assert found.id == running
    assert front.database.total_tile_seconds(running) == pytest.approx(0.5 * found.tiles_done)
    other = SurveyRequest(**BODY | {"quantities": ["region"]})
    assert most_similar_survey(other, jobs) is None
    many = SurveyRequest(**BODY | {"initial_conditions": {"count": 64}})
    assert most_similar_survey(many, jobs) is None  # sixteen times the sample: not proportional
    refined = SurveyRequest(**BODY | {"refine": True, "tile": {}})
    assert most_similar_survey(refined, jobs) is None  # few of its cells are computed
    assert 0 < measure_cell_seconds(other) < 1
    of_all, at_most = (asyncio.run(estimate_cost(front, each)) for each in (more, refined))
    assert (at_most.seconds, at_most.is_upper_bound, of_all.is_upper_bound) == (of_all.seconds, True, False)
    assert "at most about" in cost_in_words(at_most)
    assert "if all cells were computed" in cost_in_words(at_most)
