"""A survey of a few seconds is computed in the process of the command: the same bits, and as easily stopped."""

import os
import signal
import subprocess
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from depth import deep
from service_processes import assert_bit_identical, finish, serial_run, start
from typer.testing import CliRunner
from waiting import HANG, wait_until

import gear_rattle.workers.in_process
from gear_rattle.service.cli import app
from gear_rattle.workers import (
    SurveyError,
    SurveyRequest,
    create_store,
    finish_store,
    run_tiles_in_this_process,
    takes_few_seconds,
    tiles_done,
    tiles_of,
)

pytestmark = pytest.mark.usefixtures("templates_once")

FIELDS: dict[str, Any] = {
    "delta": {"start": 0.45, "stop": 0.9, "num": 4},
    "epsilon": {"start": 0.02, "stop": 0.25, "num": 4},
    "initial_conditions": {"count": 8},
    "tile": {"delta": 2, "epsilon": 2},
}
REQUEST = SurveyRequest(**FIELDS)
OPTIONS = ["--delta", "0.45:0.9:4", "--epsilon", "0.02:0.25:4", "--count", "8", "--tile", "2x2"]


def never() -> bool:
    return False


def test_a_small_survey_starts_no_other_process_and_holds_the_same_bits(tmp_path: Path) -> None:
    out = tmp_path / "survey.zarr"
    ran = CliRunner().invoke(app, ["run", *OPTIONS, "--out", str(out)])
    assert ran.exit_code == 0, ran.stderr
    assert "16 cells, 0 failed" in ran.stdout
    assert "Starting" not in ran.stderr
    with xr.open_zarr(out) as survey:
        assert_bit_identical(survey, serial_run(REQUEST))


@deep
def test_who_asks_for_processes_gets_them(tmp_path: Path) -> None:
    out = tmp_path / "survey.zarr"
    ran = finish("run", *OPTIONS, "--workers", "1", "--out", str(out))
    assert ran.returncode == 0, ran.stderr
    assert "Starting 1 process …" in ran.stderr
    with xr.open_zarr(out) as survey:
        assert_bit_identical(survey, serial_run(REQUEST))


def test_what_is_short_is_known_from_the_request_alone() -> None:
    def asked(**fields: Any) -> SurveyRequest:
        return SurveyRequest(**FIELDS | {"initial_conditions": {"count": 64}} | fields)

    assert takes_few_seconds(asked(), 42)
    assert not takes_few_seconds(asked(), 61 * 60)  # the README's
    assert not takes_few_seconds(asked(initial_conditions={"count": 4096}), 100)
    assert takes_few_seconds(asked(quantities=["region", "orbits"]), 10_000)
    assert not takes_few_seconds(asked(quantities=["region", "basins"]), 100)
    assert not takes_few_seconds(asked(model="stiff", kappa=1e4), 100)
    assert not takes_few_seconds(asked(delta={"start": 0.001, "stop": 0.9, "num": 4}), 100)


def test_a_stop_keeps_the_finished_tiles_and_leaves_the_one_at_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second tile never ends; what it would write after the stop is not written."""
    out, stop, release = tmp_path / "survey.zarr", threading.Event(), threading.Event()
    compute, written = gear_rattle.workers.in_process.compute_tile, []

    def held(request: SurveyRequest, tile: Any) -> Any:
        if tile.index == 1:
            stop.set()
            assert release.wait(HANG)
        return compute(request, tile)

    monkeypatch.setattr(gear_rattle.workers.in_process, "compute_tile", held)
    create_store(REQUEST, out)
    run_tiles_in_this_process(REQUEST, out, tiles_of(REQUEST), written.append, stop.is_set)
    assert [record.index for record in written] == [0]
    release.set()
    wait_until(lambda: not any(thread.name == "tiles" for thread in threading.enumerate()))
    assert tiles_done(REQUEST, out) == {0}
    run_tiles_in_this_process(REQUEST, out, tiles_of(REQUEST)[1:], written.append, never)
    finish_store(out)
    with xr.open_zarr(out) as survey:
        assert_bit_identical(survey, serial_run(REQUEST))


def test_a_tile_that_fails_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise RuntimeError("a fault")

    monkeypatch.setattr(gear_rattle.workers.in_process, "compute_tile", fails)
    create_store(REQUEST, tmp_path / "survey.zarr")
    with pytest.raises(SurveyError, match=r"tile 0 \(delta 0\.45 to .*RuntimeError: a fault"):
        run_tiles_in_this_process(REQUEST, tmp_path / "survey.zarr", tiles_of(REQUEST), lambda _: None, never)


def test_a_signal_ends_a_short_survey_which_the_same_command_resumes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The signal comes during the second tile, which ends long after the command."""
    out, release = tmp_path / "survey.zarr", threading.Event()
    compute = gear_rattle.workers.in_process.compute_tile

    def signalled(request: SurveyRequest, tile: Any) -> Any:
        if tile.index == 1:
            os.kill(os.getpid(), signal.SIGTERM)
            assert release.wait(HANG)
        return compute(request, tile)

    with monkeypatch.context() as patch:
        patch.setattr(gear_rattle.workers.in_process, "compute_tile", signalled)
        stopped = CliRunner().invoke(app, ["run", *OPTIONS, "--out", str(out)])
        release.set()
        wait_until(lambda: not any(thread.name == "tiles" for thread in threading.enumerate()))
    assert stopped.exit_code == 130, stopped.output
    assert "same command resumes it" in stopped.stderr
    assert tiles_done(REQUEST, out) == {0}
    assert CliRunner().invoke(app, ["run", *OPTIONS, "--out", str(out)]).exit_code == 0
    with xr.open_zarr(out) as survey:
        assert_bit_identical(survey, serial_run(REQUEST))


@deep
def test_a_signal_ends_a_short_survey_whose_kernels_are_compiled(tmp_path: Path) -> None:
    """The cache is empty, so kernels are compiled. (test_service_commands ends a command while its thread compiles.)"""
    out, cache = tmp_path / "survey.zarr", tmp_path / "cache"
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    run = start("run", *OPTIONS, "--out", str(out), settings={"RATTLE_CACHE_DIR": str(cache)}, **pipes)
    assert run.stderr is not None
    assert any("Compiling kernels, once on this machine" in line for line in run.stderr)
    os.kill(run.pid, signal.SIGTERM)
    _, said = run.communicate(timeout=HANG)
    assert run.returncode == 130, said
    assert "same command resumes it" in said
    assert CliRunner().invoke(app, ["run", *OPTIONS, "--out", str(out)]).exit_code == 0
    with xr.open_zarr(out) as survey:
        assert np.array_equal(survey.region.values, serial_run(REQUEST)["region"])


def test_help_says_when_no_other_process_is_started() -> None:
    said = CliRunner().invoke(app, ["run", "--help"], env={"COLUMNS": "200"}).stdout
    assert "this process only for a few seconds of work" in said
