"""Pages by Panel's own ASGI application, from its version 1.10 and Bokeh 3.10 on, which need Python 3.12.

These lock the websocket for a whole message, write changes down only as they leave, and answer for the document before
anything else may change it: what `socket` does for their predecessors.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from urllib.parse import parse_qsl, urlencode

from bokeh.server import session
from bokeh.server.views.static_handler import StaticHandler
from panel.io.asgi import PanelASGI
from starlette.requests import Request
from starlette.types import Message, Receive, Scope, Send

from gear_rattle.service.explorer.common.opening import applications_of
from gear_rattle.service.explorer.page.transport import PRIVATE

#: Arguments by which a request would get the page of another one.
NAMING = (b"bokeh-session-id", b"bokeh-token")


async def _in_the_event_loop(work: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
    return work(*arguments, **named)


def _replace(owner: Any, name: str, by: Callable[..., Any]) -> None:
    if not hasattr(owner, name):
        raise RuntimeError(f"this version of Bokeh has no {name}: its callbacks would run in threads")
    setattr(owner, name, by)


def _without_session(scope: Scope) -> Scope:
    """A request for a page of its own, whichever page it names."""
    query = [pair for pair in parse_qsl(scope["query_string"], keep_blank_values=True) if pair[0] not in NAMING]
    headers = [pair for pair in scope["headers"] if pair[0].lower() != b"bokeh-session-id"]
    return {**scope, "query_string": urlencode(query).encode(), "headers": headers}


class AsgiTransport:
    """See `gear_rattle.service.explorer.page.transport.Transport`."""

    def __init__(self, open_page: Callable[[], Any], title: str) -> None:
        self._panel: Any = PanelASGI(
            applications_of(open_page, title),
            index_enabled=False,
            ico_path="none",
            extra_websocket_origins=["*"],  # who may ask at all has been decided before
            **PRIVATE,
        )
        # Bokeh calls what is not a coroutine in threads, and can be told otherwise in this way only. Pages are of the
        # event loop: they share surveys and tasks with each other, and leave to threads whatever takes its time.
        _replace(self.context, "_can_initialize_document_in_worker", lambda: False)
        _replace(session, "_run_in_executor", _in_the_event_loop)

    @property
    def context(self) -> Any:
        return self._panel.core.applications["/"]

    def resources(self) -> Any:
        found = self._panel.core.resources()
        found.path_versioner = StaticHandler.append_version  # so that browsers may keep them
        return found

    async def document(self, request: Request) -> str:
        body = b""

        async def keep(message: Message) -> None:
            nonlocal body
            body += message.get("body", b"")

        await self._panel(_without_session(request.scope), request.receive, keep)
        return body.decode()

    async def socket(self, scope: Scope, receive: Receive, send: Send) -> None:
        await self._panel(scope, receive, send)

    async def asset(self, scope: Scope, receive: Receive, send: Send) -> None:
        await self._panel(scope, receive, send)

    async def stop(self) -> None:
        await self._panel.core.stop()
