"""Print the answers about a population of gears, for several commands."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table

    from rattle import Estimate, Population

WIDTH = 140  # characters in a line, enough for all numbers, however wide the terminal is
#: {number of a machine: its unit in a table, and the factor from the SI unit}.
UNITS = {
    "eccentricity": ("µm", 1e6),
    "backlash": ("µm", 1e6),
    "radius": ("mm", 1e3),
    "inertia": ("kg m²", 1.0),
    "drag": ("N m s/rad", 1.0),
    "stiffness": ("N/m", 1.0),
}


def print_population(found: Population) -> None:
    """Print the answers about a population as text and tables."""
    from rich.console import Console

    from rattle import RattleError
    from rattle.populations import is_machine

    console = Console(highlight=False, markup=False, width=WIDTH)
    console.print(f"{found.plan.gears} gears, {found.plan.count} starts each; in brackets 95 % intervals")
    console.print(
        f"runs quietly with a probability of {_estimate_text(found.quiet)}, {100 * found.undecided:.2g} % undecided"
    )
    if found.passing is not None:
        console.print(f"passes: {_estimate_text(found.passing)} of all gears")
    if found.undecided < 1.0:
        of = "W" if is_machine(found.plan.tolerances.given) else "energy per revolution"
        console.print(f"impacts hand over ({of}):")
        for share, each in found.intensity().items():
            console.print(f"  {100 * share:g} % of all are below {_estimate_text(each)}")
    for of, what in (("quiet", "whether a gear runs quietly"), ("energy", "how hard it rattles")):
        try:
            console.print(_sobol_table(found, of, what))
        except RattleError as error:
            console.print(f"What decides {what}: {error}")
    console.print(_worst_gears_table(found))


def _estimate_text(found: Estimate) -> str:
    return f"{found.value:.4g} [{found.low:.4g}, {found.high:.4g}]"


def _sobol_table(found: Population, of: str, what: str) -> Table:
    from rich.table import Table

    table = Table(f"what decides {what} [95 %]", "alone", "with others", box=None)
    for name, each in found.indices(of).items():
        table.add_row(name, _estimate_text(each.first), _estimate_text(each.total))
    return table


def _worst_gears_table(found: Population) -> Table:
    from rich.table import Table

    from rattle.populations import is_machine

    machine = is_machine(found.plan.tolerances.given)
    units = {name: UNITS.get(name, ("", 1.0)) if machine else ("", 1.0) for name in found.names}
    headings = (f"{name}, {unit}" if unit else name for name, (unit, _) in units.items())
    loud = "power, W" if machine else "energy per revolution"
    table = Table("worst gears", *headings, "quiet", loud, box=None)
    for each in found.worst():
        values = (f"{x * units[name][1]:.6g}" for name, x in each.numbers.items())
        table.add_row(str(each.row), *values, f"{each.quiet:.3f}", f"{each.energy:.4g}")
    return table
