"""Write all numbers of a cell as tables, which are shown beside the map."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from html import escape
from typing import Any

import numpy as np
import xarray as xr

import rattle
from gear_rattle.service.explorer.common.address import Ranges
from gear_rattle.service.explorer.design.axes import coordinate_text
from gear_rattle.service.explorer.design.fields import NUMBERS, text_in_unit
from gear_rattle.service.explorer.map.planes import MapBlock, MapPlane
from gear_rattle.service.explorer.point.parts import listed_attractors
from gear_rattle.workers import QUANTITIES
from gear_rattle.workers.pictures.look import in_revolutions
from gear_rattle.workers.pictures.maps import meanings_of, title_of, words_without_value
from gear_rattle.workers.survey.families import FAMILY
from gear_rattle.workers.survey.machine import SurveyedMachine
from gear_rattle.workers.survey.values.evaluate import FAILED, STATUS
from gear_rattle.workers.survey.values.schema import CELL
from rattle.models import Model
from rattle.plot import legend_name

Row = tuple[str, str]


def readout(
    cell: xr.Dataset | None,
    delta: float,
    epsilon: float,
    model: Model,
    window: Ranges,
    here: Row | None = None,
    machine: SurveyedMachine | None = None,
) -> str:
    """Return tables about a point (δ, ε), in HTML: its region, and the numbers of its cell.

    cell: the survey's cell at the point, None if the point is outside of the survey. here: name and value of a finer
    map at the point, None without a finer map. machine: machine of the survey, whose speed and eccentricity are written
    too; None if the survey has no machine.

    Returns
    -------
    str
        HTML.
    """
    rows: list[Row] = [("δ", coordinate_text(delta, window[0])), ("ε", coordinate_text(epsilon, window[1]))]
    if machine is not None and delta > 0:
        rows = [*_speed_and_eccentricity(machine, delta, epsilon), *rows]
    if delta > 0 and epsilon >= 0:
        # the error is raised if the forcing has harmonics, because regions are not defined then
        with suppress(rattle.RattleError):
            region = int(rattle.classify_regions(model.period_one(delta, epsilon)))
            rows.append(("region here", rattle.REGIONS[region]))
    if here is not None:
        rows.append(here)
    tables = [_definition_list(rows)]
    if cell is None:
        return "".join(tables) + "<p>Outside of the survey.</p>"
    at = float(cell["delta"]), float(cell["epsilon"])
    place = f"δ {at[0]:.10g}, ε {at[1]:.10g}"
    if machine is not None:
        place = ", ".join(value for _, value in _speed_and_eccentricity(machine, *at))
    status = int(cell["status"])
    tables.append(f"<h2>Cell at {place}</h2>{_distance_note(cell, delta, epsilon, window)}")
    if status in (0, FAILED):
        return "".join(tables) + f"<p>{escape(STATUS[status].replace('_', ' '))}</p>"
    scalars = _definition_list(_scalar_rows(cell))
    tables.append(scalars if machine is None else in_revolutions(scalars))
    if "attractor_kind" in cell:
        tables.append(_attractors_table(cell))
    if "orbit_exists" in cell:
        tables.append(_orbits_table(cell))
    return "".join(tables)


def _speed_and_eccentricity(machine: SurveyedMachine, delta: float, epsilon: float) -> list[Row]:
    """Return the speed and the eccentricity of a machine at a point, with names and units."""
    si = {"rpm": machine.rpm(delta), "eccentricity": machine.eccentricity(epsilon)}
    return [
        (NUMBERS[name].name.lower(), f"{text_in_unit(name, value)} {NUMBERS[name].unit}") for name, value in si.items()
    ]


def _distance_note(cell: xr.Dataset, delta: float, epsilon: float, window: Ranges) -> str:
    """Return a note on the distance from the point to its cell's centre; "" if the centre is in the window."""
    away = float(cell["delta"]) - delta, float(cell["epsilon"]) - epsilon
    if all(low <= float(cell[name]) <= high for name, (low, high) in zip(("delta", "epsilon"), window, strict=True)):
        return ""
    where = f"{away[0]:+.2g} in δ and {away[1]:+.2g} in ε from here"
    return f"<p class=faint>The centre of the cell is outside of this window: {where}.</p>"


