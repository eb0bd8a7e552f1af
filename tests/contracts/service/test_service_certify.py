"""`rattle certify`: of a point, of a survey, and the check of what it wrote."""

import json
import re
import sys
from fractions import Fraction
from pathlib import Path

import pytest
from depth import deep
from typer.testing import CliRunner, Result

import rattle
from gear_rattle.service.cli import app
from gear_rattle.workers.areas import certify_areas


def ran(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["certify", *map(str, arguments)])


def test_a_point_is_taken_as_these_very_numbers_and_its_certificates_are_proved_again(tmp_path: Path) -> None:
    said = ran("--point", "0.6", "0.0615")
    assert said.exit_code == 0
    documents = [json.loads(line) for line in said.stdout.splitlines()]
    assert [(each["label"], each["verdict"]) for each in documents] == [
        ([1, 1, 0], "saddle"),
        ([1, 1, 0], "attracting"),
    ]
    assert documents[0]["parameters"] == {"delta": "0.6", "epsilon": "0.0615", "beta": "0.6"}
    (tmp_path / "motions.jsonl").write_text(said.stdout)
    checked = ran("--check", tmp_path / "motions.jsonl")
    assert checked.exit_code == 0
    assert checked.stdout.count("proved: P(1, 1, 0)") == 2
    (tmp_path / "motions.jsonl").write_text(said.stdout.replace('"0.0615"', '"0.0616"', 1))
    checked = ran("--check", tmp_path / "motions.jsonl")
    assert checked.exit_code == 1
    assert "NOT PROVED, line 1: the box of the certificate is not mapped into itself" in checked.stdout
    assert checked.stdout.count("proved: P(1, 1, 0)") == 1


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("survey.zarr", "--check", "file"),
        ("--check", "nowhere"),
        ("--check", "/dev/null"),
        ("--point", "0.6", "x"),
        ("--curves",),
        ("--curves", "--point", "0.6", "0.1"),
        ("--codimension-two", "--point", "0.6", "0.1"),
        ("--chaos",),
        ("--chaos", "--point", "0.6", "0.1", "--kappa", "1e4"),
        ("--chaos", "--point", "0.6", "0"),
        ("--areas", "file", "--delta", "1:0.4"),
        ("--areas", "file", "--delta", "0:1"),
        ("--areas", "file", "--beta", "0"),
        ("--areas", "file", "--epsilon", "0.3"),
    ],
)
def test_what_cannot_be_meant_is_said(arguments: tuple[str, ...]) -> None:
    said = ran(*arguments)
    assert said.exit_code == 2 or isinstance(said.exception, rattle.ParameterError)


GRID = ("--delta", "0.6:0.61:2", "--epsilon", "0.0615:0.062:2", "--count", "16", "--quantity", "attractors")


@pytest.mark.parametrize("how", [(), pytest.param(("--workers", "2"), marks=deep)])
def test_certificates_that_a_run_makes_are_those_that_its_survey_asks_for(tmp_path: Path, how: tuple[str, ...]) -> None:
    asked, proved = tmp_path / "asked.zarr", tmp_path / "proved.zarr"
    said = CliRunner().invoke(app, ["run", *GRID, "--certify", "--out", str(asked)])
    assert said.exit_code == 0
    assert "Proving the periodic attractors" in said.stderr
    assert CliRunner().invoke(app, ["run", *GRID, "--out", str(proved)]).exit_code == 0
    assert not proved.with_name("proved.certificates.zarr").exists()
    assert ran(proved, *how).exit_code == 0
    lines = [
        (tmp_path / f"{name}.certificates.zarr" / "certificates.jsonl").read_text() for name in ("asked", "proved")
    ]
    assert lines[0] == lines[1] != ""


def test_a_survey_has_its_certificates_beside_it(tmp_path: Path) -> None:
    store = tmp_path / "survey.zarr"
    assert CliRunner().invoke(app, ["run", *GRID, "--out", str(store)]).exit_code == 0
    said = ran(store)
    assert said.exit_code == 0
    assert re.match(r"([1-9]) of \1 periodic attractors are proved: ", said.stdout)
    checked = ran("--check", tmp_path / "survey.certificates.zarr")
    assert checked.exit_code == 0
    assert checked.stdout.startswith("proved: P(1, 1, 0), attracting")
    points = ran(store, "--curves")
    assert points.exit_code == 0
    names = [json.loads(line)["name"] for line in points.stdout.splitlines()]
    assert names
    assert set(names) == {"SN1"}
    (tmp_path / "points.jsonl").write_text(points.stdout.splitlines()[0])
    assert ran("--check", tmp_path / "points.jsonl").stdout.startswith("proved: SN1 of [1], at beta = 0.5999")


