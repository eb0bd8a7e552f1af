"""``rattle orbits``: print the period-one orbits of one gear."""

from __future__ import annotations

from gear_rattle.service.commands.at_point import GivenPoint, add_point_options

WIDTH = 140  # characters in a line, enough for all numbers, however wide the terminal is
#: {field of the analytic limits: the name that is printed}.
NAMES = {"sn1": "SN1", "flip": "flip", "quiet_limit": "quiet limit"}


@add_point_options()
def orbits(point: GivenPoint) -> None:
    """Print the period-one orbits of one parameter point, its region and its analytic limits."""
    from rich.console import Console
    from rich.table import Table

    from rattle.models import model_of_gear
    from rattle.orbits import region_in_words

    gear, machine = point.gear, point.machine
    found = model_of_gear(gear).limits(gear.delta)
    limits = [(name, value) for field, name in NAMES.items() if (value := getattr(found, field)) is not None]
    console = Console(highlight=False, width=WIDTH)
    # Regions are defined only for forcing by one cosine.
    region = "" if gear.parameters.harmonics else f": {region_in_words(gear.region())}"
    console.print(f"{point.parameters_text}{region}")
    console.print(", ".join(f"{name} at epsilon = {value:.10g}" for name, value in limits))
    if machine is not None:
        length = machine.units.length
        console.print(", ".join(f"{name} at an eccentricity of {value * length:.6g} m" for name, value in limits))
    for each in found.missing:
        where = "" if each.epsilon is None else f" at epsilon = {each.epsilon:.10g}"
        if each.epsilon is not None and machine is not None:
            where += f", an eccentricity of {each.epsilon * machine.units.length:.6g} m"
        console.print(f"{NAMES[each.limit]}: {each.reason}{where}")
    speed = "speed" if machine is None else "speed, m/s"
    unit = 1.0 if machine is None else machine.units.velocity
    table = Table("orbit", "P(m, n+, n-)", "phase", speed, "multipliers", "stable", box=None)
    for orbit in gear.orbits():
        first, second = (_format_complex_number(value) for value in orbit.multipliers)
        label = f"({orbit.m}, {orbit.n_plus}, {orbit.n_minus})"
        stable = "yes" if orbit.stable else "no"
        table.add_row(orbit.name, label, f"{orbit.tau:.10f}", f"{orbit.v * unit:.10f}", f"{first}, {second}", stable)
    console.print(table)


def _format_complex_number(value: complex) -> str:
    return f"{value.real:.10g}" if value.imag == 0 else f"{value.real:.10g}{value.imag:+.10g}i"
