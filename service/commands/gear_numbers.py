"""The numbers of a gear as options of a command, each one number or a distribution."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from gear_rattle.service.commands.at_point import METRES, Command, with_options
from gear_rattle.service.commands.options import MACHINE, Drive

VALUE = "NUMBER|DISTRIBUTION"


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
    "drive": Drive,
}


def with_numbers(command: Command) -> Command:
    """Give a command these options; it takes what was given, by name, for its first argument."""
    return with_options(
        command, OPTIONS, lambda options: {name: value for name, value in options.items() if value is not None}
    )
