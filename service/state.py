"""What the routes of one application share, injected into them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from anyio import CapacityLimiter
from fastapi import Depends, Request

from service.broadcast import Broadcast
from service.database import Database
from service.datadir import DataDirectory
from service.jobs import JobManager
from service.settings import Settings


@dataclass(frozen=True)
class Front:
    """Everything a route may need; it lives as long as the application's lifespan."""

    settings: Settings
    directory: DataDirectory
    database: Database
    manager: JobManager
    broadcast: Broadcast
    pictures: CapacityLimiter
    points: CapacityLimiter


def front_of(request: Request) -> Front:
    """The shared state of the application that got this request."""
    front: Front = request.app.state.front
    return front


FrontState = Annotated[Front, Depends(front_of)]
