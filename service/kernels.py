"""Compiled kernels, made ready in a process of their own before anybody's time is counted.

A fresh installation compiles for a minute. That begins with the service, and goes on in this order: closed forms,
curves, attractors, all that the view of a point shows. The stiff model's wait until somebody asks for it. The
workers compile their own meanwhile: the cache of kernels lets every other process wait for one that is being compiled.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from enum import IntEnum

import anyio
from anyio import BrokenWorkerProcess, CapacityLimiter, to_process
from starlette.concurrency import run_in_threadpool

from gear_rattle.service.errors import KernelsError
from gear_rattle.service.settings import Settings
from rattle.models import AnyModel, Model, model_of
from rattle.numerics import note_in_cache

AT = 0.6, 0.1  # δ, ε of the gear that is computed for its kernels; β = 0.6
KAPPA = 1e4
LOOK_SECONDS = 0.2

log = logging.getLogger(__name__)


class Part(IntEnum):
    """What kernels are for, in the order in which they are compiled."""

    ORBITS = 0  # period-one motions and limits
    CURVES = 1
    ATTRACTORS = 2
    POINT = 3  # basins, manifolds, margins, diagrams


HERE = {Part.ORBITS, Part.CURVES}  # of the impacting model: in this process too, for its routes and its page
Work = Mapping[Part, Callable[[AnyModel], None]]


def model_for(name: Model) -> AnyModel:
    """The model whose gear is computed for its kernels."""
    return model_of(0.6, KAPPA if name is Model.STIFF else None)


def compiled(name: Model) -> bool:
    """Whether every kernel of a model is in the cache: to find that out by loading them takes seconds."""
    return note_in_cache(name).exists()


def note_compiled(name: Model) -> None:
    """Leave a note that every kernel of a model is in the cache; without a cache, nothing."""
    with suppress(OSError):
        note_in_cache(name).touch()


class Kernels:
    """The kernels of one service, in its event loop; `work` is what needs each part of them (compilation.py)."""

    def __init__(self, settings: Settings, work: Work) -> None:
        self._settings, self._work = settings, work
        self._limiter = CapacityLimiter(1)
        self._tasks: dict[Model, asyncio.Task[None]] = {}
        self._ready: dict[tuple[Model, Part], asyncio.Event] = {}
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

    def begin(self, model: Model = Model.IMPACTING, *, load: bool = False) -> None:
        """Compile what this model needs, unless that has begun or an earlier process has done it.

        Args:
            load: also load what is compiled, so that the first point need not.
        """
        if (model, Part.ORBITS) in self._ready:
            return
        known = compiled(model)
        for part in Part:
            self._ready[model, part] = asyncio.Event()
            if known:
                self._ready[model, part].set()
        if load or not known:
            self._tasks[model] = asyncio.get_running_loop().create_task(self._compile(model))

    @property
    def at_work(self) -> bool:
        """Whether kernels are being compiled now."""
        last = max(Part)
        return any(not task.done() and not self.has(model, last) for model, task in self._tasks.items())

    def has(self, model: Model, part: Part) -> bool:
        """Whether these kernels need not be compiled any more."""
        return (model, part) in self._ready and self._ready[model, part].is_set()

    async def require(self, model: Model, part: Part, patience: float | None = None) -> None:
        """Wait until these kernels are there.

        Args:
            patience: seconds; by default as long as points may be computed.

        Raises:
            KernelsError: they are still being compiled, or too many wait already.
        """
        self.begin(model)
        ready = self._ready[model, part]
        if ready.is_set():
            return
        if self._waiting >= self._settings.max_points_waiting:
            raise KernelsError
        self._waiting += 1
        try:
            with anyio.fail_after(self._settings.max_point_seconds if patience is None else patience):
                await ready.wait()
        except TimeoutError as error:
            raise KernelsError from error
        finally:
            self._waiting -= 1

    async def _compile(self, model: Model) -> None:
        computed, failed = model_for(model), False
        for part, work in self._work.items():
            try:
                await to_process.run_sync(work, computed, cancellable=True, limiter=self._limiter)
                if model is Model.IMPACTING and part in HERE:
                    await run_in_threadpool(work, computed)
            except BrokenWorkerProcess as error:  # requests compile what they need, and say what goes wrong
                log.warning("the process that compiles kernels has died: %s", error)
                failed = True
            except Exception:
                log.exception("kernels could not be made ready")
                failed = True
            self._ready[model, part].set()
        if not failed:
            note_compiled(model)
