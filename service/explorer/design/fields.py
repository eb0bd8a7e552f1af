"""Fields for the numbers of a machine, in the units of a drawing; entered values are converted to SI units."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import panel as pn

from gear_rattle.service.explorer.common.address import Pair
from gear_rattle.workers.survey.machine import SurveyedMachine
from rattle import Machine, RattleError
from rattle.machine import DRIVES
from rattle.models import Model

DIGITS = 12  # significant digits of a number that is converted from SI units


class NumberField(NamedTuple):
    """One of the numbers that describe a machine, such as its backlash, and the field in which it is entered.

    name, unit: the label of the field. field_units_per_library_unit: factor from the library's unit (SI, but rpm for
    speed) to `unit`, such as 1e6 from m to µm. initial_value: the initial value of the field; None if the field may be
    empty. is_count: True for a count, such as the number of teeth. tooltip: the tooltip, "" for none.
    """

    name: str
    unit: str
    field_units_per_library_unit: float
    initial_value: float | None
    is_count: bool = False
    tooltip: str = ""

    @property
    def label(self) -> str:
        """Label of the field: the name, and the unit if there is one."""
        return f"{self.name}, {self.unit}" if self.unit else self.name

    def to_field_unit(self, value: float) -> float:
        """Return a number in the unit of the field. value: the number in the library's unit (SI, but rpm for speed)."""
        return float(f"{value * self.field_units_per_library_unit:.{DIGITS}g}")

    def to_library_unit(self, value: float | None) -> float | None:
        """Return an entered value in the library's unit (SI, but rpm for speed); 100 µm become exactly 100e-6 m."""
        if value is None:
            return None
        return int(value) if self.is_count and float(value).is_integer() else value / self.field_units_per_library_unit


LIKE_FIRST = "A number of the second gear. If the field is empty, the number of the first gear is used."
NUMBERS = {
    "inertia": NumberField("Inertia", "kg m²", 1.0, 0.003),
    "drag": NumberField("Drag", "N m s/rad", 1.0, 5e-4),
    "backlash": NumberField("Backlash", "µm", 1e6, 100.0),
    "radius": NumberField("Base radius", "mm", 1e3, 50.0),
    "rpm": NumberField("Speed", "rpm", 1.0, 3000.0),
    "eccentricity": NumberField("Eccentricity", "µm", 1e6, 15.0),
    "stiffness": NumberField("Mesh stiffness (none: rigid)", "N/m", 1.0, None),
    "restitution": NumberField("Restitution (none: elastic)", "", 1.0, None),
    "load_torque": NumberField("Load torque", "N m", 1.0, None),
    "mesh_error": NumberField("Mesh error", "µm", 1e6, None),
    "mesh_error_2": NumberField("Mesh error, order 2", "µm", 1e6, None),
    "mesh_error_3": NumberField("Mesh error, order 3", "µm", 1e6, None),
    "teeth": NumberField("Teeth", "", 1.0, None, True, "Number of teeth of the first gear; it gives the ratio."),
    "driven_teeth": NumberField("Teeth 2", "", 1.0, None, True, LIKE_FIRST),
    "driven_inertia": NumberField("Inertia 2", "kg m²", 1.0, None, tooltip=LIKE_FIRST),
    "driven_drag": NumberField("Drag 2", "N m s/rad", 1.0, None, tooltip=LIKE_FIRST),
    "driven_radius": NumberField("Base radius 2", "mm", 1e3, None, tooltip=LIKE_FIRST),
    "driven_eccentricity": NumberField("Eccentricity 2", "µm", 1e6, None, tooltip=LIKE_FIRST),
}
ABOUT = (
    "<p class=faint>Inertia, drag and base radius are numbers of the first gear. A field with a 2 is for the second "
    "gear; if the field is empty, the number of the first gear is used.</p>"
)
# names of the numbers that every machine needs, without rpm and eccentricity, which are the axes of a survey
BASIC_NUMBERS = ("inertia", "drag", "backlash", "radius")
# names of numbers that describe the ratio and the second gear; a machine of two equal gears needs none of them
TWO_GEAR_NUMBERS = ("teeth", "driven_teeth", "driven_inertia", "driven_drag", "driven_radius")
SURVEY_NUMBERS = (*BASIC_NUMBERS, *TWO_GEAR_NUMBERS)  # names of the numbers of a survey's machine
ERRORS = ("mesh_error", "mesh_error_2", "mesh_error_3")
POINT = (
    *BASIC_NUMBERS, "rpm", "eccentricity", "stiffness", "restitution", "load_torque", *ERRORS, *TWO_GEAR_NUMBERS,
    "driven_eccentricity",
)  # fmt: skip


