"""The process of a service: it ends within seconds of SIGTERM, whatever is at work."""

from __future__ import annotations

import asyncio
import ctypes
import gc
import logging
import os
import socket
import threading
from contextlib import suppress
from types import FrameType

import psutil
import uvicorn
from fastapi import FastAPI

from service.errors import AddressError

#: From the signal to the end of everything that is still at work.
STOP_SECONDS = 3.0

#: The process that removes the semaphores of the others when they are gone.
TRACKER = "multiprocessing.resource_tracker"
OBJECTS = 50_000  # that are made between two collections of garbage: to look through them takes 15 ms, all at once

#: What is larger, in bytes, goes back to the system when it is freed. glibc moves this limit up to 32 MiB by itself;
#: then each of the arenas that threads allocate from keeps what arrays took: a service grew for hours.
LARGE = 1 << 18
M_MMAP_THRESHOLD = -3  # of malloc.h

log = logging.getLogger("uvicorn.error")


class Server(uvicorn.Server):
    """uvicorn's server, whose surveys stop while open requests end, not after them.

    Args:
        config: of uvicorn.
        app: the application.
        asked_to_stop: set if a signal came before this server listened for them.
    """

    def __init__(self, config: uvicorn.Config, app: FastAPI, asked_to_stop: threading.Event) -> None:
        super().__init__(config)
        self._app = app
        self._asked_to_stop = asked_to_stop
        with suppress(OSError, AttributeError, TypeError):  # another C library, which has no such limit
            ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, LARGE)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Begin to answer.

        Raises:
            AddressError: the address cannot be listened at; nothing has been started.
        """
        sockets = sockets or await self._bound()
        await super().startup(sockets)
        self._log_started_message(sockets)
        if self._asked_to_stop.is_set():
            self.should_exit = True
            return
        gc.set_threshold(OBJECTS)
        gc.freeze()  # or every full collection looks through all modules again, and nothing is answered meanwhile
        front = self._app.state.front
        if front.settings.preload:
            front.kernels.begin(load=True)  # before anybody asks for what needs them
        # the first who opens the explorer shall not wait for it; a reference, or the task may be collected
        if explorer := self._app.state.explorer:
            self._preparing = asyncio.ensure_future(explorer.prepare())

    async def _bound(self) -> list[socket.socket]:
        """The sockets of the address, at which nobody listens yet."""
        config, loop = self.config, asyncio.get_running_loop()
        try:
            server = await loop.create_server(asyncio.Protocol, config.host, config.port, start_serving=False)
        except OSError as error:
            raise AddressError(
                f"Nothing can listen at port {config.port} of {config.host} ({error.strerror}). Stop what does, or "
                "choose another (--port, --host)."
            ) from error
        bound = [each.dup() for each in server.sockets]
        server.close()
        return bound

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Begin to end; what cannot be interrupted is killed in time."""
        deadline = threading.Timer(STOP_SECONDS, _end_now)
        deadline.daemon = True
        deadline.start()
        super().handle_exit(sig, frame)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End requests and surveys at the same time."""
        if front := getattr(self._app.state, "front", None):
            front.end()
        await super().shutdown(sockets)


def _end_now() -> None:
    """Nothing is lost by it: tiles are files that appear whole, and the job database keeps what it has committed."""
    log.warning("still busy after %g s: ending now", STOP_SECONDS)
    for child in psutil.Process().children(recursive=True):
        with suppress(psutil.Error):
            if TRACKER not in " ".join(child.cmdline()):
                child.kill()
    os._exit(0)
