"""Mount the page in the application: its routes, and the Bokeh application behind them, loaded once in a thread."""

from __future__ import annotations

import asyncio
import gc
import logging
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from typing import TYPE_CHECKING

from fastapi import FastAPI, Request, Response
from starlette.concurrency import run_in_threadpool
from starlette.responses import HTMLResponse
from starlette.routing import Route, WebSocketRoute
from starlette.types import Message, Receive, Scope, Send

from gear_rattle.service.access import login
from gear_rattle.service.access.origins import require_browser_address
from gear_rattle.service.errors import UnavailableError
from gear_rattle.service.explorer.common.news import StatusPublisher
from gear_rattle.service.explorer.page.assets_route import AssetsApplication
from gear_rattle.service.explorer.page.head import SCHEME, head_html, html_after_head
from gear_rattle.service.jobs.manager import STARTING
from gear_rattle.service.observability.logs import format_logs_of_libraries
from gear_rattle.service.operations.overlaid import Overlays
from gear_rattle.service.settings import Settings
from gear_rattle.service.state import ApplicationState
from gear_rattle.service.web.prefix import public_path

if TYPE_CHECKING:
    from gear_rattle.service.explorer.map.shared import SharedState
    from gear_rattle.service.explorer.page.pages import PageApplication

TITLE = "gear rattle"
SIGNED_OUT = "The API key was revoked, or this browser has signed out."
GONE = "This page is no longer there."
LOOK_SECONDS, ANSWER_SECONDS = 0.2, 1.0
#: The page loads nothing from other servers. It needs 'unsafe-eval' because Bokeh compiles callbacks in the browser.
CONTENT_SECURITY = "; ".join(
    (
        "default-src 'self'",
        "script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:",
        "style-src 'self' 'unsafe-inline'",
        "connect-src 'self' blob:",
        "img-src 'self' data: blob:",
        "media-src data:",  # the sounds of motions are data URLs
        "font-src 'self' data:",
        "worker-src 'self' blob:",
        "form-action 'self'",
        "base-uri 'self'",
        "frame-ancestors 'self'",
    )
)

PAGE_HEADERS = {"Content-Security-Policy": CONTENT_SECURITY, "Cache-Control": "no-store"}

log = logging.getLogger(__name__)


