"""The documents at /help, where they are installed."""

from pathlib import Path

import pytest
from service_support import front_end

import service.app


def test_documents_are_shown_where_they_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service.app, "DOCUMENTS", tmp_path / "help")
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