def text_in_field_unit(name: str, value: float) -> str:
    """Return a number of a machine as text, in the unit of its field. name: key of `NUMBERS`."""
    return f"{NUMBERS[name].to_field_unit(value):.6g}"


def speed_and_eccentricity_ranges(machine: SurveyedMachine, delta: Pair, epsilon: Pair) -> dict[str, Pair]:
    """Return the speeds and eccentricities of a window of the plane, each (low, high).

    Damping falls as speed rises, so the highest speed belongs to the lowest δ.

    Returns
    -------
    dict[str, Pair]
        Range of the speed under "rpm", range of the eccentricity in m under "eccentricity".
    """
    return {
        "rpm": (float(machine.speed_at_damping(delta[1])), float(machine.speed_at_damping(delta[0]))),
        "eccentricity": (
            float(machine.eccentricity_in_metres(epsilon[0])),
            float(machine.eccentricity_in_metres(epsilon[1])),
        ),
    }


def machine_at(machine: SurveyedMachine | None, model: Model, delta: float, epsilon: float) -> Machine | None:
    """Return a survey's machine at a point; None for a survey without a machine, or if no machine is possible there."""
    if machine is None:
        return None
    eccentricity = float(machine.eccentricity_in_metres(epsilon))
    shape = model.parameters_at(delta, epsilon).harmonics
    errors = tuple((order, size * eccentricity, phase) for order, size, phase in shape)
    try:
        found = machine.machine_at_speed(float(machine.speed_at_damping(delta)), eccentricity)
        return replace(found, restitution=model.numbers.get("restitution"), errors=errors)
    except RattleError:
        return None


def machine_at_other_point(machine: Machine | None, delta: float, epsilon: float) -> Machine | None:
    """Return a machine of the same gears with the speed and the eccentricity of the point (delta, epsilon).

    The result is None if `machine` is None. It is also None if the machine has a mesh stiffness and
    `delta` is not the machine's δ, because κ depends on the speed.

    Returns
    -------
    Machine | None
        The machine, or None.
    """
    if machine is None or (machine.stiffness is not None and delta != machine.delta):
        return None
    speed, eccentricity = machine.speed * machine.delta / delta, epsilon * machine.units.length
    return replace(machine, speed=speed, eccentricity=eccentricity)


def _arrange_in_rows_of_two(widgets: list[Any], *above: Any) -> pn.Column:
    rows = (pn.Row(*widgets[i : i + 2], sizing_mode="stretch_width") for i in range(0, len(widgets), 2))
    return pn.Column(*above, *rows, sizing_mode="stretch_width", margin=0)


class MachineFields:
    """Fields for the numbers of a machine, and a menu of its drive: a constant torque or an imposed speed.

    needed: column of the required fields and the menu. optional: column of the other fields.
    """

    def __init__(self, names: Iterable[str], sheet: str) -> None:
        style: dict[str, Any] = {"sizing_mode": "stretch_width", "margin": (3, 4), "stylesheets": [sheet]}
        self._numbers = {
            name: pn.widgets.FloatInput(
                label=each.label, value=each.initial_value, start=0.0, description=each.tooltip or None, **style
            )
            for name in names
            for each in (NUMBERS[name],)
        }
        options = {"by a constant torque": "torque", "at an imposed speed": "speed"}
        self._drive = pn.widgets.Select(label="Driven", options=options, value=next(iter(DRIVES)), **style)
        needed = [self._numbers[name] for name in self._numbers if NUMBERS[name].initial_value is not None]
        about = pn.pane.HTML(ABOUT, stylesheets=[sheet], margin=(0, 4))
        self.needed = _arrange_in_rows_of_two([*needed, self._drive])
        self.optional = _arrange_in_rows_of_two([each for each in self._numbers.values() if each not in needed], about)
        self.panel = pn.Column(self.needed, self.optional, sizing_mode="stretch_width", margin=0)

    def entered_numbers(self) -> dict[str, Any]:
        """Return the entered numbers, as `rattle.Machine` and requests take them; empty optional fields are omitted."""
        numbers = {name: NUMBERS[name].to_library_unit(widget.value) for name, widget in self._numbers.items()}
        needed = {name for name in numbers if NUMBERS[name].initial_value is not None}
        given = {name: value for name, value in numbers.items() if name in needed or value is not None}
        return given | {"drive": self._drive.value}

    def fill_from_machine(self, machine: Mapping[str, Any]) -> None:
        """Fill the fields for a machine. machine: its numbers by name, in the library's units, and its "drive"."""
        for name, widget in self._numbers.items():
            value = machine.get(name)
            widget.value = None if value is None else NUMBERS[name].to_field_unit(value)
        self._drive.value = machine["drive"]
