"""Rows of the page's list of surveys: the status and the requested values of each survey."""

from __future__ import annotations

from typing import Any

from gear_rattle.service.database.tables import State
from gear_rattle.service.explorer.common.address import EXAMPLE, View
from gear_rattle.service.explorer.common.news import JobStatus
from gear_rattle.service.explorer.design.fields import (
    NUMBERS,
    SURVEY_NUMBERS,
    speed_and_eccentricity_ranges,
    text_in_field_unit,
)
from gear_rattle.service.explorer.map.picture import picture_query, third_axis_names
from gear_rattle.service.harmonics import harmonic_texts
from gear_rattle.workers import SurveyRequest
from gear_rattle.workers.pictures.look import LARGEST
from gear_rattle.workers.survey.stored_families import FAMILY
from rattle.models import ADDED

STORED_VARIABLES = {LARGEST: FAMILY}  # {map that is not stored: the stored variable from which it is made}


def survey_row(status: JobStatus, view: View, is_owned: bool) -> dict[str, Any]:
    """Return a survey's row in the list of surveys of a page. is_owned: whether the survey belongs to the caller."""
    job = status.job
    state, message = job.shown_state_and_message
    submitted = ["submitted", job.created[:16].replace("T", " ") + " UTC"]
    size, facts = _size_and_requested_values(job.request) if job.is_readable else ("", [])
    chosen = job.id == view.survey and job.is_readable
    return {
        "id": job.id,
        "name": job.display_name,
        "title": job.name,
        "notes": job.notes,
        "size": size,
        "state": str(state),
        "progress": job.progress,
        "message": message,
        "failed": job.cells_failed,
        "rate": status.rate,
        "left": status.seconds_left,
        "mine": is_owned,
        "facts": [*facts, submitted],
        "variable": STORED_VARIABLES.get(view.variable, view.variable) if chosen else "",
        "picture": picture_query(job.request, view, view.seen) if chosen else "",
        "slice": [next(third_axis_names(job.request), ""), view.slice] if chosen else ["", 0],
    }


def example_row(request: SurveyRequest) -> dict[str, Any]:
    """Return the row of the example, which has no files and cannot be removed. request: the request of the example."""
    size, facts = _size_and_requested_values(request.model_dump(mode="json"))
    return {
        "id": EXAMPLE,
        "name": f"Example: the paper's plane at β = {request.beta:g}",
        "notes": "",
        "size": size,
        "state": str(State.SUCCESSFUL),
        "facts": facts,
        "example": True,
    }


def _size_and_requested_values(request: dict[str, Any]) -> tuple[str, list[list[str]]]:
    """Return the size of a survey, such as "61 × 60", and rows (name, value) of its requested values."""
    delta, epsilon = request["delta"], request["epsilon"]
    facts = [
        *(machine_rows(SurveyRequest.model_validate(request)) if request.get("machine") else []),
        ["δ", _parameter_text(delta)],
        ["ε", _parameter_text(epsilon)],
        ["β", _parameter_text(request["beta"])],
        *([each.symbol, _parameter_text(request[name])] for name, each in ADDED.items() if request.get(name)),
        *([["harmonics", " ".join(harmonic_texts(request["harmonics"]))]] if request.get("harmonics") else []),
        ["computes", ", ".join(request["quantities"])],
        ["sample", f"{request['initial_conditions']['count']} initial conditions"],
    ]
    slices = [request[name]["num"] for name in third_axis_names(request)]
    return " × ".join(map(str, (delta["num"], epsilon["num"], *slices))), facts


def _parameter_text(value: Any) -> str:
    """Return the value of a parameter as text; for an axis (a dict), its range and its number of values."""
    return f"{value['start']:g} … {value['stop']:g}, {value['num']} values" if isinstance(value, dict) else f"{value:g}"


def machine_rows(request: SurveyRequest) -> list[list[str]]:
    """Return the ranges of speed and eccentricity of a machine's survey, and the other numbers of the machine.

    The list is empty for a survey without a machine.

    Returns
    -------
    list[list[str]]
        Rows of name and value.
    """
    machine, delta, epsilon = request.machine, request.delta, request.epsilon
    if machine is None:
        return []
    spans = speed_and_eccentricity_ranges(machine, (delta.start, delta.stop), (epsilon.start, epsilon.stop))
    facts = [
        [
            NUMBERS[name].name.lower(),
            f"{text_in_field_unit(name, low)} … {text_in_field_unit(name, high)} {NUMBERS[name].unit}",
        ]
        for name, (low, high) in spans.items()
    ]
    numbers = machine.model_dump()
    constant = [
        [NUMBERS[name].name.lower(), f"{text_in_field_unit(name, numbers[name])} {NUMBERS[name].unit}".rstrip()]
        for name in SURVEY_NUMBERS
        if name in numbers
    ]
    return [*facts, *constant, ["drive", machine.drive]]
