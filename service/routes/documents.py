"""The JSON documents of a survey, and the fields that a population's documents also have."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import Path
from pydantic import BaseModel, Field

from gear_rattle.service.database.tables import JobKind, JobRow, State
from gear_rattle.service.web import examples
from gear_rattle.service.web.prefix import public_path


class Links(BaseModel):
    """The URL paths of a survey's resources."""

    self: str
    events: str
    store: str
    map: str
    certificates: str | None = Field(description="null unless the survey was submitted with `certify`")


class JobDocument(BaseModel):
    """The status of a survey or a population."""

    id: str
    name: str
    state: State
    progress: int = Field(ge=0, le=100, description="finished share of the tiles in per cent")
    message: str = Field(description="why it failed or was dismissed, what it waits for, or how many proofs are tried")
    created: str
    started: str | None
    finished: str | None
    content_hash: str = Field(description="hash of the request and of the code that computes it")
    tiles_done: int
    tiles: int
    cells_done: int
    cells: int
    cells_failed: int = Field(description="cells whose status is 3; `failures` of the single document says why")


class Survey(JobDocument):
    """A survey: its status, request and results."""

    notes: str
    links: Links

    @classmethod
    def from_job(cls, job: JobRow) -> Survey:
        """Return the document of a job."""
        return cls(**job_document_fields(job), notes=job.notes, links=_links(job))


class SurveyDetail(Survey):
    """A survey with its request and the messages of its failed cells."""

    request: dict[str, Any] = Field(description="the request; empty if the job database has no readable one")
    failures: list[dict[str, Any]] = Field(description="the first 100 failed cells: indices and message")

    @classmethod
    def from_job_and_failures(cls, job: JobRow, failures: list[dict[str, Any]]) -> SurveyDetail:
        """Return the document of a job with its failed cells."""
        asked = readable_request(job)
        return cls(**job_document_fields(job), notes=job.notes, links=_links(job), request=asked, failures=failures)


class SurveyList(BaseModel):
    """One page of surveys, newest first."""

    surveys: list[Survey]
    count: int = Field(description="surveys in all")
    next: str | None = Field(description="`cursor` of the next page, null on the last")


SurveyId = Annotated[
    str, Path(description="id of a survey, from the answer to its submission", examples=[examples.SURVEY_ID])
]


def path_of_job(survey_id: str, kind: JobKind = JobKind.SURVEY) -> str:
    """Return the URL path of a survey or population, with the path prefix under which a proxy serves this service."""
    return public_path(f"/v1/{'surveys' if kind == JobKind.SURVEY else 'populations'}/{survey_id}")


def readable_request(job: JobRow) -> dict[str, Any]:
    """Return the request of a job, or an empty dictionary if its row in the job database is damaged."""
    return job.request if job.is_readable else {}


def _links(job: JobRow) -> Links:
    here = path_of_job(job.id)
    asked = f"{here}/certificates" if readable_request(job).get("certify") else None
    return Links(self=here, events=f"{here}/events", store=f"{here}/store", map=f"{here}/map.png", certificates=asked)


def job_document_fields(job: JobRow) -> dict[str, Any]:
    """Return the fields of `JobDocument` for a job."""
    state, message = job.shown_state_and_message
    return {
        "id": job.id,
        "name": job.name,
        "state": state,
        "progress": job.progress,
        "message": message,
        "created": job.created,
        "started": job.started,
        "finished": job.finished,
        "content_hash": job.content_hash,
        "tiles_done": job.tiles_done,
        "tiles": job.n_tiles,
        "cells_done": job.cells_done,
        "cells": job.n_cells,
        "cells_failed": job.cells_failed,
    }
