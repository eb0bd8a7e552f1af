"""Kernels of a service, compiled in a process of their own, so that requests do not time out because of them.

A fresh installation compiles for some minutes. The kernels of surveys, for which workers wait, are compiled when the
service starts; those of other models are compiled when a request first needs them.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import anyio
from anyio import BrokenWorkerProcess, to_process

from gear_rattle.service.errors import KernelsError
from gear_rattle.service.settings import Settings
from rattle.models import DEFAULT_MODEL
from rattle.numerics import compile_apart, note_of

log = logging.getLogger(__name__)


#: Modules and functions that compile kernels; those of surveys come first, because workers wait for them.
WORKS = (
    ("rattle.precompile", "survey"),
    ("rattle.precompile", "by_request"),
    ("gear_rattle.service.compilation", "answers"),
)


def compile_kernels(model: str) -> None:
    """Compile all kernels of a model, and wait for the end."""
    for module, work in WORKS:
        compile_apart(module, work, model)


class Kernels:
    """The kernels of one service, in its event loop."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._tasks: dict[str, asyncio.Task[None]] = {}
        self._ready: dict[str, asyncio.Event] = {}
        self._waiting = 0

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Cancel unfinished compilations at the end of the context."""
        try:
            yield
        finally:
            for task in self._tasks.values():
                task.cancel()
            await asyncio.gather(*self._tasks.values(), return_exceptions=True)

    def begin(self, model: str = DEFAULT_MODEL) -> None:
        """Compile the kernels of a model, unless that has begun or an earlier process has done it."""
        if model in self._ready:
            return
        self._ready[model] = asyncio.Event()
        if note_of(WORKS[-1][1], model).exists():
            self._ready[model].set()
        else:
            self._tasks[model] = asyncio.get_running_loop().create_task(self._compile(model))

    @property
    def at_work(self) -> bool:
        """True if kernels are being compiled now."""
        return any(not task.done() and not self.has(model) for model, task in self._tasks.items())

    def has(self, model: str) -> bool:
        """Return whether all kernels of a model are compiled."""
        return model in self._ready and self._ready[model].is_set()

    async def require(self, model: str, patience: float | None = None) -> None:
        """Wait until all kernels of a model are compiled.

        Parameters
        ----------
        model : str
            Name of the model.
        patience : float, optional
            Seconds to wait; by default the most time of a point.

        Raises
        ------
        KernelsError
            They are still being compiled, or too many requests wait for them.
        """
        self.begin(model)
        if self.has(model):
            return
        if self._waiting >= self._settings.max_points_waiting:
            raise KernelsError
        self._waiting += 1
        try:
            with anyio.fail_after(self._settings.max_point_seconds if patience is None else patience):
                await self._ready[model].wait()
        except TimeoutError as error:
            raise KernelsError from error
        finally:
            self._waiting -= 1

    async def _compile(self, model: str) -> None:
        """Compile in a process that is killed when the service ends, together with its own child."""
        try:
            for module, work in WORKS:
                await to_process.run_sync(compile_apart, module, work, model, cancellable=True)
        except BrokenWorkerProcess as error:  # requests then compile kernels themselves, and report errors
            log.warning("the process that compiles kernels has died: %s", error)
        except Exception:
            log.exception("kernels could not be made ready")
        self._ready[model].set()
