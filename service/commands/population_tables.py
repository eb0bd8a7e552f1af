"""What follows from a population, as commands print it."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table

    from rattle import Estimate, Population

WIDTH = 140  # numbers are never cut, whatever the terminal


def print_population(found: Population) -> None:
    """What follows from a population, in words and tables."""
    from rich.console import Console

    from rattle import RattleError
    from rattle.populations.tolerances import is_machine

    console = Console(highlight=False, markup=False, width=WIDTH)
    console.print(f"{found.plan.gears} gears, {found.plan.count} starts each; in brackets 95 % intervals")
    console.print(f"runs quietly with a probability of {_words(found.quiet)}, {100 * found.undecided:.2g} % undecided")
    if found.passing is not None:
        console.print(f"passes: {_words(found.passing)} of all gears")
    if found.undecided < 1.0:
        of = "W" if is_machine(found.plan.tolerances.given) else "energy per revolution"
        console.print(f"impacts hand over ({of}):")
        for share, each in found.intensity().items():
            console.print(f"  {100 * share:g} % of all are below {_words(each)}")
    for of, what in (("quiet", "whether a gear runs quietly"), ("energy", "how hard it rattles")):
        try:
            console.print(_indices(found, of, what))
        except RattleError as error:
            console.print(f"What decides {what}: {error}")
    console.print(_worst(found))


def _words(found: Estimate) -> str:
    return f"{found.value:.4g} [{found.low:.4g}, {found.high:.4g}]"


def _indices(found: Population, of: str, what: str) -> Table:
    from rich.table import Table

    table = Table(f"what decides {what}", "alone", "with others", box=None)
    for name, each in found.indices(of).items():
        table.add_row(name, _words(each.first), _words(each.total))
    return table


def _worst(found: Population) -> Table:
    from rich.table import Table

    table = Table("worst gears", *found.names, "quiet", "energy or W", box=None)
    for each in found.worst():
        values = (f"{x:.6g}" for x in each.numbers.values())
        table.add_row(str(each.row), *values, f"{each.quiet:.3f}", f"{each.energy:.4g}")
    return table
