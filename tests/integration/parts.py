"""A dask scheduler and workers as processes of their own, with certificates of one authority."""

import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from service_processes import ENVIRONMENT, ROOT
from waiting import HANG

Settings = dict[str, str]


def openssl(*arguments: str) -> None:
    subprocess.run(["openssl", *arguments], check=True, capture_output=True, timeout=HANG)


def authority(directory: Path) -> Settings:
    """Make an authority and one certificate for all parts; return dask's settings with them."""
    directory.mkdir()
    ca, ca_key, node, node_key, request = (
        str(directory / name) for name in ("ca.pem", "ca.key", "node.pem", "node.key", "node.csr")
    )
    new_key = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-noenc"]
    openssl("req", "-x509", *new_key, "-keyout", ca_key, "-out", ca, "-days", "2", "-subj", "/CN=gear rattle test")
    openssl("req", "-new", *new_key, "-keyout", node_key, "-out", request, "-subj", "/CN=node")
    openssl("x509", "-req", "-in", request, "-CA", ca, "-CAkey", ca_key, "-CAcreateserial", "-out", node, "-days", "2")
    settings = {"ca-file": ca}
    for part in ("scheduler", "worker", "client"):
        settings |= {f"{part}.cert": node, f"{part}.key": node_key}
    return {f"distributed.comm.tls.{name}": value for name, value in settings.items()}


def environment(settings: Settings) -> dict[str, str]:
    """Return dask's settings as environment variables."""
    return {f"DASK_{name.replace('.', '__').replace('-', '_').upper()}": value for name, value in settings.items()}


@contextmanager
def dask_part(
    settings: Settings, *arguments: str, base: Mapping[str, str] = ENVIRONMENT, prefix: Sequence[str] = ()
) -> Iterator[None]:
    """Run a scheduler or a worker as a process; `prefix` is a command that runs it elsewhere, e.g. on another host."""
    process = subprocess.Popen(
        [*prefix, sys.executable, "-m", "dask", *arguments],
        cwd=ROOT,
        env={**base, **environment(settings)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield
        assert process.poll() is None, arguments
    finally:
        process.terminate()
        process.wait(timeout=HANG)
