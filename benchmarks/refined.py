"""Count wrong cells among the filled cells of a refined survey: `python benchmarks/refined.py STORE --cells 200000`.

Filled cells are drawn at random and computed with other initial conditions, with a model's `attractors_of` and
`period_one`, which do not depend on the code of surveys. A cell is wrong if the computation finds an attractor that the
store does not have in the cell, or another region, or if it does not find a motion whose stored fraction is so large
that chance does not explain that. Only finished tiles of an unfinished survey are examined. The program prints a line
for each kind of error.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import replace
from multiprocessing import get_context
from typing import NamedTuple

import numpy as np
import xarray as xr

import rattle
from gear_rattle.workers import SurveyRequest, open_survey
from gear_rattle.workers.survey.refined.audit import share_upper_bound

AT_ONCE = 500  # a process computes at most this many cells at a time
CHANCE_LIMIT = 1e-3  # a missing motion is an error if chance explains it with less than this probability
LABEL = "m", "n_plus", "n_minus"
KINDS = "quiet", "chaotic", "undecided"
READ = (
    *("status", "source_level", "region", "unlisted_fraction", "attractor_kind"),
    *(f"attractor_{part}" for part in LABEL),
    *(f"{kind}_fraction" for kind in KINDS),
)


class Drawn(NamedTuple):
    """Drawn cells (k,) of a survey, with the values in the store.

    region: their regions, or None. labels (k, slots): a number for the label of each periodic attractor, else 0.
    shares: the basin fraction of each kind, by its name. unlisted: the fraction of attractors beyond the slots.
    """

    request: SurveyRequest
    seed: int
    delta: np.ndarray
    epsilon: np.ndarray
    region: np.ndarray | None
    labels: np.ndarray
    shares: dict[str, np.ndarray]
    unlisted: np.ndarray


def number(*label: np.ndarray) -> np.ndarray:
    """Return a unique number for each label (m, n_plus, n_minus), if all three numbers are below 2²⁰."""
    m, n_plus, n_minus = (np.asarray(part, np.int64) for part in label)
    found: np.ndarray = ((m << 20 | n_plus) << 20) | n_minus
    return found


def drawn(survey: xr.Dataset, cells: int, seed: int) -> Iterator[Drawn]:
    """Draw filled cells of a survey at random, and yield them tile by tile, at most AT_ONCE at a time."""
    request = SurveyRequest.model_validate_json(survey.attrs["request"])
    rng = np.random.default_rng(seed)
    survey = survey[[name for name in READ if name in survey]]
    filled = np.flatnonzero((survey.source_level.values > 0) & (survey.status.values > 0))
    row, column = np.divmod(np.sort(rng.choice(filled, min(cells, filled.size), replace=False)), request.shape[1])
    height, width = request.tile_shape
    tile = (row // height) * request.tile_grid_shape[1] + column // width
    for which in np.unique(tile):
        mine = np.flatnonzero(tile == which)
        top, left = (int(x.min()) for x in (row[mine], column[mine]))
        part = survey.isel(epsilon=slice(top, row[mine].max() + 1), delta=slice(left, column[mine].max() + 1)).load()
        for some in np.array_split(mine, 1 + mine.size // AT_ONCE):
            at = {
                "epsilon": xr.DataArray(row[some] - top, dims="cell"),
                "delta": xr.DataArray(column[some] - left, dims="cell"),
            }
            yield _drawn(request, seed, part.isel(at))


def _drawn(request: SurveyRequest, seed: int, cells: xr.Dataset) -> Drawn:
    has = {name for name in cells.data_vars if isinstance(name, str)}
    empty = np.zeros((cells.sizes["cell"], 0), np.int64)
    periodic = cells.attractor_kind == rattle.KINDS.index("periodic") if "attractor_kind" in has else None
    labels = empty if periodic is None else np.where(periodic, number(*(cells[f"attractor_{x}"] for x in LABEL)), 0).T
    return Drawn(
        request,
        seed,
        cells.delta.values,
        cells.epsilon.values,
        cells.region.values if "region" in has else None,
        labels,
        {kind: cells[f"{kind}_fraction"].values for kind in KINDS if f"{kind}_fraction" in has},
        cells.unlisted_fraction.values if "unlisted_fraction" in has else np.zeros(cells.sizes["cell"]),
    )


def compared(cells: Drawn) -> dict[str, np.ndarray]:
    """Compute the drawn cells, and return for each kind of error flags (k,) of the wrong cells."""
    request, n = cells.request, cells.delta.size
    wrong: dict[str, np.ndarray] = {}
    model = request.gear_model
    if cells.region is not None:
        wrong["region"] = rattle.classify_regions(model.period_one(cells.delta, cells.epsilon)) != cells.region
    if not cells.shares:
        return wrong
    sample = request.initial_conditions
    found = model.attractors_of(cells.delta, cells.epsilon, replace(request.sample_spec, seed=cells.seed))
    periodic = found.kind == rattle.KINDS.index("periodic")
    at = found.cell[periodic]
    label = number(found.m[periodic], found.n_plus[periodic], found.n_minus[periodic])
    lacking = (cells.labels[at] != label[:, None]).all(axis=1) & (cells.unlisted[at] == 0.0)
    wrong["periodic"] = np.bincount(at[lacking], minlength=n) > 0
    for kind, share in cells.shares.items():
        of = found.kind == rattle.KINDS.index(kind)
        seen = np.bincount(found.cell[of], found.samples[of], n)
        wrong[kind] = (seen > 0) & (share == 0.0) | (seen == 0) & ((1.0 - share) ** sample.count < CHANCE_LIMIT)
    return wrong


def main() -> None:
    """Draw cells, compute them, compare them with the store, and print the shares of wrong cells."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("store")
    parser.add_argument("--cells", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1, help="a seed other than the survey's")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=np.inf, help="longest duration of the computation")
    known = parser.parse_args()
    began, n, wrong = time.monotonic(), 0, dict[str, int]()
    with open_survey(known.store, as_stored=True) as survey, get_context("spawn").Pool(known.processes) as pool:
        if survey.attrs.get("refined_cells_filled", 1) == 0 or "source_level" not in survey:
            raise SystemExit(f"{known.store} has no filled cells")
        parts = list(drawn(survey, known.cells, known.seed))
        # The tiles are shuffled, so that after a time limit the computed cells are from the whole plane.
        np.random.default_rng(known.seed).shuffle(parts)  # type: ignore[arg-type]  # numpy's types know arrays only
        for found in pool.imap_unordered(compared, parts):
            found["any of these"] = np.logical_or.reduce(list(found.values()))
            n += found["any of these"].size
            for what, of in found.items():
                wrong[what] = wrong.get(what, 0) + int(of.sum())
            if time.monotonic() - began > 60 * known.minutes:
                pool.terminate()
                break
        audit, asked = np.bincount(survey.audit.values.ravel(), minlength=3), survey.attrs.get("refined_bound_asked")
    upper = share_upper_bound(int(audit[2]), int(audit[1:].sum()))
    print(f"{n} filled cells in {time.monotonic() - began:.0f} s; asked for: {asked}")
    print(f"of {audit[1:].sum()} that the survey audited {audit[2]} disagreed: at most {upper:.2g} are wrong (95 %)")
    for what, many in wrong.items():
        print(f"{what}: {many} wrong, {many / n:.2g}, at most {share_upper_bound(many, n):.2g} (95 %)")


if __name__ == "__main__":
    main()
