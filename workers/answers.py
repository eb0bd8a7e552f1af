"""What a population's store answers, finished or not."""

import json
from pathlib import Path

import numpy as np
import zarr

from rattle import Population
from workers.errors import SurveyError, reading
from workers.kinds import request_of
from workers.populations.request import PopulationRequest
from workers.populations.variables import gears_of
from workers.storage.integrity import read_sealed
from workers.storage.location import Place, place_of
from workers.survey.seals import ROOT
from workers.survey.values.evaluate import FAILED


def population_of(where: str | Path | Place) -> Population:
    """Return the population of a store whose gears are all computed, as `rattle.population` does. What of it failed is
    undecided.

    Raises:
        SurveyError: there is no population, it is not finished, or it is damaged.
    """
    place = place_of(where)
    root = read_sealed(place, ROOT)
    try:
        request = None if root is None else request_of(json.loads(root["attributes"]["request"]))
    except (KeyError, ValueError) as error:
        raise SurveyError(f"{place} holds a population of another version: {error}") from error
    if not isinstance(request, PopulationRequest):
        raise SurveyError(f"{place} holds no population that can be read: name the store of one")
    with reading(f"the gears of {place}"):
        group = zarr.open_group(place.zarr(), mode="r")
        status = np.asarray(group["status"])
        if missing := int((status == 0).sum()):
            raise SurveyError(f"{place} lacks {missing} gears: wait until it is finished, or run it again to resume it")
        found = gears_of(request, lambda name: np.asarray(group[name]))
    failed = status == FAILED
    if failed.any():  # their fill values: numbers and parts follow from the plan
        rows = np.flatnonzero(failed)
        found.part[rows], found.values[rows] = request.plan.parts(rows), request.plan.values(rows)
    return Population(request.plan, found)
