"""The head of the page, the same for everybody: it is sent at once, and a browser runs its scripts meanwhile."""

from __future__ import annotations

import json
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any

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


def following(head: str, view: View, scheme: str) -> str:
    """The head with the script that keeps to the theme of the system, unless the view asks for one."""
    values = {"THEME": json.dumps(theme_of(view, scheme)), "ASKED": json.dumps(bool(view.theme)), "COOKIE": COOKIE}
    script = asset("theme.js")
    for name, value in values.items():
        script = script.replace(name, value)
    return head.replace("{follow}", f"<script>{script}</script>")


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
    parts |= {name: asset(f"{name}.js") for name in ("stops", "print")}
    head = asset("head.html")
    for name, text in parts.items():
        head = head.replace(f"{{{name}}}", text)
    return head


def body_of(page: str) -> str:
    """What follows the head in a page that Bokeh has written."""
    return page.partition("</head>")[2]
