"""Select one variable of a survey as a map over the (δ, ε) plane."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gear_rattle.workers.errors import SurveyError, missing_map_message
from gear_rattle.workers.survey.request import BY_FAMILY, BY_FRACTION
from gear_rattle.workers.survey.slices import require_slice, third_axis_length
from gear_rattle.workers.survey.stored_families import FAMILY
from gear_rattle.workers.survey.values.schema import CELL, OF_PERIODIC, SLOT
from rattle.attractors import PERIODIC

if TYPE_CHECKING:  # not imported at run time: xarray takes half a second to import, which would delay a service's start
    import xarray as xr

#: SLOT_ORDER is the attribute of a slot's map that names the rule by which attractors are put into slots: BY_FRACTION,
#: BY_FAMILY or UNJOINED. UNJOINED means by fraction until the families are joined, and then by family.
SLOT_ORDER, UNJOINED = "slot_order", "unjoined"


def map_of_variable(dataset: xr.Dataset, variable: str, index: int = 0) -> xr.DataArray:
    """Return a variable as a map (epsilon, delta).

    index: the number of the map, from 0, if the variable has a map for each orbit or slot; else 0.

    Returns
    -------
    xr.DataArray
        The map; a map of a slot has the attribute SLOT_ORDER.

    Raises
    ------
    SurveyError
        There is no such map, or the dataset still has a third axis.
    """
    require_slice(third_axis_length(dataset), None)
    if variable not in dataset.data_vars or dataset[variable].dims[-2:] != CELL:
        maps = sorted(str(name) for name, values in dataset.data_vars.items() if values.dims[-2:] == CELL)
        raise SurveyError(missing_map_message(variable, maps))
    plane = dataset[variable]
    first, *others = [*plane.dims[:-2], ""]
    if index and not first:
        raise SurveyError(f"{variable} has a single map: leave the index out")
    if first:
        if not 0 <= index < plane.sizes[first]:
            raise SurveyError(
                f"{variable} has {plane.sizes[first]} maps: use an index from 0 to {plane.sizes[first] - 1}"
            )
        plane = plane.isel({first: index, **{dim: 0 for dim in others if dim}})
    return plane.assign_attrs({SLOT_ORDER: _order_of_slots(dataset)}) if first == SLOT else plane


def _order_of_slots(dataset: xr.Dataset) -> str:
    """Return the rule that orders a survey's slots: BY_FRACTION, BY_FAMILY, or UNJOINED until families are joined."""
    if "family" not in dataset[SLOT].attrs.get("long_name", ""):
        return BY_FRACTION
    return BY_FAMILY if FAMILY in dataset else UNJOINED


def mask_nonperiodic(dataset: xr.Dataset, plane: xr.DataArray, index: int) -> xr.DataArray:
    """Remove the cells whose attractor is not periodic from a map, if its variable describes periodic attractors only.

    Maps of other variables are returned unchanged. index: the slot of the map. plane: the map, or a part of it.

    Returns
    -------
    xr.DataArray
        The map; NaN in removed cells.
    """
    if plane.name not in OF_PERIODIC:
        return plane
    kind = dataset["attractor_kind"][index].sel(delta=plane["delta"], epsilon=plane["epsilon"])
    return plane.where(kind.values == PERIODIC)


def values_to_draw(plane: xr.DataArray | np.ndarray) -> np.ndarray:
    """Return the values of a map as float64; for complex values, their moduli."""
    return np.asarray(np.abs(plane) if np.iscomplexobj(plane) else plane).astype(float)
