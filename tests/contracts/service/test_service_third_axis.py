"""Surveys with a third axis, asked for over HTTP and by commands: what is of a plane asks for a slice."""

from collections.abc import Iterator
from pathlib import Path

import pytest
import xarray as xr
from depth import deep
from fastapi.testclient import TestClient
from service_support import BODY, assert_problem, compute, front_end, front_of
from typer.testing import CliRunner

from gear_rattle.service.cli import app
from gear_rattle.service.client import Client
from gear_rattle.service.commands.survey_options import request_from_options
from gear_rattle.service.database.tables import State
from gear_rattle.service.operations.chunks import is_expected_file
from gear_rattle.service.operations.estimate import _request_for_few_cells, most_similar_survey
from gear_rattle.workers import Axis, SurveyRequest, create_store, examine

pytestmark = pytest.mark.usefixtures("templates_once")

BETA = {"start": 0.4, "stop": 0.6, "num": 3}
THIRD = BODY | {"beta": BETA, "quantities": ["region"]}
REQUEST = SurveyRequest(**THIRD)


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("data"), max_cells=100) as client:
        yield client


@pytest.fixture(scope="module")
def running(client: TestClient) -> str:
    """The id of a survey with all tiles but the last, of the last slice."""
    survey_id = str(client.post("/v1/surveys", json=THIRD).json()["id"])
    front_of(client).database.set_state(survey_id, State.RUNNING)
    compute(front_of(client), survey_id, REQUEST, slice(-1))
    return survey_id


def test_what_was_asked_is_shown_and_counted(client: TestClient, running: str) -> None:
    shown = client.get(f"/v1/surveys/{running}").json()
    assert shown["request"]["beta"] == BETA
    assert (shown["cells"], shown["tiles"], shown["tiles_done"]) == (72, 12, 11)
    assert client.post("/v1/surveys", json=THIRD).json()["id"] == running  # identical


def test_all_slices_are_counted_against_the_limit(client: TestClient) -> None:
    answer = client.post("/v1/surveys", json=THIRD | {"beta": BETA | {"num": 5}})
    assert_problem(answer, 422, "120 cells exceed the limit of this service, 100.")
    answer = client.post("/v1/surveys", json=THIRD | {"beta": BETA | {"start": 0.0}})
    assert_problem(answer, 422, "body.beta", "raise start (0.0) above 0")
    answer = client.post("/v1/surveys", json=THIRD | {"beta": BETA | {"num": "x"}})
    assert_problem(answer, 422, "body.beta", "num: must be a whole number")


def test_a_picture_is_of_a_slice(client: TestClient, running: str) -> None:
    here = f"/v1/surveys/{running}/map.png"
    assert_problem(client.get(here), 422, "3 values of beta: choose a slice from 0 to 2")
    assert_problem(client.get(here, params={"slice": 3}), 422, "slice from 0 to 2")
    first, last = (client.get(here, params={"slice": number}) for number in (0, 2))
    assert first.headers["content-type"] == last.headers["content-type"] == "image/png"
    assert first.content != last.content
    assert first.headers["etag"] != last.headers["etag"]
    plain = str(client.post("/v1/surveys", json=BODY | {"quantities": ["region"]}).json()["id"])
    create_store(SurveyRequest(**BODY | {"quantities": ["region"]}), front_of(client).directory.store(plain))
    assert_problem(client.get(f"/v1/surveys/{plain}/map.png", params={"slice": 0}), 422, "leave slice out")


@deep
def test_downloads_have_all_slices(client: TestClient, running: str, tmp_path: Path) -> None:
    rows = client.get(f"/v1/surveys/{running}/download.csv").text.splitlines()
    assert rows[0].split(",")[:3] == ["delta", "epsilon", "beta"]
    assert [float(row.split(",")[2]) for row in rows[1::24]] == [0.4, 0.5, 0.6]
    (tmp_path / "s.nc").write_bytes(client.get(f"/v1/surveys/{running}/download.nc").content)
    with xr.open_dataset(tmp_path / "s.nc", engine="h5netcdf") as found:
        assert found.region.dims == ("beta", "epsilon", "delta")
        assert int((found.status == 0).sum()) == 6


def test_only_chunks_that_are_computed_are_owed(client: TestClient, running: str) -> None:
    front = front_of(client)
    keys = ["region/c/0/0/0", "region/c/2/1/0", "region/c/2/1/1", "region/c/3/0/0"]
    assert [is_expected_file(front, running, key) for key in keys] == [True, True, False, False]
    assert client.get(f"/v1/surveys/{running}/store/region/c/2/1/0").status_code == 200
    assert len(examine(front.directory.store(running)).done) == 11


def test_the_cost_is_that_of_cells_of_the_middle_slice() -> None:
    few = _request_for_few_cells(REQUEST)
    assert (few.beta, few.n_cells) == (0.5, 9)
    width = REQUEST.delta.stop - REQUEST.delta.start
    assert few.delta.start == pytest.approx(REQUEST.delta.start + width / 6)  # each stands for a ninth of the plane
    assert few.delta.stop == pytest.approx(REQUEST.delta.stop - width / 6)
    stiff = SurveyRequest(**BODY | {"quantities": ["orbits"], "model": "stiff", "kappa": (1e3, 1e4, 2)})
    assert stiff.added_parameter_values == {"kappa": 1e4}
    assert most_similar_survey(stiff, []) is None


def test_axes_are_read_by_commands(tmp_path: Path) -> None:
    given = {"count": 4, "delta": "0.5:0.7:6", "epsilon": "0.05:0.15:4"}
    assert request_from_options(given | {"beta": "0.4:0.6:3"}).beta == Axis(start=0.4, stop=0.6, num=3)
    found = request_from_options(given | {"kappa": "1e3:1e4:2", "beta": "0.5"})
    assert found.kappa == Axis(start=1e3, stop=1e4, num=2)
    store = tmp_path / "s.zarr"
    asked = ["run", "--delta", "0.5:0.7:3", "--epsilon", "0.05:0.15:3", "--quantity", "region", "--out"]
    run = CliRunner().invoke
    assert run(app, [*asked, str(store), "--beta", "0.4:0.6:2"]).exit_code == 0
    assert examine(store).is_whole
    for refused, said in (
        (["--beta", "wide"], "write a number, or START:STOP:NUM"),
        (["--beta", "0.4:0.6"], "write START:STOP:NUM"),
        (["--beta", "0.4:0.6:2", "--figure", str(tmp_path / "s.png")], "draw a slice"),
    ):
        result = run(app, [*asked, str(tmp_path / "other.zarr"), *refused])
        assert result.exit_code == 2
        assert said in " ".join(result.output.replace("│", " ").split())
    for command in (["figure", str(store), str(tmp_path / "s.png")], ["explain", str(store)]):
        assert "choose a slice from 0 to 1" in str(run(app, command).exception)
        assert run(app, [*command, "--slice", "1"]).exit_code == 0
    assert (tmp_path / "s.png").stat().st_size > 1000
    assert run(app, ["figure", "4", "--slice", "1"]).exit_code == 2


def test_a_client_takes_a_third_axis_as_a_triple(client: TestClient, running: str) -> None:
    with_axes = {name: tuple(value.values()) for name, value in THIRD.items() if name in ("delta", "epsilon", "beta")}
    job = Client(http=client).submit(THIRD, **with_axes)  # type: ignore[arg-type]
    assert job.id == running
