"""Serve metrics for Prometheus."""

from __future__ import annotations

from fastapi import APIRouter, Response
from prometheus_client import CONTENT_TYPE_LATEST

from gear_rattle.service.state import FrontState
from gear_rattle.service.web.problems import declare_problems

router = APIRouter(prefix="/v1", tags=["service"])


@router.get(
    "/metrics",
    summary="Figures for Prometheus",
    response_class=Response,
    responses={200: {"content": {"text/plain": {"schema": {"type": "string"}}}}, **declare_problems()},
)
def metrics(front: FrontState) -> Response:
    """Return the service's metrics for Prometheus. If the service needs keys, a key with the scope read suffices."""
    return Response(front.metrics.exposition(), headers={"Content-Type": CONTENT_TYPE_LATEST})
