"""Two hosts (network namespaces with a link): all traffic is TLS, and the service survives a cut of the link."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from depth import deep
from faults import REQUEST, Faults
from parts import authority, dask_part, environment
from service_processes import RATTLE, ROOT, assert_bit_identical
from waiting import HANG, SELDOM, wait_until

from gear_rattle.workers import examine, open_survey

HERE, THERE = "10.77.0.1", "10.77.0.2"
PORT, HELD = 8000, 6
SCHEDULER = f"tls://{THERE}:8786"
#: Silence after which a connection counts as lost; dask's default is 30 s, and this is the least that it allows.
LOST = "12s"
SNIFFER = """
import socket, sys
link = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(3))
with open(sys.argv[1], "ab", buffering=0) as seen:
    while True:
        seen.write(link.recv(65536))
"""
ASK = """
import sys, urllib.request
sys.stdout.write(urllib.request.urlopen(sys.argv[1], timeout=float(sys.argv[2])).read().decode())
"""


@dataclass(frozen=True)
class Hosts:
    """Two hosts: prefixes for commands that run on each."""

    here: list[str]
    there: list[str]

    def link(self, state: str) -> None:
        """Set the link between the hosts "up" or "down"."""
        subprocess.run([*self.here, "ip", "link", "set", "cable", state], check=True)


@contextmanager
def joined() -> Iterator[Hosts]:
    """Make two namespaces of this user with a link between; all end with the two processes that hold them."""
    if not all(map(shutil.which, ("unshare", "nsenter", "ip"))):
        pytest.skip("no unshare, nsenter or ip (apt-get install util-linux iproute2)")
    root = os.geteuid() == 0
    with ExitStack() as stack:

        def namespace(*prefix: str, user: bool = False) -> list[str]:
            own = ["--user", "--map-root-user"] if user and not root else []
            told = [*prefix, "unshare", *own, "--net", "sh", "-c", "ip link set lo up && echo ready && exec sleep inf"]
            holder = stack.enter_context(
                subprocess.Popen(told, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
            )
            stack.callback(holder.kill)
            assert holder.stdout is not None
            assert holder.stderr is not None
            if holder.stdout.readline() != "ready\n":
                pytest.skip(f"no network namespaces here: {holder.stderr.read()}")
            entered = [] if root else ["--user", "--preserve-credentials"]
            return ["nsenter", "--target", str(holder.pid), "--net", *entered]

        here = namespace(user=True)
        there = namespace(*here)
        commands = (
            ["link", "add", "cable", "type", "veth", "peer", "name", "cable", "netns", there[2]],
            ["address", "add", f"{HERE}/24", "dev", "cable"],
            ["link", "set", "cable", "up"],
        )
        for command in commands:
            subprocess.run([*here, "ip", *command], check=True)
        for command in (["address", "add", f"{THERE}/24", "dev", "cable"], ["link", "set", "cable", "up"]):
            subprocess.run([*there, "ip", *command], check=True)
        yield Hosts(here, there)


@deep
def test_a_survey_of_two_hosts_survives_a_cut_cable_and_tells_nothing_on_it(
    tmp_path: Path, expected: dict[str, np.ndarray]
) -> None:
    faults = Faults(tmp_path)
    trusted = authority(tmp_path / "ca") | {
        "distributed.comm.require-encryption": "true",
        "distributed.comm.timeouts.tcp": LOST,
    }
    address = ["--protocol", "tls", "--host", THERE, "--port", "8786", "--no-dashboard"]
    one = ["--nworkers", "1", "--nthreads", "1", "--no-dashboard", "--host", THERE, "--local-directory", str(tmp_path)]
    with ExitStack() as stack:
        hosts = stack.enter_context(joined())

        def part(*arguments: str) -> None:
            stack.enter_context(dask_part(trusted, *arguments, base=faults.environment, prefix=hosts.there))

        wire = stack.enter_context(running(*hosts.here, sys.executable, "-c", SNIFFER, str(tmp_path / "wire")))
        part("scheduler", *address)
        part("worker", SCHEDULER, *one)
        serve = ["serve", "--port", str(PORT), "--data", str(tmp_path / "data"), "--scheduler", SCHEDULER]
        settings = faults.environment | environment(trusted)
        service = stack.enter_context(running(*hosts.here, *RATTLE, *serve, env=settings))

        def ask(path: str) -> dict[str, Any]:
            told = subprocess.run(
                [*hosts.here, sys.executable, "-c", ASK, f"http://127.0.0.1:{PORT}{path}", str(HANG)],
                capture_output=True,
            )
            found: dict[str, Any] = json.loads(told.stdout) if told.returncode == 0 else {}
            return found

        def is_up() -> bool:
            assert service.poll() is None
            return bool(ask("/v1/health").get("cluster") == "ready")

        wait_until(is_up, SELDOM)
        faults.hold(HELD)
        survey = submitted(hosts)
        wait_until(lambda: faults.executions()[HELD])
        hosts.link("down")
        wait_until(lambda: str(ask("/v1/health")["cluster"]).startswith("unavailable"), SELDOM)
        assert ask(f"/v1/surveys/{survey}")["state"] == "running"
        hosts.link("up")
        faults.release()
        wait_until(lambda: ask(f"/v1/surveys/{survey}")["state"] in {"successful", "failed"}, SELDOM)
        document = ask(f"/v1/surveys/{survey}")
        assert (document["state"], document["cells_done"]) == ("successful", REQUEST.n_cells), document["message"]
        assert wire.poll() is None
    store = tmp_path / "data" / "surveys" / f"{survey}.zarr"
    assert examine(store).is_whole
    assert_bit_identical(open_survey(store), expected)
    assert faults.executions().total() <= REQUEST.n_tiles + 4  # the running and the waiting tile, twice at most
    told = (tmp_path / "wire").read_bytes()
    assert len(told) > 50_000
    assert b"distributed" not in told


@contextmanager
def running(*command: str, **options: Any) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(command, cwd=ROOT, **options)
    try:
        yield process
    finally:
        with suppress(ProcessLookupError):
            process.terminate()
        process.wait(timeout=HANG)


def submitted(hosts: Hosts) -> str:
    """Submit REQUEST with the command on the service's host; return the id of the survey."""
    delta, epsilon = (f"{axis.start}:{axis.stop}:{axis.num}" for axis in (REQUEST.delta, REQUEST.epsilon))
    asked = ["submit", "--delta", delta, "--epsilon", epsilon, "--count", "4", "--tile", "2x2"]
    told = subprocess.run([*hosts.here, *RATTLE, *asked], cwd=ROOT, capture_output=True, text=True, check=True)
    return told.stdout.strip()
