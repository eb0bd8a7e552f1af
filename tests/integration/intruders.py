"""Attacks of another local account on a port, and dask's settings with which `connect` enters an embedded cluster."""

import asyncio
import os
import socket
import ssl
import stat
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path

import psutil
from distributed import Client, Security, comm
from distributed.protocol import pickle
from waiting import HANG

CERTIFICATE_REQUIRED = "TLSV13_ALERT_CERTIFICATE_REQUIRED"
GIVEN_UP = 10.0  # seconds after which dask gives up; a connection that succeeds does so at the first try


def anybody() -> ssl.SSLContext:
    """Return a TLS context that accepts every certificate and has none of its own."""
    context = ssl.create_default_context()
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    return context


def stranger() -> ssl.SSLContext:
    """Return a TLS context that accepts every certificate and has a self-signed one."""
    context: ssl.SSLContext = Security.temporary().get_connection_args("client")["ssl_context"]
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    return context


def listening(pid: int) -> dict[tuple[str, int], int]:
    """Return the addresses at which a process and its descendants listen, with the process that listens at each."""
    process, found = psutil.Process(pid), {}
    for each in (process, *process.children(recursive=True)):
        for connection in each.net_connections("inet"):
            assert connection.type == socket.SOCK_STREAM, connection
            if connection.status == psutil.CONN_LISTEN:
                found[(connection.laddr.ip, connection.laddr.port)] = each.pid
    return found


def named_sockets(pid: int) -> list[str]:
    """Return the Unix sockets of a process and its descendants that other accounts could find in the file system."""
    process = psutil.Process(pid)
    every = (process, *process.children(recursive=True))
    found = {str(each.laddr) for one in every for each in one.net_connections("unix") if each.laddr}
    return [each for each in found if not (each.startswith("/") and is_private(Path(each).parent))]


def is_private(directory: Path) -> bool:
    """Return whether only the owner may enter a directory."""
    there = directory.stat()
    return there.st_uid == os.getuid() and stat.S_IMODE(there.st_mode) == 0o700


def refusal(port: int) -> str:
    """Return the error with which a port refuses a TLS connection without a certificate."""
    with socket.create_connection(("127.0.0.1", port), timeout=HANG) as plain:
        try:
            with anybody().wrap_socket(plain) as encrypted:
                return f"answered {encrypted.recv(1)!r}"
        except ssl.SSLError as error:
            return error.reason


def execute(where: str) -> None:
    """Stand in for a program that an intruder wants to execute."""
    with Path(where).open("a") as file:
        file.write(f"{os.getpid()}\n")


def intrude(addresses: Collection[str], context: ssl.SSLContext | None, where: Path) -> set[int]:
    """Ask dask's addresses to execute a function, all at once; return the processes that did it."""
    asyncio.run(_intrude(addresses, context, where))
    return set(map(int, where.read_text().split())) if where.exists() else set()


async def _intrude(addresses: Collection[str], context: ssl.SSLContext | None, where: Path) -> None:
    await asyncio.gather(*(_ask(address, operation, context, where) for address in addresses for operation in _RUNS))


_RUNS = ("run", "run_function")  # the operation's name at a worker or nanny, and at a scheduler


async def _ask(address: str, operation: str, context: ssl.SSLContext | None, where: Path) -> None:
    url = address if context else address.replace("tls://", "tcp://")
    asked = {"op": operation, "function": pickle.dumps(execute), "args": pickle.dumps((str(where),)), "reply": True}
    with suppress(OSError):
        opened = await comm.connect(url, timeout=GIVEN_UP, ssl_context=context)
        try:
            await opened.write(asked)
            await opened.read()
        finally:
            opened.abort()


def certificates(client: Client) -> dict[str, str]:
    """Return dask's settings with the certificate of an embedded cluster."""
    security = client.security
    settings = {"ca-file": security.tls_ca_file, "client.cert": security.tls_client_cert}
    settings |= {"client.key": security.tls_client_key}
    return {f"distributed.comm.tls.{name}": value for name, value in settings.items()}
