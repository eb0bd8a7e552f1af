"""Every line of docs/engineers.md is executed, and prints what stands there."""

import io
import re
import shlex
from contextlib import redirect_stdout
from pathlib import Path
from string import Template
from typing import Any

import pytest
from typer.testing import CliRunner

import rattle
from gear_rattle.service.cli import app
from rattle.machine import VERDICTS

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "engineers.md").read_text()
BLOCKS = re.findall(r"```(python|sh)\n(.*?)```", TEXT, re.DOTALL)
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
PYTHON = 10
ROUGH = 0.1  # of what a sample finds, where the document says "about"


def promised(block: str) -> list[str]:
    """Return the output that comments behind or below prints promise."""
    return re.findall(r"(?:^ +# |print\(.*\)  # )(.*)$", block, re.MULTILINE)


def test_the_question_and_its_four_answers_stand_first() -> None:
    first = TEXT.split("\n\n")[1]
    assert first.startswith("**Will this pair of gears rattle?**")
    for kind in VERDICTS:
        assert kind.split("_")[0] in first
    assert "pair of gears" in (rattle.Machine.__doc__ or "").partition("\n")[0]


def agrees(said: str, printed: str) -> bool:
    if not said.startswith("about "):
        return said == printed
    said = said.removeprefix("about ")
    numbers = (list(map(float, NUMBER.findall(text))) for text in (said, printed))
    near = all(abs(a - b) <= ROUGH for a, b in zip(*numbers, strict=True))
    return near and NUMBER.sub("", said) == NUMBER.sub("", printed)


def test_every_line_is_executed_and_prints_what_it_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    variables: dict[str, str] = {}
    out = ""
    assert [kind for kind, _ in BLOCKS].count("python") == PYTHON
    for kind, block in BLOCKS:
        if kind == "python":
            printed = io.StringIO()
            with redirect_stdout(printed):
                exec(block, names)
            lines, said = printed.getvalue().splitlines(), promised(block)
            assert len(lines) >= len(said)
            for line, comment in zip(lines, said, strict=False):
                assert agrees(comment, line), (comment, line)
        else:
            out = run(block, variables)
    assert (tmp_path / "rattling.wav").stat().st_size == 44 + 2 * 2 * 44100
    assert re.search(r"^2 impacts per revolution, P\(1, 2, 0\)$", out, re.MULTILINE)
    nearest = out.split("nearest")[1].splitlines()[1]
    assert nearest.split()[:3] == ["P(1,", "2,", "0)"]


def run(block: str, variables: dict[str, str]) -> str:
    """Return the output of the last of these lines; each is NAME="VALUE" or a command, as a shell reads it."""
    printed = ""
    for line in block.splitlines():
        words = shlex.split(Template(line).substitute(variables))
        if words[0] == "rattle":
            done = CliRunner().invoke(app, words[1:])
            assert done.exit_code == 0, done.output
            printed = done.output
        else:
            ((name, value),) = (word.split("=", 1) for word in words)
            variables[name] = value
    return printed


@pytest.mark.parametrize("link", sorted(set(re.findall(r"\]\((?!https?:)([^)#]+)\)", TEXT))))
def test_links_lead_somewhere(link: str) -> None:
    assert (ROOT / "docs" / link).exists()


def test_what_is_about_right_is_told_from_what_is_wrong() -> None:
    assert agrees("about 0.57 quiet 0", "0.55 quiet 0")
    assert not agrees("about 0.57 quiet 0", "0.40 quiet 0")
    assert not agrees("about 0.57 quiet 0", "0.57 chaotic 0")
    assert not agrees("0.57", "0.56")
