"""Show all numbers of a cell as tables beside the map, folded to one line while a point is open."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from html import escape
from typing import Any

import numpy as np
import panel as pn
import xarray as xr

import rattle
from gear_rattle.service.explorer.common.address import Ranges
from gear_rattle.service.explorer.common.text import TextPane
from gear_rattle.service.explorer.common.watch import call_on_press
from gear_rattle.service.explorer.design.axes import coordinate_text
from gear_rattle.service.explorer.design.fields import NUMBERS, text_in_field_unit
from gear_rattle.service.explorer.map.planes import MapBlock, MapPlane
from gear_rattle.service.explorer.point.parts import listed_attractors
from gear_rattle.service.explorer.point.words import complex_number_text, number_text
from gear_rattle.workers import QUANTITIES, Axis, SurveyRequest
from gear_rattle.workers.pictures.look import replace_periods_with_revolutions
from gear_rattle.workers.pictures.maps import map_title, meanings_of_codes, words_for_missing_value
from gear_rattle.workers.survey.machine import SurveyedMachine
from gear_rattle.workers.survey.stored_families import FAMILY
from gear_rattle.workers.survey.values.evaluate import FAILED, STATUS
from gear_rattle.workers.survey.values.schema import CELL
from rattle.plot import legend_name

Row = tuple[str, str]
DIGITS = 5  # significant digits of numbers

HINT = "<p class=faint>Point at the map to read a cell; click or tap it to look closer.</p>"
UNFOLD, FOLD = "All numbers of this cell", "Hide the numbers of this cell"
OF_THE_CELL = "<p class=faint>Numbers of the survey's cell and its sample, not of the open point.</p>"
INTERVAL = "The half-width of the 95 % interval follows ±. It is of the survey's sample in this cell."


class Readout:
    """Numbers of a cell beside the map. pane: a summary line, a button that unfolds the numbers, and the numbers.

    While a point is open, the numbers are folded, because they describe the survey's cell and not the point. While no
    point is open, the numbers show without summary and button.
    """

    def __init__(self, sheet: str) -> None:
        self._summary, self._tables = TextPane("", sheet), TextPane(HINT, sheet)
        self._is_unfolded = False
        self._button = pn.widgets.Button(label=UNFOLD, css_classes=["unfold"], stylesheets=[sheet], margin=(2, 0))
        call_on_press(self._button, self._toggle_numbers)
        row: dict[str, Any] = {"sizing_mode": "stretch_width", "margin": 0}
        self._head = pn.Column(self._summary.pane, self._button, visible=False, **row)
        self._numbers = pn.Column(self._tables.pane, **row)
        self.pane = pn.Column(self._head, self._numbers, **row)

    @property
    def html(self) -> str:
        """HTML of the numbers."""
        return self._tables.html

    @property
    def summary(self) -> str:
        """HTML of the summary of the cell."""
        return self._summary.html

    @property
    def is_folded(self) -> bool:
        """True if the numbers are hidden: only the summary line and the button that unfolds the numbers show."""
        return not self._numbers.visible

    def clear(self) -> None:
        """Replace the numbers by a hint that explains how to read a cell."""
        self._tables.html = HINT
        self._head.visible, self._numbers.visible = False, True

    def show(self, summary: str, tables: str, is_point_open: bool) -> None:
        """Show the numbers of a cell, in HTML. While a point is open, show the tables only if they are unfolded."""
        self._summary.html = summary
        self._tables.html = (OF_THE_CELL if is_point_open else "") + tables
        self._head.visible = is_point_open
        self._numbers.visible = self._is_unfolded or not is_point_open

    def _toggle_numbers(self) -> None:
        self._is_unfolded = not self._is_unfolded
        self._numbers.visible = self._is_unfolded
        self._button.label = FOLD if self._is_unfolded else UNFOLD


def cell_summary(cell: xr.Dataset | None, request: SurveyRequest) -> str:
    """Return a line about a cell of a survey, in HTML: its δ and ε, its number of samples, and its quiet fraction.

    cell: the cell, None outside of the survey.

    Returns
    -------
    str
        HTML.
    """
    if cell is None:
        return "<p>Outside of the survey's grid.</p>"
    said = []
    if missing := _status_in_words(int(cell["status"])):
        said = [missing]
    elif "quiet_fraction" in cell:
        count, share = request.initial_conditions.count, float(cell["quiet_fraction"])
        low, high = rattle.wilson_interval(share * count, count)
        said = [f"{count:,} starts", f"quiet {100 * share:.0f} ± {50 * float(high - low):.0f} %"]
    place = f"Survey's grid cell at {cell_position(cell, request)}"
    return f'<p title="{INTERVAL}">{escape(": ".join([place, ", ".join(said)]) if said else place)}</p>'


def cell_position(cell: xr.Dataset, request: SurveyRequest) -> str:
    """Return a cell's δ and ε as text, precise to less than half a cell; for a machine its speed and eccentricity."""
    delta, epsilon = float(cell["delta"]), float(cell["epsilon"])
    if request.machine is not None:
        return ", ".join(value for _, value in _speed_and_eccentricity(request.machine, delta, epsilon))
    return f"δ {_coordinate_text(delta, request.delta)}, ε {_coordinate_text(epsilon, request.epsilon)}"


