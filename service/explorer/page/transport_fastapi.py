"""Pages by bokeh_fastapi, which Panel builds on up to its version 1.9."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from bokeh_fastapi import BokehFastAPI
from fastapi import FastAPI, WebSocket
from panel.io.fastapi import DocHandler
from starlette.requests import Request
from starlette.types import Receive, Scope, Send

from gear_rattle.service.explorer.common.opening import applications_of
from gear_rattle.service.explorer.page.socket import PageSocket
from gear_rattle.service.explorer.page.transport import PRIVATE

if TYPE_CHECKING:
    from bokeh.server.contexts import ApplicationContext

log = logging.getLogger(__name__)


class _PageHandler(DocHandler):
    """Lets others have their turn before it writes a page down."""

    async def get_session(self, request: Request, session_id: Any) -> Any:
        session = await super().get_session(request, session_id)
        await asyncio.sleep(0)
        return session


class FastapiTransport:
    """See `gear_rattle.service.explorer.page.transport.Transport`."""

    def __init__(self, open_page: Callable[[], Any], title: str) -> None:
        self._bokeh: Any = BokehFastAPI(
            applications_of(open_page, title),
            app=FastAPI(openapi_url=None),
            **PRIVATE,
        )

    @property
    def context(self) -> ApplicationContext:
        found: ApplicationContext = self._bokeh._applications["/"]
        return found

    def resources(self) -> Any:
        return self._bokeh.resources()

    async def document(self, request: Request) -> str:
        page = await _PageHandler(self._bokeh, application_context=self.context).get(request)
        return bytes(page.body).decode()

    async def socket(self, scope: Scope, receive: Receive, send: Send) -> None:
        websocket = WebSocket(scope, receive, send)
        handler: Any = PageSocket(self._bokeh, application_context=self.context)
        try:
            await handler.ws_connect(websocket)
        except Exception as error:  # bokeh_fastapi raises anything at a token that is not one of ours
            log.info("a page was refused: %s", error)
            with suppress(RuntimeError):
                await websocket.close(1008)
        finally:
            handler.drop()
            # bokeh_fastapi does not notice when a browser leaves: its page would be kept for ever
            if handler.connection is not None:
                self._bokeh.client_lost(handler.connection)

    async def asset(self, scope: Scope, receive: Receive, send: Send) -> None:
        app = self._bokeh.app
        await app({**scope, "app": app, "router": app.router}, receive, send)

    async def stop(self) -> None:
        """Nothing runs."""
