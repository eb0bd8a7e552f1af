"""Kernels of a service, compiled in a process of their own before anybody's time is counted.

A fresh installation compiles for a minute or two. That begins with the service, in the order of `KernelPurpose`; those
of the stiff model wait until they are needed. Workers wait for the same kernels and load them.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from enum import StrEnum

import anyio
from anyio import BrokenWorkerProcess, to_process

from gear_rattle.service.errors import KernelsError
from gear_rattle.service.settings import Settings
from rattle.models import DEFAULT_MODEL
from rattle.numerics import compile_apart, note_of

log = logging.getLogger(__name__)


class KernelPurpose(StrEnum):
    """Purposes of kernels, in the order in which they are compiled: a function of `WORK` each."""

    ORBITS = "orbits"  # period-one motions and limits
    CURVES = "curves"
    ATTRACTORS = "attractors"
    POINT = "point"  # basins, manifolds, margins, diagrams


WORK = "gear_rattle.service.compilation"
LAST = list(KernelPurpose)[-1]


class Kernels:
    """The kernels of one service, in its event loop."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._tasks: dict[str, asyncio.Task[None]] = {}
        self._ready: dict[tuple[str, KernelPurpose], asyncio.Event] = {}
        self._waiting = 0

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Give up at the end what is still being compiled."""
        try:
            yield
        finally:
            for task in self._tasks.values():
                task.cancel()
            await asyncio.gather(*self._tasks.values(), return_exceptions=True)

    def begin(self, model: str = DEFAULT_MODEL) -> None:
        """Compile what this model needs, unless that has begun or an earlier process has done it."""
        if (model, LAST) in self._ready:
            return
        for part in KernelPurpose:
            self._ready[model, part] = asyncio.Event()
            if note_of(part, model).exists():
                self._ready[model, part].set()
        if not all(self.has(model, part) for part in KernelPurpose):
            self._tasks[model] = asyncio.get_running_loop().create_task(self._compile(model))

    @property
    def at_work(self) -> bool:
        """True if kernels are being compiled now."""
        return any(not task.done() and not self.has(model, LAST) for model, task in self._tasks.items())

    def has(self, model: str, part: KernelPurpose) -> bool:
        """Return whether these kernels need not be compiled any more."""
        return (model, part) in self._ready and self._ready[model, part].is_set()

    async def require(self, model: str, part: KernelPurpose, patience: float | None = None) -> None:
        """Wait until these kernels are there.

        Parameters
        ----------
        patience : float | None
            Seconds; by default as long as points may be computed.

        Raises
        ------
        KernelsError
            They are still being compiled, or too many wait already.
        """
        self.begin(model)
        if self.has(model, part):
            return
        if self._waiting >= self._settings.max_points_waiting:
            raise KernelsError
        self._waiting += 1
        try:
            with anyio.fail_after(self._settings.max_point_seconds if patience is None else patience):
                await self._ready[model, part].wait()
        except TimeoutError as error:
            raise KernelsError from error
        finally:
            self._waiting -= 1

    async def _compile(self, model: str) -> None:
        for part in KernelPurpose:
            try:
                if part is KernelPurpose.ATTRACTORS:  # workers wait for this note
                    await _apart("rattle.precompile", "survey", model)
                await _apart(WORK, part, model)
            except BrokenWorkerProcess as error:  # requests compile what they need, and say what goes wrong
                log.warning("the process that compiles kernels has died: %s", error)
            except Exception:
                log.exception("kernels could not be made ready")
            self._ready[model, part].set()


async def _apart(module: str, work: str, model: str) -> None:
    """In a process that is killed when the service ends, which ends the one that compiles."""
    await to_process.run_sync(compile_apart, module, work, model, cancellable=True)
