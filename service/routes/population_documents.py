"""The JSON documents of a population."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, Field

from gear_rattle.service.database.tables import JobKind, JobRow
from gear_rattle.service.operations.points import finite_or_none
from gear_rattle.service.routes.documents import JobDocument, job_document_fields, path_of_job, readable_request
from rattle import Estimate, Population, RattleError


class PopulationLinks(BaseModel):
    """The URL paths of a population's resources."""

    self: str
    events: str
    store: str
    answers: str


class PopulationDocument(JobDocument):
    """A population: its status, request and results. Fields about cells count gears."""

    links: PopulationLinks

    @classmethod
    def from_job(cls, job: JobRow) -> PopulationDocument:
        """Return the document of a job."""
        return cls(**job_document_fields(job), links=_population_links(job))


class PopulationDetail(PopulationDocument):
    """A population with its request and the messages of its failed gears."""

    request: dict[str, Any] = Field(description="the request; empty if the job database has no readable one")
    failures: list[dict[str, Any]] = Field(description="the first 100 failed gears: row and message")

    @classmethod
    def from_job_and_failures(cls, job: JobRow, failures: list[dict[str, Any]]) -> PopulationDetail:
        """Return the document of a job with its failed gears."""
        return cls(
            **job_document_fields(job), links=_population_links(job), request=readable_request(job), failures=failures
        )


class PopulationList(BaseModel):
    """One page of populations, newest first."""

    populations: list[PopulationDocument]
    count: int = Field(description="populations in all")
    next: str | None = Field(description="`cursor` of the next page, null on the last")


class EstimateDocument(BaseModel):
    """An estimate of the seconds from the start to the end of a population, for the given number of workers."""

    seconds: float
    workers: int
    basis: str = Field(description="basis of the estimate")


class Interval(BaseModel):
    """A number with its 95 % interval.

    An end is null if the gears are too few for a bound on that side. A value that overflows double precision is null.
    """

    value: float | None
    low: float | None
    high: float | None

    @classmethod
    def from_estimate(cls, found: Estimate) -> Interval:
        """Return the document of a number with its interval."""
        return cls(**{name: finite_or_none(value) for name, value in found._asdict().items()})


class IndexDocument(BaseModel):
    """Sobol indices of one number of the gears: shares of a result's variance.

    `first` is the share that the number explains alone, `total` the share with all its interactions.
    """

    first: Interval
    total: Interval


class WorstGearDocument(BaseModel):
    """One of the worst gears of a population: its row in the population, its numbers, and how it runs.

    The worst gears have the largest mean energy of impacts.
    """

    row: int
    numbers: dict[str, float]
    quiet: float = Field(description="share of quiet runs")
    energy: float | None = Field(description="mean energy per revolution; for a machine the mean power in W")


class Answers(BaseModel):
    """The answers about a population, with 95 % intervals."""

    gears: int
    count: int
    quiet: Interval = Field(description="probability that a gear runs quietly")
    undecided: float = Field(description="share of undecided samples")
    passing: Interval | None = Field(description="yield: share of gears that pass; null if it was not requested")
    intensity: dict[str, Interval] | None = Field(
        description="quantiles of Σv²/2 per revolution, for a machine of the power in W; null if all are undecided"
    )
    quiet_indices: dict[str, IndexDocument] | None = Field(
        description="Sobol indices of the share of quiet runs; null if unknown"
    )
    energy_indices: dict[str, IndexDocument] | None = Field(
        description="Sobol indices of the mean energy; null if unknown"
    )
    worst: list[WorstGearDocument]


def answers_document(found: Population) -> Answers:
    """Return the document with the answers about a population."""
    intensity = {} if found.undecided == 1.0 else found.intensity()
    return Answers(
        gears=found.plan.gears,
        count=found.plan.count,
        quiet=Interval.from_estimate(found.quiet),
        undecided=found.undecided,
        passing=None if found.passing is None else Interval.from_estimate(found.passing),
        intensity={str(q): Interval.from_estimate(each) for q, each in intensity.items()} or None,
        quiet_indices=_sobol_indices_of(found, "quiet"),
        energy_indices=_sobol_indices_of(found, "energy"),
        worst=[WorstGearDocument(**each._asdict() | {"energy": finite_or_none(each.energy)}) for each in found.worst()],
    )


def _sobol_indices_of(found: Population, of: str) -> dict[str, IndexDocument] | None:
    """Return each varying number's Sobol indices for `of` ("quiet" or "energy"); None if they cannot be computed."""
    try:
        indices = found.indices(of)
    except RattleError:  # no indices can be computed, for example because the gears differ too little
        return None
    return {
        name: IndexDocument(first=Interval.from_estimate(each.first), total=Interval.from_estimate(each.total))
        for name, each in indices.items()
    }


def _population_links(job: JobRow) -> PopulationLinks:
    here = path_of_job(job.id, JobKind.POPULATION)
    return PopulationLinks(self=here, events=f"{here}/events", store=f"{here}/store", answers=f"{here}/answers")
