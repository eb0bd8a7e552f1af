"""The README says what the programs print, and its commands exist."""

import re
import runpy
from pathlib import Path

import pytest
from typer.main import get_command

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()


NUMBER = re.compile(r"\d+\.\d+")


def test_the_table_of_the_papers_numbers_is_the_printed_one(capsys):
    """To the last digit but one; basin fractions, whose boundaries are fractal, to 0.003."""
    runpy.run_path(str(ROOT / "examples" / "paper_numbers.py"), run_name="__main__")
    printed = capsys.readouterr().out.strip().splitlines()
    assert len(printed) > 20
    start = README.splitlines().index(printed[0])
    for ours, shown in zip(printed, README.splitlines()[start:], strict=False):
        assert NUMBER.sub("#", ours) == NUMBER.sub("#", shown)
        for one, other in zip(NUMBER.findall(ours), NUMBER.findall(shown), strict=True):
            decimals = len(one.split(".")[1])
            assert float(one) == pytest.approx(float(other), abs=3.0 * 10.0**-decimals)


def test_commands_named_in_the_readme_exist():
    from service.cli import app

    named = set(re.findall(r"`rattle (\w+)", README))
    assert named
    assert named <= set(get_command(app).commands)
    makefile = (ROOT / "Makefile").read_text()
    for target in re.findall(r"\bmake (survey|test|lint)\b", README):
        assert f"\n{target}:" in makefile


@pytest.mark.parametrize("link", sorted(set(re.findall(r"\]\((?!https?:)([^)#]+)\)", README))))
def test_links_lead_somewhere(link):
    assert (ROOT / link).exists()
