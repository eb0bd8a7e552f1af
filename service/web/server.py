"""Run the application with uvicorn, on an address that is bound first, and end within seconds of a signal."""

from __future__ import annotations

import asyncio
import ctypes
import gc
import logging
import os
import signal
import socket
import threading
from contextlib import suppress
from types import FrameType
from typing import Any

import psutil
import uvicorn
from fastapi import FastAPI

from gear_rattle.service.errors import AddressError
from gear_rattle.service.settings import Settings

#: Longest time from the signal to the end of all work.
STOP_SECONDS = 3.0
SIGNALS = (signal.SIGINT, signal.SIGTERM)
#: The process that removes the semaphores of ended processes.
TRACKER = "multiprocessing.resource_tracker"
OBJECTS = 50_000  # new objects between two garbage collections, each of which blocks for 15 ms
#: Larger blocks, in bytes, are returned to the system when they are freed. glibc raises this limit up to 32 MiB by
#: itself; then the arena of each thread keeps the memory of arrays, and a service grew for hours.
LARGE = 1 << 18
M_MMAP_THRESHOLD = -3  # constant of malloc.h
#: A message of a page of the explorer is small.
MAX_MESSAGE_BYTES = 1 << 20

log = logging.getLogger("uvicorn.error")


def run_server(app: FastAPI, settings: Settings, log_config: dict[str, Any], asked_to_stop: threading.Event) -> bool:
    """Serve the application until SIGINT or SIGTERM.

    Parameters
    ----------
    app
        The application, whose lifespan calls ``app.state.on_start`` once ``app.state.front`` is there.
    settings
        Address and limits.
    log_config
        For `logging.config.dictConfig`.
    asked_to_stop
        Set by a signal that arrives before the server handles signals.

    Returns
    -------
    bool
        Whether the server had started.

    Raises
    ------
    AddressError
        The address cannot be bound; nothing has been started.
    """
    return_large_blocks()
    sockets = bind(settings.host, settings.port)
    server = uvicorn.Server(
        uvicorn.Config(
            app,
            http="h11",
            h11_max_incomplete_event_size=settings.max_header_bytes,
            limit_concurrency=settings.max_connections,
            timeout_keep_alive=settings.idle_seconds,
            timeout_graceful_shutdown=settings.shutdown_seconds,
            ws_max_size=MAX_MESSAGE_BYTES,
            ws_per_message_deflate=False,  # compressing maps would block the event loop
            proxy_headers=False,  # the client's address is that of the connection
            server_header=False,
            log_config=log_config,
            access_log=False,  # RequestLogMiddleware logs more
        )
    )

    def begin() -> None:
        _end_with_signals(app)
        if asked_to_stop.is_set():
            server.should_exit = True
            return
        for each in sockets:
            host, port = each.getsockname()[:2]
            log.info("listening at http://%s:%d", f"[{host}]" if ":" in host else host, port)
        gc.set_threshold(OBJECTS)
        gc.freeze()  # otherwise every full collection scans all modules, and blocks answers meanwhile
        if settings.preload:
            app.state.front.kernels.begin()  # before the first request needs them
        if explorer := app.state.explorer:  # prepared before somebody opens the explorer
            app.state.preparing = asyncio.ensure_future(explorer.prepare())  # a reference keeps the task alive

    app.state.on_start = begin
    server.run(sockets)
    return server.started


def return_large_blocks() -> None:
    """Let glibc return freed arrays to the system; other C libraries have no such limit."""
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, LARGE)


def bind(host: str, port: int) -> list[socket.socket]:
    """Return sockets bound to every address of a host; they do not listen yet, so nobody connects before the start.

    Returns
    -------
    list[socket.socket]
        One for each address.

    Raises
    ------
    AddressError
        An address is taken, not of this machine, or unknown.
    """
    bound: list[socket.socket] = []
    try:
        for family, kind, protocol, _, address in socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        ):
            each = socket.socket(family, kind, protocol)
            bound.append(each)
            each.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if family == socket.AF_INET6:
                each.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
            each.bind(address if port or len(bound) == 1 else (address[0], bound[0].getsockname()[1], *address[2:]))
    except OSError as error:
        for each in bound:
            each.close()
        raise AddressError(
            f"Nothing can listen at port {port} of {host} ({error.strerror}). Stop what does, or "
            "choose another (--port, --host)."
        ) from error
    return bound


def _end_with_signals(app: FastAPI) -> None:
    """End surveys and requests at the signal, and not only after uvicorn has closed its connections.

    It runs inside the lifespan, where uvicorn's handlers are installed; they are called after this one.
    """
    loop = asyncio.get_running_loop()

    def stop_at(number: signal.Signals) -> None:
        uvicorns = signal.getsignal(number)

        def stop(received: int, frame: FrameType | None) -> None:
            deadline = threading.Timer(STOP_SECONDS, _end_now)
            deadline.daemon = True
            deadline.start()
            loop.call_soon_threadsafe(app.state.front.end)
            if callable(uvicorns):
                uvicorns(received, frame)

        signal.signal(number, stop)

    for number in SIGNALS:
        stop_at(number)


def _end_now() -> None:
    """Kill busy processes. Nothing is lost: tiles are files that appear whole, and the database has committed."""
    log.warning("still busy after %g s: ending now", STOP_SECONDS)
    for child in psutil.Process().children(recursive=True):
        with suppress(psutil.Error):
            if TRACKER not in " ".join(child.cmdline()):
                child.kill()
    os._exit(0)
