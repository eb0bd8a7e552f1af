"""Read a population of gears from its store, for `rattle.Population`, which answers questions about it."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import zarr

from gear_rattle.workers.errors import SurveyError, report_damage
from gear_rattle.workers.kinds import parse_request_document
from gear_rattle.workers.populations.request import PopulationRequest
from gear_rattle.workers.populations.variables import read_population_gears
from gear_rattle.workers.storage.location import Place, place_of
from gear_rattle.workers.storage.manifest import read_manifest, read_unchecked_attributes, read_undamaged_root
from gear_rattle.workers.survey.values.evaluate import FAILED
from rattle import Population

if TYPE_CHECKING:
    import xarray as xr


def read_finished_population(where: str | Path | Place) -> Population:
    """Read the population from a store whose gears are all computed.

    The result equals that of `rattle.population`. The samples of a failed gear count as undecided.

    Returns
    -------
    Population
        The plan from which the gears are drawn, and the attractors of each gear in one row.

    Raises
    ------
    SurveyError
        There is no population, it is not finished, or it is damaged.
    """
    place = place_of(where)
    manifest = read_manifest(place)
    is_whole = manifest is None or read_undamaged_root(place, manifest) is not None  # old stores have no manifest
    request = _read_population_request(read_unchecked_attributes(place) if is_whole else {}, str(place))
    with report_damage(f"the gears of {place}"):
        group = zarr.open_group(place.zarr(), mode="r")
        return _read_complete_population(request, lambda name: np.asarray(group[name]), str(place))


def read_population_in_dataset(dataset: "xr.Dataset", name: str) -> Population:
    """Read the population from an opened store, for example that of a service. name: name of the store in messages.

    Returns
    -------
    Population
        The plan from which the gears are drawn, and the attractors of each gear in one row.

    Raises
    ------
    SurveyError
        There is no population, it is not finished, or it is damaged.
    """
    request = _read_population_request(dataset.attrs, name)
    with report_damage(f"the gears of {name}"):
        return _read_complete_population(request, lambda column: np.asarray(dataset[column]), name)


def _read_population_request(attributes: Any, name: str) -> PopulationRequest:
    """Return the request in a store's attributes. Raises SurveyError if the store has no readable population."""
    try:
        request = parse_request_document(json.loads(attributes["request"])) if "request" in attributes else None
    except (KeyError, ValueError) as error:
        raise SurveyError(
            f"{name} holds a population that this version cannot read ({error}): use the version that computed the "
            "population"
        ) from error
    if not isinstance(request, PopulationRequest):
        raise SurveyError(f"{name} holds no population that can be read: give the store of a population")
    return request


def _read_complete_population(request: PopulationRequest, column: Callable[[str], np.ndarray], name: str) -> Population:
    status = column("status")
    if missing := int((status == 0).sum()):
        raise SurveyError(
            f"{name} lacks {missing} gears: wait until all gears are computed, or run the population's command again, "
            "which computes the missing gears"
        )
    found = read_population_gears(request, column)
    failed = status == FAILED
    if failed.any():  # the store has fill values for failed gears, so their values are taken from the plan
        rows = np.flatnonzero(failed)
        found.part[rows], found.values[rows] = request.plan.parts(rows), request.plan.values(rows)
    return Population(request.plan, found)
