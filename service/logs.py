"""Logs as text or as lines of JSON, each with the survey and the request that it belongs to."""

from __future__ import annotations

import logging
import re
import time
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

if TYPE_CHECKING:
    from collections.abc import Iterator

    from service.metrics import Metrics

REQUEST_ID = "X-Request-ID"
GIVEN_ID = re.compile(r"[A-Za-z0-9._\-]{1,64}")
METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"})
NO_ROUTE = "none"
#: How an answer counts that never began: the client had gone.
UNANSWERED = 499

_survey: ContextVar[str | None] = ContextVar("survey", default=None)
_request: ContextVar[str | None] = ContextVar("request", default=None)

log = logging.getLogger(__name__)


@contextmanager
def about(survey_id: str) -> Iterator[None]:
    """Let every record of this thread or task carry a survey's id."""
    token = _survey.set(survey_id)
    try:
        yield
    finally:
        _survey.reset(token)


class Context(logging.Filter):
    """Adds survey and request to a record."""

    def filter(self, record: logging.LogRecord) -> bool:
        for name, variable in (("survey", _survey), ("request", _request)):
            if not hasattr(record, name) and (value := variable.get()):
                setattr(record, name, value)
        return True


class Text(logging.Formatter):
    """A line for people: the message, then what it belongs to."""

    def format(self, record: logging.LogRecord) -> str:
        names = ("survey", "request", "seconds")
        return super().format(record) + "".join(f" {n}={getattr(record, n)}" for n in names if hasattr(record, n))


def log_config(form: str) -> dict[str, Any]:
    """For `logging.config.dictConfig`: everything to stderr, as ``text`` or ``json``."""
    fields = "%(asctime)s %(levelname)s %(name)s %(message)s"
    formatter = {"()": Text, "format": fields}
    if form == "json":
        names = {"asctime": "time", "levelname": "level", "name": "logger"}
        formatter = {
            "()": "pythonjsonlogger.json.JsonFormatter",
            "format": fields,
            "datefmt": "%Y-%m-%dT%H:%M:%S%z",
            "rename_fields": names,
        }
    return {
        "version": 1,
        "disable_existing_loggers": False,
        "filters": {"context": {"()": Context}},
        "formatters": {"line": formatter},
        "handlers": {"stderr": {"class": "logging.StreamHandler", "formatter": "line", "filters": ["context"]}},
        "root": {"level": "INFO", "handlers": ["stderr"]},
    }


class RequestLogMiddleware:
    """Logs and counts each request, and gives it an id that the client may choose and is told."""

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self.app = app
        self._metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        began, answered, status = time.perf_counter(), 0.0, UNANSWERED
        given = Headers(scope=scope).get(REQUEST_ID, "")
        request_id = given if GIVEN_ID.fullmatch(given) else uuid4().hex
        token = _request.set(request_id)

        async def send_with_id(message: Message) -> None:
            nonlocal answered, status
            if message["type"] == "http.response.start":
                answered, status = time.perf_counter(), message["status"]
                MutableHeaders(scope=message)[REQUEST_ID] = request_id
            await send(message)

        try:
            await self.app(scope, receive, send_with_id)
        finally:
            seconds = (answered or time.perf_counter()) - began
            route = getattr(scope.get("route"), "path", NO_ROUTE)
            method = scope["method"] if scope["method"] in METHODS else "other"
            self._metrics.request(method, route, status, seconds)
            fields = {"method": method, "route": route, "status": status, "seconds": round(seconds, 6)}
            if survey_id := scope.get("path_params", {}).get("survey_id"):
                fields["survey"] = str(survey_id)[:64]
            log.info("%s %s %d", method, scope["path"], status, extra=fields)
            _request.reset(token)
