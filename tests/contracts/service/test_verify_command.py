"""`rattle verify` looks at all that belongs to a store, says at what, and ends with 1 if any is damaged."""

import json
import shutil
from pathlib import Path

import pytest
import xarray as xr
from typer.testing import CliRunner, Result

from gear_rattle.service.cli import app
from gear_rattle.workers import (
    SurveyRequest,
    create_store,
    finish_store,
    open_survey,
    run_tiles_in_this_process,
    tiles_of,
)
from gear_rattle.workers.certificates import CERTIFICATES, certify_survey

pytestmark = pytest.mark.usefixtures("templates_once")

REQUEST = SurveyRequest(
    delta=(0.55, 0.65, 2),
    epsilon=(0.06, 0.09, 2),
    initial_conditions={"count": 8},
    quantities=("attractors",),
    tile={"delta": 1, "epsilon": 1},
)


def ran(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["verify", *map(str, arguments)])


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("verified") / "survey.zarr"
    create_store(REQUEST, path)
    run_tiles_in_this_process(REQUEST, path, tiles_of(REQUEST), lambda _: None, lambda: False)
    finish_store(path)
    with open_survey(path) as survey:
        certify_survey(survey, path.with_name("survey.certificates.zarr"))
    return path.parent


@pytest.fixture
def store(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "here")) / "survey.zarr"


def test_it_says_what_it_looked_at(store: Path) -> None:
    said = ran(store)
    assert said.exit_code == 0
    assert "4 tiles, 4 whole, 0 damaged, 0 not computed yet; 0 of the other files damaged" in said.stdout
    assert "computed by version" in said.stdout
    assert "survey.certificates.zarr: certificates, " in said.stdout


def test_a_lost_status_of_a_finished_survey_is_damage(store: Path) -> None:
    (store / "status/c/0/1").unlink()
    said = ran(store)
    assert said.exit_code == 1
    assert "3 whole, 1 damaged, 0 not computed yet" in said.stdout
    assert "damaged: tile 1: status" in said.stdout


def test_certificates_are_verified_beside_their_survey_and_by_their_own_name(store: Path) -> None:
    out = store.with_name("survey.certificates.zarr")
    assert ran(out).exit_code == 0
    (out / CERTIFICATES).write_text("")
    for where in (store, out):
        said = ran(where)
        assert said.exit_code == 1
        assert "1 damaged" in said.stdout
        assert f"damaged: {out.name}/{CERTIFICATES}" in said.stdout


def test_a_store_of_another_version_is_verified_as_far_as_can_be(store: Path) -> None:
    (store / "manifest.json").unlink()
    root = json.loads((store / "zarr.json").read_text())
    del root["consolidated_metadata"]
    root["attributes"]["code_version"] = "0.9.0+0123456789abcdef"
    (store / "zarr.json").write_text(json.dumps(root))
    said = ran(store)
    assert said.exit_code == 0
    assert "computed by version 0.9.0+0123456789abcdef, completed" in said.stdout
    assert "chunks decoded, 0 damaged. This version cannot read the checksums" in said.stdout
    chunk = store / "attractor_kind/c/0/1/1"
    chunk.write_bytes(chunk.read_bytes()[:-1])
    said = ran(store)
    assert said.exit_code == 1
    assert "damaged: attractor_kind/c/0/1/1" in said.stdout


@pytest.mark.parametrize("what", ["nothing", "a file", "another store"])
def test_what_is_none_is_refused(tmp_path: Path, what: str) -> None:
    path = tmp_path / "store"
    if what == "a file":
        path.write_text("")
    if what == "another store":
        xr.Dataset({"x": ("i", [1.0])}).to_zarr(path, consolidated=False)
    said = ran(path)
    expected = "does not exist" if what == "nothing" else "holds no store"
    assert said.exit_code == 2 or expected in str(said.exception)
    assert not said.stdout
