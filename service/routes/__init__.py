"""One file per group of routes; :data:`ROUTERS` is all that ask for a key."""

from fastapi import APIRouter

from service.routes import (
    basins,
    curves,
    download,
    events,
    intensity,
    limits,
    machine,
    metrics,
    picture,
    points,
    populations,
    store,
    surveys,
)

ROUTERS: tuple[APIRouter, ...] = (
    surveys.router,
    populations.router,
    populations.estimates,
    events.router,
    store.router,
    picture.router,
    download.router,
    points.router,
    intensity.router,
    machine.router,
    limits.router,
    basins.router,
    curves.router,
    metrics.router,
)
