"""The routes of the REST service, a file for each group. :data:`ROUTERS` has all routers that need a key."""

from fastapi import APIRouter

from gear_rattle.service.routes import (
    certificates,
    download,
    events,
    limits,
    metrics,
    picture,
    populations,
    store,
    surveys,
)
from gear_rattle.service.routes.model import (
    basin_picture,
    intensity,
    machine,
    notebook,
    plane_curves,
    points,
    reached,
    verdict,
)

ROUTERS: tuple[APIRouter, ...] = (
    surveys.router,
    populations.router,
    populations.estimates,
    events.router,
    store.router,
    certificates.router,
    picture.router,
    download.router,
    points.router,
    reached.router,
    intensity.router,
    machine.router,
    verdict.router,
    limits.router,
    basin_picture.router,
    notebook.router,
    plane_curves.router,
    metrics.router,
)
