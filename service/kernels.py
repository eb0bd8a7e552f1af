"""Compile the kernels of a service in a process of its own, while requests wait for them with a time limit.

A fresh installation compiles for a minute. The kernels of the default model are compiled when the service starts,
because workers wait for them; the kernels of another model are compiled when a request first needs them.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import anyio
from anyio import BrokenWorkerProcess, to_process

from gear_rattle.service.errors import KernelsNotReadyError
from gear_rattle.service.settings import Settings
from rattle.models import DEFAULT_MODEL
from rattle.numerics import compile_in_subprocess, completion_note_path
from rattle.precompile import OPTIONAL_QUANTITIES, SURVEY

log = logging.getLogger(__name__)

#: Functions that compile kernels. The function for surveys comes first, because workers wait for its kernels.
COMPILERS = (SURVEY, OPTIONAL_QUANTITIES, "gear_rattle.service.compilation:compilation_steps_for_answers")


def compile_kernels(model: str) -> None:
    """Compile all kernels of a model in one separate process, and wait until it has ended."""
    compile_in_subprocess(model, *COMPILERS)


class KernelCompiler:
    """The compiler of the kernels of each model, in one event loop. Requests can wait until it has finished."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._compiled: dict[str, asyncio.Future[None]] = {}
        self.waiting = 0  # number of requests that wait for kernels

    @asynccontextmanager
    async def lifespan(self) -> AsyncIterator[None]:
        """Let compilations run during this context, and cancel unfinished ones at its end."""
        try:
            yield
        finally:
            for compiled in self._compiled.values():
                compiled.cancel()
            await asyncio.gather(*self._compiled.values(), return_exceptions=True)

    def start_compiling(self, model: str = DEFAULT_MODEL) -> None:
        """Begin to compile a model's kernels, unless that has begun before, or an earlier process compiled them."""
        if model in self._compiled:
            return
        loop = asyncio.get_running_loop()
        if all(completion_note_path(model, work).exists() for work in COMPILERS):
            self._compiled[model] = loop.create_future()
            self._compiled[model].set_result(None)
        else:
            self._compiled[model] = loop.create_task(_compile_model_kernels(model))

    @property
    def is_compiling(self) -> bool:
        """True if kernels are being compiled now."""
        return not all(compiled.done() for compiled in self._compiled.values())

    def is_compiled(self, model: str) -> bool:
        """Return whether the compilation of a model's kernels has ended, even by an error. False before it begins."""
        return model in self._compiled and self._compiled[model].done()

    async def wait_until_compiled(self, model: str, patience: float | None = None) -> None:
        """Wait until all kernels of a model are compiled, or their compilation has failed.

        Parameters
        ----------
        model : str
            Name of the model.
        patience : float, optional
            Longest wait in seconds; by default `Settings.max_point_seconds`.

        Raises
        ------
        KernelsNotReadyError
            The kernels are still being compiled, or too many requests wait for kernels.
        """
        self.start_compiling(model)
        if self.is_compiled(model):
            return
        if self.waiting >= self._settings.max_points_waiting:
            raise KernelsNotReadyError
        self.waiting += 1
        try:
            with anyio.fail_after(self._settings.max_point_seconds if patience is None else patience):
                await asyncio.wait([self._compiled[model]])
        except TimeoutError as error:
            raise KernelsNotReadyError from error
        finally:
            self.waiting -= 1


async def _compile_model_kernels(model: str) -> None:
    """Compile a model's kernels in a worker process, which is killed with its child process if the service ends."""
    try:
        await to_process.run_sync(compile_kernels, model, cancellable=True)
    except BrokenWorkerProcess as error:  # each request then compiles the kernels that it needs
        log.warning("the process that compiles kernels has died: %s", error)
    except Exception:
        log.exception("the kernels of the model %s could not be compiled", model)
