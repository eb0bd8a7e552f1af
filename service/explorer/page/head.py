"""The head of the page, the same for everybody: it is sent at once, and a browser runs its scripts meanwhile."""

from __future__ import annotations

import asyncio
import json
import secrets
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any

from starlette.requests import Request
from starlette.responses import Response

from service.explorer.common.address import THEMES, View
from service.explorer.files import asset

if TYPE_CHECKING:
    from service.explorer.page.transport import Transport

UNUSED = ("bokeh-gl",)  # the page has no WebGL; Panel's own script needs all others
#: Styles that parts of the page ask for, each where it is: late.
STYLES = ("css/loading", "css/listpanel", "bundled/theme/native", "css/button", "css/select")


COOKIE = "rattle_scheme"
#: The colours that the system of who asked for a page has; set by the route.
SCHEME: ContextVar[str] = ContextVar("scheme", default="light")


def theme_of(view: View, scheme: str) -> str:
    """The theme that a view asks for, or else that of the system as the cookie tells it."""
    return view.theme or (scheme if scheme in THEMES else THEMES[0])


class Schemes:
    """Of browsers that have no cookie yet: which colours their system has, told by the head of the page."""

    def __init__(self) -> None:
        self._waiting: dict[str, asyncio.Future[str]] = {}

    @asynccontextmanager
    async def asked(self) -> AsyncIterator[tuple[str, asyncio.Future[str]]]:
        """A word for a page that is being sent, and what its browser will answer by it."""
        page, answer = secrets.token_urlsafe(12), asyncio.get_running_loop().create_future()
        self._waiting[page] = answer
        try:
            yield page, answer
        finally:
            del self._waiting[page]

    async def route(self, request: Request) -> Response:
        """Take the answer."""
        answer = self._waiting.get(request.query_params.get("page", ""))
        scheme = request.query_params.get("scheme", "")
        if answer is not None and scheme in THEMES and not answer.done():
            answer.set_result(scheme)
        return Response(status_code=204, headers={"Cache-Control": "no-store"})


def following(head: str, view: View, scheme: str, page: str) -> str:
    """The head with the script that keeps to the theme of the system, unless the view asks for one; `page` is the word
    by which it tells that of a system that is not known.
    """
    known = theme_of(view, scheme) if is_known(view, scheme) else ""
    values = {"THEME": json.dumps(known), "ASKED": json.dumps(bool(view.theme)), "COOKIE": COOKIE, "PAGE": page}
    script = asset("theme.js")
    for name, value in values.items():
        script = script.replace(name, value)
    return head.replace("{follow}", f"<script>{script}</script>")


def is_known(view: View, scheme: str) -> bool:
    """Whether the theme of a page need not be asked for."""
    return bool(view.theme) or scheme in THEMES


def head_of(bokeh: Transport) -> str:
    """The head of every page of an application, with `{follow}` where what depends on the page goes."""
    from panel.io.resources import JS_VERSION, bundle_resources

    resources: Any = bokeh.resources()
    resources.components = [name for name in resources.components if name not in UNUSED]
    scripts, styles = bundle_resources([], resources)
    early = "\n".join(
        f'<link rel="preload" as="style" href="static/extensions/panel/{name}.css?v={JS_VERSION}">' for name in STYLES
    )
    parts = {"styles": styles, "scripts": f"{scripts}\n{early}", "css": asset("page.css")}
    parts |= {name: asset(f"{name}.js") for name in ("stops", "print", "lost", "visuals")}
    head = asset("head.html")
    for name, text in parts.items():
        head = head.replace(f"{{{name}}}", text)
    return head


def body_of(page: str) -> str:
    """What follows the head in a page that Bokeh has written."""
    return page.partition("</head>")[2]
