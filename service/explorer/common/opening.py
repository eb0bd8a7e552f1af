"""A page is made in steps, between which the event loop answers others."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

from bokeh.application.handlers import Handler
from bokeh.document import Document
from panel.io.application import build_applications
from panel.io.state import set_curdoc, state

if TYPE_CHECKING:
    from bokeh.application.application import SessionContext


class Opening(Handler):
    """Makes the parts of a page when Bokeh asks whether a session may begin, which it waits for; a document it has to
    have at once.
    """

    def __init__(self, open_page: Callable[[], Any]) -> None:
        super().__init__()
        self._open_page = open_page
        self._made: WeakKeyDictionary[Document, Any] = WeakKeyDictionary()

    async def on_session_created(self, session_context: SessionContext) -> None:
        """Make the parts, and let others have their turn."""
        document: Document = session_context._document  # type: ignore[attr-defined]  # as Panel does
        with set_curdoc(document):
            self._made[document] = self._open_page()
        await asyncio.sleep(0)

    def modify_document(self, doc: Document) -> None:
        """Put nothing into a document: another handler does."""

    def page(self) -> Any:
        """What was made for the document at hand. Raises why it could not be made."""
        document = state.curdoc
        made = self._made.pop(document, None) if document is not None else None
        return self._open_page() if made is None else made


def applications_of(open_page: Callable[[], Any], title: str) -> dict[str, Any]:
    """The application that opens pages, by its place; `open_page` is called in the event loop."""
    opening = Opening(open_page)
    applications: dict[str, Any] = build_applications({"/": opening.page}, title=title)
    applications["/"].add(opening)
    return applications
