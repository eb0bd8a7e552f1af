"""The options of one parameter point, which several commands take: dimensionless, or of a machine in SI units."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

if TYPE_CHECKING:
    from rattle import Machine
    from rattle.models import AnyGear

MACHINE = "A machine, two equal gears, in SI units, instead of DELTA and EPSILON"
METRES = "m along the line of action"


class Point(NamedTuple):
    """A parameter point; its machine, if one was given; its speed, if one was given."""

    gear: AnyGear
    machine: Machine | None
    rpm: float | None

    @property
    def words(self) -> str:
        """Its parameters."""
        from rattle.models import model_at

        gear, kappa = self.gear, model_at(self.gear).stiffness
        stiffness = "" if kappa is None else f", kappa = {kappa}"
        return f"delta = {gear.delta}, epsilon = {gear.epsilon}, beta = {gear.beta}{stiffness}"


def _argument(name: str, what: str) -> Any:
    return Annotated[float | None, typer.Argument(metavar=name, help=what, show_default=False)]


def _option(what: str, panel: str | None = None, default: str | bool = False) -> Any:
    return Annotated[float | None, typer.Option(help=what, rich_help_panel=panel, show_default=default)]


#: All None by default, so that a point is given in one of the two ways.
OPTIONS: dict[str, Any] = {
    "delta": _argument("DELTA", "Damping."),
    "epsilon": _argument("EPSILON", "Eccentricity."),
    "beta": _option("Half-backlash.", default="0.6"),
    "kappa": _option("Stiffness of the walls: the stiff model.", default="none: the impacting model"),
    "inertia": _option("kg m², of each gear with what turns with it.", MACHINE),
    "drag": _option("N m s/rad: the drag torque of each gear over its speed.", MACHINE),
    "backlash": _option(f"{METRES}.", MACHINE),
    "eccentricity": _option(f"{METRES}: the amplitude of the transmission error once a revolution.", MACHINE),
    "radius": _option("m, of the base circle.", MACHINE),
    "rpm": _option("Revolutions per minute.", MACHINE),
    "drive": Annotated[
        str | None,
        typer.Option(
            metavar="torque|speed",
            help="A constant torque on one gear, or its speed imposed.",
            rich_help_panel=MACHINE,
            show_default="torque",
        ),
    ],
    "stiffness": _option(
        "N/m of the mesh along the line of action: the stiff model.", MACHINE, "teeth do not give way"
    ),
}
NEEDED = ("inertia", "drag", "backlash", "eccentricity", "radius", "rpm")  # of a machine
DIMENSIONLESS = ("delta", "epsilon", "beta", "kappa")

Command = Callable[..., None]


def at_point(*, timed: bool = False) -> Callable[[Command], Command]:
    """Give a command these options; it takes the `Point` that they describe for its first argument.

    Args:
        timed: --rpm is of use beside DELTA and EPSILON too.
    """

    def given_point(command: Command) -> Command:
        return with_options(command, OPTIONS, lambda options: point_of(options, timed))

    return given_point


def with_options(command: Command, options: dict[str, Any], taken_as: Callable[[dict[str, Any]], Any]) -> Command:
    """Give a command options, all None by default; it takes what `taken_as` makes of them for its first argument."""
    keyword = inspect.Parameter.KEYWORD_ONLY
    own = list(inspect.signature(command, eval_str=True).parameters.values())[1:]
    shared = [inspect.Parameter(name, keyword, default=None, annotation=kind) for name, kind in options.items()]
    required = [each for each in own if each.default is inspect.Parameter.empty]  # such as a file, named first
    taken = [*required, *shared, *(each for each in own if each not in required)]

    @functools.wraps(command)
    def with_given(**given: Any) -> None:
        found = {name: given.pop(name) for name in options}
        command(taken_as(found), **given)

    del with_given.__wrapped__  # whose annotations typer would take
    with_given.__signature__ = inspect.Signature([each.replace(kind=keyword) for each in taken])  # type: ignore[attr-defined]
    with_given.__annotations__ = {each.name: each.annotation for each in taken}
    return with_given


def point_of(options: dict[str, Any], timed: bool) -> Point:
    """The point that OPTIONS describe, in one of the two ways."""
    given = {name: value for name, value in options.items() if value is not None}
    plain = {name: given[name] for name in DIMENSIONLESS if name in given}
    machine = {name: value for name, value in given.items() if name not in plain}
    if set(machine) - {"rpm"} or (machine and not timed):
        return _machine_point(plain, machine)
    if not {"delta", "epsilon"} <= set(plain):
        raise typer.BadParameter("give DELTA and EPSILON, or a machine: --inertia, --drag, and so on")

    from rattle.errors import require_number
    from rattle.models import model_of

    rpm = given.get("rpm")
    gear = model_of(plain.get("beta", 0.6), plain.get("kappa")).gear(plain["delta"], plain["epsilon"])
    return Point(gear, None, None if rpm is None else require_number("rpm", rpm, positive=True))


def _machine_point(plain: dict[str, float], machine: dict[str, Any]) -> Point:
    if plain:
        raise typer.BadParameter(
            f"{' and '.join(plain)} and a machine's {' and '.join(machine)} are two ways to say it: give one"
        )
    missing = [f"--{name}" for name in NEEDED if name not in machine]
    if missing:
        raise typer.BadParameter(f"a machine needs {' and '.join(missing)} too")

    from rattle import Machine

    found = Machine(**machine)
    return Point(found.gear, found, found.rpm)
