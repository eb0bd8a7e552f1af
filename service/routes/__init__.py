"""One file per group of routes; :data:`ROUTERS` is all of them."""

from fastapi import APIRouter

from service.routes import curves, events, health, picture, points, store, surveys

ROUTERS: tuple[APIRouter, ...] = (
    surveys.router,
    events.router,
    store.router,
    picture.router,
    points.router,
    curves.router,
    health.router,
)
