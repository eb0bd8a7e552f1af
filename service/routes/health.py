"""Whether the service can do its work."""

from __future__ import annotations

from fastapi import APIRouter
from pydantic import BaseModel, Field

import rattle
from service.problems import declared
from service.state import FrontState
from service.tables import State

router = APIRouter(prefix="/v1", tags=["service"])


class Health(BaseModel):
    """State of the service."""

    status: str = Field(description="ok, or degraded: surveys are accepted, but wait")
    cluster: str = Field(description="ready, starting, or why it is not there")
    storage: str = Field(description="ok, or why nothing can be stored now")
    version: str
    accepted: int = Field(description="surveys that wait")
    running: int = Field(description="surveys at work")


@router.get("/health", summary="State of the service", responses=declared(503))
def health(front: FrontState) -> Health:
    """503 if the job database does not answer."""
    cluster, storage = front.manager.cluster_state, front.manager.storage_state
    return Health(
        status="ok" if (cluster, storage) == ("ready", "ok") else "degraded",
        cluster=cluster,
        storage=storage,
        version=rattle.__version__,
        accepted=front.database.count(State.ACCEPTED),
        running=front.database.count(State.RUNNING),
    )
