"""``rattle orbits``: one parameter point."""

from __future__ import annotations

from typing import Annotated

import typer

from service.commands.options import Beta, Kappa

WIDTH = 140  # numbers are never cut, whatever the terminal


def orbits(
    delta: Annotated[float, typer.Argument(metavar="DELTA", help="Damping.")],
    epsilon: Annotated[float, typer.Argument(metavar="EPSILON", help="Eccentricity.")],
    beta: Beta = 0.6,
    kappa: Kappa = None,
) -> None:
    """Print the period-one orbits of one parameter point, its region and its analytic limits."""
    from rich.console import Console
    from rich.table import Table

    from rattle.models import model_of
    from rattle.orbits.period_one import in_words

    model = model_of(beta, kappa)
    gear = model.gear(delta, epsilon)
    limits = zip(("SN1", "flip", "quiet limit"), model.limits(delta), strict=True)
    parameters = f"beta = {beta}" + ("" if kappa is None else f", kappa = {kappa}")
    console = Console(highlight=False, width=WIDTH)
    console.print(
        f"delta = {gear.delta}, epsilon = {gear.epsilon}, {parameters}: {in_words(gear.region())}\n"
        + ", ".join(f"{name} at epsilon = {value:.10g}" for name, value in limits if value is not None)
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
