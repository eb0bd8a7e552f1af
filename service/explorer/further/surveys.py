"""Name the surveys that a comparison map can show."""

from __future__ import annotations

from collections.abc import Iterable

from gear_rattle.service.database.tables import JobRow
from gear_rattle.service.explorer.state.store import request_of_job


def survey_menu_options(jobs: Iterable[JobRow]) -> dict[str, str]:
    """Return the options of a menu of surveys and slices: {name in words: "survey id,number of the slice"}."""
    surveys: dict[str, str] = {}
    for each in jobs:
        for name, number, words in _named_slices(each) if each.is_readable else []:
            key = f"{name}{words}"
            surveys[f"{key} ({each.id[:6]})" if key in surveys else key] = f"{each.id},{number}"
    return surveys


def _named_slices(job: JobRow) -> list[tuple[str, int, str]]:
    """Return (survey's name, number, words) for each slice of a survey; number 0 and words "" without a third axis."""
    thirds = request_of_job(job).third_axis
    slices = [(i, f", {name} = {value:g}") for name, axis in thirds.items() for i, value in enumerate(axis.values())]
    return [(job.display_name, number, words) for number, words in slices or [(0, "")]]
