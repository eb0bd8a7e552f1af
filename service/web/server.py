"""Run the application with uvicorn. The address is bound first, and a signal ends everything within seconds."""

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

from gear_rattle.service.errors import ListenAddressError
from gear_rattle.service.settings import Settings

#: Longest time in seconds from a signal to the end of all work.
STOP_SECONDS = 3.0
SIGNALS = (signal.SIGINT, signal.SIGTERM)
#: Python module of the process that removes the semaphores of dead processes.
TRACKER = "multiprocessing.resource_tracker"
GC_OBJECTS = 50_000  # new objects between two garbage collections; a collection blocks for 15 ms
#: Blocks of memory of at least this many bytes are returned to the system when they are freed. Otherwise glibc would
#: raise this limit to as much as 32 MiB, threads would keep the memory of freed arrays, and the service would grow for
#: hours.
LARGE_BLOCK = 1 << 18
M_MMAP_THRESHOLD = -3  # value of this constant in malloc.h
#: Largest accepted websocket message, in bytes, from a page of the explorer; real messages are much smaller.
MAX_MESSAGE_BYTES = 1 << 20

log = logging.getLogger("uvicorn.error")


def run_server(app: FastAPI, settings: Settings, log_config: dict[str, Any], asked_to_stop: threading.Event) -> bool:
    """Serve the application until SIGINT or SIGTERM.

    Parameters
    ----------
    app
        The application. Its lifespan must set ``app.state.front`` and then call ``app.state.on_start()``.
    settings
        The settings of the service, with its address and limits.
    log_config
        The configuration for `logging.config.dictConfig`.
    asked_to_stop
        An event. It is set if a signal arrives before the server handles signals.

    Returns
    -------
    bool
        True if the server has started, False if it was stopped before.

    Raises
    ------
    ListenAddressError
        The address cannot be bound. Nothing has been started.
    """
    make_malloc_return_memory()
    sockets = bind_sockets(settings.host, settings.port)
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
            proxy_headers=False,  # the client's address is the address of the connection, not one in a header
            server_header=False,
            log_config=log_config,
            access_log=False,  # RequestLogMiddleware logs requests, with more details
        )
    )

    def on_start() -> None:
        _cancel_work_on_signals(app)
        if asked_to_stop.is_set():
            server.should_exit = True
            return
        for each in sockets:
            host, port = each.getsockname()[:2]
            log.info("listening at http://%s:%d", f"[{host}]" if ":" in host else host, port)
        gc.set_threshold(GC_OBJECTS)
        gc.freeze()  # otherwise every full collection scans all modules, and delays answers
        if settings.preload:
            app.state.front.kernels.start_compiling()  # so that the first requests need not wait for kernels
        if explorer := app.state.explorer:  # prepare the explorer before somebody opens it
            app.state.preparing = asyncio.ensure_future(explorer.preload_page())  # the reference keeps the task alive

    app.state.on_start = on_start
    server.run(sockets)
    return server.started


def make_malloc_return_memory() -> None:
    """Make glibc return the memory of freed arrays to the system. Do nothing with other C libraries."""
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, LARGE_BLOCK)


def bind_sockets(host: str, port: int) -> list[socket.socket]:
    """Bind sockets to all addresses of a host. They do not listen yet, so nobody can connect before the start.

    Returns
    -------
    list[socket.socket]
        The bound sockets, one for each address.

    Raises
    ------
    ListenAddressError
        An address is in use, does not belong to this machine, or is unknown.
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
        raise ListenAddressError(
            f"The service cannot listen on port {port} of {host} ({error.strerror}). Choose another port or address "
            "(--port, --host). If another program uses this port, you may stop that program instead."
        ) from error
    return bound


def _cancel_work_on_signals(app: FastAPI) -> None:
    """Make SIGINT and SIGTERM end surveys and requests at once, not only when uvicorn has closed its connections.

    This function must be called inside the lifespan, when uvicorn has installed its signal handlers. The new handlers
    also call uvicorn's handlers.
    """
    loop = asyncio.get_running_loop()

    def replace_handler(number: signal.Signals) -> None:
        uvicorns = signal.getsignal(number)

        def stop(received: int, frame: FrameType | None) -> None:
            deadline = threading.Timer(STOP_SECONDS, _kill_process_and_children)
            deadline.daemon = True
            deadline.start()
            loop.call_soon_threadsafe(app.state.front.end)
            if callable(uvicorns):
                uvicorns(received, frame)

        signal.signal(number, stop)

    for number in SIGNALS:
        replace_handler(number)


def _kill_process_and_children() -> None:
    """Kill this process and its children, except the resource tracker.

    Nothing is lost: tiles are written whole, and the database has committed.
    """
    log.warning("the service is still busy %g s after the signal: it is killed now", STOP_SECONDS)
    for child in psutil.Process().children(recursive=True):
        with suppress(psutil.Error):
            if TRACKER not in " ".join(child.cmdline()):
                child.kill()
    os._exit(0)
