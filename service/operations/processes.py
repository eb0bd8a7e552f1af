"""Run computations of requests in processes of their own, few at a time and with a time limit."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, TypeVarTuple

import anyio
from anyio import BrokenWorkerProcess, to_process

from gear_rattle.service.errors import UnavailableError
from gear_rattle.service.state import ApplicationState

Result = TypeVar("Result")
Arguments = TypeVarTuple("Arguments")


async def compute_in_process(
    front: ApplicationState,
    compute: Callable[[*Arguments], Result],
    *arguments: *Arguments,
    model: str,
    what: str,
    advice: str,
) -> Result:
    """Return `compute(*arguments)`, computed in another process. All arguments must be picklable.

    A process of its own is needed because a compiled loop cannot be interrupted, keeps other threads waiting, and may
    take minutes at extreme parameters. The time limit begins when the kernels of `model` are compiled. what: name of
    the result for the message "… could not be computed". advice: sentence that says how to need less time.

    Returns
    -------
    Result
        The return value of `compute`.

    Raises
    ------
    KernelsNotReadyError
        The kernels are still being compiled, or too many requests wait for kernels.
    UnavailableError
        Too many requests wait, the computation takes too long, its process died, or the service ends.
    """
    limits = front.settings
    with front.interruptible_work():
        await front.kernels.wait_until_compiled(model)
    if front.point_limiter.statistics().tasks_waiting >= limits.max_points_waiting:
        raise UnavailableError("Too many requests wait to be computed. Try again in a few seconds.")
    try:
        with front.interruptible_work(), anyio.fail_after(limits.max_point_seconds):
            return await to_process.run_sync(compute, *arguments, cancellable=True, limiter=front.point_limiter)
    except TimeoutError as error:
        raise UnavailableError(
            f"{what} could not be computed within {limits.max_point_seconds:g} s. {advice}"
        ) from error
    except BrokenWorkerProcess as error:
        raise UnavailableError("The process that computed this answer has died. Try again.") from error
