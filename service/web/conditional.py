"""Conditional requests (RFC 9110): status 304 replaces an answer that the client already has."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from email.utils import format_datetime, parsedate_to_datetime
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from fastapi import Request, Response
from pydantic import BaseModel
from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gear_rattle.workers.survey.version import code_version

SERVICE = Path(__file__).parents[1]  # the package `service`, whose code determines all answers

#: Cache-Control: the client must ask each time whether its copy is still valid, and gets 304 if it is.
REVALIDATE = "no-cache"
#: Cache-Control of answers that change rarely: answers that depend on the query and the code only, and files of a
#: successful survey, which change only when damage is repaired.
HOUR = "max-age=3600"

NOT_MODIFIED: dict[int | str, dict[str, Any]] = {
    304: {"description": "the client's copy, which If-None-Match names, is still valid"}
}


#: Headers of an answer that are kept when status 304 replaces the answer.
KEPT_BY_304 = frozenset({"etag", "cache-control", "last-modified", "expires", "vary", "content-location", "date"})


class IfNoneMatchAnyMiddleware:
    """Middleware that answers `If-None-Match: *` with 304 if the resource exists: if its answer has an ETag."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one ASGI connection."""
        if scope["type"] != "http" or Headers(scope=scope).get("if-none-match", "").strip() != "*":
            await self.app(scope, receive, send)
            return
        known = False

        async def send_304_if_tagged(message: Message) -> None:
            nonlocal known
            if known:
                return
            if message["type"] == "http.response.start" and message["status"] in (200, 206):
                headers = MutableHeaders(raw=list(message["headers"]))
                if known := "etag" in headers:
                    for name in set(headers) - KEPT_BY_304:
                        del headers[name]
                    await send({**message, "status": 304, "headers": headers.raw})
                    await send({"type": "http.response.body", "body": b""})
                    return
            await send(message)

        await self.app(scope, receive, send_304_if_tagged)


def json_answer(request: Request, document: BaseModel, modified: str | None = None) -> Response:
    """Return a document with the hash of its bytes as ETag; or status 304 if the client already has it.

    Parameters
    ----------
    modified : str | None
        Time of the last change, ISO 8601; None if the document may change more than once in a second.

    Returns
    -------
    Response
        The response, with the headers ETag and Cache-Control, and with Last-Modified if `modified` is given.
    """
    body = document.model_dump_json().encode()
    headers = {"ETag": f'"{_digest(body)}"', "Cache-Control": REVALIDATE}
    if modified is not None:
        headers["Last-Modified"] = format_datetime(datetime.fromisoformat(modified), usegmt=True)
    if is_not_modified(request, headers):
        return Response(status_code=304, headers=headers)
    return Response(body, media_type="application/json", headers=headers)


async def set_query_etag(request: Request, response: Response) -> None:
    """Set ETag and Cache-Control of an answer that depends only on the query and the code.

    Raises
    ------
    HTTPException
        304: the client's copy of the answer has this ETag.
    """
    query = str(sorted(request.query_params.multi_items()))
    headers = {"ETag": f'"{_digest(_hash_of_all_code().encode(), query.encode())}"', "Cache-Control": HOUR}
    if is_not_modified(request, headers):
        raise HTTPException(304, headers=headers)
    response.headers.update(headers)


def weak_etag(*parts: object) -> str:
    """Return a hash of `parts` and the code as an ETag. It is weak: a tile may be written during the computation."""
    return f'W/"{_digest(_hash_of_all_code().encode(), repr(parts).encode())}"'


def is_not_modified(request: Request, headers: Mapping[str, str]) -> bool:
    """Return whether the client already has the answer with these headers (ETag and perhaps Last-Modified)."""
    if (tags := request.headers.get("if-none-match")) is not None:
        return _etag_value(headers["ETag"]) in {_etag_value(tag) for tag in tags.split(",")}
    try:
        since = parsedate_to_datetime(request.headers["if-modified-since"])
        return parsedate_to_datetime(headers["Last-Modified"]) <= since
    except (KeyError, ValueError, TypeError):  # a header is missing, or its date is invalid or without a zone
        return False


def _etag_value(tag: str) -> str:
    return tag.strip().removeprefix("W/")


def _digest(*parts: bytes) -> str:
    return sha256(b"\0".join(parts)).hexdigest()[:32]


@cache
def _hash_of_all_code() -> str:
    """Return a hash of the code of the library, of surveys, and of the service."""
    sources = sorted(SERVICE.rglob("*.py"))
    return _digest(code_version().encode(), *(path.read_bytes() for path in sources))
