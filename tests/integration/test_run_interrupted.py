"""Ctrl-C in a terminal reaches every process at once, also while they are being started."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

COMMAND = (
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from service.cli import main; main()"
)
OPTIONS = ["--delta", "0.4:1.0:16", "--epsilon", "0.01:0.3:16", "--count", "16"]


@pytest.mark.parametrize("delay", [0.0, 0.7])
def test_while_the_cluster_starts(tmp_path: Path, delay: float) -> None:
    out = tmp_path / "survey.zarr"
    run = subprocess.Popen(
        [sys.executable, "-c", COMMAND, "run", *OPTIONS, "--out", str(out)],
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    deadline = time.monotonic() + 60
    while len(psutil.Process(run.pid).children()) < 3:  # multiprocessing's tracker and two workers
        assert run.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.01)
    time.sleep(delay)  # not a wait for anything: the moment of the interrupt is what varies
    os.killpg(run.pid, signal.SIGINT)
    output, _ = run.communicate(timeout=120)
    assert run.returncode == 130, output
    assert "Traceback" not in output
    assert "same command resumes it" in output
    assert (out / "zarr.json").exists()
