"""Maps of a survey's families: the largest family of each cell, and the share of the samples that go to a family.

All of these maps are computed from the store when they are read, a few rows at a time.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.core.indexing import ExplicitIndexer, IndexingSupport, LazilyIndexedArray, explicit_indexing_adapter

from gear_rattle.workers.errors import SurveyError, report_damage
from gear_rattle.workers.pictures.look import AMONG, LARGEST, SHARE, WHICH
from gear_rattle.workers.survey.slices import select_slice, slice_group_path, surveyed_model
from gear_rattle.workers.survey.stored_families import FAMILY, GROUP
from gear_rattle.workers.survey.values.schema import CELL, SLOT, Group
from rattle import KINDS
from rattle.attractors import CHAOTIC, PERIODIC
from rattle.plot import KIND_COLOURS, Palette, legend_name

OTHERS = 31  # the last code, for all further families: a pyramid level distinguishes 32 codes, and code 0 is "none"
FLAG_COLOURS = "flag_colours"  # attribute of a map: the colour of each code
NONE_COLOUR = "#f4efe3"
COLOUR_DISTANCE = 40.0  # least distance in CIELAB between the colours of two families, if possible
MOST_CELLS = 24_000_000  # families of larger surveys are not drawn
BAND = 1 << 22  # at most this many numbers, in all slots, are read at a time
NOT_JOINED = "The families of this survey are not joined yet: wait until all of its tiles are computed."
CONTACTS = "attractor_contacts"  # a variable of models with contact phases
LETTERS = {(1, 1, 0): "C", (1, 1, 1): "D"}  # motions of the impacting gear with a letter; A and B are never attractors


def open_survey_for_map(
    opened: Callable[[str | None], xr.Dataset], variable: str, number: int | None = None, limit: int = MOST_CELLS
) -> xr.Dataset:
    """Return a survey, or a slice of it, in which the map of `variable` can be drawn.

    Maps of families (LARGEST, SHARE) are added if `variable` is one of them, because stores do not have them.

    Parameters
    ----------
    opened : Callable[[str | None], xr.Dataset]
        Function that opens the survey (called with None) or one of its groups (called with the group's path).
    number : int | None
        The number of the slice; None for a survey without a third axis.

    Returns
    -------
    xr.Dataset
        The survey or slice.

    Raises
    ------
    SurveyError
        The survey has a third axis and no slice is given; or `variable` is LARGEST or SHARE, and the survey has no
        families or more than `limit` cells.
    """
    survey = select_slice(opened(None), number)
    if variable not in (LARGEST, SHARE):
        return survey
    if FAMILY not in survey:
        if Group.FAMILIES in json.loads(survey.attrs["request"])["quantities"]:
            raise SurveyError(NOT_JOINED)
        raise SurveyError(f"this survey has no families: compute a survey with --quantity {Group.FAMILIES}")
    if (cells := math.prod(survey.sizes[axis] for axis in CELL)) > limit:
        raise SurveyError(
            f"this survey has {cells:,} cells, and families can be drawn for at most {limit:,}: compute a "
            "survey of a smaller window, or one with fewer cells"
        )
    return add_family_maps(survey, opened(slice_group_path(number, GROUP)))


def add_family_maps(survey: xr.Dataset, table: xr.Dataset) -> xr.Dataset:
    """Add the maps of families to a survey or to a slice of it. table: the group `families` of the survey or slice.

    Returns
    -------
    xr.Dataset
        The survey with two more variables. LARGEST (among, epsilon, delta): for each cell the code of the family with
        most samples (see `_LargestFamilyMaps`), among all families and among all but quiet running. SHARE (family,
        epsilon, delta): for each family, the share of each cell's samples that go to the family.
    """
    with report_damage("the families"):
        names, colours = family_names(survey, table), family_colours(table)
    if len(names) > OTHERS - 1:
        names, colours = [*names[: OTHERS - 1], "others"], [*colours[: OTHERS - 1], KIND_COLOURS["undecided"]]
    meanings = [each.replace(" ", "_") for each in ("none", *names)]
    described = {
        "long_name": "family with the largest share of the samples",
        "units": "1",
        "flag_values": list(range(len(meanings))),
        "flag_meanings": " ".join(meanings),
        FLAG_COLOURS: " ".join((NONE_COLOUR, *colours)),
    }
    of_one = {"long_name": "share of the samples", "units": "1"}
    arrays = {LARGEST: _LargestFamilyMaps(survey), SHARE: _FamilyShareMaps(survey, table.sizes["family"])}
    lazy = {name: LazilyIndexedArray(array) for name, array in arrays.items()}
    added = {
        LARGEST: xr.Variable((AMONG, *CELL), lazy[LARGEST], described),
        SHARE: xr.Variable(("family", *CELL), lazy[SHARE], of_one),
    }
    return survey.assign(added).assign_coords({AMONG: list(WHICH), "family": np.arange(table.sizes["family"])})


def family_names(survey: xr.Dataset, table: xr.Dataset, most: int = OTHERS) -> list[str]:
    """Return names of the families 0 to most − 1, such as "2: P(1,1,0) = C"; "quiet" for family 0.

    The letter C or D is given for the impacting gear only.

    Returns
    -------
    list[str]
        A name for each family, by the family's number.
    """
    of = {name: np.asarray(table[name][:most]).tolist() for name in ("kind", "m", "n_plus", "n_minus")}
    letters = LETTERS if surveyed_model(survey).has_closed_forms else {}
    found = []
    for number, (kind, *label) in enumerate(zip(*of.values(), strict=True)):
        motion = (label[0], label[1], label[2])
        if kind == PERIODIC:
            name = legend_name(motion, _count_contact_phases(survey, table, number))
        else:
            name = {CHAOTIC: "chaos"}.get(kind, KINDS[kind])
        letter = f" = {letters[motion]}" if kind == PERIODIC and motion in letters else ""
        found.append(f"{number}: {name}{letter}" if number else name)
    return found


def _count_contact_phases(survey: xr.Dataset, table: xr.Dataset, number: int) -> int:
    """Return how many contact phases a family's motion has per period, in the cell where its basin fraction is largest.

    number: the number of the family.

    Returns
    -------
    int
        0 if the survey has no variable CONTACTS.
    """
    if CONTACTS not in survey:
        return 0
    at = {axis: float(table[f"{axis}_at"][number]) for axis in CELL}
    here = survey[[FAMILY, CONTACTS]].sel(at, method="nearest")
    return int(np.asarray(here[CONTACTS])[np.asarray(here[FAMILY]) == number].max(initial=0))


def family_colours(table: xr.Dataset) -> list[str]:
    """Return a colour for each of the families 0 to OTHERS − 2; further families share one colour on maps.

    The colour of a family is that of its label, or a spare colour if an earlier family has the same label or a similar
    colour.

    Returns
    -------
    list[str]
        Colours as "#rrggbb", by the family's number.
    """
    palette, found = Palette(COLOUR_DISTANCE), []
    rows = (np.asarray(table[name][: OTHERS - 1]).tolist() for name in ("kind", "m", "n_plus", "n_minus"))
    for kind, *label in zip(*rows, strict=True):
        found.append(palette.next_colour((label[0], label[1], label[2]) if kind == PERIODIC else KINDS[kind]))
    return found


def dominant_families(family: np.ndarray, share: np.ndarray, first: int = 0) -> np.ndarray:
    """Return for each cell the family with the largest share of its samples.

    Shares of several slots of one family are added. Of two families with equal shares, the lower number is returned.

    Parameters
    ----------
    family : np.ndarray
        The number of the family in each slot, shape (slots, …), −1 in an empty slot.
    share : np.ndarray
        The share of the samples in each slot, shape (slots, …).
    first : int
        Families with a number below this are left out.

    Returns
    -------
    np.ndarray
        Number of the family in each cell, −1 where no family has a share.
    """
    share = np.where(family >= first, np.nan_to_num(share), 0.0)
    best, most = np.full(family.shape[1:], -1, np.int32), np.zeros(family.shape[1:])
    for slot in family:
        total = np.where(family == slot, share, 0.0).sum(axis=0)
        better = (total > most) | ((total == most) & (total > 0) & (slot < best))
        best[better], most[better] = slot[better], total[better]
    return best


class _FamilyMaps(BackendArray):
    """An array (length, epsilon, delta) of maps. Its values are computed from a survey's slots when they are read."""

    def __init__(self, survey: xr.Dataset, length: int, dtype: type) -> None:
        self._family, self._fraction = survey[FAMILY], survey["attractor_fraction"]
        self.shape = (length, *(survey.sizes[axis] for axis in CELL))
        self.dtype = np.dtype(dtype)

    def __getitem__(self, key: ExplicitIndexer) -> Any:
        return explicit_indexing_adapter(key, self.shape, IndexingSupport.BASIC, self._read)

    def _read(self, key: tuple[Any, ...]) -> np.ndarray:
        asked = [np.arange(size)[part] for size, part in zip(self.shape, key, strict=True)]
        index, rows, columns = (np.atleast_1d(each) for each in asked)
        found = np.empty((index.size, rows.size, columns.size), self.dtype)
        together = max(1, BAND // max(self._family.sizes[SLOT] * columns.size, 1))
        for begin in range(0, rows.size, together):
            at = slice(begin, begin + together)
            found[:, at] = self._maps_in_window(index, rows[at], columns)
        return found.reshape([size for each in asked for size in np.shape(each)])

    def _maps_in_window(self, index: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Return the values (maps, rows, columns) of the maps with the numbers `index`, in these rows and columns."""
        spans = dict(zip(CELL, ((each.min(), each.max() + 1) for each in (rows, columns)), strict=True))
        window = {axis: slice(int(low), int(high)) for axis, (low, high) in spans.items()}
        cells = np.ix_(rows - rows.min(), columns - columns.min())
        family, share = (
            np.asarray(each.isel(window).transpose(SLOT, *CELL))[:, *cells] for each in (self._family, self._fraction)
        )
        return np.stack([self._values_on_map(int(i), family, share) for i in index])

    def _values_on_map(self, index: int, family: np.ndarray, share: np.ndarray) -> np.ndarray:
        """Return the values of map number `index`. family, share (slots, …): family and sample share of each slot."""
        raise NotImplementedError


class _LargestFamilyMaps(_FamilyMaps):
    """Two maps of the family that most samples of a cell reach: among all families, and among all but quiet running.

    A code is the number of the family plus 1, at most OTHERS; 0 if no sample of the cell goes to such a family.
    """

    def __init__(self, survey: xr.Dataset) -> None:
        super().__init__(survey, len(WHICH), np.int8)

    def _values_on_map(self, index: int, family: np.ndarray, share: np.ndarray) -> np.ndarray:
        return np.minimum(dominant_families(family, share, first=index) + 1, OTHERS).astype(np.int8)


class _FamilyShareMaps(_FamilyMaps):
    """One map for each family: the share of a cell's samples that go to the family, 0 if no sample does."""

    def __init__(self, survey: xr.Dataset, families: int) -> None:
        super().__init__(survey, families, np.float32)

    def _values_on_map(self, index: int, family: np.ndarray, share: np.ndarray) -> np.ndarray:
        found: np.ndarray = np.where(family == index, np.nan_to_num(share), 0.0).sum(axis=0).astype(np.float32)
        return found
