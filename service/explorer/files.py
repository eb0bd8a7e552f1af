"""The scripts, styles and template of the page, and its help, each read once."""

import re
from functools import cache
from pathlib import Path

from gear_rattle.service.web.documents import render_document_body

ASSETS = Path(__file__).parent / "assets"
TOUR = Path(__file__).parents[1] / "documents" / "tour.md"


@cache
def read_asset(name: str) -> str:
    """Return the text of a file in the folder `assets`, such as "page.css"."""
    return (ASSETS / name).read_text()


@cache
def help_html() -> str:
    """Return the help of the page as HTML."""
    return render_document_body(TOUR)


@cache
def help_table_rows(heading: str) -> dict[str, str]:
    """Return the table below a heading of the help: {first cell of a row: second cell}, without the table's head."""
    section = TOUR.read_text(encoding="utf-8").partition(f"## {heading}\n")[2].partition("\n## ")[0]
    _head, *rows = re.findall(r"^\| (.+?) \| (.+?) \|$", section, re.MULTILINE)
    return dict(rows)
