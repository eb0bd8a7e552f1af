"""Compute windows of the plane on the service's workers, as frames: maps of a window that become finer and finer.

The newest windows are kept, because pictures of them may be requested.
"""

from __future__ import annotations

import asyncio
import threading
from collections import OrderedDict
from collections.abc import AsyncGenerator
from contextlib import aclosing, closing, suppress
from functools import partial

import numpy as np

from gear_rattle.service.errors import UnavailableError
from gear_rattle.service.jobs.manager import STARTING
from gear_rattle.service.state import ApplicationState
from gear_rattle.workers import SurveyRequest, Window, WindowFrame, quantity_of_map, refined_frames, request_for_window
from gear_rattle.workers.pictures.look import Pair

START_CHECK_SECONDS = 0.2  # seconds between two checks whether the cluster has started
LEAST_DELTA = 1e-3  # least damping of a window, as a share of the window's largest damping
MOST_PIXELS_PER_CELL = 3.0  # a finer window is computed if a cell of the survey is larger than this many pixels
KEPT_WINDOWS, KEPT_CELLS = 8, 4_000_000  # most windows in memory, and most cells of these windows together

Key = tuple[str, str, int, Window, tuple[int, int]]


def clip_to_plane(delta: Pair, epsilon: Pair) -> Window:
    """Return the part of a window where ε ≥ 0 and δ is at least LEAST_DELTA times the largest δ of the window."""
    return Window((max(delta[0], LEAST_DELTA * delta[1]), delta[1]), (max(epsilon[0], 0.0), epsilon[1]))


def has_too_coarse_cells(
    delta: np.ndarray, epsilon: np.ndarray, window: tuple[Pair, Pair], pixels: tuple[int, int]
) -> bool:
    """Return whether a cell of a survey is wider or higher in the window than MOST_PIXELS_PER_CELL pixels.

    delta, epsilon: the axes of the survey. pixels: width and height of the window in pixels.

    Returns
    -------
    bool
        True if finer cells are worth computing.
    """
    for axis, (low, high), size in zip((delta, epsilon), window, pixels, strict=True):
        step = (axis[-1] - axis[0]) / (axis.size - 1)
        if step / (high - low) * size > MOST_PIXELS_PER_CELL:
            return True
    return False


class WindowCache:
    """A cache that computes windows of maps, with smaller cells than the survey has, and keeps the latest windows.

    One object serves all pages and pictures of a service.
    """

    def __init__(self, front: ApplicationState) -> None:
        self._front = front
        self._kept: OrderedDict[Key, WindowFrame] = OrderedDict()

    async def frames(
        self, request: SurveyRequest, variable: str, index: int, window: Window, pixels: tuple[int, int]
    ) -> AsyncGenerator[WindowFrame, None]:
        """Yield the frames that `refine_window` computes, and keep the complete frame, which is the last one."""
        async with aclosing(refine_window(self._front, request, variable, index, window, pixels)) as frames:
            async for frame in frames:
                if frame.done >= 1:
                    self._keep_frame(self._window_key(request, variable, index, window, pixels), frame)
                yield frame

    async def last_frame(
        self, request: SurveyRequest, variable: str, index: int, window: Window, pixels: tuple[int, int]
    ) -> WindowFrame:
        """Return the last frame of a window, which is complete, from memory or by computing it (`refine_window`)."""
        found = self._kept.get(self._window_key(request, variable, index, window, pixels))
        if found is None:
            async with aclosing(self.frames(request, variable, index, window, pixels)) as frames:
                async for frame in frames:
                    found = frame
        assert found is not None  # every window yields at least one frame
        return found

    @staticmethod
    def _window_key(request: SurveyRequest, variable: str, index: int, window: Window, pixels: tuple[int, int]) -> Key:
        return request.model_dump_json(), variable, index, window, pixels

    def _keep_frame(self, key: Key, frame: WindowFrame) -> None:
        self._kept[key] = frame
        self._kept.move_to_end(key)
        while len(self._kept) > KEPT_WINDOWS or sum(each.values.size for each in self._kept.values()) > KEPT_CELLS:
            self._kept.popitem(last=False)


async def refine_window(
    front: ApplicationState, request: SurveyRequest, variable: str, index: int, window: Window, pixels: tuple[int, int]
) -> AsyncGenerator[WindowFrame, None]:
    """Compute a map of a window of the plane in finer and finer frames. pixels: resolution along (delta, epsilon).

    The values are equal to the bit to those of the survey `workers.request_for_window(request, window, pixels)`.
    Quantities in closed form come at once at full resolution. A consumer that is slower than the computation gets the
    newest frame only. Closing the generator (``aclose``, or cancelling the task) cancels tasks that have not begun. At
    most `Settings.max_windows` windows are computed at once.

    Yields
    ------
    WindowFrame
        The map so far; the last frame is complete.

    Raises
    ------
    SurveyError
        The survey has no map of this variable, or the window is outside the plane or too narrow.
    ClusterLostError
        The workers were lost.
    UnavailableError
        There are no workers, or too many windows wait to be computed.
    """
    quantity_of_map(variable, index, request)
    survey = await asyncio.to_thread(request_for_window, request, window, pixels)
    while front.manager.cluster_state == STARTING:  # if the cluster does not start, `borrow_client` raises an error
        await asyncio.sleep(START_CHECK_SECONDS)
    if front.window_limiter.statistics().tasks_waiting >= front.settings.max_points_waiting:
        raise UnavailableError("Too many windows wait to be computed. Try again in a few seconds.")
    turn = object()
    await front.window_limiter.acquire_on_behalf_of(turn)
    try:
        refinement = _RefinementThread(front, survey, variable, index)
        try:
            while (frame := await refinement.wait_for_newest_frame()) is not None:
                yield frame
        finally:
            refinement.stop()
    finally:
        front.window_limiter.release_on_behalf_of(turn)


class _RefinementThread:
    """A thread that waits for frames of a window from the workers, and passes them to the event loop."""

    def __init__(self, front: ApplicationState, survey: SurveyRequest, variable: str, index: int) -> None:
        self._loop = asyncio.get_running_loop()
        self._found: asyncio.Queue[WindowFrame | Exception | None] = asyncio.Queue()
        self._stopping = threading.Event()
        work = partial(self._compute_frames, front, survey, variable, index)
        threading.Thread(target=work, name="window", daemon=True).start()

    def stop(self) -> None:
        """Ask the thread to end soon, without waiting for it."""
        self._stopping.set()

    async def wait_for_newest_frame(self) -> WindowFrame | None:
        """Wait for a further frame, and return the newest; None after the last frame. Raises an error of the thread."""
        found = await self._found.get()
        while isinstance(found, WindowFrame) and not self._found.empty():
            if not isinstance(later := self._found.get_nowait(), WindowFrame):
                self._found.put_nowait(later)
                break
            found = later
        if isinstance(found, Exception):
            raise found
        return found

    def _compute_frames(self, front: ApplicationState, survey: SurveyRequest, variable: str, index: int) -> None:
        end: Exception | None = None
        try:
            with (
                front.manager.borrow_client() as client,
                closing(refined_frames(client, survey, variable, index, self._stopping.is_set)) as frames,
            ):
                for frame in frames:
                    self._pass_frame_to_event_loop(frame)
        except Exception as error:
            end = error
        self._pass_frame_to_event_loop(end)

    def _pass_frame_to_event_loop(self, found: WindowFrame | Exception | None) -> None:
        with suppress(RuntimeError):  # the loop is closed: the service has ended
            self._loop.call_soon_threadsafe(self._found.put_nowait, found)
