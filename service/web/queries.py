"""Refuse query parameters that a route does not have, so that misspelt parameters are not silently ignored."""

from __future__ import annotations

from fastapi import Request
from fastapi.exceptions import RequestValidationError

from rattle.errors import did_you_mean

#: Names of the query parameters of each route, by path and method. They are kept, because generating the OpenAPI
#: document takes a quarter of a second, and all applications of a process have the same routes.
_parameters_of: dict[tuple[str, str], list[str]] = {}


async def refuse_unknown_query_parameters(request: Request) -> None:
    """Raise RequestValidationError for query parameters that the OpenAPI document does not declare for the route."""
    if not request.query_params:
        return
    asked = request.scope["route"].path, request.method.lower()
    if asked not in _parameters_of:
        _parameters_of.update(_declared_parameters(request))
    known = _parameters_of.setdefault(asked, [])  # a path that the OpenAPI document leaves out has no parameters
    message = f"there is no such parameter; the parameters of this path are: {', '.join(known) or 'none'}"
    unknown = [
        {"loc": ("query", name), "msg": message + did_you_mean(name, known)}
        for name in request.query_params
        if name not in known
    ]
    if unknown:
        raise RequestValidationError(unknown)


def _declared_parameters(request: Request) -> dict[tuple[str, str], list[str]]:
    return {
        (path, method): [each["name"] for each in operation.get("parameters", ()) if each["in"] == "query"]
        for path, operations in request.app.openapi()["paths"].items()
        for method, operation in operations.items()
    }
