"""The attractors of a survey joined to families, after its tiles: read from the store, and written to it."""

from pathlib import Path

import numpy as np
import zarr

from rattle import Attractors
from workers.errors import reading, storage_error
from workers.storage.location import Place, place_of
from workers.storage.store import added_to_store, has_added
from workers.survey.families import GROUP, STORED, Slots, files_of_families, joined_slots, listed
from workers.survey.request import SurveyRequest
from workers.survey.values.schema import Group


def lacks_families(request: SurveyRequest, where: str | Path | Place) -> bool:
    """Whether a survey, whose tiles are all there, is still to be joined."""
    return Group.FAMILIES in request.quantities and not has_added(where, GROUP)


def join_survey(request: SurveyRequest, where: str | Path | Place) -> None:
    """Join the attractors of a survey whose tiles are all computed, and store their families.

    The caller holds the store. The result is a function of what the tiles hold: neither their shape nor the order in
    which they came shows. A run that was killed meanwhile leaves a survey without families, which is joined anew.

    Raises:
        StorageError: it cannot be written now.
        SurveyError: there is no survey, or it is damaged.
    """
    place = place_of(where)
    families, numbers = joined_slots(request, _slots(request, place))
    try:
        added_to_store(place, files_of_families(request, families, numbers))
    except OSError as error:
        raise storage_error(f"the families of {place} cannot be written", error) from error


def _slots(request: SurveyRequest, place: Place) -> Slots:
    """Read the attractors of a survey, a row of tiles at a time."""
    parts = []
    with reading(f"the attractors of {place}"):
        arrays = {name: zarr.open_array(place.zarr(), path=name, mode="r") for name in STORED}
        height, width = request.tile_shape[0], request.shape[1]
        for row in range(0, request.shape[0], height):
            values = {name: np.asarray(each[..., row : row + height, :]) for name, each in arrays.items()}
            parts.append(listed(values, request.initial_conditions.count, row * width))
    columns = zip(*(part.attractors for part in parts), strict=True)
    attractors = Attractors._make(np.concatenate(column) for column in columns)
    return Slots(attractors, np.concatenate([part.slot for part in parts]))