def _coordinate_text(value: float, axis: Axis) -> str:
    """Return a coordinate of a cell as text, rounded by less than half a cell."""
    digits = max(math.ceil(-math.log10((axis.stop - axis.start) / (axis.num - 1) / 2)), 1)
    return f"{value:.{digits}f}".rstrip("0").rstrip(".")


def cell_tables(
    cell: xr.Dataset | None,
    delta: float,
    epsilon: float,
    request: SurveyRequest,
    window: Ranges,
    finer_row: Row | None = None,
) -> str:
    """Return tables about a point (δ, ε), in HTML: its region, and the numbers of its cell.

    cell: the survey's cell at the point, None if the point is outside of the survey. request: the survey's request; if
    it is the survey of a machine, the tables also have the speed and the eccentricity in the machine's units.
    finer_row: (title, value) of the cell at the point that the workers computed for this window, finer than a cell of
    the survey; None if they computed none.

    Returns
    -------
    str
        HTML.
    """
    machine = request.machine
    rows: list[Row] = [("δ", coordinate_text(delta, window[0])), ("ε", coordinate_text(epsilon, window[1]))]
    if machine is not None and delta > 0:
        rows = [*_speed_and_eccentricity(machine, delta, epsilon), *rows]
    if delta > 0 and epsilon >= 0:
        # regions are not defined if the forcing has harmonics; then an error is raised and the row is left out
        with suppress(rattle.RattleError):
            region = int(rattle.classify_regions(request.gear_model.period_one(delta, epsilon)))
            rows.append(("region here", rattle.REGIONS[region]))
    if finer_row is not None:
        rows.append(finer_row)
    tables = [_definition_list(rows)]
    if cell is None:
        return "".join(tables) + "<p>Outside of the survey.</p>"
    tables.append(f"<h2>Cell at {cell_position(cell, request)}</h2>{_distance_note(cell, delta, epsilon, window)}")
    if missing := _status_in_words(int(cell["status"])):
        return "".join(tables) + f"<p>{escape(missing)}</p>"
    scalars = _definition_list(_scalar_rows(cell))
    tables.append(scalars if machine is None else replace_periods_with_revolutions(scalars))
    if "attractor_kind" in cell:
        tables.append(_attractors_table(cell))
    if "orbit_exists" in cell:
        tables.append(_orbits_table(cell))
    return "".join(tables)


def _status_in_words(status: int) -> str:
    """Return the status in words of a cell that is not computed or has failed; "" for a cell that has numbers."""
    return STATUS[status].replace("_", " ") if status in (0, FAILED) else ""


def _speed_and_eccentricity(machine: SurveyedMachine, delta: float, epsilon: float) -> list[Row]:
    """Return the speed and the eccentricity of a machine at a point, with names and units."""
    si = {"rpm": machine.speed_at_damping(delta), "eccentricity": machine.eccentricity_in_metres(epsilon)}
    return [
        (NUMBERS[name].name.lower(), f"{text_in_field_unit(name, value)} {NUMBERS[name].unit}")
        for name, value in si.items()
    ]


def _distance_note(cell: xr.Dataset, delta: float, epsilon: float, window: Ranges) -> str:
    """Return a note on how far a point is from the centre of its cell; "" if the centre is inside the window."""
    away = float(cell["delta"]) - delta, float(cell["epsilon"]) - epsilon
    if all(low <= float(cell[name]) <= high for name, (low, high) in zip(("delta", "epsilon"), window, strict=True)):
        return ""
    where = f"{away[0]:+.2g} in δ and {away[1]:+.2g} in ε from here"
    return f"<p class=faint>The centre of the cell is outside of this window: {where}.</p>"


