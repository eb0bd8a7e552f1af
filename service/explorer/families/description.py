"""Name the families of a survey, and describe one: its shares of cells and samples, its extents, its borders."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from html import escape
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

from gear_rattle.service.explorer.common.address import Pair
from gear_rattle.service.explorer.common.point_state import PointTabsState
from gear_rattle.service.explorer.map.planes import MapPlane
from gear_rattle.service.explorer.point.words import number_text, percent_text
from gear_rattle.workers import StoreInBucket, SurveyRequest, open_survey
from gear_rattle.workers.errors import SurveyError, report_damage
from gear_rattle.workers.pictures.largest import family_names, open_survey_for_map
from gear_rattle.workers.pictures.look import LARGEST
from gear_rattle.workers.survey.slices import slice_group_path
from gear_rattle.workers.survey.stored_families import GROUP
from gear_rattle.workers.survey.values.evaluate import FAILED
from rattle.models import Model

MOST_LISTED = 100  # at most this many families are listed: those with the most cells
NOT_ALONE = "Some cells have two of its attractors: continuation through other cells leads from one to the other."


@dataclass(frozen=True)
class FamilyExtent:
    """The longest row or column of adjoining cells that all have the described family.

    direction: "delta" for a row, "epsilon" for a column. middle: the point (δ, ε) in its middle. half_span: half of
    its length plus one cell, in δ or ε; a diagram that extends so far on either side shows where the family ends.
    """

    direction: str
    middle: Pair
    half_span: float

    @property
    def state(self) -> PointTabsState:
        """State of the tabs for the point `middle`, with a diagram of `half_span` to either side in this direction."""
        return PointTabsState(direction=self.direction, span=float(f"{self.half_span:.12g}"))


@dataclass(frozen=True)
class FamilyDescription:
    """Description of one family.

    row: the family's numbers in the survey's table of families, by name. cell_share: share of the computed cells that
    have the family. sample_share: share of all samples that go to the family. borders: by the name of each curve on
    which motions of the family's label begin or end, the number of pairs of neighbouring cells, one with the family and
    one without it, between which the curve passes. extents: the longest row and the longest column of the family's
    cells.
    """

    name: str
    row: Mapping[str, float]
    cell_share: float
    sample_share: float
    borders: Mapping[str, int]
    extents: tuple[FamilyExtent, ...]


class StoredFamilies(NamedTuple):
    """An open survey, or a slice of one, and the table of its families."""

    survey: xr.Dataset
    table: xr.Dataset


def open_stored_families(place: Path | StoreInBucket, request: SurveyRequest, number: int) -> StoredFamilies:
    """Open a survey and its table of families in a store. This function blocks: use a thread.

    Parameters
    ----------
    number : int
        Index of the slice, if the survey has a third axis.

    Returns
    -------
    StoredFamilies
        The survey, or the slice, and its table.

    Raises
    ------
    SurveyError
        The families are not stored yet.
    """
    opened, along = partial(open_survey, place), request.slice_index(number)
    return StoredFamilies(
        open_survey_for_map(opened, LARGEST, *along), opened(slice_group_path(along[0] if along else None, GROUP))
    )


def require_family(found: StoredFamilies, number: int) -> None:
    """Raise SurveyError if there is no family of this number."""
    if number >= (size := found.table.sizes["family"]):
        if not size:
            raise SurveyError(f"This survey has no families, so there is no family {number}: choose another survey.")
        raise SurveyError(
            f"There are families 0 to {size - 1} in this survey, but no family {number}: choose another family."
        )


def names_of_first_families(found: StoredFamilies) -> list[str]:
    """Return the names of the first MOST_LISTED families. This function blocks: use a thread."""
    with report_damage("the families"):
        return family_names(*found, MOST_LISTED)


def describe_family(found: StoredFamilies, plane: MapPlane, number: int) -> FamilyDescription:
    """Return the description of the family `number`, which must exist. plane: the map of the family's basin fraction.

    This function blocks: use a thread.

    Returns
    -------
    FamilyDescription
        The description.
    """
    with report_damage("the families"):
        names = family_names(*found, number + 1)
        here = found.table.isel(family=number)
        row = {str(name): float(here[name]) for name in here.data_vars if not here[name].dims}
        curves = [str(each) for each in here["curve"].values]
        borders = dict(zip(curves, (int(each) for each in here["edges_on"].values), strict=True))
    share, status = plane.read_values_and_status()
    done = (status > 0) & (status != FAILED)
    extents = (_longest_extent(share > 0, plane, "delta"), _longest_extent(share > 0, plane, "epsilon"))
    return FamilyDescription(
        names[number],
        row,
        row["cells"] / max(int((status > 0).sum()), 1),
        float(share[done].mean(dtype=float)) if done.any() else 0.0,
        {curve: count for curve, count in borders.items() if count},
        tuple(each for each in extents if each is not None),
    )


def longest_run_of_true(there: np.ndarray) -> tuple[int, int, int]:
    """Return the longest run of True within a row of an array (m, n).

    If several runs are longest, return the run that ends first. If no value is True, the run is empty.

    Returns
    -------
    tuple[int, int, int]
        Row, first column, and the column after the last one.
    """
    run = np.zeros(there.shape[0], np.int64)
    best = 0, 0, 0
    for column, beside in enumerate(there.T):
        run = np.where(beside, run + 1, 0)
        row = int(run.argmax())
        if run[row] > best[2] - best[1]:
            best = row, column + 1 - int(run[row]), column + 1
    return best


def _longest_extent(there: np.ndarray, plane: MapPlane, direction: str) -> FamilyExtent | None:
    along, across = (plane.delta, plane.epsilon) if direction == "delta" else (plane.epsilon, plane.delta)
    line, first, end = longest_run_of_true(there if direction == "delta" else there.T)
    if end == first:
        return None
    step = float(along[-1] - along[0]) / max(along.size - 1, 1)
    middle = float(along[first] + along[end - 1]) / 2
    beside = float(across[line])
    return FamilyExtent(
        direction,
        (middle, beside) if direction == "delta" else (beside, middle),
        # one cell more than half the length, so that the diagram shows where the family ends
        (end - first) / 2 * step + step,
    )


def family_in_words(found: FamilyDescription, model: Model) -> str:
    """Return the description of a family in sentences, as HTML."""
    row = found.row
    if not row["cells"]:
        return f"<p><strong>{escape(found.name)}</strong> is in none of the cells.</p>"
    said = [
        f"<strong>{escape(found.name)}</strong> is in {row['cells']:,.0f} cells, {percent_text(found.cell_share)} of "
        f"the plane; {percent_text(found.sample_share)} of all samples go to it.",
        f"It reaches from δ {number_text(row['delta_low'])} to {number_text(row['delta_high'])} and from ε "
        f"{number_text(row['epsilon_low'])} to {number_text(row['epsilon_high'])}.",
    ]
    if row["largest_fraction"] > 0:
        at = f"δ {number_text(row['delta_at'])}, ε {number_text(row['epsilon_at'])}"
        said.append(f"Its share is largest, {percent_text(row['largest_fraction'])}, at {at}.")
    if row["unsampled"]:
        said.append(f"In {row['unsampled']:,.0f} of its cells no sample goes to it.")
    said += [*_borders_in_words(found, model), *([NOT_ALONE] if row["monodromy"] else [])]
    return f"<p>{' '.join(said)}</p>"


def _borders_in_words(found: FamilyDescription, model: Model) -> list[str]:
    """Return a list of one sentence: the curves where the family is born or ends, or that the family has no border."""
    edges = int(found.row["edges"])
    if not edges:
        return ["Its cells have no border with other cells."]
    parts = [
        f"{escape(curve)} ({percent_text(count / edges)})"
        for curve, count in sorted(found.borders.items(), key=lambda each: -each[1])
        if curve in model.curve_names
    ]
    if not parts:
        return ["At its border it is born or ends at curves of longer motions, in chaos, or where samples missed it."]
    return [
        f"At its border it is born or ends on {', '.join(parts)}; elsewhere on curves of longer motions, in chaos, or "
        "where samples missed it."
    ]
