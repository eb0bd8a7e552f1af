"""``rattle attractors``: print the attractors of one parameter point, and how hard they rattle."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated

import typer

from gear_rattle.service.commands.at_point import GivenPoint, add_point_options
from gear_rattle.service.commands.options import Sample, Seed

if TYPE_CHECKING:
    from rattle import Attractor

WIDTH = 160  # characters in a line, enough for all numbers, however wide the terminal is

SpeedLimit = Annotated[
    float | None, typer.Option(help="Largest initial speed of the model.", show_default="by the motion's own scale")
]


def attractors_of_point(point: GivenPoint, count: int, v_max: float | None, seed: int) -> tuple[Attractor, ...]:
    """Return the attractors of a point by falling basin fraction.

    v_max: the largest initial speed of samples; None for the natural speed of the point.
    """
    return point.gear.attractors(count, "natural" if v_max is None else v_max, seed)


def attractor_name(attractor: Attractor) -> str:
    """Return the label of a periodic attractor, or the kind of any other attractor."""
    phases = f"; {attractor.contacts}" if attractor.contacts else ""
    label = f"P({attractor.m}, {attractor.n_plus}, {attractor.n_minus}{phases})"
    return label if attractor.kind == "periodic" else attractor.kind


@add_point_options()
def attractors(
    point: GivenPoint,
    count: Sample = 64,
    v_max: SpeedLimit = None,
    seed: Seed = 0,
    verdict: Annotated[
        bool, typer.Option("--verdict", help="Print in one line whether a machine rattles, and nothing else.")
    ] = False,
) -> None:
    """Print the attractors of one parameter point, their basin fractions, and how hard they rattle.

    The column share has the basin fraction, with its 95 % interval. Impacts and energies are per revolution. For a
    machine, speeds are in m/s along the line of action, and the power of the impacts is in watts and in dB re 1 pW.
    Figures of chaotic motions have a 95 % error bar; undecided samples have no figures.
    """
    from rich.console import Console
    from rich.table import Table

    machine = point.machine
    if verdict:
        if machine is None:
            raise typer.BadParameter("--verdict needs a machine: give --inertia, --drag, and so on")
        typer.echo(str(machine.verdict(count, seed)))
        return
    console = Console(highlight=False, width=WIDTH)
    console.print(point.parameters_text)
    columns = ("energy", "+-") if machine is None else ("W", "+-", "dB re 1 pW")
    speeds = ("mean speed", "largest") if machine is None else ("mean m/s", "largest m/s")
    interval = "95 % from", "to"
    table = Table("attractor", "share", *interval, "impacts+", "impacts-", *speeds, *columns, "in contact", box=None)
    for each in attractors_of_point(point, count, v_max, seed):
        found = point.gear.intensity(each)
        if machine is None:
            velocity, loud = 1.0, [_number_text(found.energy), _number_text(found.errors.energy)]
        else:
            whole, velocity = machine.intensity_in_si(found), machine.units.velocity
            loud = [_number_text(whole.power), _number_text(whole.power_error), _number_text(round(whole.level, 2))]
        table.add_row(
            attractor_name(each),
            *(f"{share:.4f}" for share in (each.fraction, *each.fraction_interval)),
            *(_number_text(x) for x in (found.impacts_plus, found.impacts_minus)),
            *(_number_text(x * velocity) for x in (found.mean_speed, found.largest_speed)),
            *loud,
            _number_text(found.contact),
        )
    console.print(table)


def _number_text(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.6g}"
