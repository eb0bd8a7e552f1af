"""Serve objects of a bucket over HTTP like files, with ETag, conditional requests and single ranges (RFC 9110)."""

from __future__ import annotations

import re

from fastapi import Request, Response
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException

from gear_rattle.service.web.conditional import is_not_modified
from gear_rattle.workers import StoreInBucket

RANGE = re.compile(r"bytes=(\d*)-(\d*)")


async def object_response(store: StoreInBucket, key: str, request: Request) -> Response:
    """Return an object of a bucket, or the requested range of it, or status 304. The whole object is read into memory.

    Returns
    -------
    Response
        Status 200, 206 or 304.

    Raises
    ------
    HTTPException
        404: there is no such object. 416: the range is outside the object.
    StorageError
        The object store fails.
    """
    return await run_in_threadpool(_answer_with_object, store, key, request)


def _answer_with_object(store: StoreInBucket, key: str, request: Request) -> Response:
    try:
        body, tag = store.read_with_etag(key)
    except FileNotFoundError:
        raise HTTPException(404) from None
    headers = {"ETag": tag, "Accept-Ranges": "bytes"}
    if "if-none-match" in request.headers and is_not_modified(request, headers):
        return Response(status_code=304, headers=headers)
    asked = request.headers.get("range", "")
    if match := RANGE.fullmatch(asked.strip()) if request.headers.get("if-range", tag) == tag else None:
        start, stop = _parse_byte_range(match, len(body))
        headers["Content-Range"] = f"bytes {start}-{stop - 1}/{len(body)}"
        return Response(body[start:stop], status_code=206, headers=headers, media_type="application/octet-stream")
    return Response(body, headers=headers, media_type="application/octet-stream")


def _parse_byte_range(match: re.Match[str], size: int) -> tuple[int, int]:
    first, last = match.groups()
    if first:
        start, stop = int(first), min(int(last) + 1, size) if last else size
    else:
        start, stop = max(size - int(last or 0), 0), size
    if start >= stop:
        raise HTTPException(416, headers={"Content-Range": f"bytes */{size}"})
    return start, stop
