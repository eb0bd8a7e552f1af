"""What a page is sent: whole messages in the order in which they were made, and no change before its document."""

import asyncio
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from bokeh.document import Document
from gear_rattle.service.explorer.page.socket import CHANGE, DOCUMENT, PageSocket
from panel.io.state import state


class Browser:
    """The far end: it takes a while over each part of a message."""

    application_state = SimpleNamespace(name="CONNECTED")

    def __init__(self) -> None:
        self.got: list[str] = []

    async def send_text(self, text: str) -> None:
        for _ in range(3 * (len(self.got) % 3)):
            await asyncio.sleep(0)
        self.got.append(text)


def message(kind: str, name: str) -> Any:
    return SimpleNamespace(
        msgtype=kind, header_json=f"{name}1", metadata_json=f"{name}2", content_json=name, _buffers=()
    )


def sent(monkeypatch: pytest.MonkeyPatch, act: Callable[[PageSocket, Callable[[str, str], Any]], None]) -> list[str]:
    """The names of the messages that arrive, whole, after these calls; the document is made by `create`."""
    document = Document()

    async def opened(socket: PageSocket, *_: object) -> None:
        protocol = SimpleNamespace(create=message)
        socket.connection = SimpleNamespace(protocol=protocol, session=SimpleNamespace(document=document))

    monkeypatch.setattr(PageSocket.__mro__[1], "_async_open", opened)

    async def run() -> list[str]:
        socket = PageSocket(SimpleNamespace(), application_context=None)
        browser = socket._socket = Browser()
        await socket._async_open(None, "")  # type: ignore[arg-type] # nobody looks at it
        assert not state._connected.get(document)
        act(socket, socket.connection.protocol.create)
        assert state._connected.get(document)
        assert socket._sender is not None
        await socket._sender
        names = browser.got[2::3]
        assert browser.got == [part for name in names for part in (f"{name}1", f"{name}2", name)]
        return names

    return asyncio.run(run())


def test_messages_are_neither_mixed_nor_exchanged(monkeypatch: pytest.MonkeyPatch) -> None:
    def act(socket: PageSocket, create: Callable[[str, str], Any]) -> None:
        for kind, name in ((DOCUMENT, "document"), (CHANGE, "a"), ("OK", "b"), (CHANGE, "c")):
            socket.send_message(create(kind, name))

    assert sent(monkeypatch, act) == ["document", "a", "b", "c"]


def test_what_waits_is_not_sent_to_who_may_no_longer_be_here() -> None:
    async def run() -> tuple[list[str], list[bool]]:
        socket = PageSocket(SimpleNamespace(), application_context=None)
        browser = socket._socket = Browser()
        left = [socket.send_message(message("OK", name)) for name in "abc"]
        left.append(socket.send_message(message(DOCUMENT, "document")))
        while not browser.got:  # the first is on its way
            await asyncio.sleep(0)
        socket.drop()
        left.append(socket.send_message(message("OK", "later")))
        await asyncio.gather(*left)
        return browser.got, [each.done() for each in left]

    got, done = asyncio.run(run())
    assert len(got) < 3
    assert all(done)


def test_a_change_is_sent_after_the_document_that_does_not_hold_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def act(socket: PageSocket, create: Callable[[str, str], Any]) -> None:
        socket.send_message(create("ACK", "hello"))
        assert socket.send_message(create(CHANGE, "in the document")).done()
        document = create(DOCUMENT, "document")
        early = socket.send_message(create(CHANGE, "not in it"))
        assert not early.done()
        socket.send_message(document)
        socket.send_message(create(CHANGE, "later"))

    assert sent(monkeypatch, act) == ["hello", "document", "not in it", "later"]
