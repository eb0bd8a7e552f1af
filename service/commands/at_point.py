"""Options that describe one gear, by dimensionless numbers or as a machine in SI units, for several commands."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from gear_rattle.service.commands.options import (
    DIMENSIONLESS,
    HARMONIC,
    MACHINE,
    NUMBERS,
    Command,
    add_command_options,
    make_number_options,
)

if TYPE_CHECKING:
    from rattle import Machine
    from rattle.models import AnyGear


class GivenPoint(NamedTuple):
    """The gear that the options of a command describe.

    machine: the machine whose numbers the options give; None for dimensionless numbers. rpm: the speed in
    revolutions per minute; None if no option gives it.
    """

    gear: AnyGear
    machine: Machine | None
    rpm: float | None

    @property
    def parameters_text(self) -> str:
        """The parameters and harmonics of the gear as text, such as "delta = 0.6, epsilon = 0.1, beta = 0.6"."""
        words = [f"{name} = {value}" for name, value in self.gear.parameters.point().items()]
        words += [f"harmonic {k}: {size:g} at {phase:g}" for k, size, phase in self.gear.parameters.harmonics]
        return ", ".join(words)


def _number_argument(name: str) -> Any:
    return Annotated[float | None, typer.Argument(metavar=name.upper(), help=NUMBERS[name][0], show_default=False)]


#: All options are None by default, so that a command can tell which options were not given.
OPTIONS: dict[str, Any] = {
    **make_number_options(float, panel=MACHINE.replace("delta, epsilon and beta", "DELTA and EPSILON")),
    "transmission_error": Annotated[
        Path | None,
        typer.Option(
            metavar="CSV",
            help="Measured transmission error over whole revolutions, instead of --eccentricity: a column angle_deg, "
            "angle_rad or angle_rev, and one error_um, error_mm or error_m.",
            rich_help_panel=MACHINE,
            show_default=False,
        ),
    ],
    "orders": Annotated[
        int | None,
        typer.Option(help="Highest order of --transmission-error.", rich_help_panel=MACHINE, show_default="40"),
    ],
    "delta": _number_argument("delta"),
    "epsilon": _number_argument("epsilon"),
    "harmonic": Annotated[
        list[str] | None, typer.Option(metavar="ORDER:AMPLITUDE:PHASE", help=HARMONIC, show_default="none")
    ],
}
REQUIRED_NUMBERS = ("inertia", "drag", "backlash", "eccentricity", "radius", "rpm")  # numbers that every machine needs


def add_point_options(*, allows_rpm: bool = False) -> Callable[[Command], Command]:
    """Return a decorator that gives a command the options that describe one gear.

    The command's first argument is then a `GivenPoint`.

    Parameters
    ----------
    allows_rpm : bool
        Allow --rpm together with DELTA and EPSILON.
    """

    def add_options(command: Command) -> Command:
        return add_command_options(command, OPTIONS, lambda given: point_of_options(given, allows_rpm))

    return add_options


def point_of_options(given: dict[str, Any], allows_rpm: bool) -> GivenPoint:
    """Return the point that the given options describe, by dimensionless numbers or as a machine.

    allows_rpm: True if the option --rpm may be given together with dimensionless numbers.

    Returns
    -------
    GivenPoint
        The gear, and its machine and speed if they are given.

    Raises
    ------
    BadParameter
        Options are missing, or exclude each other.
    """
    harmonics = given.pop("harmonic", None) or ()
    plain = {name: given[name] for name in DIMENSIONLESS if name in given}
    machine = {name: value for name, value in given.items() if name not in plain}
    if set(machine) - {"rpm"} and "restitution" in plain:
        machine["restitution"] = plain.pop("restitution")
    if set(machine) - {"rpm"} or (machine and not allows_rpm):
        return _machine_point(plain | ({"harmonic": harmonics} if harmonics else {}), machine)
    if not {"delta", "epsilon"} <= set(plain):
        raise typer.BadParameter("give DELTA and EPSILON, or a machine: --inertia, --drag, and so on")

    from gear_rattle.service.harmonics import read_harmonics
    from rattle.errors import require_number
    from rattle.models import model_of, with_harmonics

    rpm = given.get("rpm")
    delta, epsilon = plain.pop("delta"), plain.pop("epsilon")
    gear = with_harmonics(model_of(**plain), read_harmonics(harmonics)).gear(delta, epsilon)
    return GivenPoint(gear, None, None if rpm is None else require_number("rpm", rpm, positive=True))


def _machine_point(plain: dict[str, Any], machine: dict[str, Any]) -> GivenPoint:
    if plain:
        raise typer.BadParameter(
            f"{' and '.join(plain)} and a machine's {' and '.join(machine)} exclude each other: give only dimensionless"
            " numbers, or only a machine's numbers"
        )
    curve, orders = machine.pop("transmission_error", None), machine.pop("orders", None)
    if curve is not None:
        machine = {**machine, **_read_measured_harmonics(curve, orders, machine)}
    elif orders is not None:
        raise typer.BadParameter("--orders needs a measured curve: give --transmission-error too")
    missing = [f"--{name}" for name in REQUIRED_NUMBERS if name not in machine]
    if missing:
        raise typer.BadParameter(f"a machine needs {' and '.join(missing)} too")

    from rattle import Machine

    found = Machine(**machine)
    return GivenPoint(found.gear, found, found.rpm)


def _read_measured_harmonics(curve: Path, orders: int | None, machine: dict[str, Any]) -> dict[str, Any]:
    """Read a measured transmission error, print a summary, and return its harmonics as numbers of a machine."""
    from rattle import read_transmission_error

    if "eccentricity" in machine:
        raise typer.BadParameter("--transmission-error takes the place of --eccentricity: leave out one of the two")
    found = read_transmission_error(curve) if orders is None else read_transmission_error(curve, orders)
    typer.echo(f"{curve}: {found}")
    return {"eccentricity": 0.0, "errors": found.harmonics}
