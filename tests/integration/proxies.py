"""nginx and Caddy with TLS, run with the configurations of docs/operations.md, at a root and below a path."""

import os
import re
import shutil
import ssl
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

import httpx
from service_processes import ROOT, free_port
from waiting import HANG, wait_until

TEXT = (ROOT / "docs" / "operations.md").read_text()
PROGRAMS = {"nginx": shutil.which("nginx") or shutil.which("/usr/sbin/nginx"), "caddy": shutil.which("caddy")}
PATH = "/rattle"
OWN_NAME, OTHER_NAME = "gears.example.org", "www.example.org"


class Proxied(NamedTuple):
    """A service behind a proxy.

    Attributes
    ----------
    root
        Address at the root of a host.
    below
        Address below a path.
    certificate
        File of the certificate that browsers and clients have to trust.
    """

    root: str
    below: str
    certificate: Path

    @property
    def trust(self) -> ssl.SSLContext:
        """Return the TLS context of a client that trusts the certificate."""
        return ssl.create_default_context(cafile=str(self.certificate))


def configuration(language: str) -> str:
    """Return the code block of docs/operations.md in this language."""
    (found,) = re.findall(rf"```{language}\n(.*?)```", TEXT, re.DOTALL)
    return str(found)


def certificate_in(directory: Path) -> tuple[Path, Path]:
    """Make a certificate for this machine, and its key."""
    certificate, key = directory / "proxy.pem", directory / "proxy.key"
    subprocess.run(
        [
            *("openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"),
            *("-keyout", str(key), "-out", str(certificate), "-days", "2", "-subj", "/CN=localhost"),
            *("-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1"),
        ],
        check=True,
        capture_output=True,
    )
    return certificate, key


def replaced(text: str, table: dict[str, str]) -> str:
    """Replace patterns in a text, and check that each occurs."""
    for pattern, instead in table.items():
        text, found = re.subn(pattern, instead, text, flags=re.MULTILINE)
        assert found, pattern
    return text


@contextmanager
def nginx(front: int, directory: Path, changes: dict[str, str] | None = None) -> Iterator[Proxied]:
    """Run nginx in front of the service at a port: the configuration of operations.md, with files of this test."""
    certificate, key = certificate_in(directory)
    root, below = free_port(), free_port()
    text = replaced(
        configuration("nginx"),
        {
            r"127\.0\.0\.1:8000": f"127.0.0.1:{front}",
            r"/etc/ssl/gears\.pem": str(certificate),
            r"/etc/ssl/gears\.key": str(key),
            rf"listen 443 ssl;(?=\s+server_name {OWN_NAME})": f"listen 127.0.0.1:{root} ssl;",
            rf"listen 443 ssl;(?=\s+server_name {OTHER_NAME})": f"listen 127.0.0.1:{below} ssl;",
            rf"({OWN_NAME}|{OTHER_NAME})": "localhost",
            r"^http \{": f"http {{ access_log off; {_temporary(directory)}",
            **(changes or {}),
        },
    )
    file = directory / "nginx.conf"
    user = "user root; " if os.geteuid() == 0 else ""  # only root may enter the directories of a test that runs as root
    file.write_text(f"{user}daemon off; pid {directory / 'nginx.pid'}; error_log {directory / 'nginx.log'};\n{text}")
    command = [str(PROGRAMS["nginx"]), "-e", str(directory / "nginx.log"), "-p", str(directory), "-c", str(file)]
    with _running(
        command, directory, Proxied(f"https://localhost:{root}", f"https://localhost:{below}{PATH}", certificate)
    ) as it:
        yield it


def _temporary(directory: Path) -> str:
    kinds = ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")
    return " ".join(f"{kind}_temp_path {directory / kind};" for kind in kinds)


@contextmanager
def caddy(front: int, directory: Path, changes: dict[str, str] | None = None) -> Iterator[Proxied]:
    """Run Caddy in front of the service at a port: the configuration of operations.md, with files of this test."""
    certificate, key = certificate_in(directory)
    root, below, plain = free_port(), free_port(), free_port()
    text = replaced(
        configuration("caddyfile"),
        {
            r"127\.0\.0\.1:8000": f"127.0.0.1:{front}",
            rf"^{OWN_NAME} \{{": f"https://localhost:{root} {{\n\ttls {certificate} {key}",
            rf"^{OTHER_NAME} \{{": f"https://localhost:{below} {{\n\ttls {certificate} {key}",
            r"\A\{": f"{{\n\tadmin off\n\thttp_port {plain}",
            **(changes or {}),
        },
    )
    file = directory / "Caddyfile"
    file.write_text(text)
    command = [str(PROGRAMS["caddy"]), "run", "--adapter", "caddyfile", "--config", str(file)]
    with _running(
        command, directory, Proxied(f"https://localhost:{root}", f"https://localhost:{below}{PATH}", certificate)
    ) as it:
        yield it


@contextmanager
def _running(command: list[str], directory: Path, found: Proxied) -> Iterator[Proxied]:
    with (directory / "proxy.log").open("w") as log:
        environment = {"HOME": str(directory), "XDG_DATA_HOME": str(directory), "XDG_CONFIG_HOME": str(directory)}
        process = subprocess.Popen(command, stdout=log, stderr=log, cwd=directory, env=environment)
    try:
        wait_until(lambda: _answers(process, found, directory))
        yield found
        assert process.poll() is None, (directory / "proxy.log").read_text()
    finally:
        process.terminate()
        process.wait(timeout=HANG)


def _answers(process: subprocess.Popen[bytes], found: Proxied, directory: Path) -> bool:
    assert process.poll() is None, (directory / "proxy.log").read_text()
    with suppress(httpx.TransportError):
        return all(httpx.get(f"{url}/v1/health", verify=found.trust, timeout=HANG).is_success for url in found[:2])
    return False


BEGIN = {"nginx": nginx, "caddy": caddy}
