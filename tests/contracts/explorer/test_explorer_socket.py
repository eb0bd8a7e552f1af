"""What a page is sent: whole messages in their order, and no change while it takes its document."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest
from bokeh.document import Document
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketDisconnect

from gear_rattle.service.explorer.common import changes
from gear_rattle.service.explorer.page.whole_messages import serve_socket

TURNS = 20  # of the event loop


class Browser:
    """The far end: it takes a while over each part of a message."""

    def __init__(self) -> None:
        self.got: list[str] = []

    async def send(self, message: Message) -> None:
        for _ in range(3 * (len(self.got) % 3)):
            await asyncio.sleep(0)
        self.got.append(message.get("text", message["type"]))


async def parts(send: Send, name: str) -> None:
    for number in (1, 2, 3):
        await send({"type": "websocket.send", "text": f"{name}{number}"})


def serve(app: ASGIApp, browser: Browser, *received: Message) -> Any:
    """Serve a websocket from which these messages come, and none after them."""
    coming = list(received)

    async def receive() -> Message:
        if not coming:
            await asyncio.Event().wait()
        return coming.pop(0)

    return serve_socket(app, {"type": "websocket"}, receive, browser.send)


def test_messages_are_neither_mixed_nor_exchanged() -> None:
    async def app(_scope: Scope, _receive: Receive, send: Send) -> None:
        await asyncio.gather(*(parts(send, name) for name in "abc"))

    browser = Browser()
    asyncio.run(serve(app, browser))
    assert browser.got == [f"{name}{number}" for name in "abc" for number in (1, 2, 3)]


def test_what_waits_is_not_sent_to_who_may_no_longer_be_here() -> None:
    async def app(_scope: Scope, _receive: Receive, send: Send) -> None:
        try:
            await parts(send, "a")
            await asyncio.Event().wait()
        finally:
            await parts(send, "b")

    async def run() -> list[str]:
        browser = Browser()
        serving = asyncio.create_task(serve(app, browser))
        while not browser.got:
            await asyncio.sleep(0)
        serving.cancel()
        await asyncio.wait([serving])
        for _ in range(TURNS):
            await asyncio.sleep(0)
        return browser.got

    assert len(asyncio.run(run())) < 3


def test_a_browser_that_leaves_is_counted_out_once_and_its_last_message_is_not_handled_again() -> None:
    """As bokeh_fastapi reads: it handles a message that is there, and goes on after `WebSocketDisconnect`."""
    handled: list[str] = []
    lost: list[int] = []

    async def app(_scope: Scope, receive: Receive, _send: Send) -> None:
        message: Message = {}
        while len(lost) < 2:
            try:
                message = await receive()
            except WebSocketDisconnect as left:
                lost.append(left.code)
            except RuntimeError:
                return
            if "text" in message:
                handled.append(message["text"])

    text = {"type": "websocket.receive", "text": "a change"}
    asyncio.run(serve(app, Browser(), text, {"type": "websocket.disconnect", "code": 1006}))
    assert handled == ["a change"]
    assert lost == [1006]


def test_a_token_that_is_refused_by_an_exception_closes_the_websocket() -> None:
    async def app(_scope: Scope, _receive: Receive, _send: Send) -> None:
        raise LookupError("no token of ours")

    browser = Browser()
    asyncio.run(serve(app, browser))
    assert browser.got == ["websocket.close"]


def test_changes_wait_while_a_browser_takes_its_document(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those made before are in the document; those made meanwhile follow it in their order."""
    document, made = Document(), list[str]()
    ticks: list[Callable[[], Any]] = []
    on_load: list[Callable[[], object]] = []
    monkeypatch.setattr(document, "add_next_tick_callback", ticks.append)
    monkeypatch.setattr("panel.state.onload", on_load.append)

    async def tick() -> None:
        while ticks:
            await ticks.pop(0)()

    async def run() -> None:
        changes.change_document(document, lambda: made.append("before"))
        await tick()
        assert made == ["before"]
        changes.change_document(document, lambda: made.append("asked for before"))
        changes.delay_changes_until_loaded(document)
        changes.change_document(document, lambda: made.append("meanwhile"))
        await tick()
        assert made == ["before"]
        await asyncio.to_thread(on_load[0])
        await asyncio.sleep(0)
        changes.change_document(document, lambda: made.append("after"))
        await tick()

    asyncio.run(run())
    assert made == ["before", "asked for before", "meanwhile", "after"]


def test_a_change_that_fails_is_logged_and_others_go_on(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    document, made = Document(), list[str]()
    ticks: list[Callable[[], Any]] = []
    monkeypatch.setattr(document, "add_next_tick_callback", ticks.append)

    async def run() -> None:
        changes.change_document(document, lambda: 1 // 0)
        waiting = asyncio.create_task(changes.change_and_wait(document, lambda: 1 // 0))
        changes.change_document(document, lambda: made.append("another"))
        await asyncio.sleep(0)
        for act in ticks:
            await act()
        with pytest.raises(ZeroDivisionError):
            await waiting

    asyncio.run(run())
    assert made == ["another"]
    assert document.callbacks.hold_value is None
    assert "could not be changed" in caplog.text
