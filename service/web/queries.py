"""Query parameters that a route does not have are refused: a misspelt one would be ignored without a word."""

from __future__ import annotations

from fastapi import Request
from fastapi.exceptions import RequestValidationError


async def refuse_unknown(request: Request) -> None:
    """Raise RequestValidationError for parameters that OpenAPI does not declare for this route."""
    if not request.query_params:
        return
    paths = request.app.openapi()["paths"]
    operation = paths.get(request.scope["route"].path, {}).get(request.method.lower(), {})
    known = [parameter["name"] for parameter in operation.get("parameters", ()) if parameter["in"] == "query"]
    message = f"there is no such parameter; this path knows {', '.join(known) or 'none'}"
    unknown = [{"loc": ("query", name), "msg": message} for name in request.query_params if name not in known]
    if unknown:
        raise RequestValidationError(unknown)
