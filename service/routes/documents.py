"""What the service answers: the documents of a survey."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import Path
from pydantic import BaseModel, Field

from service.database.tables import JobRow, State
from service.web import examples


class Links(BaseModel):
    """Paths of everything that belongs to a survey."""

    self: str
    events: str
    store: str
    map: str


class Survey(BaseModel):
    """A survey: where it stands, what was asked, where its results are."""

    id: str
    name: str
    state: State
    progress: int = Field(ge=0, le=100, description="percent of the tiles done")
    message: str = Field(description="why it failed, was dismissed, or waits although it runs")
    created: str
    started: str | None
    finished: str | None
    content_hash: str = Field(description="of the request and of the code that computes it")
    tiles_done: int
    tiles: int
    cells_done: int
    cells: int
    cells_failed: int = Field(description="cells whose status is 3; `failures` of the single document says why")
    links: Links

    @classmethod
    def of(cls, job: JobRow) -> Survey:
        return cls(**_fields(job))


class SurveyDetail(Survey):
    """A survey with its request and the messages of its failed cells."""

    request: dict[str, Any] = Field(description="empty if the job database holds none that can be read")
    failures: list[dict[str, Any]] = Field(description="the first 100 failed cells: indices and message")

    @classmethod
    def with_failures(cls, job: JobRow, failures: list[dict[str, Any]]) -> SurveyDetail:
        return cls(**_fields(job), request=job.request if job.is_readable else {}, failures=failures)


class SurveyList(BaseModel):
    """One page of surveys, newest first."""

    surveys: list[Survey]
    count: int = Field(description="surveys in all")
    next: str | None = Field(description="`cursor` of the next page, null on the last")


SurveyId = Annotated[
    str, Path(description="id of a survey, from the answer to its submission", examples=[examples.SURVEY_ID])
]


def path_of(survey_id: str) -> str:
    """Path of a survey, the parent of everything that belongs to it."""
    return f"/v1/surveys/{survey_id}"


def _fields(job: JobRow) -> dict[str, Any]:
    here = path_of(job.id)
    state, message = job.shown
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
        "links": {"self": here, "events": f"{here}/events", "store": f"{here}/store", "map": f"{here}/map.png"},
    }
