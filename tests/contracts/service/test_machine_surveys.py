"""``rattle run`` with a machine in SI units."""

from pathlib import Path

import pytest
import xarray as xr
from typer.testing import CliRunner

import rattle
from gear_rattle.service.cli import app

SI = {"inertia": "0.003", "drag": "0.05", "backlash": "100e-6", "radius": "0.05"}
SPANS = {"rpm": "1500:6000:3", "eccentricity": "2e-6:60e-6:2"}


def run(path: Path, *more: str, **changed: str | None) -> tuple[int, str]:
    given = {name: value for name, value in (SI | SPANS | changed).items() if value is not None}
    options = [text for name, value in given.items() for text in (f"--{name}", value)]
    result = CliRunner().invoke(app, ["run", "--out", str(path), *options, *more])
    return result.exit_code, result.output


def test_a_survey_of_speeds_and_eccentricities(tmp_path: Path) -> None:
    path = tmp_path / "survey.zarr"
    code, said = run(path, "--quantity", "region", drive="speed")
    assert code == 0, said
    survey = xr.open_zarr(path, chunks=None)
    machine = rattle.Machine(0.003, 0.05, 100e-6, 60e-6, 0.05, rpm=1500, drive="speed")
    assert float(survey.delta[-1]) == machine.delta
    assert float(survey.epsilon[-1]) == machine.epsilon
    assert survey.attrs["beta"] == machine.beta
    assert float(survey.rpm[-1]) == pytest.approx(1500)
    assert float(survey.eccentricity[-1]) == pytest.approx(60e-6)


@pytest.mark.parametrize(
    ("changed", "more", "message"),
    [
        ({"rpm": None}, (), "give either --delta, or a machine with --rpm"),
        ({}, ("--epsilon", "0:0.1:3"), "give either --epsilon, or a machine with --eccentricity"),
        ({"radius": None}, (), "machine.radius: is not given"),
        ({"radius": "50"}, (), "for 50 mm give 0.05"),
        ({"drive": "belt"}, (), "machine.drive"),
        ({"rpm": "3000"}, (), "START:STOP:NUM"),
        ({}, ("--beta", "0.6"), "leave beta out"),
    ],
)
def test_what_is_wrong_is_said(
    tmp_path: Path, changed: dict[str, str | None], more: tuple[str, ...], message: str
) -> None:
    path = tmp_path / "survey.zarr"
    code, said = run(path, *more, **changed)
    assert code == 2
    assert message in " ".join(said.replace("│", " ").split())
    assert not path.exists()
