"""Computations for one request, each in a process of its own: few at once, not for ever."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, TypeVarTuple

import anyio
from anyio import BrokenWorkerProcess, to_process

from gear_rattle.service.errors import UnavailableError
from gear_rattle.service.state import Front

Result = TypeVar("Result")
Arguments = TypeVarTuple("Arguments")


async def in_turn(
    front: Front,
    compute: Callable[[*Arguments], Result],
    *arguments: *Arguments,
    model: str,
    what: str,
    advice: str,
) -> Result:
    """Return the result of `compute` for these arguments, all of which can be pickled.

    In a process of its own: a compiled loop can neither be interrupted nor does it let other threads run, and at
    extreme parameters it takes minutes. Its time is counted from when the kernels of the `model` are there.

    Returns
    -------
    Result
        The return value of `compute`.

    Raises
    ------
    KernelsError
        They are still being compiled.
    UnavailableError
        Too many wait already, it takes too long (`what`, and the `advice` to follow), or it died.
    """
    limits = front.settings
    with front.interruptible():
        await front.kernels.require(model)
    if front.points.statistics().tasks_waiting >= limits.max_points_waiting:
        raise UnavailableError("Too many parameter points are being computed. Try again in a few seconds.")
    try:
        with front.interruptible(), anyio.fail_after(limits.max_point_seconds):
            return await to_process.run_sync(compute, *arguments, cancellable=True, limiter=front.points)
    except TimeoutError as error:
        raise UnavailableError(f"{what} were not found within {limits.max_point_seconds:g} s. {advice}") from error
    except BrokenWorkerProcess as error:
        raise UnavailableError("The process that computed this has died. Try again.") from error
