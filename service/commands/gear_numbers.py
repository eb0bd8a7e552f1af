"""The numbers of a gear as options of a command, each one number or a distribution."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Annotated, Any

import typer

MACHINE = "A machine in SI units, instead of delta, epsilon and beta"
METRES = "m along the line of action"
VALUE = "NUMBER|DISTRIBUTION"

Command = Callable[..., None]


def _option(what: str, panel: str | None = None, default: str | bool = False) -> Any:
    return Annotated[str | None, typer.Option(metavar=VALUE, help=what, rich_help_panel=panel, show_default=default)]


OPTIONS: dict[str, Any] = {
    "delta": _option("Damping."),
    "epsilon": _option("Eccentricity."),
    "beta": _option("Half-backlash.", default="0.6"),
    "kappa": _option("Stiffness of the walls: the stiff model.", default="none: the impacting model"),
    "inertia": _option("kg m², of each gear with what turns with it.", MACHINE),
    "drag": _option("N m s/rad: the drag torque of each gear over its speed.", MACHINE),
    "backlash": _option(f"{METRES}.", MACHINE),
    "eccentricity": _option(f"{METRES}: the amplitude of the transmission error once a revolution.", MACHINE),
    "radius": _option("m, of the base circle.", MACHINE),
    "rpm": _option("Revolutions per minute.", MACHINE),
    "stiffness": _option("N/m of the mesh along the line of action: the stiff model.", MACHINE, "none"),
    "drive": Annotated[
        str | None,
        typer.Option(
            metavar="torque|speed",
            help="A constant torque on one gear, or its speed imposed.",
            rich_help_panel=MACHINE,
            show_default="torque",
        ),
    ],
}


def with_numbers(command: Command) -> Command:
    """Give a command these options; it takes what was given, by name, for its first argument."""
    own = list(inspect.signature(command, eval_str=True).parameters.values())[1:]
    keyword = inspect.Parameter.KEYWORD_ONLY
    shared = [inspect.Parameter(name, keyword, default=None, annotation=kind) for name, kind in OPTIONS.items()]
    required = [each for each in own if each.default is inspect.Parameter.empty]
    taken = [*required, *shared, *(each for each in own if each not in required)]

    @functools.wraps(command)
    def with_given(**given: Any) -> None:
        numbers = {name: value for name in OPTIONS if (value := given.pop(name)) is not None}
        command(numbers, **given)

    del with_given.__wrapped__  # whose annotations typer would take
    with_given.__signature__ = inspect.Signature([each.replace(kind=keyword) for each in taken])  # type: ignore[attr-defined]
    with_given.__annotations__ = {each.name: each.annotation for each in taken}
    return with_given
