"""The process of a service: it ends within seconds of SIGTERM, whatever is at work."""

from __future__ import annotations

import asyncio
import gc
import logging
import os
import socket
import threading
from types import FrameType

import psutil
import uvicorn
from fastapi import FastAPI

#: From the signal to the end of everything that is still at work.
STOP_SECONDS = 3.0

log = logging.getLogger("uvicorn.error")


class Server(uvicorn.Server):
    """uvicorn's server, whose surveys stop while open requests end, not after them."""

    def __init__(self, config: uvicorn.Config, app: FastAPI) -> None:
        super().__init__(config)
        self._app = app

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Begin to answer."""
        await super().startup(sockets)
        gc.collect()
        gc.freeze()  # or every full collection looks through all modules again, and nothing is answered meanwhile
        front = self._app.state.front
        if front.settings.preload:
            front.kernels.begin(load=True)  # before anybody asks for what needs them
        # the first who opens the explorer shall not wait for it; a reference, or the task may be collected
        if explorer := self._app.state.explorer:
            self._preparing = asyncio.ensure_future(explorer.prepare())

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Begin to end; what cannot be interrupted, such as a cluster that is starting, is killed in time."""
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
        child.kill()
    os._exit(0)
