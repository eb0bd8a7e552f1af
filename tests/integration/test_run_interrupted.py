"""Ctrl-C in a terminal, which reaches every process at once, stops a run while its processes are being started."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
from depth import deep
from faults import Faults
from service_processes import OPTIONS
from waiting import HANG, wait_until

COMMAND = (
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from gear_rattle.cli import main; main()"
)


@pytest.mark.parametrize("delay", [pytest.param(0.0, marks=deep), 0.7, pytest.param(1.4, marks=deep)])
def test_while_the_cluster_starts(tmp_path: Path, delay: float) -> None:
    faults, out = Faults(tmp_path), tmp_path / "survey.zarr"
    faults.hold(0)  # so that the run cannot end before the signal
    run = subprocess.Popen(
        [sys.executable, "-c", COMMAND, "run", *OPTIONS, "--workers", "2", "--out", str(out)],
        env=faults.environment,
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    wait_until(lambda: begun(run))
    time.sleep(delay)  # the moment of the interrupt varies; this waits for nothing
    os.killpg(run.pid, signal.SIGINT)
    output, _ = run.communicate(timeout=HANG)
    assert run.returncode == 130, output
    assert "Traceback" not in output
    assert "same command resumes it" in output
    assert (out / "zarr.json").exists()


def begun(run: subprocess.Popen[str]) -> bool:
    assert run.poll() is None
    return bool(psutil.Process(run.pid).children())  # the process that starts the workers
