"""The document that a browser gets at first, the same for everybody, whose scripts ask for a page."""

from __future__ import annotations

from contextvars import ContextVar
from typing import TYPE_CHECKING, Any

from gear_rattle.service.explorer.common.address import THEMES, View
from gear_rattle.service.explorer.files import asset

if TYPE_CHECKING:
    from gear_rattle.service.explorer.page.pages import Pages

UNUSED = ("bokeh-gl",)  # the page has no WebGL; Panel's own script needs all others
#: Styles that parts of the page ask for, each where it is: late.
STYLES = ("css/loading", "css/listpanel", "bundled/theme/native", "css/button", "css/select")


#: The colours that the system of who asked for a page has; set by the route.
SCHEME: ContextVar[str] = ContextVar("scheme", default="light")


def theme_of(view: View, scheme: str) -> str:
    """Return the theme that a view asks for, or else that of the system, as its browser tells it."""
    return view.theme or (scheme if scheme in THEMES else THEMES[0])


def head_of(pages: Pages) -> str:
    """Return the document that asks for a page: all its scripts and styles, the same for everybody."""
    from panel.io.resources import JS_VERSION, bundle_resources

    resources: Any = pages.resources()
    resources.components = [name for name in resources.components if name not in UNUSED]
    scripts, styles = bundle_resources([], resources)
    early = "\n".join(
        f'<link rel="prefetch" as="style" href="static/extensions/panel/{name}.css?v={JS_VERSION}">' for name in STYLES
    )
    parts = {"styles": styles, "scripts": f"{scripts}\n{early}", "css": asset("page.css")}
    parts |= {name: asset(f"{name}.js") for name in ("theme", "stops", "print", "lost", "sheets", "visuals", "open")}
    head = asset("head.html")
    for name, text in parts.items():
        head = head.replace(f"{{{name}}}", text)
    return head


def body_of(page: str) -> str:
    """Return the text after the head of a page that Bokeh has written."""
    return page.partition("</head>")[2]
