"""One file per group of routes; :data:`ROUTERS` is all that ask for a key."""

from fastapi import APIRouter

from service.routes import (
    basins,
    curves,
    download,
    events,
    intensity,
    machine,
    metrics,
    picture,
    points,
    reached,
    store,
    surveys,
)

ROUTERS: tuple[APIRouter, ...] = (
    surveys.router,
    events.router,
    store.router,
    picture.router,
    download.router,
    points.router,
    reached.router,
    intensity.router,
    machine.router,
    basins.router,
    curves.router,
    metrics.router,
)
