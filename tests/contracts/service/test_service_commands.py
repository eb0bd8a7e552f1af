"""Commands with names and paths that people choose."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import zarr
from typer.testing import CliRunner
from waiting import HANG

from gear_rattle.service.cli import app
from gear_rattle.service.client import Client
from gear_rattle.service.commands import letters
from gear_rattle.service.commands import run as run_command
from gear_rattle.service.commands.drawing import require_writable
from gear_rattle.service.commands.survey_options import DEFAULTS, OPTIONS, SURVEYED_MACHINE, request_from_options
from gear_rattle.service.errors import ServiceError
from gear_rattle.service.settings import Settings
from gear_rattle.workers.bound import ROUNDS
from gear_rattle.workers.errors import SurveyError
from gear_rattle.workers.storage.location import place_of
from gear_rattle.workers.survey.request import InitialConditions, SurveyRequest

NAME = "[/x] [red]hi"


def test_a_name_is_shown_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    document = {"cells_done": 1, "cells": 4, "progress": 25, "created": "2026-11-21T00:00:00+00:00", "name": NAME}
    job = SimpleNamespace(id="abc", state="running", document=document)
    monkeypatch.setattr(Client, "surveys", lambda _: iter([job]))
    result = CliRunner().invoke(app, ["list"])
    assert result.exit_code == 0
    assert NAME in result.output


@pytest.mark.parametrize("name", ["picture", "picture.xyz", "picture.pgf", "missing/picture.png"])
def test_a_picture_that_cannot_be_written_is_refused_before_the_survey(name: str, tmp_path: Path) -> None:
    with pytest.raises(ServiceError, match="picture"):
        require_writable(tmp_path / name)
    require_writable(tmp_path / "picture.png")


def told(*command: str, **more: Any) -> subprocess.CompletedProcess[str]:
    """Return the output of a command for a program that reads it."""
    whole = [sys.executable, "-m", "gear_rattle.cli", *command]
    return subprocess.run(whole, stderr=subprocess.PIPE, text=True, timeout=HANG, **more)


@pytest.mark.parametrize("encoding", ["cp1252", "ascii"])
def test_letters_that_a_reader_does_not_know_are_replaced(encoding: str) -> None:
    environment = os.environ | {"PYTHONIOENCODING": encoding, "COLUMNS": "100"}
    help_of = told("run", "--help", stdout=subprocess.PIPE, env=environment, errors="replace")
    assert help_of.returncode == 0, help_of.stderr
    assert "natural" in help_of.stdout
    assert "--workers" in help_of.stdout  # and all that follows


@pytest.mark.parametrize(("encoding", "expected"), [("ascii", b"S+ S- d = 1 ? ..."), ("cp1252", b"S+ S- d = 1 ? \x85")])
def test_walls_are_told_apart_where_their_letters_are_not_known(encoding: str, expected: bytes) -> None:
    assert "Σ⁺ Σ⁻ δ = 1 你 …".encode(encoding, letters.NEAREST_LETTERS) == expected


def test_the_home_directory_is_found_where_a_shell_does_not_put_it(tmp_path: Path) -> None:
    environment = os.environ | {"HOME": str(tmp_path), "RATTLE_CACHE_DIR": str(Path.home() / ".cache" / "rattle")}
    axes = ["--delta", "0.6:0.7:2", "--epsilon", "0.05:0.1:2", "--count", "4"]
    (tmp_path / "here").mkdir()
    found = told("run", *axes, "--out=~/survey.zarr", cwd=tmp_path / "here", env=environment)
    assert found.returncode == 0, found.stderr
    assert (tmp_path / "survey.zarr" / "zarr.json").exists()
    assert not list((tmp_path / "here").iterdir())
    found = told("curves", "--beta", "0.6", "--csv=~/none/curves.csv", cwd=tmp_path / "here", env=environment)
    assert str(tmp_path / "none") in found.stderr


def test_a_store_in_the_home_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    assert str(place_of("~/survey.zarr")) == str(tmp_path / "survey.zarr")
    assert Settings(data="~/data").data == tmp_path / "data"


def test_without_the_compiler_a_command_says_so_in_a_sentence() -> None:
    found = told("orbits", "0.6", "0.1", env=os.environ | {"NUMBA_DISABLE_JIT": "1"})
    assert found.returncode == 2
    assert found.stderr.startswith("rattle: NUMBA_DISABLE_JIT is set")
    assert "Traceback" not in found.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no file that is always full")
def test_what_cannot_be_printed_is_said_in_a_sentence() -> None:
    with Path("/dev/full").open("w") as full:
        refused = told("orbits", "0.6", "0.1", stdout=full)
    assert refused.returncode == 1
    assert refused.stderr == (
        "rattle: the output cannot be written (No space left on device): free space, or write elsewhere\n"
    )


def test_no_path_resolves_where_the_working_directory_is_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    with pytest.raises(SurveyError, match="cannot be located"):
        place_of("survey.zarr")


@pytest.mark.parametrize(("share", "words"), [(1.0, "100"), (0.9961, "100"), (0.0022, "0.22"), (1.23e-7, "1.2e-05")])
def test_a_bound_is_said_to_two_digits(share: float, words: str) -> None:
    assert run_command._percent_text(share) == words


def test_a_survey_is_joined_where_it_asks_for_families(tmp_path: Path) -> None:
    store = tmp_path / "survey.zarr"
    asked = ["run", "--delta", "0.42:0.46:4", "--epsilon", "0.1:0.12:4", "--count", "4", "--out", str(store)]
    for group in ("attractors", "lyapunov", "families"):
        asked += ["--quantity", group]
    first, second = (CliRunner().invoke(app, asked) for _ in range(2))
    assert (first.exit_code, second.exit_code) == (0, 0), first.output + second.output
    assert "Joining" in first.output
    assert "is complete" in second.output
    assert "Joining" not in second.output
    found = zarr.open_consolidated(store)
    assert found["families/cells"][0] == (found["quiet_fraction"][:] > 0).sum() > 8


def test_a_refined_survey_says_what_was_filled_and_how_far_it_can_be_trusted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After further rounds, which the first audit makes needed."""
    monkeypatch.setattr("gear_rattle.workers.survey.refined.rounds.FIRST_AUDIT_FACTOR", 0.1)
    store = tmp_path / "survey.zarr"
    asked = ["run", "--delta", "0.4:1:64", "--epsilon", "0.005:0.3:64", "--quantity", "region", "--out", str(store)]
    for option in ("--audit", "--bound"):
        refused = CliRunner().invoke(app, [*asked, option, "0.1"])
        assert refused.exit_code == 2
        assert "--refine" in refused.output
    done = CliRunner().invoke(app, [*asked, "--refine", "--audit", "0.001", "--bound", "0.03"])
    assert done.exit_code == 0, done.output
    filled = int((zarr.open_array(store, path="source_level")[:] > 0).sum())
    assert f"{filled} of them filled" in done.output
    assert f"4096 cells, 0 failed; {4096 - filled} computed, {filled} filled: of " in done.output
    told = zarr.open_group(store, mode="r").attrs
    assert f"{told['refined_cells_audited']} audited ones {told['refined_cells_disagreed']} disagreed" in done.output
    assert told["refined_wrong_share_upper"] <= told["refined_bound_asked"] == 0.03
    assert 0 < filled < int((zarr.open_array(store, path="audit_leaf")[:] > 0).sum())
    assert ROUNDS in told


