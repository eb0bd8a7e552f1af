"""Write the first document that a browser gets, the same for all viewers. Its scripts request the page."""

from __future__ import annotations

from contextvars import ContextVar
from typing import TYPE_CHECKING, Any

from gear_rattle.service.explorer.common.address import THEMES, View
from gear_rattle.service.explorer.files import read_asset

if TYPE_CHECKING:
    from gear_rattle.service.explorer.page.pages import PageApplication

UNUSED_SCRIPTS = ("bokeh-gl",)  # scripts of Bokeh that are left out, because no figure of the page uses WebGL
#: Styles that parts of the page load late, when a browser draws them; the head lets the browser fetch them early.
STYLES = ("css/loading", "css/listpanel", "bundled/theme/native", "css/button", "css/select")


#: Colour scheme of the viewer's system: "light", "dark" or "" (unknown). The route of a page sets it for each request.
SCHEME: ContextVar[str] = ContextVar("scheme", default="light")


def theme_of(view: View, scheme: str) -> str:
    """Return the theme of a view; if it has none, the colour scheme of the viewer's system, else "light"."""
    return view.theme or (scheme if scheme in THEMES else THEMES[0])


def head_html(pages: PageApplication) -> str:
    """Return the HTML that a browser receives first: styles, and scripts, one of which requests the page."""
    from panel.io.resources import JS_VERSION, bundle_resources

    resources: Any = pages.resources()
    resources.components = [name for name in resources.components if name not in UNUSED_SCRIPTS]
    scripts, styles = bundle_resources([], resources)
    early = "\n".join(
        f'<link rel="prefetch" as="style" href="static/extensions/panel/{name}.css?v={JS_VERSION}">' for name in STYLES
    )
    parts = {"styles": styles, "scripts": f"{scripts}\n{early}", "css": read_asset("page.css")}
    parts |= {name: read_asset(f"{name}.js") for name in ("theme", "stops", "print", "lost", "sheets", "open")}
    head = read_asset("head.html")
    for name, text in parts.items():
        head = head.replace(f"{{{name}}}", text)
    return head


def html_after_head(page: str) -> str:
    """Return the part of an HTML page that follows its head. page: a page that Bokeh has written."""
    return page.partition("</head>")[2]
