"""SLURM on this machine: munged, slurmctld, and two slurmd as two nodes."""

import getpass
import os
import shutil
import socket
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from service_processes import free_port
from waiting import HANG, SELDOM, wait_until

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "squeue")
NODES = ("one", "two")
SBIN = os.pathsep.join([os.environ.get("PATH", ""), "/usr/sbin", "/sbin"])

CONFIGURATION = """
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={port}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
CredType=cred/munge
# A job that is queued again waits until what its first run could show has expired.
AuthInfo=socket={directory}/munge.socket,cred_expire=5
StateSaveLocation={directory}/state
SlurmdSpoolDir={directory}/spool-%n
SlurmctldPidFile={directory}/slurmctld.pid
SlurmdPidFile={directory}/slurmd-%n.pid
SlurmctldLogFile={directory}/slurmctld.log
SlurmdLogFile={directory}/slurmd-%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
ReturnToService=2
KillWait=5
# These nodes are one machine: however many processors it has, each has as many as its jobs ask for.
SlurmdParameters=config_overrides
SelectType=select/cons_res
SelectTypeParameters=CR_Core
SchedulerParameters=sched_interval=2
{nodes}
PartitionName=all Nodes={names} Default=YES MaxTime=INFINITE State=UP
"""


def missing() -> str:
    """Return why SLURM cannot run here, or an empty text if it can."""
    without = [name for name in PROGRAMS if shutil.which(name, path=SBIN) is None]
    return f"{', '.join(without)} not installed (apt-get install slurm-wlm munge)" if without else ""


class Slurm:
    """A running SLURM cluster."""

    def __init__(self, directory: Path) -> None:
        self.environment = {"SLURM_CONF": str(directory / "slurm.conf"), "PATH": SBIN}

    def command(
        self, *command: str, settings: Mapping[str, str] | None = None, cwd: str | Path | None = None
    ) -> subprocess.CompletedProcess[str]:
        """Run a command to its end."""
        environment = {**os.environ, **(settings or {}), "SLURM_CONF": self.environment["SLURM_CONF"]}
        environment["PATH"] = os.pathsep.join([environment.get("PATH", ""), SBIN])
        return subprocess.run(command, env=environment, cwd=cwd, capture_output=True, text=True, timeout=HANG)

    def submit(self, *arguments: str, settings: Mapping[str, str], cwd: Path) -> str:
        """Submit a job; return its id."""
        sent = self.command("sbatch", "--parsable", *arguments, settings=settings, cwd=cwd)
        assert sent.returncode == 0, sent.stderr
        return sent.stdout.strip()

    def job(self, number: str) -> dict[str, str]:
        """Return SLURM's description of a job, or an empty one if SLURM has forgotten the job."""
        said = self.command("scontrol", "show", "job", number).stdout.split()
        return dict(pair.split("=", 1) for pair in said if "=" in pair)

    def cancel(self, number: str) -> None:
        """Cancel a job, and wait until it is over."""
        self.command("scancel", number)
        wait_until(lambda: self.job(number).get("JobState") not in ("RUNNING", "PENDING", "COMPLETING"), SELDOM)


@contextmanager
def slurm() -> Iterator[Slurm]:
    """Run the daemons for as long as the context lasts."""
    with TemporaryDirectory(prefix="slurm-") as name, ExitStack() as stack:
        directory = Path(name)  # a short path: the name of a socket in it has at most 107 bytes
        (directory / "state").mkdir()
        nodes = [
            f"NodeName={node} NodeHostname={socket.gethostname().partition('.')[0]} NodeAddr=127.0.0.1 "
            f"Port={free_port()} CPUs=4 RealMemory=16000 State=UNKNOWN"
            for node in NODES
        ]
        text = CONFIGURATION.format(
            directory=directory,
            host=socket.gethostname().partition(".")[0],
            port=free_port(),
            user=getpass.getuser(),
            nodes="\n".join(nodes),
            names=",".join(NODES),
        )
        (directory / "slurm.conf").write_text(text)
        key = directory / "munge.key"
        key.write_bytes(os.urandom(1024))
        key.chmod(0o400)
        files = {"socket": "munge.socket", "key-file": "munge.key", "log-file": "munged.log", "seed-file": "seed"}
        found = Slurm(directory)
        options = [f"--{option}={directory / file}" for option, file in {**files, "pid-file": "munged.pid"}.items()]
        # --force: munged otherwise refuses to run as root and in a temporary directory.
        stack.enter_context(_daemon(found, directory, "munged", "--foreground", "--force", *options))
        wait_until(lambda: (directory / "munge.socket").exists())
        stack.enter_context(_daemon(found, directory, "slurmctld", "-D"))
        for node in NODES:
            stack.enter_context(_daemon(found, directory, "slurmd", "-D", "-N", node))
        wait_until(
            lambda: found.command("sinfo", "--noheader", "--format", "%D %t").stdout.split() == ["2", "idle"], SELDOM
        )
        yield found


@contextmanager
def _daemon(slurm: Slurm, directory: Path, program: str, *arguments: str) -> Iterator[None]:
    path = shutil.which(program, path=SBIN)
    with (directory / f"{program}{''.join(arguments[-1:]).replace('/', '')[-20:]}.out").open("w") as log:
        environment = {**os.environ, **slurm.environment}
        process = subprocess.Popen([str(path), *arguments], env=environment, stdout=log, stderr=log, cwd=directory)
    try:
        yield
    finally:
        process.terminate()
        with suppress(subprocess.TimeoutExpired):
            process.wait(timeout=60)
        if process.poll() is None:
            process.kill()
            process.wait()
