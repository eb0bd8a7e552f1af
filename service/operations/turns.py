"""Run computations of requests in processes of their own, few at a time and with a time limit."""

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

    It runs in a process of its own, because a compiled loop can neither be interrupted nor lets other threads run, and
    takes minutes at extreme parameters. Its time is counted from when the kernels of the `model` are compiled.

    Returns
    -------
    Result
        The return value of `compute`.

    Raises
    ------
    KernelsError
        The kernels are still being compiled.
    UnavailableError
        Too many requests wait, it takes too long (the message names `what`, and the `advice`), or the process died.
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
