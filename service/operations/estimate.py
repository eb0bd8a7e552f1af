"""Estimate the cost of a survey from similar surveys of this service, or by measuring some of its cells."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import islice

from starlette.concurrency import run_in_threadpool

from gear_rattle.service.database.tables import JobRow
from gear_rattle.service.operations.processes import compute_in_process
from gear_rattle.service.operations.surveys import list_jobs
from gear_rattle.service.state import ApplicationState
from gear_rattle.workers import AnyRequest, Axis, PopulationRequest, SurveyRequest, TileShape, compute_tile, tiles_of
from gear_rattle.workers.survey.values.schema import SAMPLED, Group
from rattle.attractors import PERIODS, WATCH

COMPARED_SURVEYS = 100  # the request is compared with at most this many surveys, the newest ones
LEAST_CELLS = 16  # a survey is used for comparison if at least this many of its cells are computed
#: Similar surveys differ at most by this factor in the number of initial conditions per cell, in the observation time,
#: and in each parameter that the model adds.
SIMILAR_FACTOR = 4.0
MEASURED_SIDE = 3  # a measurement computes this many cells along each axis
IF_ALL_COMPUTED = ", if all cells were computed"
STRONG_DAMPING = WATCH / PERIODS  # above this damping the observation time does not depend on damping


@dataclass(frozen=True)
class CostEstimate:
    """The estimated cost of a survey on this service.

    seconds: duration of the survey from the moment when it runs. workers: assumed number of workers. basis: the basis
    of the estimate in words. is_upper_bound: True if `seconds` is the time for computing all cells of a refined survey,
    which will compute an unknown number of them; then `seconds` is an upper bound.
    """

    seconds: float
    workers: int
    basis: str
    is_upper_bound: bool = False


async def estimate_cost(front: ApplicationState, request: AnyRequest) -> CostEstimate:
    """Estimate the cost of a survey from a similar survey among the newest ones, or by computing nine requested cells.

    The cost of a population is estimated by computing nine of its gears.

    Returns
    -------
    CostEstimate
        The estimate.

    Raises
    ------
    UnavailableError
        The cost must be measured, and the measurement takes too long or cannot begin now.
    """
    workers = await run_in_threadpool(front.manager.count_cluster_threads) or front.settings.workers
    found = await run_in_threadpool(_predict_seconds_from_similar_survey, front, request)
    is_upper_bound = found is None and isinstance(request, SurveyRequest) and request.refine is not None
    if is_upper_bound:
        request = request.model_copy(update={"refine": None})
        found = await run_in_threadpool(_predict_seconds_from_similar_survey, front, request)
    if found:
        seconds, basis = found
    else:
        seconds = await compute_in_process(
            front,
            measure_cell_seconds,
            request,
            model=request.model,
            what="The cost",
            advice="Request fewer initial conditions in a cell.",
        )
        few = "gears of the population" if isinstance(request, PopulationRequest) else "cells of the survey"
        basis = f"measured now on {MEASURED_SIDE * MEASURED_SIDE} {few}"
    return CostEstimate(
        seconds * request.n_cells / workers,
        workers,
        f"{basis}{IF_ALL_COMPUTED if is_upper_bound else ''}",
        is_upper_bound,
    )


def _predict_seconds_from_similar_survey(front: ApplicationState, request: AnyRequest) -> tuple[float, str] | None:
    """Predict the seconds per cell of a request from the seconds per cell of the most similar survey.

    Returns
    -------
    tuple[float, str] | None
        The predicted seconds per cell, in proportion to the samples per cell, and a text that names the similar survey.
        None for a population, or if no survey is similar.
    """
    if isinstance(request, PopulationRequest):
        return None
    jobs, _ = list_jobs(front, COMPARED_SURVEYS)
    like = most_similar_survey(request, jobs)
    if like is None:
        return None
    seconds = front.database.total_tile_seconds(like.id) / like.cells_done * _sample_ratio(request, like)
    return seconds, f"by the speed of {like.name or like.id}, {like.cells_done:,} cells of the same kind"


def most_similar_survey(request: SurveyRequest, jobs: Iterable[JobRow]) -> JobRow | None:
    """Return the job of the similar survey whose samples per cell are nearest to the request's; None if there is none.

    A similar survey has the same quantities, refinement and model, similar parameters, and similar samples.

    Returns
    -------
    JobRow | None
        The job, of which at least LEAST_CELLS cells are computed.
    """
    wanted = {str(group) for group in request.quantities}
    like = [
        job
        for job in jobs
        if job.cells_done >= LEAST_CELLS
        and job.is_readable
        and set(job.request["quantities"]) == wanted
        and job.request.get("refine") == request.model_dump(mode="json")["refine"]
        and (other := SurveyRequest.model_validate(job.request))
        and _have_similar_models(request, other)
        and _have_similar_samples(request, other)
        and 1.0 / SIMILAR_FACTOR <= _sample_ratio(request, job) <= SIMILAR_FACTOR
    ]
    return min(like, key=lambda job: abs(math.log(_sample_ratio(request, job))), default=None)


def _sample_ratio(request: SurveyRequest, job: JobRow) -> float:
    """Return the samples per cell of a request over those of a job; 1 if the request has no samples, or has basins."""
    if not SAMPLED.intersection(request.quantities) or Group.BASINS in request.quantities:
        return 1.0
    count: int = job.request["initial_conditions"]["count"]
    return request.initial_conditions.count / count


def _have_similar_models(request: SurveyRequest, other: SurveyRequest) -> bool:
    """Return whether both surveys have the same model, and added parameters within a factor SIMILAR_FACTOR."""
    ours, theirs = request.added_parameter_values, other.added_parameter_values
    if ours.keys() != theirs.keys() or request.model != other.model:
        return False
    return all(1.0 / SIMILAR_FACTOR <= ours[name] / theirs[name] <= SIMILAR_FACTOR for name in ours)


def _have_similar_samples(request: SurveyRequest, other: SurveyRequest) -> bool:
    """Return whether both surveys have similar observation times, and equal budgets and boxes of initial conditions."""
    ratio = max(request.delta.start, STRONG_DAMPING) / max(other.delta.start, STRONG_DAMPING)
    sample, its = request.initial_conditions, other.initial_conditions
    same = (sample.budget, sample.tau_range, sample.v_min, request.v_max) == (
        its.budget,
        its.tau_range,
        its.v_min,
        other.v_max,
    )
    return same and 1.0 / SIMILAR_FACTOR <= ratio <= SIMILAR_FACTOR


def measure_cell_seconds(request: AnyRequest) -> float:
    """Return the seconds that one process takes for a cell (or gear), measured on a few of the request's cells."""
    few = _request_for_few_gears(request) if isinstance(request, PopulationRequest) else _request_for_few_cells(request)
    for _ in range(2):
        began = time.perf_counter()
        for tile in tiles_of(few):
            compute_tile(few, tile)
        seconds = time.perf_counter() - began
    return seconds / few.n_cells


def _request_for_few_gears(request: PopulationRequest) -> PopulationRequest:
    """Return a request for a few gears. As many in proportion, but at least one, are tested for the yield (judged)."""
    gears = min(request.gears, MEASURED_SIDE * MEASURED_SIDE)
    judged = max(1, round(gears * request.plan.n_judged / request.n_cells))
    few = {"gears": gears, "pairs": 0, "judged": judged, "tile": None}
    return PopulationRequest.model_validate(request.model_dump(mode="json") | few)


def _request_for_few_cells(request: SurveyRequest) -> SurveyRequest:
    request = request.slice_request(next(islice(request.slices, request.n_slices // 2, None)))
    axes = {"delta": _coarsen_axis(request.delta), "epsilon": _coarsen_axis(request.epsilon)}
    return request.model_copy(update={**axes, "tile": TileShape()})


def _coarsen_axis(axis: Axis) -> Axis:
    """Return an axis of at most MEASURED_SIDE values: the centres of equal parts of the given axis."""
    num = min(axis.num, MEASURED_SIDE)
    half = (axis.stop - axis.start) / (2 * num)
    return Axis(start=axis.start + half, stop=axis.stop - half, num=num)
