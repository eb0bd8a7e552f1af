"""Answer errors with problem documents (RFC 9457). One table maps exceptions to HTTP statuses."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, Field
from sqlalchemy.exc import SQLAlchemyError
from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.responses import Response
from starlette.routing import Match
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gear_rattle.service import errors
from gear_rattle.service.web.examples import ANSWERS
from gear_rattle.workers import ClusterLostError, StorageError, SurveyError
from gear_rattle.workers.errors import DamageError
from gear_rattle.workers.survey.axes import wrong_field_message
from rattle import ParameterError, RattleError

MEDIA_TYPE = "application/problem+json"
MAX_FIELD_ERRORS = 50
RETRY_AFTER = {"Retry-After": "5"}
HEADERS_OF = {401: {"WWW-Authenticate": 'Bearer realm="gear rattle"'}, 429: RETRY_AFTER, 503: RETRY_AFTER}
#: Statuses of errors that a request to any route may get.
STATUSES_OF_ANY_ROUTE = (400, 403, 408, 413, 414, 415, 431, 500, 503)
METHODS = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE")

log = logging.getLogger(__name__)

#: HTTP statuses of exceptions. The first class that matches counts, so subclasses come before their base classes.
STATUS_OF: tuple[tuple[type[Exception], int], ...] = (
    (errors.UnauthorizedError, 401),
    (errors.ForbiddenError, 403),
    (errors.UnknownSurveyError, 404),
    (errors.UnknownKeyError, 404),
    (errors.MissingPartError, 404),
    (errors.ConflictError, 409),
    (errors.LimitError, 422),
    (ParameterError, 422),
    (StorageError, 503),
    (DamageError, 503),
    (ClusterLostError, 503),
    (SurveyError, 422),
    (errors.QueueFullError, 429),
    (errors.UnavailableError, 503),
    (SQLAlchemyError, 503),
)

#: Texts for the field `detail` of problem documents, by status, for errors without a message of their own.
ADVICE = {
    400: "The request could not be read. Send JSON encoded in UTF-8, and a range as bytes=FIRST-LAST.",
    401: "Send an API key in the header Authorization: Bearer KEY. `rattle key add` makes one where the service runs.",
    404: "There is nothing at this path. /docs lists the paths of this service. If a proxy publishes the service at a "
    "path of its host, set RATTLE_ROOT_PATH.",
    405: "This path does not have the requested method. The Allow header lists its methods; see /docs.",
    408: "The request did not arrive completely in time. Send it at once, or over a faster connection.",
    413: "The request body is too large for this service. Describe a survey by its axes, and a measured curve by fewer "
    "points.",
    414: "The URL is too long. Send a shorter URL.",
    415: "Send the body as JSON, with the header Content-Type: application/json.",
    416: "The file is shorter than the requested range. Request bytes below its Content-Length.",
    422: "Some fields of the request are wrong. `errors` names each of them.",
    431: "The request header is too large for this service. Send fewer headers, or shorter ones.",
    500: "The service has an error; the request has none. The error has been logged: please report it.",
    503: "The job database cannot answer now. Try again in a few seconds.",
}

#: {HTTP status: code} for errors whose exceptions are not of this project, such as those of FastAPI.
CODES = {
    400: "bad_request",
    401: "unauthorized",
    403: "forbidden",
    404: "not_found",
    405: "method_not_allowed",
    408: "request_timeout",
    413: "body_too_large",
    414: "url_too_long",
    415: "unsupported_media_type",
    416: "range_not_satisfiable",
    422: "invalid_request",
    431: "headers_too_large",
    500: "internal_error",
    503: "unavailable",
}


class FieldError(BaseModel):
    """A field of a request that was refused, and why."""

    field: str = Field(description="location of the field, for example body.delta.start")
    message: str = Field(description="what is wrong with it")


class Problem(BaseModel):
    """A problem document according to RFC 9457."""

    type: str = "about:blank"
    title: str = Field(description="the HTTP status in words")
    status: int
    code: str = Field(description="stable name of the kind of error, for programs")
    detail: str = Field(description="what went wrong and what to do")
    instance: str = Field("", description="path of the request")
    errors: list[FieldError] = Field(default_factory=list, description="refused fields, if there are any")


def declare_problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Return the OpenAPI declaration of a route's problem documents with these statuses."""
    schema = {"$ref": "#/components/schemas/Problem"}
    return {
        status: {"description": HTTPStatus(status).phrase, "content": {MEDIA_TYPE: {"schema": schema}}}
        for status in statuses
    }


def problem_response(
    status: int,
    detail: str,
    instance: str,
    field_errors: Iterable[FieldError] = (),
    headers: Mapping[str, str] | None = None,
    code: str = "",
) -> Response:
    """Return the problem document of an error. It is valid JSON, whatever text the request contained."""
    problem = Problem(
        title=HTTPStatus(status).phrase,
        status=status,
        code=code or CODES.get(status, "error"),
        detail=detail,
        instance=instance,
        errors=list(field_errors),
    )
    # ensure_ascii, because a lone surrogate in the name of a field cannot be encoded as UTF-8.
    body = json.dumps(problem.model_dump(), ensure_ascii=True, allow_nan=False)
    return Response(body, status, dict(headers or {}), MEDIA_TYPE)