def test_a_plane_is_proved_in_blocks_which_are_proved_again(tmp_path: Path) -> None:
    blocks, figure = tmp_path / "areas.jsonl", tmp_path / "areas.png"
    plane = ("--delta", "0.9:0.901", "--epsilon", "0:0.05", "--columns", "1")
    said = ran("--areas", blocks, *plane, "--figure", figure)
    assert said.exit_code == 0
    assert "the region: 100.00% of the plane, at least 100.00% of where it holds" in said.stdout
    assert figure.stat().st_size > 1000
    documents = [json.loads(line) for line in blocks.read_text().splitlines()]
    assert {each["claim"] for each in documents} >= {"I", "quiet is possible", "quiet captures", "C is not there"}
    assert documents[0] | {"claim": "I"} == {
        "format": 1, "theorem": "area", "claim": "I", "beta": "0.6", "delta": ["0.9", "0.901"], "epsilon": ["0", "0.05"]
    }  # fmt: skip
    lines = [line for line in blocks.read_text().splitlines() if "not there" not in line]
    blocks.write_text("\n".join([*lines, lines[0].replace('"I"', '"V"')]))
    checked = ran("--check", blocks)
    assert checked.exit_code == 1
    assert checked.stdout.count("proved: ") == len(lines)
    assert checked.stdout.splitlines()[-1].startswith(f"NOT PROVED, line {len(lines) + 1}: ")


def test_processes_of_their_own_prove_the_same_columns(tmp_path: Path) -> None:
    one, two = (tmp_path / name for name in ("one.jsonl", "two.jsonl"))
    plane = (Fraction("0.9"), Fraction("0.901")), (Fraction(0), Fraction("0.05")), Fraction("0.6"), 2
    certify_areas(one, *plane)
    certify_areas(two, *plane, processes=2)
    assert one.read_text() == two.read_text() != ""


def test_without_the_extra_a_sentence_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in list(sys.modules):
        if name.startswith("rattle.proof.") and name.rpartition(".")[2] not in ("certify", "certificate", "check"):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "flint", None)
    with pytest.raises(rattle.MissingExtraError, match=r"gear-rattle\[proof\]"):
        raise ran("--point", "0.6", "0.0615").exception or AssertionError


def test_points_where_curves_meet_are_proved_and_checked_beside_motions(tmp_path: Path) -> None:
    said = ran("--codimension-two", "--beta", "0.6")
    assert said.exit_code == 0
    assert [json.loads(line)["name"] for line in said.stdout.splitlines()] == ["COD20", "COD21", "COD23", "COD22"]
    motion = ran("--point", "0.6", "0.0615").stdout.splitlines()[0]
    corner = said.stdout.splitlines()[0]
    (tmp_path / "several.jsonl").write_text("\n".join([corner, motion, corner.replace("COD20", "COD21"), "{"]))
    checked = ran("--check", tmp_path / "several.jsonl")
    assert checked.exit_code == 1
    corner_said, motion_said, wrong, unread = checked.stdout.splitlines()
    assert corner_said == "proved: COD20 of [1, -1], at beta = 0.6: delta, epsilon to 2e-20"
    assert motion_said.startswith("proved: P(1, 1, 0)")
    assert wrong.startswith("NOT PROVED, line 3")
    assert unread.startswith("NOT PROVED, line 4")


def test_chaos_that_is_not_there_is_not_proved() -> None:
    said = ran("--chaos", "--point", "0.6", "0.0615")
    assert said.exit_code == 1
    assert said.stdout == ""
    assert "not proved: no motion that seems chaotic was found" in said.stderr


@pytest.mark.parametrize("content", [b"", b"\n \n"])
def test_a_file_without_a_certificate_is_not_checked(tmp_path: Path, content: bytes) -> None:
    """An earlier version printed nothing and ended with 0."""
    (tmp_path / "empty.jsonl").write_bytes(content)
    said = ran("--check", tmp_path / "empty.jsonl")
    assert said.exit_code == 2
    assert "certificates" in said.output


def test_a_file_that_is_no_text_is_not_proved(tmp_path: Path) -> None:
    (tmp_path / "other.jsonl").write_bytes(b"\xff\xfe\x00")
    said = ran("--check", tmp_path / "other.jsonl")
    assert said.exit_code == 1
    assert "NOT PROVED, line 1" in said.stdout


def test_a_point_without_motions_proves_nothing() -> None:
    said = ran("--point", "0.6", "0.001")
    assert said.exit_code == 1
    assert "no periodic motion was found" in said.output
