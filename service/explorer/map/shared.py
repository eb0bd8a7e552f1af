"""What all pages of an application have in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from service.explorer.common.news import News
from service.explorer.design.limits import DesignLimits
from service.explorer.map.overlays import Crises
from service.explorer.map.planes import Atlas, Plane
from service.state import Front
from workers import SurveyRequest


class WithoutSurvey(Protocol):
    """What is known without any survey, as `Atlas` has the maps of surveys."""

    request: SurveyRequest

    def plane(self, variable: str, index: int) -> Plane:
        """A map of it. Blocks: for a thread."""


@dataclass(frozen=True)
class Shared:
    """What all pages of an application have in common."""

    front: Front
    news: News
    atlas: Atlas
    crises: Crises
    limits: DesignLimits
    exact: WithoutSurvey