def install_error_handlers(app: FastAPI) -> None:
    """Make ``app`` answer all errors with problem documents."""
    app.add_exception_handler(RequestValidationError, _on_validation_error)
    app.add_exception_handler(HTTPException, _on_http_exception)
    for kind in (RattleError, SQLAlchemyError):
        app.add_exception_handler(kind, _on_known_error)
    app.add_exception_handler(Exception, _on_unknown_error)
    # This is FastAPI's documented way to extend the schema, although mypy reports it as an error.
    app.openapi = partial(_generate_openapi_with_problem, app.openapi)  # type: ignore[method-assign]


def _generate_openapi_with_problem(generate: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    # The schema is added here, because FastAPI would declare the wrong media type, application/json.
    document = generate()
    schemas = document.setdefault("components", {}).setdefault("schemas", {})
    if Problem.__name__ not in schemas:
        schema = Problem.model_json_schema(ref_template="#/components/schemas/{model}")
        schemas |= schema.pop("$defs") | {Problem.__name__: schema}
    # Examples are added here because FastAPI omits every null from its document.
    for name, example in ANSWERS.items():
        if name in schemas:
            schemas[name]["examples"] = [example]
    return document


def field_errors_of(details: Iterable[Mapping[str, Any]]) -> list[FieldError]:
    """Return the refused fields of a pydantic error, with this project's messages."""
    return [
        FieldError(field=".".join(str(part) for part in item["loc"]), message=wrong_field_message(item))
        for item in details
    ]


def _on_validation_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    found = field_errors_of(error.errors())
    detail = "; ".join(f"{item.field}: {item.message}" for item in found[:3])
    if len(found) > MAX_FIELD_ERRORS:
        detail += f" (and more: the first {MAX_FIELD_ERRORS} of {len(found)} are listed)"
    return problem_response(422, detail or ADVICE[422], request.url.path, found[:MAX_FIELD_ERRORS])


def _on_http_exception(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    if error.status_code == 304:
        return Response(status_code=304, headers=error.headers)
    own_words = error.detail != HTTPStatus(error.status_code).phrase and error.status_code not in (400, 413)
    detail = error.detail if own_words else ADVICE.get(error.status_code, error.detail)
    headers = dict(error.headers or {})
    if error.status_code == 405:
        headers["Allow"] = ", ".join(_allowed_methods(request))
    return problem_response(error.status_code, detail, request.url.path, headers=headers)


def _allowed_methods(request: Request) -> list[str]:
    # The router knows only the methods of the first route with this path. Routes for GET also answer HEAD.
    def has_route(method: str) -> bool:
        scope = {**request.scope, "method": "GET" if method == "HEAD" else method}
        return any(route.matches(scope)[0] is Match.FULL for route in request.app.routes)

    return [method for method in METHODS if has_route(method)]


def _on_known_error(request: Request, error: Exception) -> Response:
    is_base = type(error) is RattleError  # the library raises the base class if it cannot compute at these parameters
    status = next((status for kind, status in STATUS_OF if isinstance(error, kind)), 422 if is_base else 500)
    if status == 500 or isinstance(error, SQLAlchemyError):
        log.error("%s %s", request.method, request.url.path, exc_info=error)
    # The message of a database error is about SQL, and does not help clients.
    detail = ADVICE[503] if isinstance(error, SQLAlchemyError) else ADVICE[500] if status == 500 else str(error)
    fields = [FieldError(field=error.field, message=str(error))] if isinstance(error, errors.LimitError) else []
    code = error.code if isinstance(error, RattleError) and status != 500 else ""
    return problem_response(status, detail, request.url.path, fields, HEADERS_OF.get(status), code)


def answer_error(request: Request, error: Exception) -> Response:
    """Return the problem document of an error that a middleware raised before the request reached a route."""
    return (_on_http_exception if isinstance(error, HTTPException) else _on_known_error)(request, error)


def _on_unknown_error(request: Request, error: Exception) -> Response:  # noqa: ARG001 - starlette logs it
    return problem_response(500, ADVICE[500], request.url.path)


class ProblemMiddleware:
    """Middleware that answers plain-text errors of libraries (413, 416) and exceptions (500) with problem documents.

    A request with an unexpected exception is logged and counted like any other, and the exception is also logged.
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one ASGI connection."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        begun = replaced = False

        async def send_problem(message: Message) -> None:
            nonlocal begun, replaced
            begun = True
            if message["type"] == "http.response.start" and _is_plain_text_error(message):
                replaced = True
                await _problem_for_plain_error(message, scope["path"])(scope, receive, send)
            if not replaced:
                await send(message)

        try:
            await self.app(scope, receive, send_problem)
        except ClientDisconnect:  # there is nobody to answer
            raise
        except Exception:
            if not begun:
                await problem_response(500, ADVICE[500], scope["path"])(scope, receive, send)
            raise


def _is_plain_text_error(start: Message) -> bool:
    media_type = Headers(raw=start["headers"]).get("content-type", "")
    return bool(start["status"] >= 400 and media_type.startswith("text/plain"))


def _problem_for_plain_error(start: Message, path: str) -> Response:
    kept = MutableHeaders(raw=list(start["headers"]))
    for name in ("content-type", "content-length"):
        del kept[name]
    status = start["status"]
    return problem_response(status, ADVICE.get(status, HTTPStatus(status).phrase), path, headers=dict(kept))
