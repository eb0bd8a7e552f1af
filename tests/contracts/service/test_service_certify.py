"""`rattle certify`: of a point, of a survey, and the check of what it wrote."""

import json
import re
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

import rattle
from service.cli import app


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
    assert "NOT PROVED, line 1: its box is not mapped into itself" in checked.stdout
    assert checked.stdout.count("proved: P(1, 1, 0)") == 1


@pytest.mark.parametrize(
    "arguments", [(), ("survey.zarr", "--check", "file"), ("--check", "nowhere"), ("--point", "0.6", "x")]
)
def test_what_cannot_be_meant_is_said(arguments: tuple[str, ...]) -> None:
    said = ran(*arguments)
    assert said.exit_code == 2 or isinstance(said.exception, rattle.ParameterError)


def test_a_survey_has_its_certificates_beside_it(tmp_path: Path) -> None:
    store = tmp_path / "survey.zarr"
    grid = ("--delta", "0.6:0.61:2", "--epsilon", "0.0615:0.062:2", "--count", "16", "--quantity", "attractors")
    assert CliRunner().invoke(app, ["run", *grid, "--out", str(store)]).exit_code == 0
    said = ran(store)
    assert said.exit_code == 0
    assert re.match(r"([1-9]) of \1 periodic attractors are proved: ", said.stdout)
    checked = ran("--check", tmp_path / "survey.certificates.zarr")
    assert checked.exit_code == 0
    assert checked.stdout.startswith("proved: P(1, 1, 0), attracting")


def test_without_the_extra_a_sentence_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in list(sys.modules):
        if name.startswith("rattle.proof.") and name.rpartition(".")[2] not in ("certify", "certificate", "check"):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "flint", None)
    with pytest.raises(rattle.MissingExtraError, match=r"gear-rattle\[proof\]"):
        raise ran("--point", "0.6", "0.0615").exception or AssertionError
