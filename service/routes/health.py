"""Whether the service can do its work."""

from __future__ import annotations

from fastapi import APIRouter, Request
from pydantic import BaseModel, Field

import rattle
from service.state import FrontState
from service.tables import ACTIVE

router = APIRouter(prefix="/v1", tags=["service"])


class Health(BaseModel):
    """State of the service."""

    status: str = Field(description="ok, or degraded: surveys are accepted, but wait")
    version: str
    cluster: str | None = Field(description="ready, starting, or why it is not there; null without a key")
    storage: str | None = Field(description="ok, or why nothing can be stored now; null without a key")
    accepted: int | None = Field(description="surveys that wait; null without a key")
    running: int | None = Field(description="surveys at work; null without a key")


@router.get("/health", summary="State of the service")
def health(front: FrontState, request: Request) -> Health:
    """Needs no key, and says more with one. 503 if the job database does not answer."""
    cluster, storage = front.manager.cluster_state, front.manager.storage_state
    accepted, running = (front.database.count(state) for state in ACTIVE)
    status = "ok" if (cluster, storage) == ("ready", "ok") else "degraded"
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
