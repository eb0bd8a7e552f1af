"""Routes of the certificates of a survey that was submitted with `certify`: a document, and their store."""

from __future__ import annotations

import pathlib
from typing import Annotated

from fastapi import APIRouter, Path, Request, Response
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException

from gear_rattle.service.database.tables import JobRow, State
from gear_rattle.service.errors import MissingError
from gear_rattle.service.routes.documents import SurveyId, path_of
from gear_rattle.service.routes.store import FILES, KEY, file_at
from gear_rattle.service.state import Front, FrontState
from gear_rattle.service.web.conditional import HOUR, NOT_MODIFIED, REVALIDATE, json_answer
from gear_rattle.service.web.problems import declared
from gear_rattle.workers.certificates import CERTIFICATES, REFUSED
from gear_rattle.workers.storage.location import certificates_of

router = APIRouter(prefix="/v1/surveys", tags=["results"])


class CertificateLinks(BaseModel):
    """Paths of the certificates and their store."""

    self: str
    survey: str
    store: str = Field(description="for xr.open_zarr: attractor_certificate and attractor_certificate_radius")
    certificates: str = Field(description="a certificate a line, with its cell and slot")
    refused: str = Field(description="why the others are not proved, one a line")


class Certificates(BaseModel):
    """Number of periodic attractors that are proved so far."""

    state: State = Field(description="of the survey: all attractors are done when it is successful")
    proved: int
    refused: int = Field(description="not proved, which does not mean that they are false")
    links: CertificateLinks


@router.get(
    "/{survey_id}/certificates",
    summary="Proved periodic attractors of a survey",
    response_model=Certificates,
    responses={**NOT_MODIFIED, **declared(404, 422)},
)
def show_certificates(request: Request, front: FrontState, survey_id: SurveyId) -> Response:
    """Return the numbers of proved and unproved attractors of a survey that was submitted with `certify`.

    They grow once all tiles are computed.
    """
    job, out = _stored(front, survey_id)
    here = f"{path_of(survey_id)}/certificates"
    links = CertificateLinks(
        self=here,
        survey=path_of(survey_id),
        store=f"{here}/store",
        certificates=f"{here}/store/{CERTIFICATES}",
        refused=f"{here}/store/{REFUSED}",
    )
    proved, refused = (_lines(out / name) for name in (CERTIFICATES, REFUSED))
    return json_answer(request, Certificates(state=State(job.state), proved=proved, refused=refused, links=links))


@router.get(
    "/{survey_id}/certificates/store/{key:path}",
    summary="Read the zarr store of certificates, and the certificates themselves",
    response_class=Response,
    responses=FILES,
)
async def read_certificates(
    front: FrontState,
    survey_id: SurveyId,
    key: Annotated[str, Path(description="of the store", examples=["zarr.json", CERTIFICATES])],
    request: Request,
) -> Response:
    """Read a file of the store of certificates.

    Lines of certificates appear as they are proved; the variables are complete when all attractors are done.
    """
    job, out = await run_in_threadpool(_stored, front, survey_id)
    if not KEY.fullmatch(key):
        raise MissingError(f"The certificates of survey {survey_id} have no key {key!r}.")
    unchanging = job.state == State.SUCCESSFUL
    try:
        response = await file_at(out, key, request, unchanging)
    except OSError as error:
        raise HTTPException(404) from error
    response.headers["cache-control"] = HOUR if unchanging else REVALIDATE
    return response


def _stored(front: Front, survey_id: str) -> tuple[JobRow, pathlib.Path]:
    job, store = front.stored(survey_id)
    if not job.is_readable or not job.request.get("certify"):
        raise MissingError(
            f"Survey {survey_id} was submitted without certify. Submit it with it, or prove a copy: rattle certify."
        )
    return job, certificates_of(store)


def _lines(file: pathlib.Path) -> int:
    try:
        return file.read_bytes().count(b"\n")
    except FileNotFoundError:
        return 0
