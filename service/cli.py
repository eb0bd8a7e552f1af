"""The command ``rattle``. A new command is a function in a file of its own and a line here."""

from __future__ import annotations

import atexit
import gc
import os
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from errno import ENOSPC
from importlib.metadata import version
from io import TextIOWrapper
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from gear_rattle.service.commands import key, letters
from gear_rattle.service.commands.attractors import attractors
from gear_rattle.service.commands.bifurcation_curves import curves
from gear_rattle.service.commands.bifurcation_diagram import diagram
from gear_rattle.service.commands.certify import certify
from gear_rattle.service.commands.compare import compare
from gear_rattle.service.commands.copy import copy
from gear_rattle.service.commands.explain import explain
from gear_rattle.service.commands.export import export
from gear_rattle.service.commands.figure import figure
from gear_rattle.service.commands.limit import limit
from gear_rattle.service.commands.opening import open_
from gear_rattle.service.commands.orbits import orbits
from gear_rattle.service.commands.paper import paper
from gear_rattle.service.commands.remote import describe, list_, submit, watch
from gear_rattle.service.commands.run import run
from gear_rattle.service.commands.serve import serve
from gear_rattle.service.commands.sound import sound
from gear_rattle.service.commands.tolerance import tolerance
from gear_rattle.service.commands.verify import verify

FAILED, REFUSED = 1, 2  # exit status of a command that failed, and of a command that was refused with a message
FIRST_STEPS = (
    "Start here: `rattle orbits 0.6 0.1` describes one gear; `rattle run --delta 0.4:1:61 --epsilon 0.005:0.3:60 --out "
    "survey.zarr` computes a survey, and `rattle figure survey.zarr survey.png` draws it. `rattle COMMAND --help` has "
    "an example of each command."
)


class CommandGroup(TyperGroup):
    """The group of all commands. It replaces pydantic's messages about wrong values by this project's."""

    def invoke(self, ctx: typer.Context) -> Any:  # type: ignore[override]
        """Run the command; replace pydantic's message of an error about a wrong value by this project's message."""
        try:
            return super().invoke(ctx)
        except typer.BadParameter as error:
            if error.param is not None and hasattr(error.__cause__, "errors"):  # typer's error, caused by pydantic's
                from gear_rattle.workers.survey.axes import message_of_first_error

                error.message = message_of_first_error(error.__cause__)  # type: ignore[arg-type]
            raise


app = typer.Typer(
    cls=CommandGroup,
    help=f"Survey the damping-eccentricity plane of an impacting gear model.\n\n{FIRST_STEPS}",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


def _print_version(is_requested: bool) -> None:
    if is_requested:
        typer.echo(f"rattle {version('gear-rattle')}")  # importing the library would load the compiler
        raise typer.Exit


@app.callback()
def _top_level_options(
    _: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    pass


#: {group in `rattle --help`: its commands, each with an example}.
COMMANDS: dict[str, tuple[tuple[Callable[..., Any], str], ...]] = {
    "Survey": (
        (run, "run --delta 0.4:1:61 --epsilon 0.005:0.3:60 --out survey.zarr"),
        (open_, "open survey.zarr"),
        (figure, "figure survey.zarr survey.png"),
        (explain, "explain survey.zarr"),
        (export, "export survey.zarr survey.nc"),
        (copy, "copy survey.zarr s3://bucket/surveys/survey.zarr"),
        (verify, "verify survey.zarr"),
    ),
    "One gear": (
        (orbits, "orbits 0.6 0.1"),
        (attractors, "attractors 0.6 0.1"),
        (diagram, "diagram --delta 0.6 --epsilon 0.05:0.12 --figure diagram.pdf"),
        (curves, "curves --csv curves.csv"),
        (sound, "sound rattling.wav 0.6 0.1 --rpm 3000"),
    ),
    "Engineering": (
        (tolerance, "tolerance --delta 0.6 --epsilon normal:0.1:0.01:0 --out batch.zarr"),
        (limit, "limit epsilon --delta 0.6 --share 0.9"),
        (compare, "compare impacts.csv 0.6 0.1"),
    ),
    "Proofs": (
        (certify, "certify --point 0.6 0.089"),
        (paper, "paper"),
    ),
    "Service": (
        (serve, "serve --data data"),
        (submit, "submit --delta 0.4:1:31 --epsilon 0.005:0.3:30 --watch"),
        (list_, "list"),
        (watch, "watch ID"),
        (describe, 'describe ID --name "first map"'),
    ),
}
for panel, commands in COMMANDS.items():
    for command, example in commands:
        name = command.__name__.removesuffix("_")
        app.command(name, rich_help_panel=panel, epilog=f"Example: rattle {example}")(command)
app.add_typer(key.app, name="key", rich_help_panel="Service", epilog="Example: rattle key add alice --scope submit")


def main() -> None:
    """Run a command. An error of this project is printed as a sentence without traceback; the exit status is then 2."""
    status: list[int] = []
    atexit.register(_end_process_with_busy_threads, status)  # registered first, so that it is called last
    atexit.register(gc.freeze)  # the garbage collection at exit would scan all modules, which is slow
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            # This error handler replaces letters, such as δ, that the terminal does not have.
            stream.reconfigure(errors=letters.NEAREST_LETTERS)
    try:
        _run_command()
    except SystemExit as end:
        status.append(end.code if isinstance(end.code, int) else FAILED if end.code else 0)
        raise


def _end_process_with_busy_threads(status: list[int]) -> None:
    """End the process at once if a thread still computes or compiles, because Python would wait for this thread.

    status: a list with the exit status, or empty if the command failed with an unexpected error.
    """
    if any(thread.daemon for thread in threading.enumerate()):
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):  # raised if the program that reads the output has ended
                stream.flush()
        os._exit(status[0] if status else FAILED)


def _expand_home(argument: str) -> str:
    """Expand `~` in an argument such as `--out=~/x`, where shells do not expand it."""
    name, _, value = argument.partition("=")
    if name.startswith("--") and (value == "~" or value.startswith("~/")):
        return f"{name}={os.path.expanduser(value)}"
    return argument


def _run_command() -> None:
    try:
        app([_expand_home(each) for each in sys.argv[1:]])
    except ModuleNotFoundError as error:
        typer.echo(
            f"rattle: {error.name} is not installed. For the service: pip install 'gear-rattle[service]'", err=True
        )
        raise SystemExit(REFUSED) from error
    except OSError as error:
        if error.errno != ENOSPC or error.filename is not None:
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # otherwise Python fails again when it flushes the output at exit
        typer.echo(f"rattle: the output cannot be written ({error.strerror}): free space, or write elsewhere", err=True)
        raise SystemExit(FAILED) from error
    except Exception as error:
        errors = sys.modules.get("rattle.errors")  # importing it would load the compiler
        if errors is None or not isinstance(error, errors.RattleError):
            raise
        typer.echo(f"rattle: {error}", err=True)
        raise SystemExit(REFUSED) from error
