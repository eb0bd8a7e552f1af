"""`rattle --help` groups the commands, says where to start, and each command has an example that it takes."""

import shlex
from typing import Any

import pytest
import typer.main
from typer.testing import CliRunner

from gear_rattle.service.cli import COMMANDS, FIRST_STEPS, app

GROUP: Any = typer.main.get_command(app)
NAMES = sorted(GROUP.commands)


def test_help_has_the_groups_and_a_start() -> None:
    shown = " ".join(CliRunner().invoke(app, ["--help"]).output.replace("│", " ").split())
    for panel in ("Survey", "One gear", "Engineering", "Proofs", "Service"):
        assert f"─ {panel} ─" in shown
    assert list(COMMANDS) == ["Survey", "One gear", "Engineering", "Proofs", "Service"]
    assert "Start here" in shown
    assert "rattle orbits 0.6 0.1" in FIRST_STEPS


@pytest.mark.parametrize("name", NAMES)
def test_each_command_has_an_example_of_options_that_it_knows(name: str) -> None:
    command = GROUP.commands[name]
    _, first, *arguments = shlex.split(command.epilog.removeprefix("Example: "))
    assert first == name
    while hasattr(command, "commands"):
        command = command.commands[arguments.pop(0)]
    with command.make_context(name, arguments, resilient_parsing=True) as context:
        assert not context.args


@pytest.mark.parametrize("name", [name for name in NAMES if name != "key"])
def test_each_option_is_described(name: str) -> None:
    for option in GROUP.commands[name].params:
        if option.name != "help":
            text = getattr(option, "help", None)
            assert text is None or ((text[0].isupper() or text[0] in "`(") and text.endswith(".")), (option.name, text)
