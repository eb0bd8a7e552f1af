"""Serve the certificates of a survey that was submitted with `certify`: how many there are, and their store."""

from __future__ import annotations

import pathlib
from typing import Annotated

from fastapi import APIRouter, Path, Request, Response
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException

from gear_rattle.service.database.tables import UNREADABLE, JobRow, State
from gear_rattle.service.errors import ConflictError, MissingPartError
from gear_rattle.service.routes.documents import SurveyId, path_of_job
from gear_rattle.service.routes.store import FILES, KEY, file_response
from gear_rattle.service.state import ApplicationState, FrontState
from gear_rattle.service.web.conditional import HOUR, NOT_MODIFIED, REVALIDATE, json_answer
from gear_rattle.service.web.problems import declare_problems
from gear_rattle.workers.certificates import CERTIFICATES, REFUSED
from gear_rattle.workers.storage.location import certificates_path

router = APIRouter(prefix="/v1/surveys", tags=["results"])


class CertificateLinks(BaseModel):
    """Paths of a survey's certificates and their store."""

    self: str
    survey: str
    store: str = Field(description="for xr.open_zarr: attractor_certificate and attractor_certificate_radius")
    certificates: str = Field(description="file with a certificate in each line, with its cell and slot")
    refused: str = Field(description="file with a reason in each line, why an attractor is not proved")


class Certificates(BaseModel):
    """Counts of a survey's periodic attractors: how many have been proved, and how many could not be proved."""

    state: State = Field(description="state of the survey; all attractors have been tried when it is successful")
    proved: int
    refused: int = Field(description="attractors that could not be proved, which does not mean that they do not exist")
    links: CertificateLinks


@router.get(
    "/{survey_id}/certificates",
    summary="Proved periodic attractors of a survey",
    response_model=Certificates,
    responses={**NOT_MODIFIED, **declare_problems(404, 409, 422)},
)
def show_certificates(request: Request, front: FrontState, survey_id: SurveyId) -> Response:
    """Return how many attractors of a survey with `certify` have been proved, and how many could not be proved.

    Both numbers are 0 until all tiles are computed, and grow afterwards.
    """
    job, out = _find_job_and_certificates(front, survey_id)
    here = f"{path_of_job(survey_id)}/certificates"
    links = CertificateLinks(
        self=here,
        survey=path_of_job(survey_id),
        store=f"{here}/store",
        certificates=f"{here}/store/{CERTIFICATES}",
        refused=f"{here}/store/{REFUSED}",
    )
    proved, refused = (_count_lines(out / name) for name in (CERTIFICATES, REFUSED))
    return json_answer(request, Certificates(state=State(job.state), proved=proved, refused=refused, links=links))


@router.get(
    "/{survey_id}/certificates/store/{key:path}",
    summary="Read the zarr store of certificates, and the certificates themselves",
    response_class=Response,
    responses={**FILES, **declare_problems(409)},
)
async def read_certificates(
    front: FrontState,
    survey_id: SurveyId,
    key: Annotated[str, Path(description="of the store", examples=["zarr.json", CERTIFICATES])],
    request: Request,
) -> Response:
    """Read a file of the store of certificates.

    Certificates appear one by one as attractors are proved. The variables of the store are complete when the proof of
    every attractor has been attempted.
    """
    job, out = await run_in_threadpool(_find_job_and_certificates, front, survey_id)
    if not KEY.fullmatch(key):
        raise MissingPartError(f"The certificates of survey {survey_id} have no key {key!r}.")
    is_unchanging = job.state == State.SUCCESSFUL
    try:
        response = await file_response(out, key, request, is_unchanging)
    except OSError as error:
        raise HTTPException(404) from error
    response.headers["cache-control"] = HOUR if is_unchanging else REVALIDATE
    return response


def _find_job_and_certificates(front: ApplicationState, survey_id: str) -> tuple[JobRow, pathlib.Path]:
    job, store = front.find_job_and_store(survey_id)
    if not job.is_readable:
        raise ConflictError(UNREADABLE)
    if not job.request.get("certify"):
        raise MissingPartError(
            f"Survey {survey_id} was submitted without certify. Submit it again with certify, or prove it with the "
            "command rattle certify."
        )
    return job, certificates_path(store)


def _count_lines(file: pathlib.Path) -> int:
    try:
        return file.read_bytes().count(b"\n")
    except FileNotFoundError:
        return 0
