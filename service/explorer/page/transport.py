"""How the Bokeh application behind the page is reached: Panel has one way before Bokeh 3.10, and another since."""

from __future__ import annotations

import secrets
from typing import TYPE_CHECKING, Any, Protocol

from starlette.requests import Request
from starlette.types import Receive, Scope, Send

if TYPE_CHECKING:
    from bokeh.server.contexts import ApplicationContext

#: Of a Bokeh application. A page belongs to who opened it: nobody makes up another's. Neither headers nor cookies are
#: kept for it: they would be written into the page, the key among them. Bokeh signs by the first secret of a process.
PRIVATE: dict[str, Any] = {
    "secret_key": secrets.token_bytes(32),
    "sign_sessions": True,
    "include_headers": [],
    "include_cookies": [],
}


class Transport(Protocol):
    """A Bokeh application within ours."""

    @property
    def context(self) -> ApplicationContext:
        """Its open pages."""

    def resources(self) -> Any:
        """The scripts and styles that a page needs."""

    async def document(self, request: Request) -> str:
        """A new page as HTML, made for the caller and the colours of this context."""

    async def socket(self, scope: Scope, receive: Receive, send: Send) -> None:
        """The websocket of a page, until one side leaves; closed at once if no page of ours asks for it."""

    async def asset(self, scope: Scope, receive: Receive, send: Send) -> None:
        """A script or a style."""

    async def stop(self) -> None:
        """End what runs beside the pages."""