#: Fails, with SIGABRT, in a process whose C library is taken down in an orderly way, as a compiler at work does.
TAKEN_DOWN = """
import ctypes, sys, threading
library = ctypes.CDLL(None)
assert library.__cxa_atexit(ctypes.cast(library.abort, ctypes.c_void_p), None, None) == 0
import gear_rattle.service.cli
wait = threading.Event().wait
gear_rattle.service.cli.app.command("computes")(lambda: (threading.Thread(target=wait, daemon={daemon}).start()
    if {daemon} else None, print("told", end=""), sys.exit(130)))
sys.argv[1:] = ["computes"]
gear_rattle.service.cli.main()
"""


@pytest.mark.parametrize(("daemon", "status"), [(True, 130), (False, -signal.SIGABRT)])
def test_a_command_whose_thread_still_computes_ends_without_taking_the_compiler_down(daemon: bool, status: int) -> None:
    ended = subprocess.run(
        [sys.executable, "-c", TAKEN_DOWN.format(daemon=daemon)], capture_output=True, text=True, timeout=HANG
    )
    assert (ended.returncode, ended.stdout) == (status, "told"), ended.stderr


def test_the_options_of_a_survey_are_the_fields_of_its_request() -> None:
    options = {"count", "v_max", "budget", "quantity", "harmonic", "audit", "bound"}
    fields = (set(SurveyRequest.model_fields) | options) - {
        "initial_conditions",
        "quantities",
        "harmonics",
        "model",
        "machine",
    }
    assert set(OPTIONS) == fields | set(SURVEYED_MACHINE)
    axes = {"delta": "0.5:0.7:6", "epsilon": "0.05:0.15:4"}
    assert {"count": InitialConditions().count, "seed": SurveyRequest.model_fields["seed"].default} == DEFAULTS
    assert request_from_options(axes | DEFAULTS) == request_from_options(axes)