def finer_value(plane: MapPlane, finer: MapBlock | None, delta: float, epsilon: float) -> Row | None:
    """Return the title of a finer map and its value at a point; None if there is no finer map at the point."""
    value = finer.value_at(delta, epsilon) if finer is not None else None
    if value is None:
        return None
    here = words_without_value(plane.plane) if np.isnan(value) else _value_text(value, plane.plane)
    return f"{title_of(plane.plane)}, computed here", here


def cell_in_words(plane: MapPlane, delta: float, epsilon: float, window: Ranges, finer: MapBlock | None = None) -> str:
    """Return a phrase for screen readers: the point, and the value of the map at the point."""
    place = f"δ {coordinate_text(delta, window[0])}, ε {coordinate_text(epsilon, window[1])}"
    here = finer_value(plane, finer, delta, epsilon)
    said = ", ".join(here) if here is not None else _value_in_words(plane, delta, epsilon)
    if (machine := plane.request.machine) is None or delta <= 0:
        return f"{place}: {said}"
    in_si = ", ".join(value for _, value in _speed_and_eccentricity(machine, delta, epsilon))
    return f"{in_si} ({place}): {in_revolutions(said)}"


def _value_in_words(plane: MapPlane, delta: float, epsilon: float) -> str:
    at = plane.value_and_status(delta, epsilon)
    if at is None:
        return "outside of the survey"
    value, status = at
    if status in (0, FAILED):
        said = STATUS[status].replace("_", " ")
    elif np.isnan(value):
        said = words_without_value(plane.plane)
    else:
        said = _value_text(value, plane.plane)
    return f"{title_of(plane.plane)}, {said}"


def _value_text(number: float, variable: xr.DataArray) -> str:
    if "flag_meanings" in variable.attrs:
        return meanings_of(variable)[int(number)]
    return _number_text(bool(number) if variable.dtype == bool else number)


def _scalar_rows(cell: xr.Dataset) -> Iterator[Row]:
    for name in (quantity.name for quantity in QUANTITIES if quantity.dims == CELL and quantity.name in cell):
        yield name.replace("_", " "), _value_text(cell[name].item(), cell[name])


def _attractors_table(cell: xr.Dataset) -> str:
    head = ["attractor", "share"]
    exponents, families = "attractor_lyapunov" in cell, FAMILY in cell
    rows = []
    for one, kind, label, contacts in listed_attractors(cell):
        row = [legend_name(label, contacts) if kind == "periodic" else kind, f"{float(one['attractor_fraction']):.1%}"]
        if families:
            row.append(str(int(one[FAMILY])) if int(one[FAMILY]) >= 0 else "–")
        if exponents:
            row += [_number_text(float(value)) for value in one["attractor_lyapunov"]]
        rows.append(row)
    return _html_table(head + (["family"] if families else []) + (["λ₁", "λ₂"] if exponents else []), rows)


def _orbits_table(cell: xr.Dataset) -> str:
    rows = []
    for orbit in cell["orbit"].values:
        one = cell.sel(orbit=orbit)
        if bool(one["orbit_exists"]):
            multipliers = ", ".join(_complex_text(complex(value)) for value in one["orbit_multiplier"].values)
            stable = "stable" if bool(one["orbit_stable"]) else "unstable"
            numbers = [_number_text(float(one[name])) for name in ("orbit_phase", "orbit_velocity")]
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


def _number_text(value: float) -> str:
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, int) or not np.isfinite(value):
        return {"nan": "–", "inf": "∞", "-inf": "−∞"}.get(str(value), str(value))
    return f"{value:.5g}".replace("-", "−")


def _complex_text(value: complex) -> str:
    if value.imag == 0:
        return _number_text(value.real)
    return f"{_number_text(value.real)} {'+' if value.imag > 0 else '−'} {_number_text(abs(value.imag))}i"
