"""Report the health of the service, and whether it is ready."""

from __future__ import annotations

from fastapi import APIRouter, Request
from pydantic import BaseModel, Field

import rattle
from gear_rattle.service.database.tables import ACTIVE, State
from gear_rattle.service.errors import DirectoryMissingError, KernelsNotReadyError, UnavailableError
from gear_rattle.service.jobs.manager import OK, READY, STARTING
from gear_rattle.service.state import ApplicationState, FrontState

router = APIRouter(prefix="/v1", tags=["service"])
COMPILING_STATUS = "warming"


class Health(BaseModel):
    """The state of the service, of its cluster and of its storage."""

    status: str = Field(description="ok; warming: kernels are being compiled; degraded: surveys are accepted, but wait")
    version: str
    cluster: str | None = Field(description="ready, starting, or why there is no cluster; null without a key")
    storage: str | None = Field(description="ok, or why nothing can be stored now; null without a key")
    accepted: int | None = Field(description="number of waiting surveys; null without a key or job database")
    running: int | None = Field(description="number of running surveys; null without a key or job database")


class ReadyDocument(BaseModel):
    """The answer of a service that can compute surveys now."""

    status: str = Field(description="ready")


def _storage_state(front: ApplicationState) -> str:
    try:
        front.directory.require_present()
    except DirectoryMissingError as error:
        return f"unavailable: {error}"
    return front.manager.storage_state


def _job_count_or_none(front: ApplicationState, state: State) -> int | None:
    try:
        return front.database.count_jobs(state)
    except DirectoryMissingError:
        return None


def _service_status(front: ApplicationState, storage: str) -> str:
    cluster = front.manager.cluster_state
    if cluster not in (READY, STARTING) or storage != OK:
        return "degraded"
    if front.kernels.is_compiling:
        return COMPILING_STATUS
    return "ok" if cluster == READY else "degraded"


@router.get("/health", summary="State of the service")
def health(front: FrontState, request: Request) -> Health:
    """Return the state of the service. No key is needed; with a key the answer has more fields.

    The status is 503 if the job database does not answer.
    """
    cluster, storage = front.manager.cluster_state, _storage_state(front)
    accepted, running = (_job_count_or_none(front, state) for state in ACTIVE)
    status = _service_status(front, storage)
    if request.state.caller is None:
        return Health(
            status=status, version=rattle.__version__, cluster=None, storage=None, accepted=None, running=None
        )
    return Health(
        status=status,
        version=rattle.__version__,
        cluster=cluster,
        storage=storage,
        accepted=accepted,
        running=running,
    )


@router.get("/ready", summary="Whether the service can do its work now")
def ready(front: FrontState) -> ReadyDocument:
    """Answer 200 if the service can compute surveys now. No key is needed.

    The status is 503 with Retry-After until kernels are compiled and workers have connected, and while nothing can be
    stored. Load balancers and scripts that wait for the service use this route.
    """
    if front.kernels.is_compiling:
        raise KernelsNotReadyError
    if (front.manager.cluster_state, _storage_state(front)) != (READY, OK):
        raise UnavailableError("The service is not ready: GET /v1/health says why. Try again in a few seconds.")
    return ReadyDocument(status=READY)
