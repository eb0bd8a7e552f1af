"""The batch scripts of deploy/slurm, submitted to a SLURM cluster of two nodes on this machine."""

import os
import re
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import slurm
from faults import Faults
from service_processes import OPTIONS, REQUEST, ROOT, assert_bit_identical, client_of, free_port, serial_run, server
from waiting import SELDOM, wait_until

import rattle.numerics.compile
from gear_rattle.workers import open_survey

pytestmark = pytest.mark.skipif(bool(slurm.missing()), reason=slurm.missing())

SCRIPTS = ROOT / "deploy" / "slurm"
#: Fewer resources than the scripts request.
FEW = ["--nodes=2", "--ntasks-per-node=1", "--mem-per-cpu=2000M"]


@pytest.fixture(scope="module")
def cluster() -> Iterator[slurm.Slurm]:
    with slurm.slurm() as found:
        yield found


class Shared:
    """A directory that both nodes share, with the scripts, and the environment with which jobs are submitted."""

    def __init__(self, directory: Path) -> None:
        self.directory, self.faults = directory, Faults(directory)
        for name in ("cluster.sh", "survey.sbatch", "cluster.sbatch"):
            shutil.copy(SCRIPTS / name, directory)
        kernels = rattle.numerics.compile.cache_directory()
        self.cache = directory / "cache"  # has only the kernels for the processor of this machine
        self.cache.mkdir()
        (self.cache / kernels.name).symlink_to(kernels)
        self.kinds = {kernels.name}
        self.settings = self.faults.environment | {
            "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]),
            "RATTLE_CACHE_DIR": str(self.cache),
        }

    def logs(self) -> str:
        return "\n".join(path.read_text() for path in self.directory.glob("*.log"))


@pytest.fixture
def shared(tmp_path: Path) -> Shared:
    return Shared(tmp_path)


def run_of(cluster: slurm.Slurm, shared: Shared, store: Path, *options: str) -> str:
    """Submit the survey as the comments of the script say."""
    arguments = [*FEW, *options, "survey.sbatch", *OPTIONS, "--out", str(store)]
    return cluster.submit(*arguments, settings=shared.settings, cwd=shared.directory)


def ended(cluster: slurm.Slurm, number: str) -> bool:
    return cluster.job(number).get("JobState", "COMPLETED") not in ("RUNNING", "PENDING", "COMPLETING")


def assert_whole(store: Path, expected: dict[str, np.ndarray]) -> None:
    with open_survey(store) as dataset:
        assert_bit_identical(dataset, expected)


def test_a_job_that_is_cancelled_is_submitted_again(cluster: slurm.Slurm, shared: Shared) -> None:
    store = shared.directory / "survey.zarr"
    shared.faults.hold(4)
    first = run_of(cluster, shared, store)
    wait_until(lambda: len(shared.faults.executions()) > 4 or ended(cluster, first), SELDOM)
    assert not ended(cluster, first), shared.logs()
    cluster.cancel(first)
    shared.faults.release()
    second = run_of(cluster, shared, store)
    wait_until(lambda: ended(cluster, second), SELDOM)
    assert cluster.job(second)["JobState"] == "COMPLETED", shared.logs()
    assert cluster.job(second)["NumNodes"] == "2"
    assert_whole(store, serial_run(REQUEST))
    assert {path.name for path in shared.cache.iterdir()} == shared.kinds  # neither node compiled others


def test_a_job_that_meets_its_time_limit_is_queued_again_and_goes_on(cluster: slurm.Slurm, shared: Shared) -> None:
    store = shared.directory / "survey.zarr"
    shared.faults.hold(4)
    number = run_of(cluster, shared, store, "--time=2", "--signal=B:USR1@30")
    wait_until(lambda: cluster.job(number).get("Restarts", "0") != "0" or ended(cluster, number), SELDOM)
    assert not ended(cluster, number), shared.logs()
    shared.faults.release()
    wait_until(lambda: ended(cluster, number), SELDOM)
    assert cluster.job(number)["JobState"] == "COMPLETED", shared.logs()
    assert_whole(store, serial_run(REQUEST))


def test_a_service_whose_cluster_is_a_job_goes_on_with_the_next_one(cluster: slurm.Slurm, shared: Shared) -> None:
    place = shared.directory / "cluster"
    settings = shared.settings | {"RATTLE_CLUSTER": str(place)}
    first = cluster.submit(*FEW, "cluster.sbatch", settings=settings, cwd=shared.directory)
    wait_until(lambda: (place / "scheduler.json").exists() or ended(cluster, first), SELDOM)
    exported = re.findall(r"export (\w+)='?([^'\n]*)'?", (place / "environment").read_text())
    port, shared_settings = free_port(), settings | dict(exported)
    arguments = ("--scheduler", str(place / "scheduler.json"))
    shared.faults.hold(4)
    with server(shared.directory / "data", port, *arguments, settings=shared_settings), client_of(port) as client:
        job = client.submit(REQUEST)
        wait_until(lambda: len(shared.faults.executions()) > 4 or ended(cluster, first), SELDOM)
        assert not ended(cluster, first), shared.logs()
        cluster.cancel(first)
        shared.faults.release()
        second = cluster.submit(*FEW, "cluster.sbatch", settings=settings, cwd=shared.directory)
        job.wait()
        with job.open() as dataset:
            assert_bit_identical(dataset, serial_run(REQUEST))
        cluster.cancel(second)