def value_of_finer_cell(plane: MapPlane, finer: MapBlock | None, delta: float, epsilon: float) -> Row | None:
    """Return (title, value) of the finer cell at a point; None if no finer cell is computed there.

    finer: the finer cells that the workers computed for a window, None without them.

    Returns
    -------
    Row | None
        The map's title and the value in words.
    """
    value = finer.value_at(delta, epsilon) if finer is not None else None
    if value is None:
        return None
    here = words_for_missing_value(plane.plane) if np.isnan(value) else _cell_value_text(value, plane.plane)
    return f"{map_title(plane.plane)}, computed here", here


def cell_in_words(plane: MapPlane, delta: float, epsilon: float, window: Ranges, finer: MapBlock | None = None) -> str:
    """Return a phrase for screen readers: the point, and the value of the map there, from the finer cells if any."""
    place = f"δ {coordinate_text(delta, window[0])}, ε {coordinate_text(epsilon, window[1])}"
    here = value_of_finer_cell(plane, finer, delta, epsilon)
    said = ", ".join(here) if here is not None else _value_in_words(plane, delta, epsilon)
    if (machine := plane.request.machine) is None or delta <= 0:
        return f"{place}: {said}"
    in_si = ", ".join(value for _, value in _speed_and_eccentricity(machine, delta, epsilon))
    return f"{in_si} ({place}): {replace_periods_with_revolutions(said)}"


def _value_in_words(plane: MapPlane, delta: float, epsilon: float) -> str:
    at = plane.value_and_status(delta, epsilon)
    if at is None:
        return "outside of the survey"
    value, status = at
    if missing := _status_in_words(status):
        said = missing
    elif np.isnan(value):
        said = words_for_missing_value(plane.plane)
    else:
        said = _cell_value_text(value, plane.plane)
    return f"{map_title(plane.plane)}, {said}"


def _cell_value_text(number: float, variable: xr.DataArray) -> str:
    if "flag_meanings" in variable.attrs:
        return meanings_of_codes(variable)[int(number)]
    return _scalar_text(bool(number) if variable.dtype == bool else number)


def _scalar_rows(cell: xr.Dataset) -> Iterator[Row]:
    for name in (quantity.name for quantity in QUANTITIES if quantity.dims == CELL and quantity.name in cell):
        yield name.replace("_", " "), _cell_value_text(cell[name].item(), cell[name])


def _attractors_table(cell: xr.Dataset) -> str:
    head = ["attractor", "share"]
    exponents, families = "attractor_lyapunov" in cell, FAMILY in cell
    rows = []
    for one, kind, label, contacts in listed_attractors(cell):
        row = [legend_name(label, contacts) if kind == "periodic" else kind, f"{float(one['attractor_fraction']):.1%}"]
        if families:
            row.append(str(int(one[FAMILY])) if int(one[FAMILY]) >= 0 else "–")
        if exponents:
            row += [number_text(float(value), DIGITS) for value in one["attractor_lyapunov"]]
        rows.append(row)
    return _html_table(head + (["family"] if families else []) + (["λ₁", "λ₂"] if exponents else []), rows)


def _orbits_table(cell: xr.Dataset) -> str:
    rows = []
    for orbit in cell["orbit"].values:
        one = cell.sel(orbit=orbit)
        if bool(one["orbit_exists"]):
            multipliers = ", ".join(
                complex_number_text(complex(value), DIGITS) for value in one["orbit_multiplier"].values
            )
            stable = "stable" if bool(one["orbit_stable"]) else "unstable"
            numbers = [number_text(float(one[name]), DIGITS) for name in ("orbit_phase", "orbit_velocity")]
            rows.append([str(orbit), stable, *numbers, multipliers])
    return _html_table(["orbit", "stability", "τ", "v", "multipliers"], rows)


def _definition_list(rows: Any) -> str:
    return "<dl>" + "".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in rows) + "</dl>"


def _html_table(head: list[str], rows: list[list[str]]) -> str:
    if not rows:
        return ""
    titles = "".join(f"<th scope=col>{escape(title)}</th>" for title in head)
    body = "".join("<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>" for row in rows)
    return f"<table><thead><tr>{titles}</tr></thead><tbody>{body}</tbody></table>"


def _scalar_text(value: float) -> str:
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    return str(value) if isinstance(value, int) else number_text(value, DIGITS)
