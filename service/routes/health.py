"""Whether the service can do its work."""

from __future__ import annotations

from fastapi import APIRouter, Request
from pydantic import BaseModel, Field

import rattle
from service.errors import KernelsError, UnavailableError
from service.jobs import OK, READY, STARTING
from service.state import Front, FrontState
from service.tables import ACTIVE

router = APIRouter(prefix="/v1", tags=["service"])
WARMING = "warming"


class Health(BaseModel):
    """State of the service."""

    status: str = Field(description="ok; warming: kernels are being compiled; degraded: surveys are accepted, but wait")
    version: str
    cluster: str | None = Field(description="ready, starting, or why it is not there; null without a key")
    storage: str | None = Field(description="ok, or why nothing can be stored now; null without a key")
    accepted: int | None = Field(description="surveys that wait; null without a key")
    running: int | None = Field(description="surveys at work; null without a key")


class Ready(BaseModel):
    """The service can do its work now."""

    status: str = Field(description="ready")


def _status(front: Front) -> str:
    cluster, storage = front.manager.cluster_state, front.manager.storage_state
    if cluster not in (READY, STARTING) or storage != OK:
        return "degraded"
    if front.kernels.at_work:
        return WARMING
    return "ok" if cluster == READY else "degraded"


@router.get("/health", summary="State of the service")
def health(front: FrontState, request: Request) -> Health:
    """Needs no key, and says more with one. 503 if the job database does not answer."""
    cluster, storage = front.manager.cluster_state, front.manager.storage_state
    accepted, running = (front.database.count(state) for state in ACTIVE)
    status = _status(front)
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
async def ready(front: FrontState) -> Ready:
    """Needs no key. 503 with Retry-After until kernels are compiled and workers are there, and while nothing can be
    stored: for a load balancer, or a script that waits.
    """
    if front.kernels.at_work:
        raise KernelsError
    manager = front.manager
    if (manager.cluster_state, manager.storage_state) != (READY, OK):
        raise UnavailableError("Surveys wait: GET /v1/health says for what. Try again in a few seconds.")
    return Ready(status=READY)
