"""Authorise every request before it reaches a route, so that a new route needs a key unless it is listed here."""

from __future__ import annotations

import logging
from typing import Annotated

from fastapi import Depends, Request, Security
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer
from sqlalchemy.exc import SQLAlchemyError
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection
from starlette.responses import RedirectResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gear_rattle.service.access.keys import COOKIE, Caller, find_caller_of_session, find_key_of_token
from gear_rattle.service.access.login import LOGIN, LOGOUT, login_url
from gear_rattle.service.access.origins import is_local_request, is_loopback, require_own_host, require_same_origin
from gear_rattle.service.database.tables import Scope as KeyScope
from gear_rattle.service.errors import ForbiddenError, UnauthorizedError
from gear_rattle.service.settings import Settings
from gear_rattle.service.web import problems
from gear_rattle.service.web.prefix import path_without_prefix
from rattle import RattleError

#: The path below which the scripts and styles of /docs and /redoc are served.
REFERENCE_ASSETS = "/docs/static"
REFERENCE_PATHS = frozenset(
    {
        *("/docs", "/docs/oauth2-redirect", "/redoc", "/openapi.json"),
        *(f"{REFERENCE_ASSETS}/{name}" for name in ("swagger-ui-bundle.js", "swagger-ui.css", "favicon.png")),
        f"{REFERENCE_ASSETS}/redoc.standalone.js",
    }
)
#: Paths that need no key: the state of the service, its documentation, and the login.
OPEN_PATHS = frozenset({"/v1/health", "/v1/ready", *REFERENCE_PATHS, LOGIN})
#: Paths that accept a POST without a key: login and logout.
LOGIN_PATHS = frozenset({LOGIN, LOGOUT})
EXPLORER_PATH = "/"
SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
LONGEST_TARGET = 8192  # the most bytes of a request's path and query

#: Content-Security-Policy of our pages, such as /docs and /help. They load nothing from other hosts, because scripts
#: from other hosts could use the session's cookie.
CONTENT_SECURITY = "; ".join(
    (
        "default-src 'self'",
        "script-src 'self' 'unsafe-inline'",
        "style-src 'self' 'unsafe-inline'",
        "img-src 'self' data:",
        "font-src 'self' data:",
        "worker-src 'self' blob:",
        "object-src 'none'",
        "base-uri 'self'",
        "form-action 'self'",
        "frame-ancestors 'self'",
    )
)
#: Headers of all answers. They keep browsers from guessing another media type, and pages of other sites from loading
#: answers as scripts or images, or showing pages of this service in a frame.
RESPONSE_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Content-Security-Policy": CONTENT_SECURITY,
}

log = logging.getLogger(__name__)

BEARER = HTTPBearer(
    scheme_name="key",
    bearerFormat="rattle_ID_SECRET",
    description="An API key, made by `rattle key add`. A service on loopback asks for none.",
    auto_error=False,  # the middleware has already refused requests without a key
)


async def caller_of(request: Request, _: Annotated[HTTPAuthorizationCredentials | None, Security(BEARER)]) -> Caller:
    """Return the sender of a request.

    `AccessMiddleware` has found the sender, and has refused requests without a required key. This dependency of a route
    lets the OpenAPI document say that the route needs a key.

    Returns
    -------
    Caller
        The owner of the request's key, or a caller without a key.
    """
    caller: Caller = request.state.caller
    return caller


CallerState = Annotated[Caller, Depends(caller_of)]


def requires_keys(settings: Settings) -> bool:
    """Return whether a service with these settings requires a key from every caller."""
    return not settings.insecure and (settings.require_keys or not is_loopback(settings.host))


