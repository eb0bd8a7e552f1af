"""Serve the pages of the explorer by an application of Panel (`panel.io.fastapi`) inside the service's application."""

from __future__ import annotations

import asyncio
import secrets
import sys
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager, suppress
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qsl, urlencode
from weakref import WeakKeyDictionary, WeakValueDictionary

from bokeh.application.handlers import Handler
from bokeh.document import Document
from bokeh.protocol.exceptions import ProtocolError
from bokeh.util.token import get_session_id
from fastapi import FastAPI
from panel.io.application import Application
from panel.io.fastapi import add_applications
from panel.io.state import set_curdoc
from starlette.requests import Request
from starlette.types import Message, Receive, Scope, Send

from gear_rattle.service.explorer.common.changes import delay_changes_until_loaded

if TYPE_CHECKING:
    import panel as pn
    from bokeh.application.application import SessionContext
    from bokeh.server.session import ServerSession

#: Seconds for which a page without a connected browser is kept, as the browser may still connect or come back;
#: seconds between two checks for such pages.
UNUSED_SECONDS, CHECK_SECONDS = 15.0, 1.0

#: The id of a page is signed, so that nobody can make up the id of another viewer's page. Headers and cookies are not
#: kept, because Bokeh would write them, with the API key, into the page. Bokeh signs with the first key that a process
#: gives it.
SETTINGS: dict[str, Any] = {
    "secret_key": secrets.token_bytes(32),
    "sign_sessions": True,
    "include_headers": [],
    "include_cookies": [],
    "websocket_origin": "*",  # the service has already checked who may connect
    "unused_session_lifetime_milliseconds": int(1e3 * UNUSED_SECONDS),
    "check_unused_sessions_milliseconds": int(1e3 * CHECK_SECONDS),
}
#: Query arguments and a header with which a request could name the page of another viewer: requests lose them.
NAMING = ("bokeh-session-id", "bokeh-token", "bokeh_session_id")


class _PageHandler(Handler):
    """A Bokeh handler that makes the parts of a page and puts them into the document of the page.

    `on_session_created` makes the parts in the event loop, and `modify_document` puts them into the document. Between
    the two steps the event loop serves other requests.
    """

    def __init__(self, open_page: Callable[[], pn.Template], title: str) -> None:
        super().__init__()
        self._open_page, self._title = open_page, title
        self._made: WeakKeyDictionary[Document, pn.Template | Exception] = WeakKeyDictionary()
        self.contexts: WeakValueDictionary[str, Any] = WeakValueDictionary()

    async def on_session_created(self, session_context: SessionContext) -> None:
        """Make the parts of a new page, and keep them, or the error, for `modify_document`."""

        async def make(document: Document) -> None:
            with set_curdoc(document):
                try:
                    self._made[document] = self._open_page()
                except Exception as error:  # raised in `modify_document`; Bokeh would only log it here
                    self._made[document] = error

        await session_context.with_locked_document(make)
        self.contexts[session_context.id] = session_context
        await asyncio.sleep(0)

    def modify_document(self, doc: Document) -> None:
        """Put the parts that `on_session_created` made into the document, or raise the error that it kept."""
        made = self._made.pop(doc)
        if isinstance(made, Exception):
            raise made
        with doc.models.freeze():  # otherwise Bokeh would collect all models anew after each part
            made.server_doc(doc, title=self._title)


class PageApplication:
    """An ASGI application that has a page at ``/``, its websocket at ``/ws``, scripts and styles.

    Parameters
    ----------
    open_page
        Makes a page for the caller and colour scheme in the context variables CALLER and SCHEME. It is called in the
        event loop.
    title
        Title of the document.
    """

    def __init__(self, open_page: Callable[[], pn.Template], title: str) -> None:
        self._handler = _PageHandler(open_page, title)
        self._app = FastAPI(openapi_url=None)
        served: dict[str, Any] = {"/": Application(self._handler)}
        self._bokeh = add_applications(served, app=self._app, **SETTINGS)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one ASGI connection."""
        await self._app(dict(scope), receive, send)

    def expire_unused_pages(self) -> AbstractAsyncContextManager[Any]:
        """Return a context in which unused pages are ended."""
        return self._app.router.lifespan_context(self._app)

    def resources(self) -> Any:
        """Return the scripts and styles of a page, with versions in their addresses, so browsers may cache them."""
        from bokeh.server.views.static_handler import StaticHandler

        found: Any = self._bokeh.resources()
        found.path_versioner = StaticHandler.append_version
        return found

    def sessions(self) -> list[ServerSession]:
        """Return the sessions of all open pages."""
        found = (context.session for context in self._handler.contexts.values())
        return [session for session in found if session is not None and not session.destroyed]

    def page_session_of(self, scope: Scope) -> ServerSession | None:
        """Return the session of the page that the token in a websocket's request names; None if it is gone."""
        with suppress(ProtocolError, LookupError, ValueError):  # raised for a text that is not a token of this service
            asked = get_session_id("".join(scope["subprotocols"][-1:]))
            return next((session for session in self.sessions() if session.id == asked), None)
        return None

    async def new_page_html(self, request: Request) -> str:
        """Return a new page as HTML."""
        body = b""

        async def keep(message: Message) -> None:
            nonlocal body
            body += message.get("body", b"")

        query = [pair for pair in parse_qsl(request.url.query, keep_blank_values=True) if pair[0] not in NAMING]
        headers = [pair for pair in request.scope["headers"] if pair[0].lower().decode("latin-1") not in NAMING]
        changed = {"path": "/", "raw_path": b"/", "query_string": urlencode(query).encode(), "headers": headers}
        await self({**request.scope, **changed}, request.receive, keep)
        return body.decode()

    async def serve_websocket(self, session: ServerSession, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve the websocket of a page until the browser or the service ends it."""
        delay_changes_until_loaded(session.document)
        if sys.version_info < (3, 12):
            from gear_rattle.service.explorer.page.whole_messages import serve_socket

            await serve_socket(self, scope, receive, send)
        else:
            await self(scope, receive, send)
