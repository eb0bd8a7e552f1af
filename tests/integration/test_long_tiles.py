"""A kill, a freeze and a change of the clock in the middle of tiles that take seconds do not change the results."""

import os
import signal
import subprocess
from collections import Counter
from contextlib import suppress
from pathlib import Path

import numpy as np
import psutil
import pytest
from depth import deep
from faults import Faults
from service_processes import assert_bit_identical, start
from waiting import HANG, wait_until

from gear_rattle.workers import SurveyRequest, examine, open_survey

STARTS = 65536  # initial conditions per cell; a tile then computes for about four seconds
REQUEST = SurveyRequest(
    delta={"start": 0.5, "stop": 0.6, "num": 6},
    epsilon={"start": 0.05, "stop": 0.2, "num": 6},
    initial_conditions={"count": STARTS},
    tile={"delta": 2, "epsilon": 2},
)
OPTIONS = ["--delta", "0.5:0.6:6", "--epsilon", "0.05:0.2:6", "--count", str(STARTS), "--tile", "2x2"]
BEGUN = 0.1  # seconds of processor time that a tile has used before a fault happens
DAY = 86_400.0
#: A wall clock for every process, including dask's scheduler, that is set by writing an offset to a file.
CLOCK = """
real, SET = time.time, {!r}

def turned():
    try:
        with open(SET) as file:
            return real() + float(file.read())
    except (FileNotFoundError, ValueError):
        return real()

time.time = turned

@patch("gear_rattle.workers.cluster.cluster")
def silence(cluster):
    cluster.SILENT_SECONDS = 5

@patch("gear_rattle.workers.survey.tiles")
def count_ends(tiles):
    after(tiles, "compute_tile", lambda request, tile, *_, **__: note(f"end {{tile.index}} {{os.getpid()}}"))
"""


@pytest.fixture
def faults(tmp_path: Path) -> Faults:
    """Inject into every process a clock that :func:`turn` sets."""
    faults = Faults(tmp_path)
    faults.inject(CLOCK.format(str(tmp_path / "clock")))
    return faults


def turn(directory: Path, seconds: float) -> None:
    """Set the clock of every process to an offset from the real time."""
    new = directory / "clock.new"
    new.write_text(str(seconds))
    new.rename(directory / "clock")


def in_the_middle(faults: Faults) -> int:
    """Return the id of a process that has computed its current tile for a while."""
    seen: dict[tuple[int, int], float] = {}

    def found() -> int:
        begun, ended = (Counter(line.split()[1] for line in faults.notes(word).elements()) for word in ("tile", "end"))
        for name in begun:
            if begun[name] > ended[name]:
                with suppress(psutil.NoSuchProcess):
                    used = psutil.Process(int(name)).cpu_times().user
                    if used - seen.setdefault((int(name), begun[name]), used) >= BEGUN:
                        return int(name)
        return 0

    return int(wait_until(found))


@deep
def test_a_kill_a_freeze_and_a_clock_in_the_middle_of_a_tile(
    faults: Faults, tmp_path: Path, expected: dict[str, np.ndarray]
) -> None:
    out = tmp_path / "survey.zarr"
    command = ["run", *OPTIONS, "--workers", "2", "--out", str(out)]
    run = start(*command, settings=faults.environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        os.kill(in_the_middle(faults), signal.SIGKILL)
        in_the_middle(faults)
        turn(tmp_path, DAY)  # the scheduler believes that every worker has been silent for a day
        os.kill(frozen := in_the_middle(faults), signal.SIGSTOP)
        wait_until(lambda: not psutil.pid_exists(frozen))
        in_the_middle(faults)
        turn(tmp_path, -DAY)
        told, errors = run.communicate(timeout=HANG)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(run.pid, signal.SIGKILL)
    assert run.returncode == 0, errors
    assert f"{REQUEST.n_cells} cells, 0 failed" in told
    assert examine(out).is_whole
    assert_bit_identical(open_survey(out), expected)
    # Repeated: one tile for the kill, one for the freeze, and up to two per worker for each change of the clock.
    assert faults.executions().total() <= REQUEST.n_tiles + 2 + 2 * 2 * 2
