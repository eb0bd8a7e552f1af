"""The README says what the programs print, and its commands exist."""

import re
from pathlib import Path

import pytest
from typer.main import get_command

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()


PAPER = (ROOT / "docs" / "paper.md").read_text()  # checked in test_paper.py


def test_what_is_said_of_the_paper_is_what_its_document_counts():
    agreeing, numbers, findings = map(
        int, re.findall(r"(\d+) of its (\d+) numbers agree .*\n?.*?(\d+) findings", README)[0]
    )
    table = PAPER.split("## Numbers")[1].split("## Statements")[0]
    verdicts = re.findall(r"\| (agrees|off: finding \d+|undecided) \|$", table, re.MULTILINE)
    assert len(verdicts) == numbers
    assert verdicts.count("agrees") == agreeing
    assert len(re.findall(r"^### \d+\. ", PAPER, re.MULTILINE)) == findings


def test_the_first_example_prints_what_its_comment_says(capsys):
    block = re.findall(r"```python\n(import rattle\n.*?)```", README, re.DOTALL)[0]
    exec(block, {})
    (comment,) = re.findall(r"print\(attractor\..*\)  # (.*), …$", block, re.MULTILINE)
    assert capsys.readouterr().out.splitlines()[:3] == comment.split(", ")


def test_commands_named_in_the_readme_exist():
    from gear_rattle.service.cli import app

    named = set(re.findall(r"`rattle (\w+)", README))
    assert named
    assert named <= set(get_command(app).commands)
    makefile = (ROOT / "Makefile").read_text()
    for target in re.findall(r"\bmake (survey|test|lint)\b", README):
        assert f"\n{target}:" in makefile


@pytest.mark.parametrize("link", sorted(set(re.findall(r"\]\((?!https?:)([^)#]+)\)", README))))
def test_links_lead_somewhere(link):
    assert (ROOT / link).exists()
