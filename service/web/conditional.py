"""Conditional requests (RFC 9110): a client does not get again what it already has."""

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

#: Clients ask again each time, and get 304 if nothing has changed.
REVALIDATE = "no-cache"
#: For answers that change rarely: those that depend on the query and the code alone, and the store of a successful
#: survey, which changes when damage is repaired.
HOUR = "max-age=3600"

NOT_MODIFIED: dict[int | str, dict[str, Any]] = {
    304: {"description": "the client's copy, by If-None-Match, is still valid"}
}


#: Headers of an answer that its 304 keeps.
OF_UNCHANGED = frozenset({"etag", "cache-control", "last-modified", "expires", "vary", "content-location", "date"})


class AnyTagMiddleware:
    """Answers `If-None-Match: *` with 304 where the answer would have an ETag, since only then the resource exists."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one ASGI connection."""
        if scope["type"] != "http" or Headers(scope=scope).get("if-none-match", "").strip() != "*":
            await self.app(scope, receive, send)
            return
        known = False

        async def send_unless_known(message: Message) -> None:
            nonlocal known
            if known:
                return
            if message["type"] == "http.response.start" and message["status"] in (200, 206):
                headers = MutableHeaders(raw=list(message["headers"]))
                if known := "etag" in headers:
                    for name in set(headers) - OF_UNCHANGED:
                        del headers[name]
                    await send({**message, "status": 304, "headers": headers.raw})
                    await send({"type": "http.response.body", "body": b""})
                    return
            await send(message)

        await self.app(scope, receive, send_unless_known)


def json_answer(request: Request, document: BaseModel, modified: str | None = None) -> Response:
    """Return a document with the hash of its bytes as ETag, or 304.

    Parameters
    ----------
    modified : str | None
        Time of the last change, ISO 8601; None if it may change more than once a second.

    Returns
    -------
    Response
        With ETag and Cache-Control, and Last-Modified if it is given.
    """
    body = document.model_dump_json().encode()
    headers = {"ETag": f'"{_digest(body)}"', "Cache-Control": REVALIDATE}
    if modified is not None:
        headers["Last-Modified"] = format_datetime(datetime.fromisoformat(modified), usegmt=True)
    if is_known(request, headers):
        return Response(status_code=304, headers=headers)
    return Response(body, media_type="application/json", headers=headers)


async def function_of_query(request: Request, response: Response) -> None:
    """Set the ETag of routes that depend on the query and the code alone, or raise HTTPException 304."""
    query = str(sorted(request.query_params.multi_items()))
    headers = {"ETag": f'"{_digest(_answer_version().encode(), query.encode())}"', "Cache-Control": HOUR}
    if is_known(request, headers):
        raise HTTPException(304, headers=headers)
    response.headers.update(headers)


def picture_tag(*parts: object) -> str:
    """Return a weak ETag: pictures with the same one show the same, except perhaps for a further tile."""
    return f'W/"{_digest(_answer_version().encode(), repr(parts).encode())}"'


def is_known(request: Request, headers: Mapping[str, str]) -> bool:
    """Return whether the client already has the representation with these headers."""
    if (tags := request.headers.get("if-none-match")) is not None:
        return _opaque(headers["ETag"]) in {_opaque(tag) for tag in tags.split(",")}
    try:
        since = parsedate_to_datetime(request.headers["if-modified-since"])
        return parsedate_to_datetime(headers["Last-Modified"]) <= since
    except (KeyError, ValueError, TypeError):  # a header is missing, or its date is invalid or without a zone
        return False


def _opaque(tag: str) -> str:
    return tag.strip().removeprefix("W/")


def _digest(*parts: bytes) -> str:
    return sha256(b"\0".join(parts)).hexdigest()[:32]


@cache
def _answer_version() -> str:
    """Return a hash of the code that computes answers, and of the code that writes them."""
    sources = sorted(Path(__file__).parent.rglob("*.py"))
    return _digest(code_version().encode(), *(path.read_bytes() for path in sources))
