"""The numbers of a machine as fields, in the units that a drawing has, and in SI units what is entered there."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import panel as pn

from gear_rattle.service.explorer.common.address import Pair
from gear_rattle.workers.survey.machine import SurveyedMachine
from rattle import Machine, RattleError
from rattle.machine import DRIVES

DIGITS = 12  # of a number that was converted and back
EXACT = "0[.][0000000000000000]"


class NumberEntry(NamedTuple):
    """How a number of a machine is entered.

    What it is, its unit, how many of it the SI unit is, what is there at first.
    """

    name: str
    unit: str
    per: float
    first: float | None

    @property
    def label(self) -> str:
        """Name and unit."""
        return f"{self.name}, {self.unit}"

    def entered(self, value: float) -> float:
        """Return a number of the library in this unit."""
        return float(f"{value * self.per:.{DIGITS}g}")

    def meant(self, value: float | None) -> float | None:
        """Return an entered value in the library's form: division rounds to 100e-6 for 100 µm."""
        return None if value is None else value / self.per


NUMBERS = {
    "inertia": NumberEntry("Inertia", "kg m²", 1.0, 0.003),
    "drag": NumberEntry("Drag", "N m s/rad", 1.0, 5e-4),
    "backlash": NumberEntry("Backlash", "µm", 1e6, 100.0),
    "radius": NumberEntry("Base radius", "mm", 1e3, 50.0),
    "rpm": NumberEntry("Speed", "rpm", 1.0, 3000.0),
    "eccentricity": NumberEntry("Eccentricity", "µm", 1e6, 15.0),
    "stiffness": NumberEntry("Mesh stiffness (none: rigid)", "N/m", 1.0, None),
}
EQUAL = "<p class=faint>Two equal gears: each of them has this inertia, drag and base radius.</p>"
PAIR = ("inertia", "drag", "backlash", "radius")  # of every machine of a survey
POINT = (*PAIR, "rpm", "eccentricity", "stiffness")


def in_unit(name: str, value: float) -> str:
    """Return a number of a machine in its unit, for people."""
    return f"{NUMBERS[name].entered(value):.6g}"


def spans_of(machine: SurveyedMachine, delta: Pair, epsilon: Pair) -> dict[str, Pair]:
    """Return the speeds and eccentricities of a window of the plane, each (low, high).

    High speed means little damping.

    Returns
    -------
    dict[str, Pair]
        Ranges by name.
    """
    return {
        "rpm": (float(machine.rpm(delta[1])), float(machine.rpm(delta[0]))),
        "eccentricity": (float(machine.eccentricity(epsilon[0])), float(machine.eccentricity(epsilon[1]))),
    }


def machine_at(machine: SurveyedMachine | None, delta: float, epsilon: float) -> Machine | None:
    """Return the machine of a survey at a point; None without one, or where nothing turns so fast."""
    if machine is None:
        return None
    try:
        return machine.at(float(machine.rpm(delta)), float(machine.eccentricity(epsilon)))
    except RattleError:
        return None


def machine_beside(machine: Machine | None, delta: float, epsilon: float) -> Machine | None:
    """Return the pair of gears of a point at another one.

    None without one, or where a stiffness would be another one.

    Returns
    -------
    Machine | None
        The machine, or None.
    """
    if machine is None or (machine.stiffness is not None and delta != machine.delta):
        return None
    speed, eccentricity = machine.speed * machine.delta / delta, epsilon * machine.units.length
    return replace(machine, speed=speed, eccentricity=eccentricity)


class MachineFields:
    """Fields for these numbers, two in a row, and for what drives the pair."""

    def __init__(self, names: Iterable[str], sheet: str) -> None:
        style: dict[str, Any] = {"sizing_mode": "stretch_width", "margin": (3, 4), "stylesheets": [sheet]}
        self._numbers = {
            name: pn.widgets.FloatInput(label=each.label, value=each.first, start=0.0, format=EXACT, **style)
            for name in names
            for each in (NUMBERS[name],)
        }
        options = {"by a constant torque": "torque", "at an imposed speed": "speed"}
        self._drive = pn.widgets.Select(label="Driven", options=options, value=next(iter(DRIVES)), **style)
        each = [*self._numbers.values(), self._drive]
        self.widgets: list[Any] = each
        rows = (pn.Row(*each[i : i + 2], sizing_mode="stretch_width") for i in range(0, len(each), 2))
        about = pn.pane.HTML(EQUAL, stylesheets=[sheet], margin=(0, 4))
        self.panel = pn.Column(about, *rows, sizing_mode="stretch_width", margin=0)

    def given(self) -> dict[str, Any]:
        """Return the entered numbers, as `rattle.Machine` and requests take them; optional empty fields are omitted."""
        numbers = {name: NUMBERS[name].meant(widget.value) for name, widget in self._numbers.items()}
        return {name: value for name, value in numbers.items() if name != "stiffness" or value is not None} | {
            "drive": self._drive.value
        }

    def show(self, machine: Mapping[str, Any]) -> None:
        """Enter these numbers in SI units."""
        for name, widget in self._numbers.items():
            value = machine.get(name)
            widget.value = None if value is None else NUMBERS[name].entered(value)
        self._drive.value = machine["drive"]
