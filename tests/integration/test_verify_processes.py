"""`rattle verify --processes N` says what one process says: of whole, damaged and unfinished stores."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from gear_rattle.service.cli import app
from gear_rattle.workers import (
    SurveyError,
    SurveyRequest,
    create_store,
    examine,
    finish_store,
    run_tiles_in_this_process,
    tiles_of,
)

REQUEST = SurveyRequest(
    delta=(0.5, 0.9, 7), epsilon=(0.05, 0.2, 6), quantities=("region",), tile={"delta": 2, "epsilon": 2}
)


def assert_the_same(store: Path, processes: int, status: int, said: str) -> None:
    """Several processes print the same lines as one, in the same order."""
    one = CliRunner().invoke(app, ["verify", str(store)])
    assert one.exit_code == status, one.output
    assert said in one.stdout
    several = CliRunner().invoke(app, ["verify", str(store), "--processes", str(processes)])
    assert (several.exit_code, several.stdout) == (status, one.stdout)


def test_several_processes_find_what_one_finds(tmp_path: Path) -> None:
    store, tiles = tmp_path / "survey.zarr", tiles_of(REQUEST)
    create_store(REQUEST, store)
    run_tiles_in_this_process(REQUEST, store, tiles[:2], lambda _: None, lambda: False)
    assert_the_same(store, 50, 0, "12 tiles, 2 whole, 0 damaged, 10 not computed yet")  # more processes than tiles
    run_tiles_in_this_process(REQUEST, store, tiles[2:], lambda _: None, lambda: False)
    finish_store(store)
    for column in (1, 2, 3):  # in parts of different processes
        flipped = store / f"status/c/1/{column}"
        content = flipped.read_bytes()
        flipped.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    (store / "status/c/2/0").unlink()
    assert_the_same(store, 2, 1, "12 tiles, 8 whole, 4 damaged, 0 not computed yet")
    assert list(examine(store, 2).damaged.items()) == [(each, ("status",)) for each in (5, 6, 7, 8)]


def test_an_error_of_a_process_is_the_error_of_the_command(tmp_path: Path) -> None:
    store = tmp_path / "survey.zarr"
    create_store(REQUEST, store)
    run_tiles_in_this_process(REQUEST, store, tiles_of(REQUEST)[:1], lambda _: None, lambda: False)
    unreadable = store / "status/c/0/0"
    unreadable.unlink()
    unreadable.symlink_to(unreadable)  # the system refuses to follow it
    for processes in (1, 2):
        with pytest.raises(SurveyError, match="cannot be read"):
            examine(store, processes)
