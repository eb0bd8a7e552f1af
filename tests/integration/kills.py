"""A service and its workers killed ten times a minute: `PYTHONPATH=tests python tests/integration/kills.py`.

This takes minutes, so it is not part of the test suite. One survey after the other is submitted; each must have the
same bits as a serial run, and no tile may be lost or counted twice.
"""

import argparse
import os
import random
import signal
import subprocess
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import xarray as xr
from service_processes import FIELDS, answers, assert_bit_identical, client_of, free_port, serial_run, start, workers_of
from waiting import wait_until

from gear_rattle.service.client import Job
from gear_rattle.service.errors import ServiceError
from gear_rattle.workers import SurveyRequest, examine


def main() -> None:
    """Kill and restart the service and its workers, and compare every survey with a serial run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--kills", type=float, default=10.0, help="a minute")
    parser.add_argument("--seed", type=int, default=0)
    known = parser.parse_args()
    rng, port = random.Random(known.seed), free_port()
    kills = {"service": 0, "worker": 0}
    surveys = 0
    with tempfile.TemporaryDirectory() as directory, client_of(port) as client:
        data = Path(directory)
        service = _started(data, port)
        end = time.monotonic() + 60 * known.minutes
        while time.monotonic() < end:
            request = SurveyRequest(**FIELDS | {"seed": surveys, "initial_conditions": {"count": 256}})
            job = client.submit(request, force=True)
            while not _ended(job):
                time.sleep(rng.expovariate(known.kills / 60))
                victim = rng.choice(["service", "worker"])
                if victim == "service":
                    os.killpg(service.pid, signal.SIGKILL)
                    service.wait()
                    service = _started(data, port)
                    kills["service"] += 1
                else:
                    kills["worker"] += _kill_a_worker(service.pid, rng)
            store = data / "surveys" / f"{job.id}.zarr"
            assert job.refresh().document["tiles_done"] == request.n_tiles
            assert examine(store).is_whole
            assert_bit_identical(xr.open_zarr(store), serial_run(request))
            surveys += 1
            print(f"{surveys} surveys, killed: {kills}", flush=True)
        service.send_signal(signal.SIGTERM)
        service.wait()


def _started(data: Path, port: int) -> subprocess.Popen[str]:
    service = start("serve", "--port", str(port), "--data", str(data), "--workers", "2")
    wait_until(lambda: answers(service, port))
    return service


def _ended(job: Job) -> bool:
    with suppress(ServiceError):
        state: str = job.refresh().state
        assert state != "failed", job.document["message"]
        return state == "successful"
    return False


def _kill_a_worker(pid: int, rng: random.Random) -> int:
    if not (workers := workers_of(pid)):
        return 0
    rng.choice(workers).kill()
    return 1


if __name__ == "__main__":
    main()