class Explorer:
    """The explorer of one application: its routes, and the pages that browsers have open."""

    def __init__(self, app: FastAPI, settings: Settings) -> None:
        self._settings = settings
        self._front: ApplicationState | None = None
        self.news: StatusPublisher | None = None
        self._overlaid: Overlays | None = None
        self._shared: SharedState | None = None
        self._loading: asyncio.Future[PageApplication] | None = None
        self._running = AsyncExitStack()
        self._head = ""
        self._preparation_task: asyncio.Task[None] | None = None
        self._assets, self._socket = AssetsApplication(self.load), _PageWebsocketRoute(self.load)
        app.router.routes += [
            Route("/", self._serve_first_document, methods=["GET"], include_in_schema=False),
            WebSocketRoute("/ws", self._socket),
            Route("/page", self._serve_page, methods=["GET"], include_in_schema=False),
            Route("/static/{path:path}", self._assets, methods=["GET"], include_in_schema=False),
            Route("/components/{path:path}", self._assets, methods=["GET"], include_in_schema=False),
            *login.ROUTES,
        ]

    @asynccontextmanager
    async def serve_pages(self, front: ApplicationState, overlaid: Overlays) -> AsyncIterator[None]:
        """Return the context in which the application runs: open pages get job status, and closed pages are dropped."""
        self._front, self._overlaid = front, overlaid
        self.news = StatusPublisher(front)
        async with self._running, self.news.publish_status():
            yield

    async def preload_page(self) -> None:
        """Load the packages of the page once the cluster has started; with the setting `preload` also the first map."""
        assert self._front is not None
        try:
            while self._front.manager.cluster_state == STARTING and self._loading is None:
                await asyncio.sleep(LOOK_SECONDS)
            await self.load()
            if self._front.settings.preload and self._shared is not None:
                await self._shared.compute_default_map()
        except Exception:  # `load` tries again at the next request of a page
            log.exception("the explorer cannot be loaded")

    async def load(self) -> PageApplication:
        """Return the application that serves the pages; load it at the first call, or again after a failure."""
        failed = self._loading is not None and self._loading.done() and self._loading.exception() is not None
        if self._loading is None or failed:
            self._loading = asyncio.ensure_future(self._load_pages())
        return await asyncio.shield(self._loading)

    async def _load_pages(self) -> PageApplication:
        pages = await run_in_threadpool(self._build_pages)  # in a thread, because the imports take more than a second
        await self._running.enter_async_context(pages.expire_unused_pages())
        return pages

    def _build_pages(self) -> PageApplication:
        from bokeh.settings import settings

        from gear_rattle.service.explorer.map.planes import MapCache
        from gear_rattle.service.explorer.map.shared import SharedState
        from gear_rattle.service.explorer.page.page import open_page
        from gear_rattle.service.explorer.page.pages import PageApplication
        from gear_rattle.service.explorer.places.exact import ExactMaps

        assert self._front is not None
        assert self.news is not None
        assert self._overlaid is not None
        # Bokeh's validation takes a quarter of the time to build a page, and nobody sees its warnings.
        settings.perform_document_validation.set_value(False)
        front = self._front
        shared = self._shared = SharedState(
            front, self.news, MapCache(front), self._overlaid, ExactMaps(), self._on_map_drawn
        )
        found = PageApplication(lambda: open_page(shared), TITLE)
        self._head = head_html(found)
        format_logs_of_libraries()  # the service formats the log records of Panel's handlers too
        gc.freeze()  # otherwise every full garbage collection would scan the packages just loaded, and delay answers
        return found

    def _on_map_drawn(self) -> None:
        """Start the processes that compute clicked points when the first page shows a map, if `preload` is set.

        The processes are not needed without a page. Started earlier, they would slow down the first page.
        """
        assert self._front is not None
        if self._front.settings.preload and self._preparation_task is None:
            from gear_rattle.service.explorer.point.work import prepare_processes

            self._preparation_task = asyncio.create_task(prepare_processes(self._front))

    async def _serve_first_document(self, _request: Request) -> Response:
        """Return the first document, whose scripts request the page itself.

        A page takes memory until its browser leaves. So only clients that run the scripts of this document get a page.

        Returns
        -------
        Response
            The first document; its scripts get the page from `/page`, and changes by the websocket.
        """
        await self.load()
        return HTMLResponse(self._head, headers=PAGE_HEADERS)

    async def _serve_page(self, request: Request) -> Response:
        from gear_rattle.service.explorer.common.viewer import CALLER

        require_browser_address(request.headers, public_path("/"))
        pages = await self.load()
        if len(pages.sessions()) >= self._settings.max_pages:
            raise UnavailableError("Too many pages of the explorer are open. Close some, and try again in a minute.")
        CALLER.set(request.state.caller)
        SCHEME.set(request.headers.get("rattle-theme", ""))
        # A page is built to its end even if the browser leaves meanwhile; then the page expires by itself.
        body = html_after_head(await asyncio.shield(pages.new_page_html(request)))
        return HTMLResponse(body, headers=PAGE_HEADERS)


LEFT_CODES = (1000, 1001)  # close codes of RFC 6455: a normal end, and a page that was closed or reloaded


class _PageWebsocketRoute:
    """ASGI application for the websockets of pages; it refuses a websocket whose page does not exist."""

    def __init__(self, load: Callable[[], Awaitable[PageApplication]]) -> None:
        self._load = load

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        from gear_rattle.service.explorer.common.viewer import CALLER

        pages = await self._load()
        caller = scope["state"]["caller"]
        CALLER.set(caller)
        code = 0
        session = pages.page_session_of(scope)
        if session is None:  # without this answer, Bokeh would make a page that the browser does not have
            log.info("a websocket was refused: its page does not exist, or no longer exists")
            await send({"type": "websocket.close", "code": 1008, "reason": GONE})
            return

        async def receive_and_note_close_code() -> Message:
            nonlocal code
            message = await receive()
            code = message.get("code", 0)
            return message

        with scope["app"].state.front.revocations.cancel_when_revoked(caller) as visit:
            await pages.serve_websocket(session, scope, receive_and_note_close_code, send)
            if code in LEFT_CODES:
                session.request_expiration()  # otherwise the computations of the closed page would go on
        if visit.cancelled_caught:
            with suppress(RuntimeError):  # raised if the browser has closed the websocket meanwhile
                await send({"type": "websocket.close", "code": 1008, "reason": SIGNED_OUT})
