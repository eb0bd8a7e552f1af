"""Compute slow overlays of maps for the explorer and for pictures. The latest overlays are kept for later requests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gear_rattle.service.errors import ServiceError, UnavailableError
from gear_rattle.service.operations.crises import CrisisCurves
from gear_rattle.service.operations.design_limits import DesignLimits
from gear_rattle.service.operations.windows import WindowCache, clip_to_plane, has_too_coarse_cells
from gear_rattle.service.state import ApplicationState
from gear_rattle.workers import ClusterLostError, SurveyError, SurveyRequest
from gear_rattle.workers.pictures.look import (
    CRISIS,
    LIMIT,
    FinerCells,
    MapPictureOptions,
    OverlayData,
    needs_whole_survey,
)
from gear_rattle.workers.pictures.planes import values_to_draw
from rattle import RattleError
from rattle.models import Model

Line = np.ndarray
Band = tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class PictureOptions:
    """The options of a picture of a map.

    index: number of the slot, orbit or family. slice: number of the slice; None without a third axis. share: required
    probability of quiet running for the design limit. pixels: resolution along (delta, epsilon) at which to compute the
    window anew; None draws the cells of the survey.
    """

    variable: str
    index: int
    slice: int | None
    look: MapPictureOptions
    share: float
    pixels: tuple[int, int] | None
    has_caption: bool


class Overlays:
    """The overlays of all maps of an application: crisis curves, design limits, and finer windows."""

    def __init__(self, front: ApplicationState) -> None:
        self.crises, self.limits, self.windows = CrisisCurves(front), DesignLimits(front), WindowCache(front)

    async def compute_overlays(self, request: SurveyRequest, options: PictureOptions) -> OverlayData:
        """Return the overlays of a map. request: the request of the survey or slice that the map shows.

        A crisis curve or a finer window that does not exist for this map is left out. Raises RattleError if the
        workers are lost, or if a computation fails, such as that of the design limit.

        Returns
        -------
        OverlayData
            The lines, the band of the design limit, and the finer window.
        """
        lines = options.look.lines or ()
        found: dict[str, Line] = {}
        band = None
        if CRISIS in lines and (crisis := await self._crisis_line(request.gear_model)) is not None:
            found[CRISIS] = crisis
        if LIMIT in lines:
            found[LIMIT], band = await self._design_limit_line_and_band(request, options.share)
        return OverlayData(found, band, await self._compute_finer_window(request, options))

    async def _crisis_line(self, model: Model) -> Line | None:
        try:
            return await self.crises.crisis_curve_of(model)
        except ServiceError:
            raise
        except RattleError:  # the model has no crisis curve, or the curve was not found
            return None

    async def _design_limit_line_and_band(self, request: SurveyRequest, share: float) -> tuple[Line, Band]:
        span = request.delta.start, request.delta.stop
        found = [each async for each in self.limits.limits_over_damping(request.gear_model, span, share)]
        delta, limits = found[-1]  # the last result has all dampings
        return design_limit_line(delta, limits), design_limit_band(delta, limits)

    async def _compute_finer_window(self, request: SurveyRequest, options: PictureOptions) -> FinerCells | None:
        look, pixels = options.look, options.pixels
        if (
            look.delta is None
            or look.epsilon is None
            or pixels is None
            or needs_whole_survey(options.variable, request)
        ):
            return None
        if not has_too_coarse_cells(
            request.delta.values(), request.epsilon.values(), (look.delta, look.epsilon), pixels
        ):
            return None
        window = clip_to_plane(look.delta, look.epsilon)
        try:
            frame = await self.windows.last_frame(request, options.variable, options.index, window, pixels)
        except ClusterLostError as error:
            # Coarse cells are no substitute: clients would keep their picture under the ETag of the finer one.
            raise UnavailableError("The workers were lost while the window was computed. Try again soon.") from error
        except SurveyError:  # the window lies outside the plane, or is too narrow: the survey's own cells are drawn
            return None
        return FinerCells(frame.delta, frame.epsilon, values_to_draw(frame.values))


def design_limit_line(delta: np.ndarray, limits: np.ndarray) -> Line:
    """Return the design limits of `DesignLimits.limits_over_damping` as a line (δ, ε), shape (k, 2).

    Returns
    -------
    Line
        The points; (NaN, NaN) at a damping without a limit, so that the line is interrupted there.
    """
    return np.column_stack([np.where(np.isnan(limits[0]), np.nan, delta), limits[0]])


def design_limit_band(delta: np.ndarray, limits: np.ndarray) -> Band:
    """Return the 95 % intervals of design limits as a band over damping.

    Returns
    -------
    Band
        Dampings (k,), and the lower and the upper ends of the intervals (k,) in ε. Dampings at which an end is not
        finite are left out.
    """
    _, low, high = limits
    sure = np.isfinite(low) & np.isfinite(high)
    return delta[sure], low[sure], high[sure]
