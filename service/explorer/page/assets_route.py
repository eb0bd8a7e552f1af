"""Serve the scripts and styles of Bokeh and Panel from the installed packages."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import Message, Receive, Scope, Send

from gear_rattle.service.web.prefix import path_without_prefix

if TYPE_CHECKING:
    from gear_rattle.service.explorer.page.pages import PageApplication

CACHE_FOREVER = "private, max-age=31536000, immutable"  # Cache-Control of an address with a version
MOST_KEPT = 16 << 20  # most bytes of responses in memory


class AssetsApplication:
    """ASGI app that serves scripts and styles, from memory where possible: a page waits until it has all its files."""

    def __init__(self, load: Callable[[], Awaitable[PageApplication]]) -> None:
        self._load = load
        self._kept: dict[tuple[str, bytes], list[Message]] = {}
        self._size = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one ASGI connection."""
        key = (path_without_prefix(scope), scope["query_string"])
        headers = Headers(scope=scope)
        whole = scope["method"] == "GET" and "range" not in headers and "if-none-match" not in headers
        if whole and key in self._kept:
            for message in self._kept[key]:
                await send(dict(message))
            return
        pages = await self._load()
        sent: list[Message] = []

        async def keep(message: Message) -> None:
            if message["type"] == "http.response.start" and message["status"] == 200 and b"v=" in key[1]:
                MutableHeaders(scope=message)["Cache-Control"] = CACHE_FOREVER
            sent.append(message)
            await send(message)

        await pages(scope, receive, keep)
        body = b"".join(message.get("body", b"") for message in sent[1:])
        if whole and sent[0]["status"] == 200 and self._size + len(body) < MOST_KEPT:
            self._size += len(body)
            self._kept[key] = [sent[0], {"type": "http.response.body", "body": body}]
