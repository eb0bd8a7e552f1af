"""What commands do with names and paths that people choose."""

from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from service.cli import app
from service.client import Client
from service.commands.drawing import require_writable
from service.errors import ServiceError

NAME = "[/x] [red]hi"


def test_a_name_is_shown_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    document = {"cells_done": 1, "cells": 4, "progress": 25, "created": "2026-11-21T00:00:00+00:00", "name": NAME}
    job = SimpleNamespace(id="abc", state="running", document=document)
    monkeypatch.setattr(Client, "surveys", lambda _: iter([job]))
    result = CliRunner().invoke(app, ["list"])
    assert result.exit_code == 0
    assert NAME in result.output


@pytest.mark.parametrize("name", ["picture", "picture.xyz", "missing/picture.png"])
def test_a_picture_that_cannot_be_written_is_refused_before_the_survey(name: str, tmp_path: Path) -> None:
    with pytest.raises(ServiceError, match="picture"):
        require_writable(tmp_path / name)
    require_writable(tmp_path / "picture.png")
