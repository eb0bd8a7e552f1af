"""Deep zoom: a window that shows more than the survey has, computed afresh on the workers of the service, finer block
by block, while the viewer stays there and no longer.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncGenerator, Callable
from contextlib import aclosing, closing, suppress
from functools import partial

import numpy as np

from rattle import RattleError
from service.errors import UnavailableError
from service.explorer.common.address import Ranges
from service.explorer.common.viewer import Viewer
from service.explorer.map.planes import Block, Plane, box_of
from service.jobs.manager import STARTING
from service.state import Front
from workers import Frame, SurveyRequest, Window, map_quantity, refined, window_survey

LOOK_SECONDS = 0.2
LEAST_DELTA = 1e-3  # of the upper end, where the window reaches to no damping at all
COARSEST = 3.0  # pixels of a cell of the survey, beyond which it is computed finer


async def refine(
    front: Front, request: SurveyRequest, variable: str, index: int, window: Window, pixels: tuple[int, int]
) -> AsyncGenerator[Frame, None]:
    """Compute a map of a window of the plane, about pixels (along δ, along ε) of it: frames ever finer.

    The values are those of the survey `workers.window_survey(request, window, pixels)`, to the bit; quantities in
    closed form come at once at full resolution. Who is slower than the workers gets the newest frame. Closing this
    (``aclose``, or cancelling the task) gives up what is not begun. Waits for its turn behind `Settings.max_windows`.

    Raises:
        SurveyError: there is no such map or window, or it cannot be computed.
        ClusterLostError: the workers went away.
        UnavailableError: they are not there, or too many windows wait already.
    """
    map_quantity(variable, index, request)
    survey = await asyncio.to_thread(window_survey, request, window, pixels)
    while front.manager.cluster_state == STARTING:  # once it has started, whether it lives is told below
        await asyncio.sleep(LOOK_SECONDS)
    if front.windows.statistics().tasks_waiting >= front.settings.max_points_waiting:
        raise UnavailableError("Too many windows are being computed. Try again in a few seconds.")
    turn = object()
    await front.windows.acquire_on_behalf_of(turn)
    try:
        refinement = _Refinement(front, survey, variable, index)
        try:
            while (frame := await refinement.newest()) is not None:
                yield frame
        finally:
            refinement.stop()
    finally:
        front.windows.release_on_behalf_of(turn)


class _Refinement:
    """A thread that waits for the workers, and hands what it gets to the event loop."""

    def __init__(self, front: Front, survey: SurveyRequest, variable: str, index: int) -> None:
        self._loop = asyncio.get_running_loop()
        self._found: asyncio.Queue[Frame | Exception | None] = asyncio.Queue()
        self._stopping = threading.Event()
        run = partial(self._run, front, survey, variable, index)
        threading.Thread(target=run, name="window", daemon=True).start()

    def stop(self) -> None:
        """Let the thread come to its end, soon."""
        self._stopping.set()

    async def newest(self) -> Frame | None:
        """The newest frame, or the next one; None after the last. Raises what the thread raised."""
        found = await self._found.get()
        while isinstance(found, Frame) and not self._found.empty():
            if not isinstance(later := self._found.get_nowait(), Frame):
                self._found.put_nowait(later)
                break
            found = later
        if isinstance(found, Exception):
            raise found
        return found

    def _run(self, front: Front, survey: SurveyRequest, variable: str, index: int) -> None:
        end: Exception | None = None
        try:
            with (
                front.manager.lent_client() as client,
                closing(refined(client, survey, variable, index, self._stopping.is_set)) as frames,
            ):
                for frame in frames:
                    self._hand_over(frame)
        except Exception as error:
            end = error
        self._hand_over(end)

    def _hand_over(self, found: Frame | Exception | None) -> None:
        with suppress(RuntimeError):  # the loop is closed: the service has ended
            self._loop.call_soon_threadsafe(self._found.put_nowait, found)


class Zoom:
    """The refinement of one page; `show` gets each frame in the event loop, `say` what goes on."""

    def __init__(self, viewer: Viewer, show: Callable[[Block], None], say: Callable[[str], None]) -> None:
        self._viewer, self._show, self._say = viewer, show, say
        self._task: asyncio.Task[None] | None = None

    def start(self, plane: Plane, variable: str, index: int, window: Ranges, pixels: tuple[int, int]) -> None:
        """Refine this window; what was refined before is given up."""
        self.stop()
        self._task = self._viewer.start(self._refine(plane, variable, index, window, pixels))

    def stop(self) -> None:
        if self._task is not None:
            self._task.cancel()
            self._task = None

    async def _refine(self, plane: Plane, variable: str, index: int, window: Ranges, pixels: tuple[int, int]) -> None:
        delta, epsilon = window
        inside = Window((max(delta[0], LEAST_DELTA * delta[1]), delta[1]), (max(epsilon[0], 0.0), epsilon[1]))
        self._say("Computing this window …")
        try:
            frames = refine(self._viewer.front, plane.request, variable, index, inside, pixels)
            async with aclosing(frames):
                async for frame in frames:
                    self._show(block_of(frame))
                    self._say(f"Computing this window: {frame.done:.0%}" if frame.done < 1 else "")
        except RattleError as error:
            self._say(f"This window is not shown finer: {error}")


def block_of(frame: Frame) -> Block:
    """Cells of a window as those of a map; of complex values the modulus."""
    values = (np.abs(frame.values) if np.iscomplexobj(frame.values) else frame.values).astype(np.float32)
    status = np.ones(values.shape, np.int8)
    return Block(frame.delta, frame.epsilon, values, status, box_of(frame.delta, frame.epsilon))


def coarser(plane: Plane, window: Ranges, pixels: tuple[int, int]) -> bool:
    """Whether cells of the survey are large on the screen, or the window shows more than the survey."""
    for axis, (low, high), size in zip((plane.delta, plane.epsilon), window, pixels, strict=True):
        step = (axis[-1] - axis[0]) / (axis.size - 1)
        if step / (high - low) * size > COARSEST:
            return True
    return False
