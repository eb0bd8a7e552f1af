"""``rattle orbits``: one parameter point."""

from __future__ import annotations

from typing import Annotated

import typer

from service.commands.options import Beta

WIDTH = 140  # numbers are never cut, whatever the terminal
REGIONS = ("none of I to V", "I", "II", "III", "IV", "V")


def orbits(
    delta: Annotated[float, typer.Argument(metavar="DELTA", help="Damping.")],
    epsilon: Annotated[float, typer.Argument(metavar="EPSILON", help="Eccentricity.")],
    beta: Beta = 0.6,
) -> None:
    """Print the period-one orbits of one parameter point, its region and its analytic limits."""
    from rich.console import Console
    from rich.table import Table

    from rattle import Gear

    gear = Gear(delta, epsilon, beta)
    console = Console(highlight=False, width=WIDTH)
    console.print(
        f"delta = {gear.delta}, epsilon = {gear.epsilon}, beta = {gear.beta}: region {REGIONS[gear.region()]}\n"
        f"SN1 at epsilon = {gear.sn1:.10g}, flip at {gear.flip:.10g}, quiet limit at {gear.quiet_limit:.10g}"
    )
    table = Table("orbit", "P(m, n+, n-)", "phase", "speed", "multipliers", "stable", box=None)
    for orbit in gear.orbits():
        first, second = (_complex(value) for value in orbit.multipliers)
        label = f"({orbit.m}, {orbit.n_plus}, {orbit.n_minus})"
        stable = "yes" if orbit.stable else "no"
        table.add_row(orbit.name, label, f"{orbit.tau:.10f}", f"{orbit.v:.10f}", f"{first}, {second}", stable)
    console.print(table)


def _complex(value: complex) -> str:
    return f"{value.real:.10g}" if value.imag == 0 else f"{value.real:.10g}{value.imag:+.10g}i"
