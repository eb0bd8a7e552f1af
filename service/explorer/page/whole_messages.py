"""Work around three defects of bokeh_fastapi, by which Panel serves websockets on Python 3.11.

First, bokeh_fastapi sends a message in parts, and may send another message between two parts if a part has to wait.
Second, it goes on when a browser has left, unless `receive` raises an exception. Third, it may raise any exception if
this service did not issue the token of a request.
"""

from __future__ import annotations

import asyncio
import logging
from contextlib import suppress

from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketDisconnect

log = logging.getLogger(__name__)


async def serve_socket(app: ASGIApp, scope: Scope, receive: Receive, send: Send) -> None:
    """Serve a websocket with `app` until one side leaves. Messages are queued: `app` never waits for the browser."""
    outbox: asyncio.Queue[Message] = asyncio.Queue()
    left: list[Message] = []
    is_told = False

    async def enqueue(message: Message) -> None:
        if not left:
            outbox.put_nowait(message)

    async def deliver() -> None:
        while True:
            message = await outbox.get()
            try:
                await send(message)
            except Exception as error:  # for example, the browser has left
                log.debug("a message to a page is lost: %s", error)
            outbox.task_done()

    async def receive_until_disconnect() -> Message:
        nonlocal is_told
        if not left:
            message = await receive()
            if message["type"] != "websocket.disconnect":
                return message
            left.append(message)
            # When `receive` raises, `app` handles the last message again. This empty message makes that harmless.
            return {"type": "websocket.receive"}
        if is_told:
            raise RuntimeError("the browser has left")
        is_told = True
        raise WebSocketDisconnect(left[0].get("code", 1005))

    sender = asyncio.create_task(deliver())
    try:
        await app(scope, receive_until_disconnect, enqueue)
        if not left:
            await outbox.join()
    except Exception as error:
        log.info("a page was refused: %s", error)
        with suppress(RuntimeError):
            await send({"type": "websocket.close", "code": 1008})
    finally:
        sender.cancel()  # queued messages are not sent: this task may end because the caller lost its rights
