"""Serve the documents at /help: the site that `make docs` builds, or the Markdown as pages if there is no site."""

from __future__ import annotations

import re
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from markdown_it import MarkdownIt
from mdit_py_plugins.anchors import anchors_plugin
from mdit_py_plugins.front_matter import front_matter_plugin
from starlette.requests import Request
from starlette.responses import HTMLResponse
from starlette.routing import Mount, Route, Router
from starlette.staticfiles import StaticFiles

from gear_rattle.service.web.prefix import public_path

if TYPE_CHECKING:
    from collections.abc import Callable

    from starlette.types import ASGIApp

INDEX = "index.md"
#: Pattern of a list of pages for Sphinx (`toctree`) in a Markdown document. This module replaces the list by links.
TOCTREE = re.compile(r"^```\{toctree\}\n:hidden:\n:caption: ([^\n]*)\n(.*?)^```\n", re.MULTILINE | re.DOTALL)
PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<link rel="icon" href="data:,"><title>{title}</title><style>
:root {{ color-scheme: light dark }}
body {{ font: 16px/1.5 system-ui, sans-serif; max-width: 56rem; margin: 1rem auto 4rem; padding: 0 1rem }}
pre, table {{ overflow-x: auto; display: block }} pre {{ padding: .6rem; border: 1px solid #8888 }}
img {{ max-width: 100% }} td, th {{ border: 1px solid #8888; padding: .2rem .5rem; text-align: left }}
</style></head><body><nav><a href="{root}/help/">Help</a> · <a href="{root}/docs">REST API</a></nav>
<main>{body}</main></body></html>"""


def documents_app(site: Path, sources: Path) -> ASGIApp | None:
    """Return an application that serves the site, or else the Markdown files; None if neither exists."""
    if (site / "index.html").is_file():
        return StaticFiles(directory=site, html=True)
    return next((_markdown_app(each.resolve()) for each in (site, sources) if (each / INDEX).is_file()), None)


def _markdown_app(directory: Path) -> Router:
    """Return an application that serves the Markdown files of a directory as HTML, and all other files unchanged."""
    documents = {f"/{each.relative_to(directory).as_posix()}": each for each in directory.rglob("*.md")}

    def respond_with(document: Path) -> Callable[[Request], HTMLResponse]:
        return lambda _request: HTMLResponse(render_document(document))

    pages = [Route(path, respond_with(document)) for path, document in {"/": directory / INDEX, **documents}.items()]
    return Router([*pages, Mount("/", StaticFiles(directory=directory))])


def render_document(document: Path) -> str:
    """Convert a Markdown document to an HTML page."""
    return PAGE.format(title=escape(_title(document)), root=public_path(""), body=render_document_body(document))


def _title(document: Path) -> str:
    """Return the title of a Markdown document: its first heading."""
    return next(iter(re.findall(r"^# (.+)$", document.read_text(encoding="utf-8"), re.MULTILINE)), "gear-rattle")


def render_document_body(document: Path) -> str:
    """Convert a Markdown document to HTML for the body of a page."""

    def list_pages(tree: re.Match[str]) -> str:
        pages = {f"{name}.md": document.parent / f"{name}.md" for name in tree[2].split()}
        links = (f"- [{_title(page)}]({name})\n" for name, page in pages.items() if page.is_file())
        return f"## {tree[1]}\n\n" + "".join(links)

    text = TOCTREE.sub(list_pages, document.read_text(encoding="utf-8"))
    markdown = MarkdownIt("commonmark").enable("table").use(front_matter_plugin).use(anchors_plugin, max_level=4)
    return str(markdown.render(text))
