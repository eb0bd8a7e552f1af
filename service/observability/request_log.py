"""Log one line for every request."""

from __future__ import annotations

import re
import time
from typing import TYPE_CHECKING
from uuid import uuid4

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gear_rattle.service.observability.logs import current_request, log

if TYPE_CHECKING:
    from gear_rattle.service.observability.metrics import Metrics


REQUEST_ID = "X-Request-ID"
GIVEN_ID = re.compile(r"[A-Za-z0-9._\-]{1,64}")
METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"})
NO_ROUTE = "none"
#: The status that is logged for a request whose client disconnected before the answer began.
UNANSWERED_STATUS = 499


class RequestLogMiddleware:
    """ASGI middleware that logs and counts each request, and gives it an id.

    The client may choose the id. The answer has the id, too.
    """

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self.app = app
        self._metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one ASGI connection."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        began, answered, status = time.perf_counter(), 0.0, UNANSWERED_STATUS
        given = Headers(scope=scope).get(REQUEST_ID, "")
        request_id = given if GIVEN_ID.fullmatch(given) else uuid4().hex
        token = current_request.set(request_id)

        async def send_with_id(message: Message) -> None:
            nonlocal answered, status
            if message["type"] == "http.response.start":
                answered, status = time.perf_counter(), message["status"]
                MutableHeaders(scope=message)[REQUEST_ID] = request_id
            await send(message)

        try:
            await self.app(scope, receive, send_with_id)
        except ClientDisconnect:
            raise
        except Exception:
            if not answered:  # no answer has begun, so an outer middleware will send status 500
                status = 500
            raise
        finally:
            seconds = (answered or time.perf_counter()) - began
            route = getattr(scope.get("route"), "path", NO_ROUTE)
            method = scope["method"] if scope["method"] in METHODS else "other"
            self._metrics.count_request(method, route, status, seconds)
            fields = {"method": method, "route": route, "status": status, "seconds": round(seconds, 6)}
            if survey_id := scope.get("path_params", {}).get("survey_id"):
                fields["survey"] = str(survey_id)[:64]
            log.info("%s %s %d", method, scope["path"], status, extra=fields)
            current_request.reset(token)
