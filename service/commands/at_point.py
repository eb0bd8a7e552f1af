"""The options of one parameter point, which several commands take: dimensionless, or of a machine in SI units."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from gear_rattle.service.commands.options import DIMENSIONLESS, NUMBERS, Command, number_options, with_options

if TYPE_CHECKING:
    from rattle import Machine
    from rattle.models import AnyGear


class GivenPoint(NamedTuple):
    """A parameter point; its machine, if one was given; its speed, if one was given."""

    gear: AnyGear
    machine: Machine | None
    rpm: float | None

    @property
    def words(self) -> str:
        """Its parameters."""
        return ", ".join(f"{name} = {value}" for name, value in self.gear.parameters.point().items())


def _argument(name: str) -> Any:
    return Annotated[float | None, typer.Argument(metavar=name.upper(), help=NUMBERS[name][0], show_default=False)]


#: All None by default, so that a point is given in one of the two ways.
OPTIONS: dict[str, Any] = {
    **number_options(float, panel="A machine, two equal gears, in SI units, instead of DELTA and EPSILON"),
    "delta": _argument("delta"),
    "epsilon": _argument("epsilon"),
}
NEEDED = ("inertia", "drag", "backlash", "eccentricity", "radius", "rpm")  # of a machine


def at_point(*, timed: bool = False) -> Callable[[Command], Command]:
    """Give a command these options; it takes the `GivenPoint` that they describe for its first argument.

    Parameters
    ----------
    timed : bool
        --rpm is of use beside DELTA and EPSILON too.
    """

    def given_point(command: Command) -> Command:
        return with_options(command, OPTIONS, lambda given: point_of_options(given, timed))

    return given_point


def point_of_options(given: dict[str, Any], timed: bool) -> GivenPoint:
    """Return the point that OPTIONS describe, in one of the two ways."""
    plain = {name: given[name] for name in DIMENSIONLESS if name in given}
    machine = {name: value for name, value in given.items() if name not in plain}
    if set(machine) - {"rpm"} or (machine and not timed):
        return _machine_point(plain, machine)
    if not {"delta", "epsilon"} <= set(plain):
        raise typer.BadParameter("give DELTA and EPSILON, or a machine: --inertia, --drag, and so on")

    from rattle.errors import require_number
    from rattle.models import model_of

    rpm = given.get("rpm")
    delta, epsilon = plain.pop("delta"), plain.pop("epsilon")
    gear = model_of(**plain).gear(delta, epsilon)
    return GivenPoint(gear, None, None if rpm is None else require_number("rpm", rpm, positive=True))


def _machine_point(plain: dict[str, float], machine: dict[str, Any]) -> GivenPoint:
    if plain:
        raise typer.BadParameter(
            f"{' and '.join(plain)} and a machine's {' and '.join(machine)} are two ways to say it: give one"
        )
    missing = [f"--{name}" for name in NEEDED if name not in machine]
    if missing:
        raise typer.BadParameter(f"a machine needs {' and '.join(missing)} too")

    from rattle import Machine

    found = Machine(**machine)
    return GivenPoint(found.gear, found, found.rpm)
