"""The bound of the wrong share that a refined survey was asked for: its tiles go through rounds until it is met."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import reduce
from itertools import islice
from pathlib import Path

import numpy as np
import zarr

from gear_rattle.workers.errors import reading, storage_error
from gear_rattle.workers.storage.added import Each, here
from gear_rattle.workers.storage.location import Place, place_of
from gear_rattle.workers.storage.manifest import attributes_of, noting, tell
from gear_rattle.workers.storage.store import write_tile
from gear_rattle.workers.survey.refined.audit import AUDIT, DISAGREED, LEAF, ROUNDS, SOURCE_LEVEL, TOLD
from gear_rattle.workers.survey.refined.rounds import KINDS, Counts, Round, next_round, upper_of
from gear_rattle.workers.survey.request import SurveyRequest
from gear_rattle.workers.survey.tiles import Tile, compute_tile, first_audit, tiles_of

COUNTED = (SOURCE_LEVEL, AUDIT, LEAF)


def lacks_bound(request: SurveyRequest, where: str | Path | Place) -> bool:
    """Return whether a bound was requested and is not yet known to be met.

    Of a survey whose tiles are all there.

    Returns
    -------
    bool
        True if the bound is still to be met.
    """
    return request.is_bounded and TOLD[-1] not in attributes_of(place_of(where))


def meet_bound(
    request: SurveyRequest,
    where: str | Path | Place,
    each: Each = here,
    at_once: int = 1,
    should_pause: Callable[[], bool] = lambda: False,
) -> bool:
    """Take a survey whose tiles are all there through rounds of audits until its bound is met.

    The caller holds the store.

    The caller holds the store, whose attractors are not yet joined. What a tile holds follows from the request and the
    rounds, and these from what all tiles have: neither tiles nor workers nor where a run was interrupted show.

    Parameters
    ----------
    each : Each
        Does the tasks.
    at_once : int
        Tiles that it is given at a time to be computed.
    should_pause : Callable[[], bool]
        Asked after each time: whether the rest is left for another call.

    Returns
    -------
    bool
        Whether the bound is met; False after a pause.

    Raises
    ------
    StorageError
        It cannot be written now.
    SurveyError
        There is no survey, or it is damaged.
    """
    assert request.refine is not None
    assert request.refine.bound is not None
    place = place_of(where)
    later = tuple(Round(*asked) for asked in json.loads(attributes_of(place).get(ROUNDS, "[]")))
    while True:
        tiles = [(replace(tile, rounds=later),) for tile in tiles_of(request)]
        # All of them: in parts, a turn might end before it comes to a tile that is to be computed.
        found = each(found_in, request, str(place), tiles)
        waiting = iter([tile for tile, counts in zip(tiles, found, strict=True) if counts is None])
        with noting(place) as note:
            while part := list(islice(waiting, at_once)):
                taken = each(take_through, request, str(place), part)
                note({tile.index: files for (tile,), (_, files) in zip(part, taken, strict=True)})
                found += [counts for counts, _ in taken]
                if should_pause():
                    return False
        counts = reduce(_sum, (one for one in found if one is not None))
        more = next_round(request.refine.bound, (first_audit(request), *later), counts)
        if more is None:
            break
        later = (*later, more)
        _tell(place, {ROUNDS: json.dumps(later)})
    told = (int(x.sum()) for x in (counts.filled, counts.audited, counts.disagreed))
    _tell(place, dict(zip(TOLD, (*told, upper_of(counts, len(later))), strict=True)))
    return True


def found_in(_request: SurveyRequest, path: str, tile: Tile) -> Counts | None:
    """Return the findings of the last round in a tile; None if it has not gone through the rounds."""
    place = place_of(path)
    with reading(f"the audit of {place}"):
        stored = {name: np.asarray(zarr.open_array(place.zarr(), path=name, mode="r")[tile.at]) for name in COUNTED}
    return _counts(tile, stored)


def take_through(request: SurveyRequest, path: str, tile: Tile) -> tuple[Counts, dict[str, str]]:
    """Compute and write a tile as it is after the rounds that it names. May be done twice.

    Returns what the last round found, and the digests of the tile's chunks by their keys.

    Returns
    -------
    tuple[Counts, dict[str, str]]
        Findings of the last round, and digests of the tile's chunks by their keys.
    """
    values, _ = compute_tile(request, tile)
    files = write_tile(request, path, tile, values)
    counts = _counts(tile, values)
    assert counts is not None, "what is filled has gone through all rounds"
    return counts, files


def _counts(tile: Tile, values: Mapping[str, np.ndarray]) -> Counts | None:
    """Return the findings of the last round in a tile; None if its cells have gone through others."""
    source, audit, leaf = (values[name] for name in COUNTED)
    now = (leaf > 0) & (leaf // KINDS == len(tile.rounds))
    filled = source > 0
    if (filled & ~now).any() or (leaf // KINDS > len(tile.rounds)).any():
        return None
    return Counts(*(_by_kind(leaf[now & of]) for of in (True, audit > 0, audit == DISAGREED, filled)))


def _by_kind(leaf: np.ndarray) -> np.ndarray:
    return np.bincount(leaf % KINDS, minlength=KINDS)


def _sum(one: Counts, other: Counts) -> Counts:
    return Counts(*(a + b for a, b in zip(one, other, strict=True)))


def _tell(place: Place, told: Mapping[str, str | int | float]) -> None:
    try:
        tell(place, told)
    except OSError as error:
        refusal = storage_error(f"{place} cannot be written", error)
        raise refusal from error
