"""The attractors of a survey joined to families, after its tiles: read from the store, and written to it; and one
family of a survey as a map.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import zarr

from rattle import KINDS, Attractors, wilson_interval
from workers.boundaries.edges import Polyline, edges_of
from workers.errors import SurveyError, reading, storage_error
from workers.storage.location import Place, place_of
from workers.storage.store import added_to_store, has_added, open_survey, rewrite_tile
from workers.survey.families import FAMILY, GROUP, STORED, Slots, files_of_families, joined_slots, listed, with_empty
from workers.survey.request import Along, SurveyRequest
from workers.survey.seals import path_of
from workers.survey.slices import slice_of
from workers.survey.tiles import Tile, tiles_of
from workers.survey.values.quantities import stored
from workers.survey.values.schema import CELL, SLOT, Group

if TYPE_CHECKING:
    import xarray as xr

#: Of a curve in the store: its points and what joins them.
CURVE_POINTS = ("point_delta", "point_epsilon", "piece")
PER_CELL = {
    "fraction": "share of the sampled initial conditions; 0 of an orbit that exists and that none of them found",
    "fraction_upper": "upper end of the 95 % Wilson interval of fraction",
    "phase": "phase τ of a representative point, in forcing periods",
    "velocity": "speed v of a representative point",
    "lyapunov": "Lyapunov exponent per forcing period, natural logarithm",
    "multiplier": "size of the Floquet multiplier of a periodic motion",
    "attractors": "attractors of the cell that are of this family: more than one where monodromy is",
}


def lacks_families(request: SurveyRequest, where: str | Path | Place) -> bool:
    """Whether a survey, whose tiles are all there, is still to be joined."""
    return Group.FAMILIES in request.quantities and not has_added(where, FAMILY)


def join_survey(request: SurveyRequest, where: str | Path | Place) -> None:
    """Join the attractors of a survey whose tiles are all computed, each slice for itself, and store their families.

    The caller holds the store. The result is a function of what the tiles hold: neither their shape nor the order in
    which they came shows. A run that was killed meanwhile leaves a survey without families, which is joined anew.

    Raises:
        StorageError: it cannot be written now.
        SurveyError: there is no survey, or it is damaged.
    """
    place = place_of(where)
    found = {}
    for along, each in request.slices.items():
        joined = joined_slots(each, _slots(each, place, along))
        found[along] = joined, edges_of(joined.families, _curves(each, place, along))
    try:
        _move(request, place, {along: joined.source for along, (joined, _) in found.items()})
        added_to_store(place, files_of_families(request, found))
    except OSError as error:
        raise storage_error(f"the families of {place} cannot be written", error) from error


def _slots(request: SurveyRequest, place: Place, along: Along) -> Slots:
    """Read the attractors of a slice, a row of tiles at a time."""
    parts = []
    with reading(f"the attractors of {place}"):
        arrays = {name: zarr.open_array(place.zarr(), path=name, mode="r") for name in STORED}
        height, width = request.tile_shape[0], request.shape[1]
        for row in range(0, request.shape[0], height):
            here = Tile(0, slice(0, width), slice(row, row + height), along).at
            values = {name: np.asarray(each[here]) for name, each in arrays.items()}
            parts.append(listed(values, request.initial_conditions.count, row * width))
    columns = zip(*(part.attractors for part in parts), strict=True)
    attractors = Attractors._make(np.concatenate(column) for column in columns)
    return Slots(attractors, np.concatenate([part.slot for part in parts]))


def _move(request: SurveyRequest, place: Place, sources: Mapping[Along, np.ndarray]) -> None:
    """Move what is in the slots of the tiles; tiles in which everything is in place are left as they are."""
    quantities = [each for each in stored(request.quantities, request.model) if each.per_cell]
    arrays = {each.name: zarr.open_array(place.zarr(), path=each.name, mode="r") for each in quantities}
    slots = np.arange(request.n_slots)[:, None, None]
    for tile in tiles_of(request):
        here = with_empty(sources[tile.along][:, tile.epsilon, tile.delta])
        if (here == slots).all():
            continue
        with reading(f"tile {tile.index} of {place}"):
            values = {name: np.asarray(each[tile.at]) for name, each in arrays.items()}
        for each in quantities:
            if each.dims[0] == SLOT:
                index = here.reshape(here.shape[0], *(1,) * (len(each.dims) - 3), *here.shape[1:])
                values[each.name] = np.take_along_axis(values[each.name], index, 0)
        rewrite_tile(request, place, tile, values)


def _curves(request: SurveyRequest, place: Place, along: Along) -> dict[str, Polyline]:
    """The curves of a slice, as they were traced for its template."""
    found: dict[str, Polyline] = {}
    with reading(f"the curves of {place}"):
        for name in request.gear_model.curve_names:
            delta, epsilon, piece = (
                np.asarray(zarr.open_array(place.zarr(), path=path_of(along, f"curves/{name}/{each}"), mode="r")[:])
                for each in CURVE_POINTS
            )
            found[name] = delta, epsilon, piece
    return found


def open_family(path_or_url: str | Path | Place, number: int, slice_number: int | None = None) -> xr.Dataset:
    """One family of a survey that was computed with families, as a map over (epsilon, delta).

    slice_number: of a survey with a third axis, from 0: each slice has families of its own.

    fraction, with its upper bound: NaN where the family is not; 0 where its orbit exists and no sample went to it.
    phase, velocity: a point of it; lyapunov and, of a periodic one, multiplier, the size of each (exponent, …);
    attractors: how many of them the cell has, whose shares are added and of which the largest is told. Attributes: its
    row of the group `families`.

    Raises:
        SurveyError: there is no survey, it has no families, or none of this number, or no such slice.
    """
    with open_survey(path_or_url) as whole:
        along = () if slice_number is None else (slice_number,)
        survey, group = slice_of(whole, slice_number), path_of(along, GROUP)
        return family_in(survey, lambda: open_survey(path_or_url, group), number, str(path_or_url))


def family_in(survey: xr.Dataset, families: Callable[[], xr.Dataset], number: int, name: str) -> xr.Dataset:
    """The same of a survey, or a slice of it, that has been opened, and told of by its name; `families` opens its group
    of that name. Raises as `open_family`.
    """
    import xarray as xr

    if FAMILY not in survey:
        raise SurveyError(f"{name} has no families: compute it with --quantity {Group.FAMILIES}")
    with families() as table:
        if not (isinstance(number, int | np.integer) and 0 <= number < table.sizes["family"]):
            raise SurveyError(f"there are families 0 to {table.sizes['family'] - 1}, and no {number!r}")
        row = {str(key): values.item() for key, values in table.isel(family=int(number)).items() if not values.ndim}
        entered = table.isel(entered=np.flatnonzero(np.asarray(table["entered_family"]) == number)).load()
    values = _map_of(survey, int(number), entered)
    count = json.loads(survey.attrs["request"])["initial_conditions"]["count"]
    coords = {name: survey[name].load() for name in CELL} | {"exponent": [1, 2]}
    there = values["attractors"] > 0
    won = np.where(there, np.rint(np.nan_to_num(values["fraction"]) * count), 0.0)
    values["fraction_upper"] = np.where(there, wilson_interval(won, count)[1], np.nan)
    m = int(row["m"])
    values["multiplier"] = np.exp(m * values["lyapunov"]) if m else np.full_like(values["lyapunov"], np.nan)
    dims = {name: (("exponent", *CELL) if values[name].ndim == 3 else CELL) for name in PER_CELL}
    data = {name: (dims[name], values[name], {"long_name": PER_CELL[name], "units": "1"}) for name in PER_CELL}
    kind = KINDS[row.pop("kind")]
    label = f"P({m},{row['n_plus']},{row['n_minus']})" if m else kind
    return xr.Dataset(data, coords, {"family": int(number), "kind": kind, "label": label, **row})


def _map_of(survey: xr.Dataset, number: int, entered: xr.Dataset) -> dict[str, np.ndarray]:
    """Fraction, point, exponents and number of a family's attractors, from its slots and from what was entered."""
    of = np.asarray(survey[FAMILY]) == number
    share = np.where(of, np.asarray(survey["attractor_fraction"], float), -1.0)
    slot, there = share.argmax(axis=0), of.any(axis=0)
    at = entered["entered_row"].values, entered["entered_column"].values

    def best(name: str, of_entered: np.ndarray) -> np.ndarray:
        """Of the attractor with the largest share, or else of the entered orbit."""
        values = np.asarray(survey[f"attractor_{name}"], float)
        index = slot.reshape(1, *(1,) * (values.ndim - 3), *slot.shape)
        found: np.ndarray = np.where(there, np.take_along_axis(values, index, 0)[0], np.nan)
        fresh = ~there[at]
        found[..., at[0][fresh], at[1][fresh]] = of_entered[fresh].T
        return found

    attractors = of.sum(axis=0)
    np.add.at(attractors, at, 1)
    return {
        "fraction": np.where(attractors > 0, np.where(of, share, 0.0).sum(axis=0), np.nan),
        "phase": best("phase", entered["entered_phase"].values),
        "velocity": best("velocity", entered["entered_velocity"].values),
        "lyapunov": best("lyapunov", entered["entered_lyapunov"].values),
        "attractors": attractors,
    }
