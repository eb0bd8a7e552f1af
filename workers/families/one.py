"""Open one family of a survey as a map."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gear_rattle.workers.errors import SurveyError
from gear_rattle.workers.storage.location import Place
from gear_rattle.workers.storage.store import open_survey
from gear_rattle.workers.survey.slices import select_slice, slice_group_path
from gear_rattle.workers.survey.stored_families import FAMILY, GROUP
from gear_rattle.workers.survey.values.schema import CELL, Group
from rattle import KINDS, wilson_interval

if TYPE_CHECKING:
    import xarray as xr

#: {variable of a family's map: its description}.
MAP_VARIABLES = {
    "fraction": "share of the sampled initial conditions; 0 for a stable orbit that none of them reached",
    "fraction_upper": "upper end of the 95 % Wilson interval of fraction",
    "phase": "phase τ of a representative point, in forcing periods",
    "velocity": "speed v of a representative point",
    "lyapunov": "Lyapunov exponent per forcing period, natural logarithm",
    "multiplier": "size of the Floquet multiplier of a periodic motion",
    "attractors": "number of attractors of this family in the cell; more than one where the family has monodromy",
}


def open_family(path_or_url: str | Path | Place, number: int, slice_number: int | None = None) -> xr.Dataset:
    """Return one family of a survey that was computed with families, as a map over (epsilon, delta).

    `fraction` and `fraction_upper` are NaN in cells without the family; `fraction` is 0 where the family's orbit exists
    but no sample reached it. `phase` and `velocity` are a state on the attractor; `lyapunov` has both exponents, and
    `multiplier` the moduli of the multipliers of a periodic orbit. `attractors` is the number of attractors of the
    family in a cell. If there are several, `fraction` is the sum of their fractions, and all other variables describe
    the attractor with the largest fraction. The attributes are the family's row of the group `families`.

    Parameters
    ----------
    slice_number : int | None
        The number of the slice, from 0, if the survey has a third axis, because each slice has its own families; None
        without a third axis.

    Returns
    -------
    xr.Dataset
        Variables on (epsilon, delta), two of them with the dimension `exponent`.

    Raises
    ------
    SurveyError
        There is no survey, it has no families, or there is no such family or slice.
    """
    return family_as_map(lambda group: open_survey(path_or_url, group), str(path_or_url), number, slice_number)


def family_as_map(
    opened: Callable[[str | None], xr.Dataset], name: str, number: int, slice_number: int | None = None
) -> xr.Dataset:
    """Return one family as a map, as `open_family` does, of a survey that the function `opened` opens.

    Parameters
    ----------
    opened : Callable[[str | None], xr.Dataset]
        Function that opens the survey (if it is called with None) or a group of the survey (with the group's path).
    name : str
        The name of the survey in messages.

    Returns
    -------
    xr.Dataset
        Variables on (epsilon, delta), two of them with the dimension `exponent`.

    Raises
    ------
    SurveyError
        The survey has no families, or no family of this number, or there is no such slice.
    """
    import xarray as xr

    with opened(None) as whole:
        survey = select_slice(whole, slice_number)
        if FAMILY not in survey:
            raise SurveyError(f"{name} has no families: compute a survey with --quantity {Group.FAMILIES}")
        with opened(slice_group_path(slice_number, GROUP)) as table:
            if not (isinstance(number, int | np.integer) and 0 <= number < table.sizes["family"]):
                known = table.sizes["family"]
                advice = f"use a number from 0 to {known - 1}" if known else "the survey has no families"
                raise SurveyError(f"there is no family {number!r}: {advice}")
            row = {str(key): values.item() for key, values in table.isel(family=int(number)).items() if not values.ndim}
            entered = table.isel(entered=np.flatnonzero(np.asarray(table["entered_family"]) == number)).load()
        values = _family_maps(survey, int(number), entered)
        count = json.loads(survey.attrs["request"])["initial_conditions"]["count"]
        coords = {axis: survey[axis].load() for axis in CELL} | {"exponent": [1, 2]}
    there = values["attractors"] > 0
    won = np.where(there, np.rint(np.nan_to_num(values["fraction"]) * count), 0.0)
    values["fraction_upper"] = np.where(there, wilson_interval(won, count)[1], np.nan)
    m = int(row["m"])
    values["multiplier"] = np.exp(m * values["lyapunov"]) if m else np.full_like(values["lyapunov"], np.nan)
    dims = {name: (("exponent", *CELL) if values[name].ndim == 3 else CELL) for name in MAP_VARIABLES}
    data = {
        name: (dims[name], values[name], {"long_name": MAP_VARIABLES[name], "units": "1"}) for name in MAP_VARIABLES
    }
    kind = KINDS[row.pop("kind")]
    label = f"P({m},{row['n_plus']},{row['n_minus']})" if m else kind
    return xr.Dataset(data, coords, {"family": int(number), "kind": kind, "label": label, **row})


def _family_maps(survey: xr.Dataset, number: int, entered: xr.Dataset) -> dict[str, np.ndarray]:
    """Return the maps of a family: basin fraction, state, Lyapunov exponents, and number of attractors.

    entered: the family's orbits that have no slot, because only continuation found them.

    Returns
    -------
    dict[str, np.ndarray]
        Maps by name.
    """
    of = np.asarray(survey[FAMILY]) == number
    share = np.where(of, np.asarray(survey["attractor_fraction"], float), -1.0)
    slot, there = share.argmax(axis=0), of.any(axis=0)
    at = entered["entered_row"].values, entered["entered_column"].values

    def values_of_largest_attractor(name: str, orbit_values: np.ndarray) -> np.ndarray:
        """Return the values of a variable for the attractor that represents the family in each cell.

        The family is represented by the attractor with the largest fraction among its slots in the cell; in a cell
        without such a slot, by the cell's orbit in `entered`. orbit_values: the variable of all orbits in `entered`.

        Returns
        -------
        np.ndarray
            NaN in cells without the family.
        """
        values = np.asarray(survey[f"attractor_{name}"], float)
        index = slot.reshape(1, *(1,) * (values.ndim - 3), *slot.shape)
        found: np.ndarray = np.where(there, np.take_along_axis(values, index, 0)[0], np.nan)
        fresh = ~there[at]
        found[..., at[0][fresh], at[1][fresh]] = orbit_values[fresh].T
        return found

    attractors = of.sum(axis=0)
    np.add.at(attractors, at, 1)
    return {
        "fraction": np.where(attractors > 0, np.where(of, share, 0.0).sum(axis=0), np.nan),
        "phase": values_of_largest_attractor("phase", entered["entered_phase"].values),
        "velocity": values_of_largest_attractor("velocity", entered["entered_velocity"].values),
        "lyapunov": values_of_largest_attractor("lyapunov", entered["entered_lyapunov"].values),
        "attractors": attractors,
    }
