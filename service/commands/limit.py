"""``rattle limit``: print the design limit of one number of a gear."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gear_rattle.service.commands import options

if TYPE_CHECKING:
    from rattle import Limit

#: The unit in which a length is printed, and the factor from metres to this unit.
MICROMETRES = (" µm", 1e6)
LENGTHS = ("eccentricity", "backlash", "driven_eccentricity", "mesh_error", "mesh_error_2", "mesh_error_3")
UNITS = {
    **dict.fromkeys(LENGTHS, MICROMETRES),
    "rpm": (" rpm", 1.0),
    "drag": (" N m s/rad", 1.0),
    "load_torque": (" N m", 1.0),
}
MOST_VALUES = 1000  # largest number of values for --over


@options.add_number_options
def limit(
    numbers: dict[str, str],
    of: Annotated[
        str,
        typer.Argument(
            metavar="NUMBER",
            help="Number to limit: eccentricity, mesh_error, backlash, rpm, drag or load_torque of a machine, error_12 "
            "the amplitude of its order 12; epsilon, beta, delta, load, harmonic_12; or restitution.",
        ),
    ],
    share: Annotated[float, typer.Option(help="Least probability of quiet running.")] = 0.99,
    over: Annotated[
        str | None,
        typer.Option(
            metavar="NAME=START:STOP:NUM", help="Compute the limit as a curve over another number.", show_default=False
        ),
    ] = None,
    between: Annotated[
        str | None,
        typer.Option(
            metavar="LOW:HIGH",
            help="Range in which the limit is searched.",
            show_default="up to where nothing is quiet",
        ),
    ] = None,
    count: Annotated[int, typer.Option(help="Number of initial conditions.")] = 2048,
    budget: options.Budget = None,
    seed: options.Seed = 0,
) -> None:
    """Print the design limit: the value of a number up to which a gear runs quietly with a given probability.

    For eccentricity, mesh error, backlash, restitution and speed this is the largest allowed value, for damping, drag
    and load the least. All other numbers of the gear are options: delta, epsilon and beta, or a machine's numbers.
    """
    from gear_rattle.service.commands.progress import print_compilation_messages
    from rattle import design_limit, design_limits
    from rattle.attractors import BUDGET

    given: dict[str, Any] = {
        name: text if name == "drive" else _read_number(name, text) for name, text in numbers.items()
    }
    asked: dict[str, Any] = {"between": None if between is None else _read_range(between)}
    asked |= {"count": count, "seed": seed, "budget": BUDGET if budget is None else budget}
    with print_compilation_messages():
        if over is None:
            at = f" at {given['rpm']:g} rpm" if "rpm" in given and of != "rpm" else ""
            typer.echo(_limit_text(of, share, design_limit(given, of, share, **asked), at))
            return
        name, values = _read_axis(over)
        for value in values:
            (found,) = design_limits(given, of, name, [value], share, **asked)
            unit, scale = UNITS.get(name, ("", 1.0))
            typer.echo(f"{name} {scale * value:.6g}{unit if scale != 1.0 else ''}: {_limit_text(of, share, found)}")


def _limit_text(of: str, share: float, found: Limit, at: str = "") -> str:
    """Return a limit as a line of text.

    of: the name of the limited number. share: the required probability of quiet running. at: words to add, such as
    " at 900 rpm".
    """
    from rattle.populations import SAFE_IF_SMALL

    unit, scale = UNITS.get(of, MICROMETRES if of.startswith("error_") else ("", 1.0))
    if math.isnan(found.value):
        return f"no limit of {of} was found in the searched range: give another range with --between"
    # SAFE_IF_SMALL does not list amplitudes of orders, such as error_12. Such an amplitude is safe if it is small.
    way = "up to" if SAFE_IF_SMALL.get(of, True) else "down to"
    value, low, high = (f"{scale * x:.4g}" for x in found)
    return f"{of} {way} {value}{unit} [{low}, {high}]{at} for P(quiet) of {share:g} at least"


def _read_number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise typer.BadParameter(
            f"--{name} must be a number, got {text!r}: rattle limit accepts no distributions"
        ) from None


def _read_range(text: str) -> tuple[float, float]:
    try:
        low, high = (float(part) for part in text.split(":"))
    except ValueError:
        raise typer.BadParameter(f"--between {text!r}: write LOW:HIGH, such as 1e-6:50e-6") from None
    return low, high


def _read_axis(text: str) -> tuple[str, list[float]]:
    from gear_rattle.workers import Axis

    name, _, axis = text.partition("=")
    values = Axis.parse(axis)
    if values.num > MOST_VALUES:
        raise typer.BadParameter(f"{values.num:,} values exceed the limit of {MOST_VALUES:,}: lower NUM")
    return name, values.values().tolist()
