"""What the root of a store says of it that only its tiles can tell."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from gear_rattle.workers.errors import SurveyError
from gear_rattle.workers.storage.integrity import read_sealed, require_there
from gear_rattle.workers.storage.location import Place
from gear_rattle.workers.survey.seals import ROOT, sealed


def attributes_of(place: Place) -> dict[str, Any]:
    """Return what the root says.

    Raises:
        StorageError: it cannot be read now.
        SurveyError: there is no survey, or it is damaged.
    """
    return dict(_root(place)["attributes"])


def tell(place: Place, told: Mapping[str, Any]) -> None:
    """Let the root say this besides; None: it says no more of it. The caller holds the store.

    Raises:
        OSError: it cannot be written now.
        SurveyError: there is no survey, or it is damaged.
    """
    root = _root(place)
    known = root["attributes"]
    changed = {name: value for name, value in {**known, **told}.items() if value is not None}
    if json.dumps(changed, sort_keys=True) != json.dumps(known, sort_keys=True):
        place.put(ROOT, sealed({**root, "attributes": changed}))


def _root(place: Place) -> dict[str, Any]:
    if (root := read_sealed(place, ROOT)) is None:
        require_there(place)
        raise SurveyError(f"{ROOT} of {place} is damaged: run the survey again to repair it")
    return root