class AccessMiddleware:
    """Middleware that refuses requests that are too large, come from another site's page, or lack a required key.

    Parameters
    ----------
    app
        The application that gets the accepted requests. ``state["caller"]`` of a request is its `Caller`. The value is
        None for a request that lacks a required key; such a request may reach only open paths, such as /v1/health.
    settings
        The settings of the service.
    """

    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        self.app = app
        self._settings = settings
        self._requires_all = requires_keys(settings)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one ASGI connection."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        try:
            self._check_target_and_headers(scope)
            headers, method = Headers(scope=scope), scope.get("method", "GET")
            if method not in SAFE_METHODS or scope["type"] == "websocket":
                require_same_origin(headers)
                _require_uncompressed_body(headers)
            scope.setdefault("state", {})["caller"] = await self._find_authorised_caller(scope, headers, method)
        except (RattleError, SQLAlchemyError, HTTPException) as error:
            if scope["type"] == "websocket":
                log.warning("a websocket was refused: %s", error)
                await send({"type": "websocket.close", "code": 1008, "reason": ""})
            elif (
                isinstance(error, UnauthorizedError)
                and self._is_page_path(path_without_prefix(scope))
                and method in SAFE_METHODS
            ):
                there = login_url(EXPLORER_PATH, scope["query_string"].decode("ascii", "replace"))
                await RedirectResponse(there, 303)(scope, receive, _wrap_send_with_headers(send))
            else:
                await problems.answer_error(Request(scope), error)(scope, receive, _wrap_send_with_headers(send))
            return
        await self.app(scope, receive, _wrap_send_with_headers(send))

    def _is_page_path(self, path: str) -> bool:
        return self._settings.explorer and path == EXPLORER_PATH

    async def _find_authorised_caller(self, scope: Scope, headers: Headers, method: str) -> Caller | None:
        # Unless the settings say `insecure`, a request from another machine needs a key, even if the service listens on
        # a loopback address.
        asks = self._requires_all or not (self._settings.insecure or is_local_request(scope, headers))
        if not asks:
            require_own_host(headers, self._settings.host, self._settings.allowed_hosts)
            return Caller()
        try:
            caller = await run_in_threadpool(self._authenticate_caller, scope, headers)
        except UnauthorizedError:
            if path_without_prefix(scope) in (OPEN_PATHS if method in SAFE_METHODS else LOGIN_PATHS):
                return None
            raise
        may_read = method in SAFE_METHODS or path_without_prefix(scope) in LOGIN_PATHS
        wanted = KeyScope.READ if may_read else KeyScope.SUBMIT
        if not caller.has_scope(wanted):
            raise ForbiddenError(
                f"This API key may only read, and {method} needs the scope {wanted}. "
                f"`rattle key add NAME --scope {wanted}` makes a key that has it."
            )
        return caller

    def _authenticate_caller(self, scope: Scope, headers: Headers) -> Caller:
        kind, _, token = headers.get("authorization", "").partition(" ")
        database = scope["app"].state.front.database
        if not kind and (session := HTTPConnection(scope).cookies.get(COOKIE)) is not None:
            if (caller := find_caller_of_session(database, session)) is not None:
                return caller
            raise UnauthorizedError("The session of this browser has ended. Sign in again at /login.")
        if kind.lower() != "bearer":
            raise UnauthorizedError(problems.ADVICE[401])
        key = find_key_of_token(database, token.strip())
        if key is None:
            raise UnauthorizedError("This API key is unknown or was revoked. `rattle key add` makes a new key.")
        return Caller(key)

    def _check_target_and_headers(self, scope: Scope) -> None:
        headers: list[tuple[bytes, bytes]] = scope["headers"]
        target = len(scope.get("raw_path") or b"") + len(scope.get("query_string", b""))
        size = target + sum(len(name) + len(value) for name, value in headers)
        names = [name for name, _ in headers]
        if target > LONGEST_TARGET:
            raise HTTPException(414, problems.ADVICE[414])
        if size > self._settings.max_header_bytes or len(headers) > self._settings.max_headers:
            raise HTTPException(431, problems.ADVICE[431])
        # With both headers, a proxy and this server could disagree about where the body ends (request smuggling).
        if b"transfer-encoding" in names and b"content-length" in names:
            raise HTTPException(400, problems.ADVICE[400], {"Connection": "close"})
        if not scope["path"].isprintable():  # the router would ignore a line break at the end of a path
            raise HTTPException(404, problems.ADVICE[404])


def _require_uncompressed_body(headers: Headers) -> None:
    """Raise HTTPException for a compressed body, which no route decompresses."""
    coding = ", ".join(headers.getlist("content-encoding")).strip()
    if coding.lower() not in ("", "identity"):
        what = "Send the body without Content-Encoding: this service does not decompress bodies."
        raise HTTPException(415, what, {"Accept-Encoding": "identity"})


def _wrap_send_with_headers(send: Send) -> Send:
    async def send_with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in RESPONSE_HEADERS.items():
                headers.setdefault(name, value)
        await send(message)

    return send_with_headers
