"""Compute slow overlays of maps for the explorer and for pictures. Each is computed once for all requests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gear_rattle.service.errors import ServiceError
from gear_rattle.service.operations.crises import Crises
from gear_rattle.service.operations.design_limits import DesignLimits
from gear_rattle.service.operations.windows import Windows, inside, is_coarse
from gear_rattle.service.state import Front
from gear_rattle.workers import SurveyError, SurveyRequest
from gear_rattle.workers.pictures.look import CRISIS, LIMIT, FinerCells, Look, Overlays, is_survey_only
from gear_rattle.workers.pictures.planes import drawn_numbers
from rattle import RattleError
from rattle.models import Model

Line = np.ndarray
Band = tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Asked:
    """A requested picture of a map.

    index: number of the slot, orbit or family. slice: number of the slice, if there is a third axis. share: required
    probability of quiet running for the design limit. pixels: resolution along (delta, epsilon) at which to compute the
    window anew; None draws the cells of the survey.
    """

    variable: str
    index: int
    slice: int | None
    look: Look
    share: float
    pixels: tuple[int, int] | None
    has_caption: bool


class Overlaid:
    """The overlays of all maps of an application."""

    def __init__(self, front: Front) -> None:
        self.crises, self.limits, self.windows = Crises(front), DesignLimits(front), Windows(front)

    async def over(self, request: SurveyRequest, asked: Asked) -> Overlays:
        """Return the overlays of a map. request: of the survey or slice. Raises UnavailableError, ClusterLostError."""
        lines = asked.look.lines or ()
        found: dict[str, Line] = {}
        band = None
        if CRISIS in lines and (crisis := await self._crisis(request.gear_model)) is not None:
            found[CRISIS] = crisis
        if LIMIT in lines:
            found[LIMIT], band = await self._limit(request, asked.share)
        return Overlays(found, band, await self._finer(request, asked))

    async def _crisis(self, model: Model) -> Line | None:
        try:
            return await self.crises.of(model)
        except ServiceError:
            raise
        except RattleError:  # the model has no crisis curve, or it was not found
            return None

    async def _limit(self, request: SurveyRequest, share: float) -> tuple[Line, Band]:
        span = request.delta.start, request.delta.stop
        found = [each async for each in self.limits.along(request.gear_model, span, share)]
        delta, limits = found[-1]  # the last result has all dampings
        return limit_line(delta, limits), limit_band(delta, limits)

    async def _finer(self, request: SurveyRequest, asked: Asked) -> FinerCells | None:
        look, pixels = asked.look, asked.pixels
        if look.delta is None or look.epsilon is None or pixels is None or is_survey_only(asked.variable, request):
            return None
        if not is_coarse(request.delta.values(), request.epsilon.values(), (look.delta, look.epsilon), pixels):
            return None
        window = inside(look.delta, look.epsilon)
        try:
            frame = await self.windows.finest(request, asked.variable, asked.index, window, pixels)
        except SurveyError:  # the window lies outside the plane, or is too narrow: the survey's own cells are drawn
            return None
        return FinerCells(frame.delta, frame.epsilon, drawn_numbers(frame.values))


def limit_line(delta: np.ndarray, limits: np.ndarray) -> Line:
    """Return the line (k, 2) of a design limit from the result of `DesignLimits.along`; NaN where there is no limit."""
    return np.column_stack([np.where(np.isnan(limits[0]), np.nan, delta), limits[0]])


def limit_band(delta: np.ndarray, limits: np.ndarray) -> Band:
    """Return the dampings at which both ends of the limit's interval are known, and these ends."""
    _, low, high = limits
    sure = np.isfinite(low) & np.isfinite(high)
    return delta[sure], low[sure], high[sure]
