"""``rattle tolerance`` and ``rattle limit``: what they print, keep, and refuse."""

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

import rattle
from gear_rattle.service.cli import app
from gear_rattle.workers.answers import read_finished_population

PLAIN = ["--delta", "0.6", "--epsilon", "uniform:0.03:0.21", "--beta", "normal:0.6:0.02"]
FEW = ["--gears", "30", "--count", "4", "--pairs", "20"]
DRAWING = ["--inertia", "0.003", "--drag", "1.5e-3", "--backlash", "300e-6", "--radius", "0.05", "--rpm", "3000"]


def said(*arguments: str, code: int = 0) -> str:
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == code, result.output
    return " ".join(result.output.replace("│", " ").split())


def test_a_population_is_computed_kept_and_told(tmp_path: Path) -> None:
    out = tmp_path / "population.zarr"
    words = said("tolerance", "--out", str(out), *PLAIN, *FEW, "--share", "0.6", "--judged", "4", "--seed", "1")
    found = read_finished_population(out)
    assert f"runs quietly with a probability of {found.quiet.value:.4g} [{found.quiet.low:.4g}" in words
    assert found.passing is not None
    assert f"passes: {found.passing.value:.4g}" in words
    assert "99 % of all are below" in words
    assert str(found.worst(1)[0].row) in words.split("worst gears")[1]
    again = said("tolerance", "--out", str(out), *PLAIN, *FEW, "--share", "0.6", "--judged", "4", "--seed", "1")
    assert "is complete" in again
    refused = CliRunner().invoke(app, ["tolerance", "--out", str(out), *PLAIN, *FEW])
    assert "holds another survey or population: choose another path" in str(refused.exception)


def test_correlations_are_given_by_name(tmp_path: Path) -> None:
    out = tmp_path / "population.zarr"
    said("tolerance", "--out", str(out), *PLAIN, *FEW, "--correlation", "beta:epsilon:0.4")
    found = read_finished_population(out).plan.tolerances
    assert found.names == ("epsilon", "beta")
    assert found.correlation.tolist() == [[1.0, 0.4], [0.4, 1.0]]  # type: ignore[union-attr]


def test_measured_gears_are_read_from_a_table(tmp_path: Path) -> None:
    table, out = tmp_path / "gears.csv", tmp_path / "population.zarr"
    table.write_text("eccentricity,backlash\n14e-6,280e-6\n15e-6,310e-6\n18e-6,300e-6\n16e-6,305e-6\n")
    given = [text for text in DRAWING if text not in ("--backlash", "300e-6")]
    words = said("tolerance", "--out", str(out), *given, "--measured", str(table), *FEW)
    found = read_finished_population(out).plan.tolerances
    measured, matrix = rattle.read_gears(table)
    assert {name: found.given[name] for name in found.names} == measured
    assert found.correlation.tolist() == matrix.tolist()  # type: ignore[union-attr]
    assert "impacts hand over (W):" in words


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--delta", "0.6", "--epsilon", "0.1"], "nothing varies"),
        (["--delta", "0.6", "--epsilon", "normal:0.1:0.1"], "cut it off (low=0)"),
        (["--delta", "0.6", "--epsilon", "gamma:1:2"], "write a number, or normal:MEAN"),
        ([*DRAWING, "--eccentricity", "normal:15:5:0"], "for 15"),
        (
            [*PLAIN, "--correlation", "beta:delta:0.4"],
            "write NAME:NAME:NUMBER, with two of the varying numbers (epsilon, beta)",
        ),
        ([*PLAIN, "--correlation", "beta:beta:0.4"], "write NAME:NAME:NUMBER, with two of the varying numbers"),
        ([*PLAIN, "--correlation", "beta:epsilon:0.4", "--correlation", "epsilon:beta:0.1"], "twice"),
        ([*PLAIN, "--correlation", "beta:epsilon:1"], "these correlations are impossible"),
        ([*PLAIN, "--shock-phase", "0.1"], "a shock needs a speed: give --shock-speed"),
        ([*PLAIN, "--gears", "1"], "gears: must be at least 2"),
        ([*PLAIN, "--measured", "nothing.csv"], "cannot be read"),
    ],
)
def test_what_cannot_be_meant_is_refused(more: list[str], words: str, tmp_path: Path) -> None:
    refused = said("tolerance", "--out", str(tmp_path / "population.zarr"), *more, code=2)
    assert words.split()[0] in refused
    assert not (tmp_path / "population.zarr").exists()


def test_a_limit_is_told_with_its_interval_and_unit() -> None:
    words = said("limit", "eccentricity", *DRAWING, "--share", "0.9", "--count", "128")
    given = dict(zip((name[2:] for name in DRAWING[::2]), map(float, DRAWING[1::2]), strict=True))
    exact = rattle.design_limit(given, "eccentricity", 0.9, count=128)
    value, low, high = (f"{1e6 * x:.4g}" for x in exact)
    assert f"eccentricity up to {value} µm [{low}, {high}] at 3000 rpm for P(quiet) of 0.9 at least" in words


def test_a_limit_is_told_as_a_curve() -> None:
    lines = said("limit", "epsilon", "--share", "0.8", "--count", "64", "--over", "delta=0.5:0.7:2")
    limits = [float(each) for each in re.findall(r"delta 0\.[57]: epsilon up to (\S+)", lines)]
    assert len(limits) == 2
    assert limits[0] < limits[1]
    assert "no limit of epsilon" in said(
        "limit", "epsilon", "--delta", "0.6", "--share", "0.8", "--count", "64", "--between", "0.01:0.02"
    )
    assert "write LOW:HIGH" in said("limit", "epsilon", "--delta", "0.6", "--between", "1", code=2)
    assert "must be a number" in said("limit", "epsilon", "--delta", "uniform:1:2", code=2)
