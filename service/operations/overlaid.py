"""What is drawn over maps and takes long to find, for the explorer and for pictures: found once for all who ask."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rattle import RattleError
from rattle.models import AnyModel
from service.errors import ServiceError
from service.operations.crises import Crises
from service.operations.design_limits import DesignLimits
from service.operations.windows import Windows, inside, is_coarse
from service.state import Front
from workers import SurveyError, SurveyRequest
from workers.pictures.look import CRISIS, LIMIT, SURVEY_ONLY, Finer, Look, Over

Line = np.ndarray
Band = tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Wanted:
    """A map whose picture is wanted: of a survey, or of a slice of it; share: the least P(quiet) of the design limit;
    pixels: how finely a window is computed, None: not.
    """

    request: SurveyRequest
    variable: str
    index: int
    look: Look
    share: float
    pixels: tuple[int, int] | None


class Overlaid:
    """Of one application."""

    def __init__(self, front: Front) -> None:
        self.crises, self.limits, self.windows = Crises(front), DesignLimits(front), Windows(front)

    async def over(self, wanted: Wanted) -> Over:
        """What is drawn over a map. Raises UnavailableError, or what `Windows.finest` raises."""
        request, lines = wanted.request, wanted.look.lines or ()
        found: dict[str, Line] = {}
        band = None
        if CRISIS in lines and (crisis := await self._crisis(request.gear_model)) is not None:
            found[CRISIS] = crisis
        if LIMIT in lines:
            found[LIMIT], band = await self._limit(request, wanted.share)
        return Over(found, band, await self._finer(wanted))

    async def _crisis(self, model: AnyModel) -> Line | None:
        try:
            return await self.crises.of(model)
        except ServiceError:
            raise
        except RattleError:  # there is none
            return None

    async def _limit(self, request: SurveyRequest, share: float) -> tuple[Line, Band]:
        span = request.delta.start, request.delta.stop
        found = [each async for each in self.limits.along(request.gear_model, span, share)]
        delta, limits = found[-1]  # all of them
        return limit_line(delta, limits), limit_band(delta, limits)

    async def _finer(self, wanted: Wanted) -> Finer | None:
        request, look, pixels = wanted.request, wanted.look, wanted.pixels
        if look.delta is None or look.epsilon is None or pixels is None or wanted.variable in SURVEY_ONLY:
            return None
        if not is_coarse(request.delta.values(), request.epsilon.values(), (look.delta, look.epsilon), pixels):
            return None
        window = inside(look.delta, look.epsilon)
        try:
            frame = await self.windows.finest(request, wanted.variable, wanted.index, window, pixels)
        except SurveyError:  # it lies outside the plane, or is too narrow: the page has the survey's cells there, too
            return None
        values = np.abs(frame.values) if np.iscomplexobj(frame.values) else frame.values
        return Finer(frame.delta, frame.epsilon, values.astype(float))


def limit_line(delta: np.ndarray, limits: np.ndarray) -> Line:
    """The line of a design limit (k, 2), NaN where there is none, from `DesignLimits.along`."""
    return np.column_stack([np.where(np.isnan(limits[0]), np.nan, delta), limits[0]])


def limit_band(delta: np.ndarray, limits: np.ndarray) -> Band:
    """Where its interval is known: dampings, its lower and its upper ends."""
    _, low, high = limits
    sure = np.isfinite(low) & np.isfinite(high)
    return delta[sure], low[sure], high[sure]
