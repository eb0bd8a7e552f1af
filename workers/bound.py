"""Compute rounds of audits of a refined survey until its share of wrong cells meets the requested bound."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import reduce
from itertools import islice
from pathlib import Path

import numpy as np
import zarr

from gear_rattle.workers.errors import report_damage, storage_error
from gear_rattle.workers.storage.added import RunForEach, run_in_this_process
from gear_rattle.workers.storage.location import Place, place_of
from gear_rattle.workers.storage.manifest import read_root_attributes, set_store_attributes, tile_recorder
from gear_rattle.workers.storage.store import write_tile
from gear_rattle.workers.survey.refined.audit import AUDIT, AUDIT_ATTRIBUTES, DISAGREED, LEAF, ROUNDS, SOURCE_LEVEL
from gear_rattle.workers.survey.refined.rounds import (
    KINDS,
    AuditCounts,
    AuditRound,
    next_audit_round,
    upper_bound_of_wrong_share,
)
from gear_rattle.workers.survey.request import SurveyRequest
from gear_rattle.workers.survey.tiles import Tile, compute_tile, first_audit_round, tiles_of

COUNTED_VARIABLES = (SOURCE_LEVEL, AUDIT, LEAF)  # variables of a tile from which its `AuditCounts` follow


def lacks_wrong_cell_bound(request: SurveyRequest, where: str | Path | Place) -> bool:
    """Return whether a survey must meet a bound on its share of wrong cells, and its store records no met bound yet.

    All tiles of the survey must be computed.

    Returns
    -------
    bool
        False for a survey without such a bound.
    """
    return request.has_wrong_share_bound and AUDIT_ATTRIBUTES[-1] not in read_root_attributes(place_of(where))


def audit_until_bound_is_met(
    request: SurveyRequest,
    where: str | Path | Place,
    each: RunForEach = run_in_this_process,
    at_once: int = 1,
    should_pause: Callable[[], bool] = lambda: False,
) -> bool:
    """Compute rounds of audits until a survey meets its bound on the share of wrong cells. All tiles must be computed.

    The caller holds the lock of the store, and the survey's families are not joined yet. The content of a tile follows
    from the request and the rounds, and the next round follows from the findings of the last round in all tiles. So the
    result does not depend on the size of tiles, the number of workers or interruptions.

    Parameters
    ----------
    each : RunForEach
        Function that runs a task for each of several items, such as `run_in_this_process`.
    at_once : int
        Number of tiles in a group; each tile is one task.
    should_pause : Callable[[], bool]
        Called after each group of tiles. If it returns true, the remaining work is left to another call.

    Returns
    -------
    bool
        True if the bound is met, False after a pause.

    Raises
    ------
    SurveyError
        There is no survey, or it is damaged.
    StorageError
        The store cannot be written now.
    """
    assert request.refine is not None
    assert request.refine.bound is not None
    place = place_of(where)
    later = tuple(AuditRound(*asked) for asked in json.loads(read_root_attributes(place).get(ROUNDS, "[]")))
    while True:
        tiles = [(replace(tile, rounds=later),) for tile in tiles_of(request)]
        # The counts of all tiles are read without a pause. If a call could pause while it reads, the next call would
        # read all counts again, and perhaps no call would ever compute a tile.
        found = each(audit_counts_of_tile, request, str(place), tiles)
        waiting = iter([tile for tile, counts in zip(tiles, found, strict=True) if counts is None])
        with tile_recorder(place) as note:
            while part := list(islice(waiting, at_once)):
                taken = each(recompute_tile, request, str(place), part)
                note({tile.index: files for (tile,), (_, files) in zip(part, taken, strict=True)})
                found += [counts for counts, _ in taken]
                if should_pause():
                    return False
        counts = reduce(_add_counts, (one for one in found if one is not None))
        more = next_audit_round(request.refine.bound, (first_audit_round(request), *later), counts)
        if more is None:
            break
        later = (*later, more)
        _write_attributes(place, {ROUNDS: json.dumps(later)})
    told = (int(x.sum()) for x in (counts.filled, counts.audited, counts.disagreed))
    _write_attributes(
        place, dict(zip(AUDIT_ATTRIBUTES, (*told, upper_bound_of_wrong_share(counts, len(later))), strict=True))
    )
    return True


def audit_counts_of_tile(_request: SurveyRequest, path: str, tile: Tile) -> AuditCounts | None:
    """Read how many cells of a tile the last round of audits audited, how many were wrong, and how many stay filled.

    Returns
    -------
    AuditCounts | None
        None if the stored tile was computed with other rounds than `tile.rounds`, so that it must be computed again.
    """
    place = place_of(path)
    with report_damage(f"the audit of {place}"):
        stored = {
            name: np.asarray(zarr.open_array(place.zarr(), path=name, mode="r")[tile.selection])
            for name in COUNTED_VARIABLES
        }
    return _count_audited_cells(tile, stored)


def recompute_tile(request: SurveyRequest, path: str, tile: Tile) -> tuple[AuditCounts, dict[str, str]]:
    """Compute a tile with its rounds of audits (`tile.rounds`), and write it. A repetition writes the same bytes.

    Returns
    -------
    tuple[AuditCounts, dict[str, str]]
        Audit counts of the last round, and digests of the tile's chunks by key.
    """
    values, _ = compute_tile(request, tile)
    files = write_tile(request, path, tile, values)
    counts = _count_audited_cells(tile, values)
    assert counts is not None, "every filled cell has gone through all rounds"
    return counts, files


def _count_audited_cells(tile: Tile, values: Mapping[str, np.ndarray]) -> AuditCounts | None:
    """Count the findings of the last round of audits in a tile: see the fields of `AuditCounts`.

    values: arrays of the tile by variable.

    Returns
    -------
    AuditCounts | None
        None if `values` come from other rounds than `tile.rounds`.
    """
    source, audit, leaf = (values[name] for name in COUNTED_VARIABLES)
    now = (leaf > 0) & (leaf // KINDS == len(tile.rounds))
    filled = source > 0
    if (filled & ~now).any() or (leaf // KINDS > len(tile.rounds)).any():
        return None
    return AuditCounts(*(_counts_by_kind(leaf[now & of]) for of in (True, audit > 0, audit == DISAGREED, filled)))


def _counts_by_kind(leaf: np.ndarray) -> np.ndarray:
    return np.bincount(leaf % KINDS, minlength=KINDS)


def _add_counts(first: AuditCounts, second: AuditCounts) -> AuditCounts:
    return AuditCounts(*(a + b for a, b in zip(first, second, strict=True)))


def _write_attributes(place: Place, attributes: Mapping[str, str | int | float]) -> None:
    try:
        set_store_attributes(place, attributes)
    except OSError as error:
        refusal = storage_error(f"{place} cannot be written", error)
        raise refusal from error
