"""The documents at /help, where they are installed."""

import re
import shutil
from pathlib import Path
from urllib.parse import urljoin, urlsplit

import pytest
from service_support import front_end

import gear_rattle.service.app
from gear_rattle.service.explorer.files import help_html
from gear_rattle.service.explorer.map.controls import FEATURED
from gear_rattle.service.explorer.map.overlays import LABELS
from gear_rattle.workers.pictures.look import LINES, POINTS
from rattle.orbits.orbits_a_to_d import PAPER_REGIONS
from rattle.plot import MARKERS


def test_documents_are_shown_where_they_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gear_rattle.service.app, "DOCUMENTS", tmp_path / "help")
    monkeypatch.setattr(gear_rattle.service.app, "SOURCES", tmp_path / "docs")
    with front_end(tmp_path / "one") as client:
        assert client.get("/help/").status_code == 404
    (tmp_path / "help" / "tutorials").mkdir(parents=True)
    (tmp_path / "help" / "index.html").write_text("<h1>gear-rattle</h1>")
    (tmp_path / "help" / "tutorials" / "first.html").write_text("<h1>A first survey</h1>")
    (tmp_path / "secret").write_text("no page")
    with front_end(tmp_path / "two") as client:
        page = client.get("/help/tutorials/first.html")
        assert (page.status_code, page.text) == (200, "<h1>A first survey</h1>")
        assert page.headers["x-content-type-options"] == "nosniff"
        assert "gear-rattle" in client.get("/help").text
        assert client.get("/help/%2e%2e/secret").status_code == 404
        assert client.get("/help/nowhere").status_code == 404
        assert "/help" not in client.get("/openapi.json").text


@pytest.mark.parametrize("where", ["DOCUMENTS", "SOURCES"])
def test_documents_are_pages_before_a_site_is_built(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    monkeypatch.setattr(gear_rattle.service.app, "DOCUMENTS", tmp_path / "help")
    if where == "DOCUMENTS":  # as a wheel has them
        shutil.copytree(
            gear_rattle.service.app.SOURCES, tmp_path / "help", ignore=shutil.ignore_patterns("site", "generated")
        )
        monkeypatch.setattr(gear_rattle.service.app, "SOURCES", tmp_path / "docs")
    with front_end(tmp_path / "data") as client:
        todo, asked, seen = ["/help/"], {"/help/"}, dict[str, str]()
        while todo:  # every page that is linked, and every picture
            answer = client.get(todo.pop())
            assert answer.status_code == 200, answer.url
            here = str(answer.url)
            seen[here.partition("/help/")[2]] = answer.text if "html" in answer.headers["content-type"] else ""
            assert "default-src 'self'" in answer.headers["content-security-policy"]
            links = re.findall(r'(?:href|src)="([^"#]+)', seen[here.partition("/help/")[2]])
            paths = {urlsplit(urljoin(here, link)).path for link in links if not link.startswith("https:")}
            todo += [path for path in paths if path.startswith("/help/") and path not in asked]
            asked |= paths
        assert {"", "explorer.md", "how-to/surveys.md", "images/survey.png", "decisions/README.md"} <= set(seen)
        assert "<h1" in seen["explorer.md"]
        assert "<table>" in seen["how-to/surveys.md"]
        assert "toctree" not in seen[""]
        for page, title in {"explorer.md": "The explorer", "tutorials/first-survey.md": "A first survey"}.items():
            assert f'<li><a href="{page}">{title}</a></li>' in seen[""]
        assert 'id="slots"' in seen["families.md"]  # links lead to headings
        assert client.get("/help/../service/app.py").status_code == 404
        assert client.get("/help/%2e%2e/service/app.py").status_code == 404
        assert client.get("/help/nowhere.md").status_code == 404


def test_the_help_of_the_page_names_every_map_line_region_and_point() -> None:
    named = set(re.findall(r"<td>(.*?)</td>", help_html()))
    assert named >= {each.button for each in FEATURED}
    assert named >= {LABELS.get(line, line) for line in LINES if line != POINTS}
    assert named >= {*PAPER_REGIONS, *MARKERS}
